from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gcs_autotune.design import StepMetrics, combine, is_better, step_metrics
from gcs_autotune.design.step_metrics import (
    HALVES,
    INTERVAL,
    MIN_SAMPLES,
    _without_spikes,
    error_behind,
    noise_floor,
)
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


SHARES = np.array([0.0, 0.3, 0.7, 1.2, 1.1, 1.02, 0.98, 1.01, 1.03, 1.0, 1.0])
"""Of a step that is read by hand, a second apart."""


def by_hand(step: float, shares: Array = SHARES, begin: float = 100.0, **options: float) -> StepMetrics:
    """Measure *shares* of a step of *step* after two samples at rest, the output moving with each of them."""
    t = begin + np.arange(-2.0, len(shares))
    target = np.where(t < begin, 3.0, 3.0 + step)
    output = np.zeros(len(t))
    output[:6] = -0.7, 0.9, 1.0, -1.0, -1.0, 0.0
    return step_metrics(t, target, 3.0 + step * np.append([0.0, 0.0], shares), output, **options)


@pytest.mark.parametrize("step", [2.0, -2.0])
def test_the_figures_of_a_step_of_eleven_samples_match_a_hand_calculation(step: float) -> None:
    found = by_hand(step)
    assert found.itae == pytest.approx(0.7 + 2 * 0.3 + 3 * 0.2 + 4 * 0.1 + 5 * 0.02 + 6 * 0.02 + 7 * 0.01 + 8 * 0.03)
    assert found.overshoot == pytest.approx(0.2)
    assert found.rise == pytest.approx((2.0 + 0.2 / 0.5) - 0.1 / 0.3)
    assert found.settling == 5.0
    assert found.steady_error == pytest.approx(0.01), "of the last third, which begins after 6.7 s"
    longer = by_hand(step, np.append(SHARES, 1.0))
    assert longer.steady_error == pytest.approx(0.03 / 4), "of the last four of twelve, after 7.3 s"
    assert found.travel == pytest.approx((2.0 + 1.0) / 10.0), "what it did before is not counted"
    assert found.oscillation == pytest.approx(0.015)


@pytest.mark.parametrize("step", [2.0, -2.0])
def test_the_noise_floor_is_subtracted_from_every_figure_except_the_steady_error(step: float) -> None:
    found = by_hand(step, quantum=0.02 / 1.01)
    beyond = np.maximum(np.abs(1.0 - SHARES) - 0.01, 0.0)
    assert found.itae == pytest.approx(float(np.arange(11.0) @ beyond))
    assert (found.overshoot, found.oscillation) == pytest.approx((0.19, 0.005))
    assert found.settling == 5.0
    assert found.steady_error == pytest.approx(0.01)
    wide = by_hand(step, quantum=0.3 / 1.01)
    assert wide.settling == 4.0, "its band is as wide as the floor"
    edge = by_hand(step, np.array([0.0, 0.5, 1.5, 1.25, 0.75, *[1.0] * 6]), noise_std=0.25)
    assert edge.settling == 3.0, "its edge is a part of the band"
    assert (wide.oscillation, wide.overshoot) == pytest.approx((0.0, 0.05))
    assert by_hand(step, np.minimum(SHARES, 0.95), quantum=0.2).overshoot == 0.0


def test_samples_faster_than_the_noise_are_thinned_from_the_last_one() -> None:
    errors = np.abs(1.0 - SHARES)
    every_second = 2.0 * (2 * errors[2] + 4 * errors[4] + 6 * errors[6] + 8 * errors[8])
    assert by_hand(2.0, noise_time=2.0).itae == pytest.approx(every_second)
    assert by_hand(2.0, noise_time=0.4).itae == by_hand(2.0).itae
    thirds = [(1, errors[1]), (4, errors[4]), (7, errors[7]), (10, errors[10])]
    by_thirds = sum(1.5 * (t * e + u * f) for (t, e), (u, f) in pairwise(thirds))
    assert by_hand(2.0, noise_time=3.0).itae == pytest.approx(by_thirds)


def test_steps_that_begin_in_motion_or_never_finish_have_valid_times() -> None:
    under_way = np.array([0.4, 0.3, 0.7, 1.2, 1.1, 1.02, 0.98, 1.0, 1.0, 1.0, 1.0])
    assert by_hand(2.0, under_way).rise == pytest.approx(2.4), "a tenth is there at once"
    assert math.isnan(by_hand(2.0, 0.7 * SHARES).rise)
    late = SHARES.copy()
    late[8] = 1.06
    assert by_hand(2.0, late).settling == 9.0, "at nine tenths of the time it counts"
    late[9] = 1.06
    assert math.isnan(by_hand(2.0, late).settling)
    late[10] = 1.06
    assert math.isnan(by_hand(2.0, late).settling)
    assert by_hand(2.0, np.ones(9)).settling == 0.0


def test_a_step_without_a_target_change_starts_at_the_median_of_three_positions() -> None:
    t = np.arange(10.0)
    position = np.array([0.2, 0.9, 0.3, 0.4, 0.6, 0.8, 1.3, 1.3, 1.3, 1.3])
    found = step_metrics(t, np.full(10, 1.3), position, np.zeros(10))
    assert found.steady_error == pytest.approx(0.0, abs=1e-12)
    assert found.rise == pytest.approx((5.0 + 0.4 / 0.5) - 3.0)
    assert found.overshoot == 0.0
    lifted = step_metrics(t, np.full(10, 1.3), position + np.where(t == 9.0, 0.1, 0.0), np.zeros(10))
    assert lifted.overshoot == pytest.approx(0.1, abs=1e-12), "of a step of one: the middle of the three is 0.3"


def test_a_step_needs_eight_samples_to_be_measured() -> None:
    assert MIN_SAMPLES == 8
    assert by_hand(2.0, SHARES[:8]).rise > 0.0
    with pytest.raises(NotInformative, match="only 7 samples after the step"):
        by_hand(2.0, SHARES[:7])
    t = np.arange(8.0)
    assert step_metrics(t, np.ones(8), t / 7.0, t).overshoot == 0.0
    with pytest.raises(NotInformative, match="a step of 7 samples"):
        step_metrics(t[:7], np.ones(7), t[:7] / 7.0, t[:7])


def test_a_step_just_beyond_twice_the_floor_is_measured() -> None:
    assert noise_floor(0.1, 0.0) == 0.2 and noise_floor(0.1, 0.4) == pytest.approx(0.404)
    assert by_hand(-2.0, noise_std=0.499).steady_error == pytest.approx(0.01)
    with pytest.raises(NotInformative, match="larger step"):
        by_hand(-2.0, noise_std=0.5)


def test_time_stamps_may_repeat_but_not_always_and_not_decrease() -> None:
    t, rise = np.arange(10.0), np.linspace(0.0, 1.0, 10)
    twice = np.where(t == 4.0, 3.0, t)
    assert step_metrics(twice, np.ones(10), rise, t).overshoot == 0.0
    at_last = np.where(t == 9.0, 1.0, 0.0)
    assert step_metrics(at_last, np.ones(10), rise, t).travel == pytest.approx(9.0)
    for wrong in (np.full(10, 3.0), np.where(t == 4.0, 2.9, t)):
        with pytest.raises(NotInformative, match="does not increase"):
            step_metrics(wrong, np.ones(10), rise, t)
    with pytest.raises(NotInformative, match="same number of samples"):
        step_metrics(*[np.ones((10, 2))] * 4)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_spike_differs_from_two_equal_neighbours_by_over_a_quarter(side: float) -> None:
    plain = np.array([0.5, 0.5, 0.5, 0.5, 0.5, 0.75])
    for leap, is_lone in ((0.25, False), (0.375, True), (-0.25, False), (-0.375, True)):
        values = side * (plain + np.where(np.arange(6) == 2, leap, 0.0))
        assert np.array_equal(_without_spikes(values, side), side * plain if is_lone else values)
    for apart, is_lone in ((0.125, True), (0.25, False)):
        values = side * np.array([0.5, 0.5, 1.25, 0.5 + apart, 0.5 + apart])
        assert bool(_without_spikes(values, side)[2] == side * (0.5 + 0.5 * apart)) is is_lone
    ends = side * np.array([9.0, 0.0, 0.0, 0.0, -9.0])
    assert np.array_equal(_without_spikes(ends, side), ends), "an end has one neighbour only"
    assert np.array_equal(_without_spikes(2.0 * plain, 9.0), 2.0 * plain)


def test_steps_are_combined_by_their_mean_and_their_worst() -> None:
    other = StepMetrics(
        itae=1.0, overshoot=0.02, rise=2.0, settling=5.0, steady_error=0.03, travel=0.5, oscillation=0.1
    )
    joined = StepMetrics(
        itae=1.5, overshoot=0.05, rise=1.5, settling=4.0, steady_error=0.03, travel=0.4, oscillation=0.1
    )
    assert combine([GOOD, other]) == combine([other, GOOD]) == joined


def test_an_error_without_noise_is_unchanged() -> None:
    error = np.sin(np.arange(50.0))
    assert np.array_equal(error_behind(error, 0.0), error)


def fitted_behind(error: Array, std: float) -> Array:
    """What :func:`error_behind` documents, each parabola fitted by least squares."""
    found = error.copy()
    for i in range(len(error)):
        low, high, least = error[i] - INTERVAL * std, error[i] + INTERVAL * std, std
        for half in (h for h in HALVES if 2 * h + 1 <= len(error)):
            first = min(max(i - half, 0), len(error) - 2 * half - 1)
            place = np.arange(first - i, first - i + 2 * half + 1) / half
            powers = np.stack([np.ones_like(place), place, place**2], axis=1)
            value = float(np.linalg.lstsq(powers, error[first : first + len(place)])[0][0])
            own = std * math.sqrt(float(np.linalg.inv(powers.T @ powers)[0, 0]))
            low, high = max(low, value - INTERVAL * own), min(high, value + INTERVAL * own)
            if low > high:
                break
            if own < least:
                found[i], least = value, own
    return found


def test_neighbourhoods_grow_from_two_samples_to_256_doubling_every_second_one() -> None:
    assert HALVES == tuple(sorted([*(2**k for k in range(1, 9)), *(3 * 2**k for k in range(7))]))
    assert INTERVAL == 1.5


@pytest.mark.parametrize("step", [2.0, -2.0])
def test_the_tracking_error_excludes_noise_and_is_relative_to_the_step(step: float) -> None:
    shares = SHARES + 0.003 * np.cos(5.0 * np.arange(11.0))
    behind = fitted_behind(1.0 - shares, 0.02)
    expected = float(np.trapezoid(np.arange(11.0) * np.maximum(np.abs(behind) - 0.04, 0.0)))
    assert by_hand(step, shares, noise_std=0.04).itae == pytest.approx(expected)
    assert np.abs(behind - (1.0 - shares)).max() > 0.01


@pytest.mark.parametrize("count", [4, 5, 8, 30, 61])
@pytest.mark.parametrize("every", [1, 2])
def test_each_sample_is_smoothed_by_the_widest_consistent_parabola(count: int, every: int) -> None:
    t = np.arange(every * count) * 10.0 / count
    error = (1.0 - wave(t, 0.5, 3.0) + np.random.default_rng(6).normal(0.0, 0.02, len(t)))[::every]
    assert error_behind(error, 0.02) == pytest.approx(fitted_behind(error, 0.02), abs=1e-9)


def test_a_first_order_lag_has_its_textbook_numbers() -> None:
    t = np.linspace(0.0, 20.0, 4001)
    found = measure(t, lag(t))
    assert found.itae == pytest.approx(1.0, rel=1e-2)
    assert found.rise == pytest.approx(math.log(9.0), rel=1e-3)
    assert found.settling == pytest.approx(math.log(20.0), rel=5e-3)
    assert (found.overshoot, found.steady_error, found.oscillation) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_a_second_order_lag_overshoots_by_the_formula() -> None:
    t = np.linspace(0.0, 20.0, 4001)
    found = measure(t, wave(t, 0.3))
    assert found.overshoot == pytest.approx(math.exp(-math.pi * 0.3 / math.sqrt(1.0 - 0.09)), rel=1e-3)


def test_an_undamped_oscillation_is_reported_and_never_settles() -> None:
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


def test_steps_down_and_up_have_the_same_figures() -> None:
    t = np.linspace(0.0, 15.0, 301)
    up, down = measure(t, wave(t, 0.4), step=0.7), measure(t, wave(t, 0.4), step=-0.7)
    assert up.itae == pytest.approx(down.itae)
    assert up.overshoot == pytest.approx(down.overshoot)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), rate=st.floats(8.0, 50.0), damping=st.floats(0.2, 0.9))
def test_uneven_samples_give_the_same_figures_as_even_ones(seed: int, rate: float, damping: float) -> None:
    rng = np.random.default_rng(seed)
    even = np.linspace(0.0, 20.0, 4001)
    regular = np.arange(1, int(20 * rate)) / rate
    uneven = np.concatenate([[0.0], regular + rng.uniform(-0.45, 0.45, len(regular)) / rate, [20.0]])
    wanted, found = measure(even, wave(even, damping)), measure(uneven, wave(uneven, damping))
    assert found.itae == pytest.approx(wanted.itae, rel=0.1, abs=0.02)
    assert found.overshoot == pytest.approx(wanted.overshoot, abs=0.04)


def test_noise_and_quantisation_change_the_figures_little() -> None:
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


def test_an_error_of_one_quantum_does_not_count_and_of_two_does() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    quantum = math.radians(2.0)
    one, two = (np.where(t < 0.0, 0.0, 1.0 + n * quantum / 0.5) for n in (1, 2))
    near, far = (measure(t, share, quantum=quantum) for share in (one, two))
    assert near.itae == near.overshoot == near.settling == 0.0
    assert far.itae > 10.0
    assert far.overshoot == pytest.approx(quantum / 0.5, rel=0.02)
    assert math.isnan(far.settling)


def test_a_coarse_compass_gives_the_figures_of_a_fine_one_within_its_quantum() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    quantum = math.radians(2.0)
    true = wave(t, 0.3)
    read = np.round(0.5 * true / quantum) * quantum / 0.5
    fine, coarse = measure(t, true, quantum=quantum), measure(t, read, quantum=quantum)
    assert coarse.itae == pytest.approx(fine.itae, rel=0.06)
    assert coarse.overshoot == pytest.approx(fine.overshoot, abs=quantum / 0.5)


def test_a_fine_quantum_does_not_change_the_figures() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    assert measure(t, wave(t, 0.3), noise_std=0.002, quantum=0.001) == measure(t, wave(t, 0.3), noise_std=0.002)


def test_a_step_of_two_quanta_is_rejected_as_too_small() -> None:
    t = np.linspace(-1.0, 20.0, 1051)
    with pytest.raises(NotInformative, match="larger step"):
        measure(t, lag(t), step=0.07, quantum=math.radians(2.0))


def test_both_directions_are_averaged_and_limits_use_the_worse() -> None:
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
        (np.arange(20.0)[::-1].copy(), np.ones(20), "does not increase"),
        (np.arange(20.0), np.full(20, np.nan), "finite"),
        (np.arange(20.0), np.ones(19), "same number of samples"),
        (np.arange(20.0), np.full(20, 0.5), "no step"),
    ],
)
def test_a_record_without_a_step_is_rejected_with_a_reason(t: Array, position: Array, match: str) -> None:
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
        (replace(GOOD, itae=1.0, oscillation=0.2), "remaining oscillation"),
        (replace(GOOD, itae=1.0, steady_error=0.2), "remaining error"),
        (replace(GOOD, itae=1.0, travel=2.0), "travel"),
        (replace(GOOD, itae=1.0, settling=math.nan), "not settled"),
    ],
)
def test_each_cost_of_speed_alone_restores_the_old_gains(after: StepMetrics, reason: str) -> None:
    verdict = is_better(GOOD, after)
    assert not verdict.better
    assert any(reason in line for line in verdict.reasons)


def test_old_gains_that_were_worse_in_everything_forbid_nothing() -> None:
    wild = StepMetrics(math.inf, 1.2, 1.0, math.nan, 0.3, 2.0, 0.9)
    assert is_better(wild, replace(GOOD, overshoot=0.3)).better
    unmeasured = StepMetrics(*[math.nan] * 7)
    assert is_better(unmeasured, GOOD).better


def noisy_step(noise: float, target_held: float = 1.0, seconds: float = 20.0) -> StepMetrics:
    """A step of one that is followed with a time constant of 1 s, read through white noise."""
    t = np.arange(0.0, seconds, 0.05)
    x = target_held * (1.0 - np.exp(-t)) + noise * np.random.default_rng(3).normal(size=len(t))
    x[0] = 0.0
    target = np.where(t > 0.0, 1.0, 0.0)
    return step_metrics(t, target, x, np.zeros(len(t)), noise_std=noise)


def test_settling_hidden_by_noise_is_not_reported_as_never_settled() -> None:
    clean, noisy, off = noisy_step(0.0), noisy_step(0.08), noisy_step(0.01, target_held=0.8)
    assert clean.settling == pytest.approx(3.0, abs=0.1) and not clean.hidden_by_noise
    assert math.isnan(noisy.settling) and noisy.hidden_by_noise
    assert math.isnan(off.settling) and not off.hidden_by_noise, "20 % off its target when the record ends"


def test_one_direction_that_did_not_settle_is_not_hidden_by_the_noise_of_the_other() -> None:
    noisy, off = noisy_step(0.08), noisy_step(0.01, target_held=0.8)
    assert combine([noisy, noisy_step(0.0)]).hidden_by_noise
    assert not combine([noisy, off]).hidden_by_noise
