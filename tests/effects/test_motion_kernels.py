"""The compiled small parts of effects, each against its definition: quick enough with the compiler switched off."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import cholesky, expm, solve_continuous_lyapunov

from gcs_autotune.effects import rung
from gcs_autotune.effects.actuator import play
from gcs_autotune.effects.kernels import SETTLED, earlier, fading, following, limited
from gcs_autotune.effects.narrow_band import Oscillator, whitened

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
        asked = 2.0 * np.sqrt(d * time_constant / resolution) * -np.expm1(-(until - begin) / (2.0 * time_constant))
        inside = np.sum((stamps[:-1] >= begin) & (stamps[:-1] < until))
        assert inside == max(1, int(np.ceil(asked - 1e-9)))


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


def test_play_is_dragged_along_by_its_flanks() -> None:
    u = np.array([0.0, 0.3, 1.0, 0.8, 0.2, -1.0, -0.9, 0.0])
    assert play(u, 0.25) == pytest.approx([0.0, 0.05, 0.75, 0.75, 0.45, -0.75, -0.75, -0.25])
    assert play(u, 0.0) == pytest.approx(u)


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.37])
def test_a_smooth_motion_a_moment_ago_is_exact_for_a_cubic_on_uneven_stamps(delay: float) -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.06, 0.14, 60))

    def cubic(at: np.ndarray) -> np.ndarray:
        return 0.4 * at**3 - at**2 + 0.5 * at - 2.0

    found = earlier(t, cubic(t), delay, coasting=False)
    inside = t - delay > t[0]
    assert inside.sum() > 50
    assert found[inside] == pytest.approx(cubic(t - delay)[inside], abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_kink_at_a_stamp_does_not_ring(sign: float) -> None:
    t = 0.1 * np.arange(60)
    motion = sign * np.abs(t - 3.0)
    found = earlier(t, motion, 0.04, coasting=False)
    assert found[1:] == pytest.approx(sign * np.abs(t - 0.04 - 3.0)[1:], abs=1e-6)


def test_before_the_first_stamp_a_position_coasts_and_a_velocity_holds() -> None:
    t = 1.0 + 0.1 * np.arange(30)
    parabola = 2.0 + 3.0 * (t - 1.0) + 0.5 * (t - 1.0) ** 2
    assert earlier(t, parabola, 0.25, coasting=True)[:2] == pytest.approx([2.0 - 0.75, 2.0 - 0.45])
    assert earlier(t, parabola, 0.25, coasting=False)[:2] == pytest.approx([2.0, 2.0])


def test_stamps_that_nearly_coincide_are_passed_over_and_few_are_joined_by_lines() -> None:
    t = np.sort(np.append(0.1 * np.arange(40), 2.001))
    motion = np.sin(t)
    spoilt = motion + np.where(t == 2.001, 0.5, 0.0)
    assert earlier(t, spoilt, 0.05, coasting=False)[5:] == pytest.approx(np.sin(t - 0.05)[5:], abs=1e-4)
    twice = np.sort(np.append(0.1 * np.arange(40), 2.0))
    assert earlier(twice, np.sin(twice), 0.05, coasting=False)[5:] == pytest.approx(np.sin(twice - 0.05)[5:], abs=1e-4)
    assert earlier(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 0.0]), 0.5, coasting=False) == pytest.approx(
        [0.0, 1.0, 1.0]
    )


@pytest.mark.parametrize(("omega", "zeta"), [(2.0, 0.1), (5.0, 0.7)])
def test_a_spring_under_held_pushes_swings_as_an_integrator_says(omega: float, zeta: float) -> None:
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


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("even", [False, True])
def test_a_narrow_band_is_whitened_as_its_covariance_says(rate: bool, even: bool) -> None:
    """The covariance of all samples at once, from a Lyapunov equation; its triangular root whitens them."""
    law = Oscillator(omega=1.7, zeta=0.15, lag=0.8, rate=rate, rho=3.0)
    rng = np.random.default_rng(7)
    n = 16
    t = 0.2 * np.arange(n) if even else np.cumsum(rng.uniform(0.05, 0.4, n))
    A = np.array(
        [
            [0.0, law.omega, 0.0],
            [-law.omega, -2.0 * law.zeta * law.omega, 0.0],
            [1.0 / law.lag, 0.0, -1.0 / law.lag],
        ]
    )
    drive = np.zeros((3, 3))
    drive[1, 1] = 1.0
    stationary = solve_continuous_lyapunov(A, -drive)
    seen = np.array([1.0, 0.0, -1.0]) if rate else np.array([0.0, 0.0, 1.0])
    stationary *= law.rho / (seen @ stationary @ seen)
    C = np.eye(n)
    for i in range(n):
        for j in range(i + 1):
            C[i, j] += seen @ expm(A * (t[i] - t[j])) @ stationary @ seen
            C[j, i] = C[i, j]
    L = cholesky(C, lower=True)
    columns = rng.normal(size=(n, 2))
    E, deviation = whitened(law, t, columns)
    assert deviation == pytest.approx(np.diag(L), rel=1e-8)
    assert pytest.approx(np.linalg.solve(L, columns), abs=1e-8) == E
