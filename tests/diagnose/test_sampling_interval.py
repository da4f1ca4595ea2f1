"""The interval between samples is chosen by evidence; no cause is reported from an invalid model of the craft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.diagnose.process_noise import noise_equation, search_with_process_noise
from gcs_autotune.diagnose.process_noise_starts import at_the_right_interval, plain_with_process_noise
from gcs_autotune.diagnose.sampling_interval import prediction_horizon, refitted, rms_ahead, stands
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem
from gcs_autotune.identify.problems import Fitted, Problem, fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.trial import Channel, Trial

INTERVAL = 0.1
DAMPING, OF_SPEED, GAIN = -0.8, -2.0, 0.4


def quiet(stage: str, done: int, total: int) -> None:
    """Show nothing."""


def sailed(seed: int, *, seconds: float = 100.0, lag: float = 0.0, speed: float = 1.2, drift: float = 0.03) -> Trial:
    """A boat whose turning resistance grows with speed ahead and astern, its actuator *lag* [s] late."""
    rng = np.random.default_rng(seed)
    fine, n = 10, round(seconds / INTERVAL)
    h = INTERVAL / fine
    legs = rng.uniform(2.0, 5.0, 200).cumsum()
    sizes = rng.choice([-1.0, -0.6, 0.6, 1.0], 200)
    t = np.arange(n) * INTERVAL
    command = sizes[np.searchsorted(legs, t, side="right")]
    # It goes ahead, stops, and goes astern.
    u = speed * np.clip(1.6 * np.sin(2.0 * np.pi * t / (0.6 * seconds) + rng.uniform(0.0, 6.0)), -1.0, 1.0)
    psi, rate = np.zeros(n), np.zeros(n)
    r, heading, push, acting = 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        psi[k], rate[k] = heading, r
        for _ in range(fine):
            acting = command[k] if lag == 0.0 else acting + h * (command[k] - acting) / lag
            push += -h * push / 3.0 + drift * np.sqrt(2.0 * h / 3.0) * rng.standard_normal()
            r += h * (GAIN * acting + DAMPING * r + OF_SPEED * abs(u[k]) * r + push)
            heading += h * r
    psi += np.radians(0.1) * rng.standard_normal(n)
    channels = {
        "psi": Channel("psi", "rad", t, psi),
        "u": Channel("u", "m/s", t, u),
        "N": Channel("N", "N m", t, command),
    }
    return Trial(f"run{seed}", channels)


def begun(runs: Sequence[Trial]) -> tuple[Problem, Fitted, NoisyProblem, NoisyFit]:
    form = plain_form(runs, "yaw")
    problem, base = fit_base(form, prepare_as_recorded(runs, form, None)[0])
    equation = noise_equation(problem)
    assert equation is not None
    found = plain_with_process_noise(problem, base, *equation, quiet)
    assert found is not None
    return problem, base, *found


def test_a_fit_with_drift_as_large_as_the_commands_or_quicker_than_a_sample_is_invalid() -> None:
    _, _, problem, plain = begun([sailed(1)])
    assert stands(problem, plain)
    loud = replace(plain, noise=replace(plain.noise, size=abs(float(plain.theta[0]))))
    assert not stands(problem, loud)
    quick = replace(plain, theta=np.array([plain.theta[0] * 20.0, -1.1 / INTERVAL]))
    assert not stands(problem, quick)


def test_the_prediction_horizon_covers_the_command_steps_even_for_a_quick_fit() -> None:
    _, _, problem, plain = begun([sailed(1)])
    quick = replace(plain, theta=np.array([plain.theta[0], -50.0]))
    assert prediction_horizon(problem, quick) == 5.0


def test_a_valid_plain_model_keeps_the_sampling_interval() -> None:
    problem, _, close, plain = begun([sailed(2, speed=0.0)])
    equation = noise_equation(problem)
    assert equation is not None
    (same, fit), hint, words = at_the_right_interval(problem, *equation, (close, plain), ["speed-damping"], quiet)
    assert same is close and fit is plain and hint is None and words == ""


def test_a_refit_that_became_too_quick_is_replaced_by_the_one_that_predicts_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a lake boat, one run left out, a damping of 2.4 1/s became 18 and all that it had gained was lost."""
    _, _, problem, plain = begun([sailed(1, speed=0.0)])
    quick = replace(plain, theta=20.0 * plain.theta)
    monkeypatch.setattr(problem, "fit", lambda *args, **options: quick)
    kept = refitted(problem, plain, 4, 5.0)
    assert kept is not None
    assert 0.5 < float(kept.theta[1] / plain.theta[1]) < 2.0
    assert rms_ahead(problem, kept, 5.0) < 0.9 * rms_ahead(problem, quick, 5.0)


@pytest.mark.slow
def test_damping_that_grows_with_speed_is_identified_ahead_and_astern() -> None:
    problem, base, *_ = begun([sailed(3), sailed(4), sailed(5)])
    slugs = ["speed-damping", "velocity-product", "quadratic-drag", "dead-zone"]
    search = search_with_process_noise(problem, base, slugs, (), quiet)
    assert search is not None
    first = search.accepted[0]
    assert first.effect.slug == "speed-damping" and first.ahead < 0.9
    fit = search.fit
    assert abs(first.effect["N_|u|r"] / OF_SPEED - 1.0) < 0.25
    assert abs(float(fit.theta[1]) / DAMPING - 1.0) < 0.4
