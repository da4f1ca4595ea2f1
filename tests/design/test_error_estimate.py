"""The tracking error that is read through noise, against that of the motion behind it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.design import step_metrics
from gcs_autotune.design.step_metrics import error_behind, noise_floor

Array = NDArray[np.float64]
STEPS = 200
PERIOD, SECONDS = 0.1, 10.0
GOOD_COMPASS = 0.25 / 30.0
"""A quarter of a degree under a step of thirty."""


def oscillation(t: Array, damping: float = 0.5, omega: float = 3.0) -> Array:
    fast = omega * math.sqrt(1.0 - damping**2)
    return np.exp(-damping * omega * t) * (np.cos(fast * t) + damping * omega / fast * np.sin(fast * t))


def lag(t: Array) -> Array:
    return np.exp(-t / 0.5)


def standing(t: Array) -> Array:
    """An error of 2 % that stays."""
    return oscillation(t) + 0.02 * (1.0 - lag(t))


def creeping(t: Array) -> Array:
    """An integral that works off the last 3 % in ten seconds."""
    return oscillation(t) - 0.03 * (np.exp(-t / 10.0) - lag(t))


def slow(t: Array) -> Array:
    return oscillation(t, 0.3, 1.0)


SHAPES = (lag, oscillation, standing, creeping, slow)


def read(t: Array, error: Array, assumed: float, noise_time: float = 0.0) -> float:
    """Return the tracking error of a unit step whose *error* (n,) is known from *t* = 0 on, *assumed* its noise."""
    t, position = np.concatenate([[-PERIOD], t]), np.concatenate([[0.0], 1.0 - error])
    found = step_metrics(
        t, np.where(t < 0.0, 0.0, 1.0), position, np.zeros_like(t), noise_std=assumed, noise_time=noise_time
    )
    return found.itae


def itae_of_draws(error: Array, noise: float, assumed: float | None = None) -> Array:
    """Return what :data:`STEPS` draws of *noise* make of one step."""
    rng, t = np.random.default_rng(11), PERIOD * np.arange(len(error))
    draws = rng.normal(0.0, noise, (STEPS, len(error)))
    return np.array([read(t, error + n, noise if assumed is None else assumed) for n in draws])


@pytest.mark.parametrize("seconds", [SECONDS, 3.0 * SECONDS])
@pytest.mark.parametrize("noise", [0.2 * GOOD_COMPASS, 0.5 * GOOD_COMPASS, GOOD_COMPASS, 2.0 * GOOD_COMPASS])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_tracking_error_of_noisy_steps_matches_the_true_motion(
    shape: Callable[[Array], Array], noise: float, seconds: float
) -> None:
    """Within 6 % on the mean, 15 % from one to the next: of what goes beyond the floor, without the noise."""
    t = np.arange(0.0, seconds + PERIOD / 2.0, PERIOD)
    error = shape(t)
    true = float(np.trapezoid(t * np.maximum(np.abs(error) - noise_floor(noise, 0.0), 0.0), t))
    found = itae_of_draws(error, noise)
    assert abs(float(np.mean(found)) - true) < 0.06 * true
    assert float(np.std(found)) < 0.15 * true


@pytest.mark.parametrize("shape", SHAPES)
def test_a_simulated_step_has_the_mean_tracking_error_of_flown_ones(shape: Callable[[Array], Array]) -> None:
    t, fine = np.arange(0.0, SECONDS + 0.05, PERIOD), np.arange(0.0, SECONDS + 0.01, 0.02)
    flown = float(np.mean(itae_of_draws(shape(t), GOOD_COMPASS)))
    predicted = read(fine, shape(fine), GOOD_COMPASS, noise_time=PERIOD)
    assert predicted == pytest.approx(flown, rel=0.05)


def test_assuming_a_tenth_more_noise_changes_little() -> None:
    """A floor under single readings lost a quarter of a quick ROV's tracking error by that."""
    t = np.arange(0.0, 3.0 * SECONDS + PERIOD / 2.0, PERIOD)
    exact, more = (float(np.mean(itae_of_draws(creeping(t), GOOD_COMPASS, s * GOOD_COMPASS))) for s in (1.0, 1.1))
    assert more == pytest.approx(exact, rel=0.1)


def test_pure_noise_is_nearly_no_error_and_a_jump_keeps_its_time() -> None:
    noise = np.random.default_rng(4).normal(0.0, 1.0, 400)
    assert float(np.std(error_behind(noise, 1.0))) < 0.3
    found = error_behind(noise + np.where(np.arange(400) < 200, 0.0, 20.0), 1.0)
    assert np.all(np.abs(found[:198]) < 4.0)
    assert np.all(found[202:] > 16.0)


def test_samples_of_a_moving_mean_are_thinned() -> None:
    """Else their common noise is taken for motion."""
    rng = np.random.default_rng(5)
    t = 0.1 * np.arange(401)
    white = rng.normal(0.0, 0.05, len(t) + 4)
    mean = np.convolve(white, np.full(5, 0.2), "valid")
    once, each = (read(t, mean, 0.05 / math.sqrt(5.0), noise_time=span) for span in (0.5, 0.0))
    assert once < 0.5 * each
