from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gcs_autotune.design import StepMetrics, combine, is_better, step_metrics
from gcs_autotune.errors import NotInformative

Array = NDArray[np.float64]
GOOD = StepMetrics(itae=2.0, overshoot=0.05, rise=1.0, settling=3.0, steady_error=0.01, travel=0.3)


def lag(t: Array, tau: float = 1.0) -> Array:
    return 1.0 - np.exp(-np.maximum(t, 0.0) / tau)


def wave(t: Array, damping: float, omega: float = 2.0) -> Array:
    moving = np.maximum(t, 0.0)
    fast = omega * math.sqrt(1.0 - damping**2)
    share = damping / math.sqrt(1.0 - damping**2)
    return 1.0 - np.exp(-damping * omega * moving) * (np.cos(fast * moving) + share * np.sin(fast * moving))


def measure(t: Array, share: Array, step: float = 0.5, start: float = 0.2, **options: float) -> StepMetrics:
    target = np.where(t < 0.0, start, start + step)
    return step_metrics(t, target, start + step * share, np.zeros_like(t), **options)


def test_a_first_order_lag_has_its_textbook_numbers() -> None:
    t = np.linspace(0.0, 20.0, 4001)
    found = measure(t, lag(t))
    assert found.itae == pytest.approx(1.0, rel=1e-2)
    assert found.rise == pytest.approx(math.log(9.0), rel=1e-3)
    assert found.settling == pytest.approx(math.log(20.0), rel=5e-3)
    assert (found.overshoot, found.steady_error, found.oscillation) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_a_second_order_lag_overshoots_as_the_formula_says() -> None:
    t = np.linspace(0.0, 20.0, 4001)
    found = measure(t, wave(t, 0.3))
    assert found.overshoot == pytest.approx(math.exp(-math.pi * 0.3 / math.sqrt(1.0 - 0.09)), rel=1e-3)


def test_an_undamped_swing_is_seen_as_oscillation_and_never_settles() -> None:
    t = np.linspace(0.0, 30.0, 601)
    found = measure(t, wave(t, 0.0))
    assert found.oscillation == pytest.approx(1.0, rel=0.02)
    assert math.isnan(found.settling)


def test_travel_is_strokes_per_second() -> None:
    t = np.linspace(0.0, 10.0, 101)
    output = np.where((t > 2.0) & (t < 5.0), 0.5, 0.0)
    found = step_metrics(t, np.full_like(t, 0.5), 0.5 * lag(t), output)
    assert found.travel == pytest.approx(0.1)


def test_samples_before_the_step_do_not_count() -> None:
    t = np.linspace(-5.0, 20.0, 5001)
    found, plain = measure(t, lag(t)), measure(t[t >= 0.0], lag(t[t >= 0.0]))
    assert found.itae == pytest.approx(plain.itae, rel=1e-2)
    assert found.settling == pytest.approx(plain.settling, abs=0.02)


def test_steps_down_and_steps_up_read_the_same() -> None:
    t = np.linspace(0.0, 15.0, 301)
    up, down = measure(t, wave(t, 0.4), step=0.7), measure(t, wave(t, 0.4), step=-0.7)
    assert up.itae == pytest.approx(down.itae)
    assert up.overshoot == pytest.approx(down.overshoot)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), rate=st.floats(8.0, 50.0), damping=st.floats(0.2, 0.9))
def test_uneven_samples_give_the_same_answer_as_even_ones(seed: int, rate: float, damping: float) -> None:
    rng = np.random.default_rng(seed)
    even = np.linspace(0.0, 20.0, 4001)
    regular = np.arange(1, int(20 * rate)) / rate
    uneven = np.concatenate([[0.0], regular + rng.uniform(-0.45, 0.45, len(regular)) / rate, [20.0]])
    wanted, found = measure(even, wave(even, damping)), measure(uneven, wave(uneven, damping))
    assert found.itae == pytest.approx(wanted.itae, rel=0.1, abs=0.02)
    assert found.overshoot == pytest.approx(wanted.overshoot, abs=0.04)


def test_noise_and_quantisation_move_the_verdict_little() -> None:
    t = np.linspace(0.0, 20.0, 401)
    degrees = math.radians(1.0)
    rng = np.random.default_rng(3)
    noisy = 0.5 * wave(t, 0.5) + rng.normal(0.0, 0.3 * degrees, len(t))
    rough = np.round(noisy / degrees) * degrees
    target = np.full_like(t, 0.5)
    clean = measure(t, wave(t, 0.5), noise_std=0.5 * degrees)
    found = step_metrics(t, target, rough, np.zeros_like(t), noise_std=0.5 * degrees)
    assert found.overshoot == pytest.approx(clean.overshoot, abs=0.05)
    assert found.itae == pytest.approx(clean.itae, rel=0.1)
    assert math.isfinite(found.settling)
    assert found.oscillation < 0.03


def test_an_error_of_one_quantum_is_none_and_of_two_is_one() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    quantum = math.radians(2.0)
    one, two = (np.where(t < 0.0, 0.0, 1.0 + n * quantum / 0.5) for n in (1, 2))
    near, far = (measure(t, share, quantum=quantum) for share in (one, two))
    assert near.itae == near.overshoot == near.settling == 0.0
    assert far.itae > 10.0
    assert far.overshoot == pytest.approx(quantum / 0.5, rel=0.02)
    assert math.isnan(far.settling)


def test_a_coarse_compass_says_the_same_as_a_fine_one_within_its_quantum() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    quantum = math.radians(2.0)
    true = wave(t, 0.3)
    read = np.round(0.5 * true / quantum) * quantum / 0.5
    fine, coarse = measure(t, true, quantum=quantum), measure(t, read, quantum=quantum)
    assert coarse.itae == pytest.approx(fine.itae, rel=0.06)
    assert coarse.overshoot == pytest.approx(fine.overshoot, abs=quantum / 0.5)


def test_a_fine_sensor_is_measured_as_finely_as_ever() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    assert measure(t, wave(t, 0.3), noise_std=0.002, quantum=0.001) == measure(t, wave(t, 0.3), noise_std=0.002)


def test_a_step_of_two_quanta_is_refused_as_too_small_to_measure() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    with pytest.raises(NotInformative, match="larger step"):
        measure(t, lag(t), step=0.07, quantum=math.radians(2.0))


def test_both_directions_are_averaged_and_limits_count_as_the_worse() -> None:
    found = combine([GOOD, replace(GOOD, itae=4.0, overshoot=0.2, settling=math.nan)])
    assert found.itae == 3.0
    assert found.overshoot == 0.2
    assert math.isnan(found.settling)
    assert math.isnan(combine([]).itae)


def test_one_wild_sample_is_not_an_overshoot() -> None:
    t = np.linspace(0.0, 20.0, 401)
    share = lag(t)
    share[200] = 3.0
    assert measure(t, share).overshoot < 0.01


@pytest.mark.parametrize(
    ("t", "position", "match"),
    [
        (np.arange(5.0), np.ones(5), "samples"),
        (np.arange(20.0)[::-1].copy(), np.ones(20), "forwards"),
        (np.arange(20.0), np.full(20, np.nan), "finite"),
        (np.arange(20.0), np.ones(19), "equally long"),
        (np.arange(20.0), np.full(20, 0.5), "no step"),
    ],
)
def test_what_is_no_step_is_refused_in_words(t: Array, position: Array, match: str) -> None:
    with pytest.raises(NotInformative, match=match):
        step_metrics(t, np.full(len(t), 0.5), position, np.zeros(len(t)))


def test_a_clearly_better_step_is_kept() -> None:
    verdict = is_better(GOOD, replace(GOOD, itae=1.0))
    assert verdict.better
    assert "50% lower" in verdict.reasons[0]


@pytest.mark.parametrize(
    ("after", "reason"),
    [
        (replace(GOOD, itae=1.95), "at least 5% lower"),
        (replace(GOOD, itae=3.0), "higher"),
        (replace(GOOD, itae=math.nan), "could not be measured"),
        (replace(GOOD, itae=1.0, overshoot=0.2), "overshoot"),
        (replace(GOOD, itae=1.0, oscillation=0.2), "swing"),
        (replace(GOOD, itae=1.0, steady_error=0.2), "steady error"),
        (replace(GOOD, itae=1.0, travel=2.0), "travel"),
        (replace(GOOD, itae=1.0, settling=math.nan), "did not settle"),
    ],
)
def test_every_price_of_speed_alone_brings_the_old_gains_back(after: StepMetrics, reason: str) -> None:
    verdict = is_better(GOOD, after)
    assert not verdict.better
    assert any(reason in line for line in verdict.reasons)


def test_old_gains_that_were_worse_in_everything_do_not_forbid_anything() -> None:
    wild = StepMetrics(math.inf, 1.2, 1.0, math.nan, 0.3, 2.0, 0.9)
    assert is_better(wild, replace(GOOD, overshoot=0.3)).better
    unmeasured = StepMetrics(*[math.nan] * 7)
    assert is_better(unmeasured, GOOD).better
