"""A hull that slides, identified in yaw alone: the missing sway is blamed neither on a sensor nor on another craft."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import fit
from gcs_autotune.trial import Channel, Trial

STEP, LASTS = 0.1, 150.0


def zig_zag(seed, rudder, late=0.0):
    """A tanker's yaw and sway: sliding turns it further, and it goes on turning while it slides.

    late [s] : by how much the recorded turn rate lags.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, LASTS, STEP)
    delta, psi, r, v, side = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t)), 1.0
    for k in range(len(t) - 1):
        side = -1.0 if psi[k] > rudder else 1.0 if psi[k] < -rudder else side
        delta[k] = side * rudder
        v[k + 1] = v[k] + STEP * (-0.08 * v[k] - 0.45 * r[k] + 0.02 * delta[k])
        r[k + 1] = r[k] + STEP * (-0.12 * r[k] - 0.35 * v[k] + 0.05 * delta[k] - 25.0 * abs(r[k]) * r[k])
        psi[k + 1] = psi[k] + STEP * r[k]
    delta[-1] = delta[-2]
    seen = np.interp(t - late, t, r) + 1e-5 * rng.normal(size=len(t))
    columns = {
        "delta": ("rad", delta),
        "psi": ("rad", psi + 2e-4 * rng.normal(size=len(t))),
        "r": ("rad/s", seen),
        "v": ("m/s", v + 1e-3 * rng.normal(size=len(t))),
    }
    return Trial(f"z{seed}", {n: Channel(n, unit, t, values) for n, (unit, values) in columns.items()})


def test_a_rate_that_agrees_with_the_heading_is_kept_although_the_model_is_incomplete():
    found = fit([zig_zag(1, 0.35)], dof="yaw")
    assert found.extra["signals_left_out"] == {}
    assert found.extra["signals"] == ["psi", "r"]


def test_a_rate_that_lags_behind_the_heading_is_still_left_out():
    found = fit([zig_zag(1, 0.35, late=0.8)], dof="yaw")
    assert list(found.extra["signals_left_out"]) == ["r"]


def test_runs_that_differ_for_lack_of_sway_are_not_reported_as_another_craft():
    found = fit([zig_zag(1, 0.09), zig_zag(2, 0.18), zig_zag(3, 0.35)], dof="yaw")
    result = {d.slug: d.cause for d in found.doubts}
    assert "run-apart" not in result
    assert "does not show that the craft changed" in result["runs-disagree"]
    assert "also moved in sway" in result["runs-disagree"]


def pushed_about(seed, drift):
    """A craft (T 10 s) under changing moments, and a force that drifts, both per inertia."""
    rng, dt, n = np.random.default_rng(seed), 0.1, 2400
    command = np.repeat(rng.choice([-1.0, 0.0, 1.0], n // 40), 40)
    psi, r, push = np.zeros(n), 0.0, 0.0
    for k in range(1, n):
        push += -dt * push / 60.0 + drift * np.sqrt(2.0 * dt / 60.0) * rng.standard_normal()
        r += dt * (0.01 * command[k - 1] - 0.1 * r + push)
        psi[k] = psi[k - 1] + dt * r
    t = dt * np.arange(n)
    psi += 2e-4 * rng.standard_normal(n)
    return Trial("ferry", {"psi": Channel("psi", "rad", t, psi), "N": Channel("N", "N m", t, command)})


@pytest.mark.slow
def test_pieces_are_fitted_if_a_drifting_force_hides_the_input_over_whole_runs():
    """A ferry's manoeuvre was refused, although its moment went with its turning acceleration by 0.89."""
    found = fit([pushed_about(1, 0.008)], dof="yaw")
    assert found.doubts[0].slug == "only-in-pieces"
    assert "runs-disagree" not in {d.slug for d in found.doubts}
    assert found.model.alpha == pytest.approx(100.0, rel=0.25)


def test_pieces_of_an_input_without_effect_are_rejected():
    run = pushed_about(1, 0.008)
    other = Channel("N", "N m", run["N"].t, np.roll(run["N"].values[::-1], 700))
    with pytest.raises(NotInformative, match="no better than a straight line"):
        fit([Trial("ferry", {**run.channels, "N": other})], dof="yaw")
