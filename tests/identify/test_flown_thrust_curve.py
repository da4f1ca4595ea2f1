"""The thrust curve of a flown run: a hull with a dead zone gains one, and a hull without does not."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

from gcs_autotune.identify import AxisFit, fit_axis, model_file_of
from gcs_autotune.identify.thrust import with_thrust_curve
from gcs_autotune.report import fit_document
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import StudySettings, study

INERTIA, LINEAR, QUADRATIC = 0.03, 0.08, 0.05
"""A hull like that of a small ROV, per full output."""
DEAD = 0.15
"""Dead zone of its thrusters [fraction of full output]."""
LEVELS = (0.0, 0.67, 0.34, 0.0, -0.67, -0.34, 0.0)
SIZES = (0.0, 0.2, 0.4, 0.6, 0.4, 0.2, 0.0, -0.2, -0.4, -0.6, -0.4, -0.2, 0.0)


@cache
def flown(dead: float, linear: float, seed: int, levels: tuple[float, ...] = LEVELS, ahead: float = 0.0) -> Trial:
    """Return steps of 8 s of the hull, simulated independently of the package's models.

    ahead : noise of the measured speed [m/s] if the motion is one ahead; 0 for a turn with a measured heading.
    """
    h, rng = 0.005, np.random.default_rng(seed)
    t = h * np.arange(int(8.0 * len(levels) / h))
    N = np.repeat(levels, len(t) // len(levels))
    force = np.sign(N) * np.maximum(np.abs(N) - dead, 0.0) + 0.002
    psi, rate, r = np.zeros(len(t)), np.zeros(len(t)), 0.0
    for i in range(len(t) - 1):
        psi[i + 1] = psi[i] + h * r
        r += h * (force[i] - linear * r - QUADRATIC * r * abs(r)) / INERTIA
        rate[i + 1] = r
    few = slice(None, None, 20)
    if ahead > 0.0:
        speed = rate[few] + rng.normal(0.0, ahead, len(t[few]))
        return Trial("steps", {"X": Channel("X", "1", t[few], N[few]), "u": Channel("u", "m/s", t[few], speed)})
    noise = rng.normal(0.0, 0.004, len(t[few]))
    channels = {"N": Channel("N", "1", t[few], N[few]), "psi": Channel("psi", "rad", t[few], psi[few] + noise)}
    return Trial("steps", channels)


@cache
def plain(dead: float, linear: float, seed: int, levels: tuple[float, ...] = LEVELS) -> AxisFit:
    return fit_axis(flown(dead, linear, seed, levels), dof="yaw")


def text_of(fit: AxisFit) -> str:
    return " ".join(render_text(fit_document(fit)).replace("│", " ").split())


@pytest.mark.parametrize("seed", [1, 2])
def test_steps_of_two_sizes_show_that_the_hull_has_no_linear_damping(seed: int) -> None:
    without = plain(DEAD, 0.0, seed)
    fit = with_thrust_curve(without, [flown(DEAD, 0.0, seed)])
    assert [own.slug for own in fit.effects] == ["quadratic-actuator"]
    assert without.model.beta > 0.05
    assert fit.model.beta < 0.002
    assert fit.model.alpha / fit.model.beta_quadratic == pytest.approx(INERTIA / QUADRATIC, rel=0.02)
    assert "dead-zone-or-curve" in [doubt.slug for doubt in fit.doubts]
    assert "time constant of" not in text_of(fit)


def test_a_fit_that_starts_from_a_model_file_has_the_doubt_of_the_flight_too() -> None:
    run = flown(DEAD, 0.0, 1)
    flight = with_thrust_curve(plain(DEAD, 0.0, 1), [run])
    settings = StudySettings(begin=model_file_of(flight).model, check=False)
    again = study([run], [], settings, "").fit
    assert "dead-zone-or-curve" in [doubt.slug for doubt in again.doubts]
    for own, other in (("alpha_r", "N_rdot"), ("beta_rr", "N_rr")):
        assert again.parameters[other].std == pytest.approx(flight.parameters[own].std, rel=0.02)


def test_standard_errors_cover_the_actuator_that_the_runs_do_not_exclude() -> None:
    fit = with_thrust_curve(plain(DEAD, 0.0, 1), [flown(DEAD, 0.0, 1)])
    assert fit.model.alpha > 1.2 * INERTIA
    assert abs(fit.model.alpha - INERTIA) < HALF_WIDTH * fit.parameters["alpha_r"].std


def test_steps_of_many_sizes_show_the_dead_zone() -> None:
    fit = with_thrust_curve(plain(DEAD, LINEAR, 1, SIZES), [flown(DEAD, LINEAR, 1, SIZES)])
    (own,) = fit.significant_effects
    assert own.slug == "dead-zone"
    assert own["width"] == pytest.approx(DEAD, abs=0.005)
    assert fit.model.beta == pytest.approx(LINEAR, rel=0.05)
    assert "dead-zone-or-curve" not in [doubt.slug for doubt in fit.doubts]


def test_a_dead_zone_as_small_as_the_noise_of_the_speed_is_found() -> None:
    run = flown(DEAD, LINEAR, 1, SIZES, ahead=0.2)
    without = fit_axis(run, dof="surge")
    assert not without.lacks_a_term
    (own,) = with_thrust_curve(without, [run]).significant_effects
    assert (own.slug, own["width"]) == ("dead-zone", pytest.approx(DEAD, abs=0.03))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_hull_with_proportional_thrust_gains_no_thrust_curve(seed: int) -> None:
    without = plain(0.0, LINEAR, seed)
    assert with_thrust_curve(without, [flown(0.0, LINEAR, seed)]) is without
    found = re.search(r"time constant of ([\d.]+) s", text_of(without))
    assert found is not None
    assert float(found[1]) == pytest.approx(INERTIA / LINEAR, abs=0.02)


def test_a_model_that_lacks_a_term_states_no_time_constant() -> None:
    text = text_of(plain(DEAD, 0.0, 1))
    assert "time constant of" not in text
    assert "How motion decays without input is uncertain: the model lacks a term." in text
