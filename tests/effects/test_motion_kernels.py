"""The compiled small parts of effects, each against its definition: quick enough with the compiler switched off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import cholesky, expm, solve_continuous_lyapunov

from gcs_autotune.effects import rung
from gcs_autotune.effects.actuator import backlash
from gcs_autotune.effects.kernels import SETTLED, earlier, fading, following, limited
from gcs_autotune.effects.narrow_band import SETTLED as SETTLED_AT
from gcs_autotune.effects.narrow_band import Oscillator, cost, driven, whitened

T = np.array([0.5, 1.5, 1.9, 3.0, 4.0])
U = np.array([0.3, -1.0, 0.8, 0.8, 0.2])
FINE, COARSE = 1e-3, 1e3


def lagged(t: float, time_constant: float) -> float:
    """The first-order lag of the held commands, segment by segment."""
    y = U[0]
    for j, since in enumerate(T):
        until = min(t, T[j + 1]) if j + 1 < len(T) else t
        if until > since:
            y = U[j] + (y - U[j]) * np.exp(-(until - since) / time_constant)
    return float(y)


def slewed(t: float, rate: float) -> float:
    """The held commands approached no faster than *rate*."""
    y = U[0]
    for j, since in enumerate(T):
        until = min(t, T[j + 1]) if j + 1 < len(T) else t
        if until > since:
            y += np.clip(U[j] - y, -rate * (until - since), rate * (until - since))
    return float(y)


def faded(t: float, start: float, rate: float, floor: float) -> float:
    held = U[int(np.searchsorted(T, t, side="right")) - 1]
    return float(held * max(1.0 - rate * (t - start), floor))


def same_impulse(stamps: np.ndarray, values: np.ndarray, motion: Callable[[float], float], end: float) -> None:
    """Every held value is the mean of the motion over its piece."""
    edges = [*stamps, end]
    seen = 0
    for value, begin, until in zip(values, edges, edges[1:], strict=False):
        if until - begin > 1e-9 and begin < end:
            kinks = [k for k in T if begin < k < until]
            mean = quad(motion, begin, until, points=kinks or None, limit=200)[0] / (until - begin)
            assert value == pytest.approx(mean, abs=2e-6), (begin, until)
            seen += 1
    assert seen >= len(T)


@pytest.mark.parametrize("time_constant", [0.2, 1.5])
@pytest.mark.parametrize("resolution", [FINE, 0.05, COARSE])
def test_a_lag_between_stamps_has_the_exact_mean_on_every_piece(time_constant: float, resolution: float) -> None:
    stamps, values = following(T, U, time_constant, resolution)
    end = T[-1] + SETTLED * time_constant
    assert set(T) <= set(stamps.tolist())
    assert stamps[-1] == pytest.approx(end)
    assert values[-1] == U[-1]
    assert np.all(np.diff(stamps) >= 0.0)
    same_impulse(stamps[:-1], values[:-1], lambda t: lagged(t, time_constant), end)
    # as many pieces as the slope asks for: 2 sqrt(d T / resolution) (1 - exp(-h / 2T)) in each interval, rounded up
    for j, (begin, until) in enumerate(zip(T, [*T[1:], end], strict=True)):
        d = abs(lagged(begin, time_constant) - U[j])
        requested = 2.0 * np.sqrt(d * time_constant / resolution) * -np.expm1(-(until - begin) / (2.0 * time_constant))
        inside = np.sum((stamps[:-1] >= begin) & (stamps[:-1] < until))
        assert inside == max(1, int(np.ceil(requested - 1e-9)))


def test_two_commands_at_one_stamp_count_as_the_second() -> None:
    t, u = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0, -1.0])
    stamps, values = following(t, u, 0.5, COARSE)
    assert stamps[1] == stamps[2] == 1.0
    assert values[1] == 0.0, "where the lag is then"
    alone = following(t[[0, 2, 3]], u[[0, 2, 3]], 0.5, COARSE)
    assert values[[0, 2, 3, 4]] == pytest.approx(alone[1])
    slow, fading_off = limited(t, u, 2.0, COARSE), fading(t, u, 0.0, 3.0, 0.1, 0.2, COARSE)
    assert slow[1] == pytest.approx(limited(t[[0, 2, 3]], u[[0, 2, 3]], 2.0, COARSE)[1])
    assert fading_off[1][1] == pytest.approx(0.9 * u[1])
    assert fading_off[1][[0, 2, 3]] == pytest.approx(fading(t[[0, 2, 3]], u[[0, 2, 3]], 0.0, 3.0, 0.1, 0.2, COARSE)[1])


@pytest.mark.parametrize("rate", [0.4, 3.0])
@pytest.mark.parametrize("resolution", [FINE, COARSE])
def test_a_limited_rate_has_the_exact_mean_on_every_piece(rate: float, resolution: float) -> None:
    stamps, values = limited(T, U, rate, resolution)
    same_impulse(stamps, values, lambda t: slewed(t, rate), 12.0)
    assert values[-1] == U[-1]
    # pieces of sqrt(resolution / rate) while it is under way, and one more from where it has arrived
    expected, y = 0, U[0]
    for u, h in zip(U, [*np.diff(T), np.inf], strict=True):
        reached = abs(u - y) / rate
        expected += int(np.ceil(min(reached, h) / np.sqrt(resolution / rate))) + (reached < h)
        y += np.clip(u - y, -rate * h, rate * h)
    assert len(stamps) == expected


@pytest.mark.parametrize(("rate", "floor"), [(0.2, 0.6), (0.2, 0.0), (0.0, 0.5), (-0.1, 0.5)])
@pytest.mark.parametrize("resolution", [FINE, COARSE])
def test_a_fading_gain_has_the_exact_mean_on_every_piece(rate: float, floor: float, resolution: float) -> None:
    stamps, values = fading(T, U, T[0], 7.0, rate, floor, resolution)
    same_impulse(stamps, values, lambda t: faded(t, T[0], rate, floor), 7.0)
    assert (len(stamps) == len(T)) is (resolution == COARSE or rate == 0.0)
    for u, begin, until in zip(U, T, [*T[1:], 7.0], strict=True):
        if 1.0 - rate * (until - T[0]) > floor:  # pieces as long as the slope times their square is the resolution
            requested = (until - begin) * np.sqrt(abs(u * rate) / resolution)
            assert np.sum((stamps >= begin) & (stamps < until)) == max(1, int(np.ceil(requested - 1e-9)))
    if rate > 0.0:
        bottom = T[0] + (1.0 - floor) / rate
        assert np.sum((stamps >= bottom) & ~np.isin(stamps, T)) <= 1, "what is as weak as it gets is drawn in one piece"


def test_backlash_follows_its_flanks() -> None:
    u = np.array([0.0, 0.3, 1.0, 0.8, 0.2, -1.0, -0.9, 0.0])
    assert backlash(u, 0.25) == pytest.approx([0.0, 0.05, 0.75, 0.75, 0.45, -0.75, -0.75, -0.25])
    assert backlash(u, 0.0) == pytest.approx(u)


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.37])
def test_a_delayed_motion_is_exact_for_a_cubic_on_uneven_stamps(delay: float) -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.06, 0.14, 60))

    def cubic(at: np.ndarray) -> np.ndarray:
        return 0.4 * at**3 - at**2 + 0.5 * at - 2.0

    found = earlier(t, cubic(t), delay, coasting=False)
    inside = t - delay > t[0]
    assert inside.sum() > 50
    assert found[inside] == pytest.approx(cubic(t - delay)[inside], abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_a_kink_at_a_stamp_does_not_ring_at_any_offset(sign: float, offset: float) -> None:
    t = 0.1 * np.arange(60)
    found = sign * (earlier(t, sign * (np.abs(t - 3.0) + offset), 0.04, coasting=False)) - offset
    assert found[1:] == pytest.approx(np.abs(t - 0.04 - 3.0)[1:], abs=1e-6)


def test_before_the_first_stamp_a_position_coasts_and_a_velocity_holds() -> None:
    t = 1.0 + 0.1 * np.arange(30)
    parabola = 2.0 + 3.0 * (t - 1.0) + 0.5 * (t - 1.0) ** 2
    assert earlier(t, parabola, 0.25, coasting=True)[:2] == pytest.approx([2.0 - 0.75, 2.0 - 0.45])
    assert earlier(t, parabola, 0.25, coasting=False)[:2] == pytest.approx([2.0, 2.0])


def test_four_stamps_are_enough_for_an_exact_cubic() -> None:
    t = np.array([0.0, 0.9, 2.1, 3.0])
    found = earlier(t, t**3 - 2.0 * t, 0.5, coasting=False)
    assert found[1:] == pytest.approx((t[1:] - 0.5) ** 3 - 2.0 * (t[1:] - 0.5), abs=1e-9)


def test_nearly_equal_stamps_are_skipped_and_few_stamps_are_interpolated_linearly() -> None:
    t = np.sort(np.append(0.1 * np.arange(40), 2.001))
    motion = np.sin(t)
    spoilt = motion + np.where(t == 2.001, 0.5, 0.0)
    assert earlier(t, spoilt, 0.05, coasting=False)[1:] == pytest.approx(np.sin(t - 0.05)[1:], abs=1e-4)
    twice = np.sort(np.append(0.1 * np.arange(40), 2.0))
    assert earlier(twice, np.sin(twice), 0.05, coasting=False)[5:] == pytest.approx(np.sin(twice - 0.05)[5:], abs=1e-4)
    assert earlier(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 0.0]), 0.5, coasting=False) == pytest.approx(
        [0.0, 1.0, 1.0]
    )


@pytest.mark.parametrize(("omega", "zeta"), [(2.0, 0.1), (5.0, 0.7)])
def test_a_spring_under_held_forces_oscillates_as_by_an_integrator(omega: float, zeta: float) -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.05, 0.3, 40))
    push = rng.normal(size=40)

    def slope(at: float, s: np.ndarray) -> list[float]:
        held = push[int(np.searchsorted(t, at, side="right")) - 1]
        return [omega * s[1], omega * (held - s[0]) - 2.0 * zeta * omega * s[1]]

    state, places = np.array([push[0], 0.0]), [np.array([push[0], 0.0])]
    for begin, until in pairwise(t):
        middle = 0.5 * (begin + until)
        state = solve_ivp(lambda _, s, at=middle: slope(at, s), (begin, until), state, rtol=1e-10, atol=1e-12).y[:, -1]
        places.append(state)
    position, velocity = rung(omega, zeta, t, push)
    assert position == pytest.approx(np.array(places)[:, 0], abs=1e-7)
    assert velocity == pytest.approx(np.array(places)[:, 1], abs=1e-7)


def covariance_of(law: Oscillator, t: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n) of all samples at once, relative to the noise, from Lyapunov equations."""
    A = np.array(
        [
            [0.0, law.omega, 0.0],
            [-law.omega, -2.0 * law.zeta * law.omega, 0.0],
            [1.0 / law.lag, 0.0, -1.0 / law.lag],
        ]
    )
    stationary = solve_continuous_lyapunov(A, -np.diag([0.0, 1.0, 0.0]))
    assert law.share == pytest.approx(stationary[2, 2] / stationary[0, 0])
    seen = np.array([1.0, 0.0, -1.0]) if law.rate else np.array([0.0, 0.0, 1.0])
    stationary *= law.rho / (seen @ stationary @ seen)
    leak = 1.0 / (t[-1] - t[0])
    slow = np.array([[-law.fade, 0.0, 0.0], [1.0 / law.lag, -1.0 / law.lag, 0.0], [0.0, 1.0 / law.lag, -leak]])
    drifting = solve_continuous_lyapunov(slow, -np.diag([2.0 * law.fade * law.slow, 0.0, 0.0]))
    last = np.array([0.0, 1.0, 0.0] if law.rate else [0.0, 0.0, 1.0])
    return np.eye(len(t)) + _covariance(A, stationary, seen, t) + _covariance(slow, drifting, last, t)


def _covariance(A: np.ndarray, stationary: np.ndarray, seen: np.ndarray, t: np.ndarray) -> np.ndarray:
    over = [expm(A * gap) for gap in np.diff(t)]
    C = np.zeros((len(t), len(t)))
    for j in range(len(t)):
        state = stationary @ seen
        C[j, j] += seen @ state
        for i in range(j + 1, len(t)):
            state = over[i - 1] @ state
            C[i, j] = C[j, i] = seen @ state
    return C


LAW = Oscillator(omega=1.7, zeta=0.3, lag=0.8, rate=False, rho=3.0)
GAPS = np.array([*np.random.default_rng(7).uniform(0.05, 0.4, 7), *[0.5] * 60, 0.8, 0.5, 0.5, 0.2, 0.2, 0.9])
"""Uneven; even for so long that the gain is taken for the one it keeps; and uneven again."""


@pytest.mark.parametrize("rate", [False, True])
def test_a_narrow_band_is_whitened_by_its_covariance(rate: bool) -> None:
    """The triangular root of the covariance of all samples whitens them."""
    law, t = replace(LAW, rate=rate), np.concatenate([[3.0], 3.0 + np.cumsum(GAPS)])
    L = cholesky(covariance_of(law, t), lower=True)
    columns = np.random.default_rng(8).normal(size=(len(t), 2))
    E, deviation = whitened(law, t, columns)
    assert deviation == pytest.approx(np.diag(L), rel=1e-8)
    assert pytest.approx(np.linalg.solve(L, columns), abs=1e-8) == E
    kept = [i for i in range(1, len(t)) if deviation[i] == deviation[i - 1]]
    assert kept[0] > SETTLED_AT, "a gain is kept after so many samples only"
    assert len(kept) > 3


@pytest.mark.parametrize("fade", [0.05, 1.0 / LAW.lag])
@pytest.mark.parametrize("rate", [False, True])
def test_a_narrow_band_with_a_slow_force_is_whitened_by_its_covariance(rate: bool, fade: float) -> None:
    """The second decay rate is that of the craft, which the filter keeps apart by two thousandths."""
    law, t = replace(LAW, rate=rate, slow=2.0, fade=fade), np.concatenate([[3.0], 3.0 + np.cumsum(GAPS)])
    L = cholesky(covariance_of(law, t), lower=True)
    columns = np.random.default_rng(8).normal(size=(len(t), 2))
    E, deviation = whitened(law, t, columns)
    assert deviation == pytest.approx(np.diag(L), rel=3e-3)
    assert pytest.approx(np.linalg.solve(L, columns), abs=1e-2) == E


def test_the_drift_of_waves_is_a_slow_force_of_the_same_size_in_speed_and_position() -> None:
    """Per lag squared, its variance is that of the wave force times the square of the ratio."""
    for rate in (False, True):
        law = replace(LAW, rate=rate).drifting(0.5)
        waves = law.omega**2 * law.rho / (1.0 - law.share if rate else law.share)
        assert law.slow / law.lag**2 == pytest.approx(0.25 * waves)
        assert law.fade == 2.0 * law.zeta * law.omega


@pytest.mark.parametrize("rate", [False, True])
def test_a_gain_that_settles_within_a_few_samples_matches_the_covariance(rate: bool) -> None:
    quick, even = Oscillator(omega=9.0, zeta=0.9, lag=0.1, rate=rate, rho=3.0), np.arange(26.0)
    found = whitened(quick, even, np.zeros((26, 1)))[1]
    assert found == pytest.approx(np.diag(cholesky(covariance_of(quick, even), lower=True)), rel=1e-8)


@pytest.mark.parametrize("rate", [False, True])
def test_the_likelihood_of_several_records_uses_the_best_noise_level(rate: bool) -> None:
    law, rng = replace(LAW, rate=rate), np.random.default_rng(9)
    records = [(np.cumsum(rng.uniform(0.1, 0.5, n)), rng.normal(size=n)) for n in (5, 9)]
    square, logs = 0.0, 0.0
    for t, error in records:
        C = covariance_of(law, t)
        square += error @ np.linalg.solve(C, error)
        logs += np.linalg.slogdet(C)[1]
    assert cost(law, records) == pytest.approx(14 * np.log(square / 14) + logs)
    plain = sum(error @ error for _, error in records)
    assert cost(None, records) == pytest.approx(14 * np.log(plain / 14))
    assert cost(None, [(np.arange(3.0), np.zeros(3))]) == pytest.approx(3 * np.log(1e-300)), "an error of none"
    assert cost(None, []) == 0.0


@pytest.mark.parametrize(("zeta", "damped"), [(0.0, 0.03), (0.02, 0.03), (0.2, 0.2)])
def test_ringing_has_a_damping_ratio_of_at_least_0_03(zeta: float, damped: float) -> None:
    t, push = 0.4 * np.arange(6), np.array([0.3, 1.0, -1.0, 0.0, 0.5, 2.0])
    found = driven(replace(LAW, zeta=zeta), t, push)
    assert np.array_equal(found, rung(LAW.omega, damped, t, push))
