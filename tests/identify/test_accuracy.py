"""Statistics over noise seeds: unbiased, efficient, correct intervals. The long version is in benchmarks/."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.cramer_rao import cramer_rao
from gcs_autotune.identify.signals import autocorrelation, prepare
from gcs_autotune.identify.signals.whiteness import whiteness
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial

pytestmark = pytest.mark.slow

SEEDS = 30
NOISE = 0.01
QUADRATIC = (0.031, 0.0, 0.069, 0.003)


@pytest.fixture(scope="module")
def clean(record: Callable[..., Trial]) -> list[Trial]:
    return [record(QUADRATIC, Relay(C, 15 * DEG), 40.0, name=str(C)) for C in (0.08, 0.16)]


def noisy(trial: Trial, rng: np.random.Generator) -> Trial:
    psi = trial["psi"]
    values = psi.values + rng.normal(0.0, NOISE, len(psi))
    return Trial(trial.name, {"psi": Channel("psi", "rad", psi.t, values), "N": trial["N"]})


def test_the_fit_is_unbiased_and_efficient_and_its_intervals_cover(clean: list[Trial]) -> None:
    model = SingleDof("yaw", "N m", *QUADRATIC)
    bound = cramer_rao(model, clean, NOISE, free=("alpha", "beta_quadratic", "delta"))
    errors, inside, iso = [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        fit = fit_axis([noisy(t, rng) for t in clean], structure="nonlinear", delay=0.0)
        picked = [fit.parameters[n] for n in ("alpha_r", "beta_rr")]
        errors.append([p.value - truth for p, truth in zip(picked, (0.031, 0.069), strict=True)])
        inside.append([abs(e) <= 1.96 * p.std for e, p in zip(errors[-1], picked, strict=True)])
        iso.append(np.mean([e.alpha for e in fit.iso]) - 0.031)
    table = np.array(errors)
    spread, rms = table.std(axis=0, ddof=1), np.sqrt((table**2).mean(axis=0))
    assert np.all(np.abs(table.mean(axis=0)) < 2.5 * spread / np.sqrt(SEEDS))
    assert np.all(rms < 1.3 * np.array([bound["alpha"], bound["beta_quadratic"]]))
    assert 0.85 <= np.mean(inside) <= 1.0
    assert np.sqrt(np.mean(np.square(iso))) > 5.0 * rms[0]


def test_the_bound_halves_when_the_record_is_four_times_as_informative(clean: list[Trial]) -> None:
    model = SingleDof("yaw", "N m", *QUADRATIC)
    one, half = cramer_rao(model, clean, NOISE), cramer_rao(model, clean, NOISE / 2.0)
    assert half["alpha"] == pytest.approx(one["alpha"] / 2.0)
    twice = cramer_rao(model, [*clean, *clean], NOISE)
    assert twice["alpha"] == pytest.approx(one["alpha"] / np.sqrt(2.0))
    with_rate = cramer_rao(model, [_with_rate(t) for t in clean], {"psi": NOISE, "r": NOISE})
    assert with_rate["alpha"] < one["alpha"]


def _with_rate(trial: Trial) -> Trial:
    psi = trial["psi"]
    rate = Channel("r", "rad/s", psi.t, np.gradient(psi.values, psi.t))
    return Trial(trial.name, {**trial.channels, "r": rate})


def test_white_noise_passes_the_whiteness_test_and_filtered_noise_does_not() -> None:
    rng = np.random.default_rng(0)
    white = rng.normal(size=2000)
    coloured = np.convolve(white, np.ones(4) / 4.0, mode="same")
    assert whiteness(white) > 0.01
    assert whiteness(coloured) < 1e-6
    assert autocorrelation(coloured, 1)[0] == pytest.approx(0.75, abs=0.05)


def test_standard_errors_grow_when_the_noise_is_coloured(clean: list[Trial]) -> None:
    """Drifting noise of the same size carries less information, and the error bars are larger."""
    within, inflated = [], []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        trials = []
        for trial in clean:
            drift = np.zeros(len(trial["psi"]))
            for k in range(1, len(drift)):
                drift[k] = 0.9 * drift[k - 1] + rng.normal(0.0, NOISE * np.sqrt(1.0 - 0.81))
            psi = Channel("psi", "rad", trial["psi"].t, trial["psi"].values + drift)
            trials.append(Trial(trial.name, {"psi": psi, "N": trial["N"]}))
        fit = fit_axis(trials, structure="nonlinear", delay=0.0)
        inflated.append(fit.extra["std_inflation"])
        alpha = fit.parameters["alpha_r"]
        within.append(abs(alpha.value - 0.031) <= 2.0 * alpha.std)
    assert min(inflated) > 1.2
    assert np.mean(within) >= 0.75


def test_preparing_a_record_changes_no_sample(clean: list[Trial]) -> None:
    (record,) = prepare(clean[0], "yaw")
    assert record.position is not None
    assert np.array_equal(record.position.t, clean[0]["psi"].t)
    assert np.allclose(np.exp(1j * record.position.values), np.exp(1j * clean[0]["psi"].values), atol=1e-12)
