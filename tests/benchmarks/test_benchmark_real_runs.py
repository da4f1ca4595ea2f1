"""The comparison on real runs: the grid, the score, the linear predictor, and that no method sees what it predicts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real_runs.methods.linear_state_space import free_run
from benchmarks.real_runs.methods.ours import first_motion
from benchmarks.real_runs.methods.plain_scipy import FORMS as BY_HAND
from benchmarks.real_runs.methods.plain_scipy import train
from benchmarks.real_runs.runs import CRAFTS, DATA, FIRST, Run, gridded, load
from benchmarks.real_runs.score import fit_percents
from gcs_autotune.models import FORMS
from gcs_autotune.trial import Channel, Trial

pytestmark = pytest.mark.slow

A = np.diag([0.98, 0.95, 0.9])
B = np.array([[0.02, 0.0], [0.0, 0.01], [0.03, -0.03]])


def linear_run(seed: int, n: int = 300) -> Run:
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.normal(size=(n // 15, 2)), 15, axis=0)
    Y = np.zeros((n, 3))
    Y[0] = 0.3, -0.2, 0.1
    for i in range(1, n):
        Y[i] = A @ Y[i - 1] + B @ U[i - 1]
    psi = np.concatenate([[0.0], np.cumsum(0.05 * (Y[1:, 2] + Y[:-1, 2]))])
    return Run("linear", 0.1 * np.arange(n), U, Y, psi, np.ones((n, 3), dtype=bool))


def test_the_true_linear_model_scores_a_hundred_and_its_integrated_rate_the_heading() -> None:
    run = linear_run(1)
    Y, psi = free_run(A, B, np.eye(3), np.zeros((3, 2)), run, np.ones(2), np.ones(3))
    assert fit_percents(run, Y, psi) == pytest.approx(dict.fromkeys(("u", "v", "r", "psi"), 100.0), abs=1e-6)


def test_prediction_uses_nothing_after_the_first_second() -> None:
    run = linear_run(2)
    hidden = replace(run, Y=np.vstack([run.Y[:FIRST], np.full((len(run.t) - FIRST, 3), 7.0)]))
    seen, blind = (free_run(A, B, np.eye(3), np.zeros((3, 2)), r, np.ones(2), np.ones(3))[0] for r in (run, hidden))
    assert blind == pytest.approx(seen)
    assert first_motion(hidden)[0] == pytest.approx(first_motion(run)[0])


def test_the_mean_scores_zero_and_a_diverged_prediction_minus_infinity() -> None:
    run = linear_run(3)
    mean = np.tile(run.Y[FIRST:].mean(axis=0), (len(run.t), 1))
    assert fit_percents(run, mean, run.psi)["u"] == pytest.approx(0.0, abs=1e-9)
    mean[-1] = np.nan
    assert fit_percents(run, mean, run.psi)["r"] == -math.inf


def test_samples_inside_a_gap_are_not_scored() -> None:
    t = 0.1 * np.arange(100)
    ok = (t < 3.0) | (t > 6.0)
    wave = np.sin(t)
    names = {n: Channel(n, "", t[ok], wave[ok]) for n in ("u", "v", "r")}
    trial = Trial("gap", {**names, "psi": Channel("psi", "rad", t, wave), "X": Channel("X", "N", t, wave)})
    run = gridded(trial, ("X",))
    assert not run.seen[45].any()
    assert run.seen[10].all()


def test_the_independent_scipy_fit_identifies_a_boat_of_its_own_form() -> None:
    rng = np.random.default_rng(4)
    U = np.repeat(rng.uniform(-5.0, 15.0, (10, 2)), 20, axis=0)
    x, rows = np.zeros(4), []
    for L, R in U:
        rows.append(x)
        for _ in range(10):
            u, v, r, _ = x
            slope = np.array(
                [
                    0.03 * (L + R) - 0.2 * u - 0.3 * abs(u) * u,
                    -0.5 * v - 0.2 * u * r + 0.05 * r,
                    0.02 * (L - R) - 0.5 * r - 0.6 * abs(u) * r + 0.03 * u + 0.01,
                    r,
                ]
            )
            x = x + 0.01 * slope
    S = np.array(rows)
    run = Run("twin", 0.1 * np.arange(len(S)), U, S[:, :3], S[:, 3], np.ones((len(S), 3), dtype=bool))
    predicted = train([run], "twin-thruster")(run)
    assert min(fit_percents(run, *predicted).values()) > 95.0


@pytest.mark.parametrize("name", list(CRAFTS))
def test_every_craft_has_its_files_its_form_and_an_independent_form(name: str) -> None:
    craft = CRAFTS[name]
    assert set(FORMS[craft.form].inputs) == set(craft.inputs)
    assert craft.form in BY_HAND
    assert not set(craft.train) & set(craft.held)
    if not DATA.is_dir():
        pytest.skip("the measured runs are not beside the repository (../shared/data)")
    for run in (*craft.train, *craft.held):
        assert gridded(load(craft, run), craft.inputs).seen.mean() > 0.9
