from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune.trial import Channel, Mark, Trial
from gcs_autotune.workflow.noise_estimate import jitter_in, noise_behind, noise_while_held

T = np.arange(0.0, 20.0, 0.1)


def held(values: np.ndarray, t: np.ndarray = T) -> Trial:
    psi = Channel("psi", "rad", t, values)
    marks = (Mark(0.0, "target"), Mark(10.0, "target"), Mark(15.0, "target"))
    return Trial("step", {"psi": psi}, marks, meta={"signal": "psi"})


def test_noise_is_estimated_from_the_hold_and_not_from_the_step():
    noise = np.random.default_rng(1).normal(0.0, 0.003, len(T))
    step = np.where(T > 10.0, 0.5 * (1.0 - np.exp(-(T - 10.0))), 0.0)
    assert noise_while_held(held(noise + step)) == pytest.approx(0.003, rel=0.2)


def test_noise_is_estimated_to_15_percent_despite_steps_and_kicks() -> None:
    t = np.arange(0.0, 72.0, 0.1)
    steps = np.where(t > 12.0, 0.5, 0.0) * (1.0 - np.exp(-(t - 12.0))) - np.where(t > 42.0, 0.5, 0.0)
    kicks = sum(0.02 * np.exp(-(((t - at) / 0.5) ** 2)) for at in (20.0, 31.0, 55.0, 63.0))
    marks = tuple(Mark(at, "target") for at in (0.0, 12.0, 42.0))
    found = []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0.0, 0.003, len(t))
        psi = Channel("psi", "rad", t, noise + steps + kicks)
        found.append(noise_while_held(Trial("step", {"psi": psi}, marks, meta={"signal": "psi"})))
    assert found == pytest.approx([0.003] * 8, rel=0.15)


def test_slow_drift_while_holding_is_not_noise():
    assert noise_while_held(held(0.02 * T + 0.001 * T**2)) < 1e-9


def test_a_coarse_constant_sensor_has_quantisation_noise():
    assert noise_while_held(held(np.zeros(len(T))), 0.035) == pytest.approx(0.035 / math.sqrt(12.0))


@pytest.mark.parametrize(("of_the_fit", "expected"), [(0.0055, 0.0055), (0.32, 0.005)])
def test_the_residual_of_a_poor_model_is_not_the_noise_of_a_turn_rate(of_the_fit: float, expected: float) -> None:
    turning = np.where(T > 10.0, -0.5, 0.5) + np.random.default_rng(3).normal(0.0, 0.005, len(T))
    step = Trial("step", {"r": Channel("r", "rad/s", T, turning)}, (Mark(0.0, "target"),), meta={"signal": "r"})
    fit = SimpleNamespace(noise={"r": of_the_fit})
    assert noise_behind(step, fit, True, 0.0) == pytest.approx(expected, rel=0.2)


def test_without_a_hold_the_noise_is_unknown():
    few = T[::20]
    assert noise_while_held(held(np.zeros(len(few)), few)) == math.inf


def test_drift_is_not_jitter_and_noise_is():
    wandering = 0.02 * np.sin(0.8 * T)
    jittering = np.random.default_rng(2).normal(0.0, 0.003, len(T))
    assert jitter_in(held(wandering)) < 1e-4
    assert jitter_in(held(wandering + jittering)) == pytest.approx(0.003, rel=0.3)
    assert jitter_in(held(np.zeros(len(T))), 0.035) == pytest.approx(0.035 / math.sqrt(12.0))
