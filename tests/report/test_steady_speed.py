"""The steady speed for an output: beyond the speeds flown its error includes the damping structure."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.report import fit_document
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.trial import Channel, Trial

ALPHA, BETA, OUTPUT = 4.0, 2.0, 0.6
"""A craft with a time constant of 2 s; 0.6 of full output sustains 0.3 m/s."""


def fitted(half: float) -> AxisFit:
    """Return the model from pushes of *half* [s] to either side."""
    t = np.arange(0.0, 80.0, 0.1)
    X = OUTPUT * np.where((t / half).astype(int) % 2 == 0, 1.0, -1.0)
    u = np.zeros(len(t))
    for i in range(len(t) - 1):
        steady = X[i] / BETA
        u[i + 1] = steady + (u[i] - steady) * np.exp(-0.1 * BETA / ALPHA)
    noise = np.random.default_rng(1).normal(0.0, 0.005, len(t))
    run = Trial("run", {"X": Channel("X", "1", t, X), "u": Channel("u", "m/s", t, u + noise)})
    return fit_axis(run, dof="surge")


def text_of(fit: AxisFit) -> str:
    return " ".join(render_text(fit_document(fit)).replace("│", " ").split())


def steady_speed(half: float) -> tuple[float, float]:
    """Return the speed [m/s] stated, and its error."""
    found = re.search(r"sustains ([\d.]+) ± ([\d.]+) m/s", text_of(fitted(half)))
    assert found is not None
    return float(found[1]), float(found[2])


def test_a_speed_within_the_flown_range_has_the_error_of_the_fit() -> None:
    speed, error = steady_speed(half=20.0)
    assert abs(speed - 0.3) < 3.0 * error
    assert error < 0.006


def test_a_speed_beyond_the_flown_range_includes_the_error_of_the_damping_structure() -> None:
    speed, error = steady_speed(half=1.0)
    assert abs(speed - 0.3) < 3.0 * error
    assert error > 0.02


def test_a_diverging_model_has_no_steady_speed() -> None:
    stable = fitted(half=20.0)
    diverging = text_of(replace(stable, model=replace(stable.model, beta=-stable.model.beta)))
    assert "motion decays with a time constant of 2.0 s" in text_of(stable)
    assert "Without input, motion grows with a time constant of 2.0 s" in diverging
    assert "sustains" not in diverging
