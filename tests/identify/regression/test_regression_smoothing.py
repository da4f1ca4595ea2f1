"""Value, rate and acceleration from uneven noisy samples."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.identify.regression.smoothing import SMOOTHERS
from gcs_autotune.identify.signals import Signal


def wave(noise: float, seed: int = 0) -> tuple[Signal, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 60.0, 600))
    return Signal("psi", t, np.sin(0.7 * t) + 0.3 * np.sin(2.0 * t) + rng.normal(0.0, noise, 600), 0.0), t[20:-20]


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_clean_signal_gives_its_derivatives(name):
    signal, t = wave(0.0)
    smooth = SMOOTHERS[name](signal, 2, None)
    rate = 0.7 * np.cos(0.7 * t) + 0.6 * np.cos(2.0 * t)
    acceleration = -0.49 * np.sin(0.7 * t) - 1.2 * np.sin(2.0 * t)
    assert np.std(smooth.at(t, 1) - rate) < 2e-3
    assert np.std(smooth.at(t, 2) - acceleration) < 3e-2


@pytest.mark.parametrize("name", SMOOTHERS)
def test_the_removed_noise_equals_the_added_noise(name):
    found = [SMOOTHERS[name](wave(0.02, seed)[0], 2, None).noise for seed in range(6)]
    assert np.mean(found) == pytest.approx(0.02, rel=0.1)


def test_the_regularised_spline_estimates_accelerations_better_than_local_polynomials():
    signal, t = wave(0.01)
    truth = -0.49 * np.sin(0.7 * t) - 1.2 * np.sin(2.0 * t)
    spline = np.std(SMOOTHERS["smoothing"](signal, 2, None).at(t, 2) - truth)
    local = np.std(SMOOTHERS["savitzky-golay"](signal, 2, None).at(t, 2) - truth)
    assert spline < 0.5 * local
    assert spline < 0.06 * np.std(truth)


def test_a_rounding_sensor_is_smoothed_by_at_least_its_rounding_error():
    t = np.arange(0.0, 30.0, 0.1)
    step = np.deg2rad(2.0)
    signal = Signal("psi", t, np.round(0.5 * np.sin(0.4 * t) / step) * step, step)
    smooth = SMOOTHERS["smoothing"](signal, 2, None)
    assert smooth.noise >= 0.95 * step / np.sqrt(12.0)
    assert np.std(smooth.at(t[20:-20], 1) - 0.2 * np.cos(0.4 * t[20:-20])) < 0.02


def test_the_setting_of_one_signal_smooths_another_equally():
    first, _ = wave(0.02)
    second, t = wave(0.02, seed=1)
    assert len(SMOOTHERS) >= 2
    for smoother in SMOOTHERS.values():
        setting = smoother(first, 2, None).setting
        doubled = Signal("psi", second.t, 2.0 * second.values, 0.0)
        assert np.allclose(
            smoother(doubled, 2, setting).at(t, 1), 2.0 * smoother(second, 2, setting).at(t, 1), atol=1e-8
        )
