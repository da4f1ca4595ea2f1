"""Manoeuvres of roll and pitch on the simulated BlueROV2 Heavy in six degrees of freedom, and what is identified."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import GuardTripped, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import fit_axis, load_model, save_model, validate
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow import FlySettings, Unattended, fly

from .sitl_harness import SLOW_LOOP, WHEN, Ear, SitlHarness

RIGHTING = 134.39 * 0.01
"""Restoring moment per angle of bluerov2_6dof.toml [N m/rad]."""
INERTIA = {"K": 0.449, "M": 0.365}


def flown(harness: SitlHarness, name: str, force: str, **common: object) -> Trial:
    settings = FlySettings(name, harness.common(**common), force=force)
    (run,) = fly(settings, Unattended(), Ear(harness.said), WHEN).runs
    assert run.trial is not None
    harness.assert_untouched()
    return run.trial


@pytest.mark.slow
@pytest.mark.parametrize(("force", "dof"), [("K", "roll"), ("M", "pitch")])
def test_a_free_decay_in_roll_and_pitch_gives_restoring_moment_per_inertia(
    force: str, dof: str, tmp_path: Path
) -> None:
    run = flown(SitlHarness(tmp_path, "bluerov2-6dof", **SLOW_LOOP), "free-decay", force)
    assert run.ending == "completed"
    released = next(mark.t for mark in run.marks if mark.kind == "release")
    assert np.all(run[force].between(released + 0.5, run.end).values == 0.0)
    model = fit_axis(run, dof=dof).model
    assert model.restoring / model.alpha == pytest.approx(RIGHTING / INERTIA[force], rel=0.06)


@pytest.mark.slow
def test_a_relay_oscillates_in_roll_and_stays_within_the_angle_limit(tmp_path: Path) -> None:
    run = flown(SitlHarness(tmp_path, "bluerov2-6dof", **SLOW_LOOP), "relay", "K")
    assert run.ending == "completed"
    assert np.max(np.abs(run["phi"].values)) < math.radians(45.0)
    assert run["K"].values.max() == pytest.approx(-run["K"].values.min(), abs=0.02)
    size = float(run.meta["C"])
    pull = sum(c * size**n for c, n in zip((8.9, 176.0, -404.1, 389.9, -140.3), (1, 3, 5, 7, 9), strict=True))
    moment = 4.0 * 0.218 * pull / size  # of the four vertical thrusters, per output flown
    assert fit_axis(run, dof="roll").model.alpha * moment == pytest.approx(INERTIA["K"], rel=0.05)


def test_a_boat_and_a_sub_without_the_motor_are_refused_before_anything_moves(tmp_path: Path) -> None:
    boat = SitlHarness(tmp_path)
    with pytest.raises(WrongVehicle, match=r"needs K, which this vehicle \(.*\) does not have. Use --force N$"):
        flown(boat, "relay", "K")
    sub = SitlHarness(tmp_path / "sub", "bluerov2-6dof", parameters={"FRAME_CONFIG": 1.0})
    with pytest.raises(WrongVehicle, match="none of this vehicle's outputs drives M on this FRAME_CONFIG"):
        flown(sub, "free-decay", "M")
    for harness in (boat, sub):
        assert not harness.vehicle.autopilot.armed
        harness.assert_untouched()


def test_an_angle_limit_below_the_tilt_is_kept(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2-6dof", **SLOW_LOOP)
    with pytest.raises((GuardTripped, PreconditionFailed), match="roll"):
        flown(harness, "free-decay", "K", envelope=Envelope(roll=math.radians(4.0)))
    harness.assert_untouched()


def synthetic(model: SingleDof, seconds: float = 40.0) -> Trial:
    """Return a run of *model* in roll under a square wave that ends half-way, by the midpoint rule at 1 kHz."""
    h, phi, p, rows = 1e-3, 0.0, 0.0, []
    for k in range(round(seconds / h)):
        t = k * h
        tau = (0.3 if int(t / 0.88 + 1e-6) % 2 else -0.3) if t < 0.5 * seconds else 0.0
        if k % 40 == 0:
            rows.append((t, phi, p, tau))
        half = p + 0.5 * h * model.acceleration(p, tau, phi)
        p += h * model.acceleration(half, tau, phi + 0.5 * h * p)
        phi += h * half
    return measured("square", rows)


def measured(name: str, rows: list[tuple[float, ...]], marks: tuple[Mark, ...] = ()) -> Trial:
    """Return a run of *rows* (t, phi, p, K), with noise."""
    t, angle, rate, force = np.array(rows).T
    noise = np.random.default_rng(4).normal(0.0, 0.002, (2, len(t)))
    columns = (("phi", "rad", angle + noise[0]), ("p", "rad/s", rate + noise[1]), ("K", "1", force))
    return Trial(name, {n: Channel(n, unit, t, values) for n, unit, values in columns}, marks)


def decay(model: SingleDof, angle: float, weak: float) -> Trial:
    """Return a decay of *model* in roll from *angle* [rad], released after 1 s. Until then the thrusters hold the craft
    with *weak* times their gain.
    """
    h, phi, p, rows = 1e-3, angle, 0.0, []
    for k in range(9000):
        held = k < 1000
        if k % 40 == 0:
            rows.append((k * h, phi, p, model.restoring * math.sin(angle) / weak if held else 0.0))
        if not held:
            half = p + 0.5 * h * model.acceleration(p, 0.0, phi)
            p += h * model.acceleration(half, 0.0, phi + 0.5 * h * p)
            phi += h * half
    return measured("decay", rows, (Mark(1.0, "release"),))


TRUTH = SingleDof("roll", "1", 0.05, 0.01, 0.04, 0.01, 0.0, 0.2)


def test_all_parameters_of_a_roll_model_are_recovered_and_survive_a_file(tmp_path: Path) -> None:
    run = synthetic(TRUTH)
    found = fit_axis(run)
    for name, truth in zip(("alpha_p", "beta_p", "beta_pp", "delta", "delay", "gamma_phi"),
                           (0.05, 0.01, 0.04, 0.01, 0.0, 0.2), strict=True):  # fmt: skip
        parameter = found.parameters[name]
        assert abs(parameter.value - truth) <= max(4.0 * parameter.std, 0.004), name
    assert found.parameters["gamma_phi"].unit == "1/rad"
    save_model(found, tmp_path / "roll.json")
    again = load_model(tmp_path / "roll.json")
    assert again.axis == found.model
    assert "K_sinphi" in again.names
    assert validate(found.model, run).fit_percent > 98.0


@pytest.mark.slow
def test_a_decay_held_by_weak_thrusters_does_not_bias_the_model_of_a_relay() -> None:
    runs = [synthetic(TRUTH), decay(TRUTH, 0.3, 0.4)]
    found = fit_axis(runs).model
    assert found.restoring / found.alpha == pytest.approx(TRUTH.restoring / TRUTH.alpha, rel=0.02)
    assert found.alpha == pytest.approx(TRUTH.alpha, rel=0.02)
    assert validate(found, runs[1]).fit_percent > 95.0


def test_a_method_without_a_restoring_moment_is_refused() -> None:
    with pytest.raises(UsageError, match=r"does not fit the restoring moment of roll\. Use one of output-error"):
        fit_axis(synthetic(TRUTH, 8.0), method="frequency")
