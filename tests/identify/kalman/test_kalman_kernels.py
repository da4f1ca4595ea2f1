"""The filter's kernels one by one against the same algebra with whole matrices: small enough to run uncompiled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.identify.kalman import sweep, transition
from gcs_autotune.identify.kalman.sweep import FilterHistory, backward, forward, new_history
from gcs_autotune.identify.kalman.transition import inertia, measure, sigma_step, step
from gcs_autotune.models import INPUT, NU_SIZE, Program, Scratch, carry
from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.kernel import NU

Array = NDArray[np.float64]


def ints(*values: Any) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


# A boat: parameters are drag, yaw drag, delay, current north, current east, coupling of the masses, mass.
BOAT = Program(
    active=ints(0, 1, 5),
    column=ints(3, 4, -1, -1, -1, 5, 0, 1, -1, -1, -1, 2),
    rows=ints(0, 1, 5, 0, 5),
    pars=ints(0, 0, 1, -1, -1),
    scales=ints(-1, -1, -1, -1, -1),
    coefs=np.array([-1.0, -2.0, -1.0, 1.0, 1.0]),
    factors=ints((NU, NU_SIZE, -1), (NU + 1, -1, -1), (NU + 5, -1, -1), (INPUT, -1, -1), (INPUT + 1, -1, -1)),
    inertia=ints((0, 0, 6), (1, 1, -1), (5, 5, -1), (1, 5, 5), (5, 1, 5)),
    inertia_coefs=np.array([1.0, 3.0, 2.0, 0.5, 0.5]),
    delay=2,
    lag=-1,
    current_x=3,
    current_y=4,
    drift_x=-1,
    drift_y=-1,
    reach=-1,
    bottom=-1,
    payload=ints(-1, -1, -1, -1, -1, -1),
    depth=-1,
    coriolis=1,
    spatial=0,
    m=2,
)
THETA = np.array([0.9, 0.6, 0.07, 0.2, -0.3, 0.4, 2.0])
X = np.array([0.3, -0.2, 0.6, 0.8, -0.1, 0.3])
T_IN = np.array([-1.0, 0.2, 0.45, 0.9])
INPUTS = np.array([[0.7, 0.2], [-0.4, 0.5], [0.9, -0.3], [0.1, 0.4]])
N_STATES, PACE = 6, 2.0
NONE = np.full(7, -1, dtype=np.int64)


def masses(theta: Array) -> tuple[Array, Array]:
    M = np.zeros((6, 6))
    M[0, 0], M[1, 1], M[5, 5], M[1, 5], M[5, 1] = theta[6], 3.0, 2.0, 0.5 * theta[5], 0.5 * theta[5]
    active = np.ix_([0, 1, 5], [0, 1, 5])
    return M, np.linalg.inv(M[active])


def moved(x: Array, t: float, stop: float, theta: Array = THETA, pace: float = PACE) -> Array:
    """Return the state at *stop*, by the simulation's own sweep."""
    out = np.zeros((2, N_STATES))
    none = np.zeros((2, N_STATES, 0))
    done, _ = kernel.sweep(
        BOAT, theta, *masses(theta), x, T_IN, INPUTS, np.array([t, stop]), NONE, NONE[:6], pace, 1e4, out, none,
    )  # fmt: skip
    assert done
    return out[1]


@njit
def carried_at_once(
    P: Program, theta: Array, M: Array, M_inverse: Array, x: Array, S: Array, t: float, stop: float, row: int,
    free: NDArray[np.int64], max_rate: float, W: Scratch,
) -> tuple[bool, float, int, float]:  # fmt: skip
    """Call what only compiled functions may call."""
    return carry(P, theta, M, M_inverse, x, S, t, stop, row, T_IN, INPUTS, free, max_rate, transition.MAX_STEPS, W)


def carried(theta: Array, *rest: Any) -> tuple[bool, float, int, float]:
    return carried_at_once(BOAT, theta, *masses(theta), *rest)


def scratch(q: int = 6) -> Scratch:
    return kernel.scratch(6, q)


def differences(function: Any, at: Array, h: float = 1e-6) -> Array:
    return np.stack([(function(at + h * e) - function(at - h * e)) / (2.0 * h) for e in np.eye(len(at))], axis=1)


def covariance(size: int, seed: int = 1) -> Array:
    root = 0.05 * np.random.default_rng(seed).standard_normal((size, size))
    return root @ root.T + 1e-3 * np.eye(size)


def row_at(t: float) -> int:
    return int(np.searchsorted(T_IN + THETA[2], t, side="right")) - 1


@pytest.mark.slow
@pytest.mark.parametrize(("t", "stop"), [(0.0, 0.1), (0.0, 0.27), (0.1, 1.2), (0.97, 1.0)])
def test_a_state_and_its_sensitivities_pass_input_jumps_as_in_a_simulation(t: float, stop: float) -> None:
    free = ints(6, -1, 7, 8, -1, 9, -1)
    x, S = X.copy(), np.eye(6, 10)
    finite, rate, row, spent = carried(THETA, x, S, t, stop, row_at(t), free, 12.0, kernel.scratch(6, 10))
    assert finite and spent == pytest.approx((stop - t) * 12.0 / kernel.REACH)
    assert row == row_at(stop)
    assert x == pytest.approx(moved(X, t, stop, pace=12.0), abs=1e-10)
    assert 0.3 < rate < 5.0
    assert S[:, :6] == pytest.approx(differences(lambda z: moved(z, t, stop, pace=12.0), X), abs=1e-6)
    by_theta = differences(lambda theta: moved(X, t, stop, theta, pace=12.0), THETA)
    assert S[:, 6:][:, [0, 2, 3]] == pytest.approx(by_theta[:, [0, 3, 5]], abs=1e-6)
    if (t, stop) == (0.1, 1.2):
        assert S[:, 7] == pytest.approx(by_theta[:, 2], abs=3e-4)
        assert np.abs(S[:, 7]).max() > 0.05
    y = X.copy()
    without = np.zeros((6, 0))
    carried(THETA, y, without, t, stop, row_at(t), NONE, 12.0, kernel.scratch(6, 0))
    assert y == pytest.approx(x, abs=1e-12)


def test_a_model_too_stiff_or_diverging_is_abandoned() -> None:
    def is_finite(max_rate: float, x: Array = X) -> bool:
        room = np.zeros((6, 0))
        return carried(THETA, x.copy(), room, 0.0, 0.1, 0, NONE, max_rate, kernel.scratch(6, 0))[0]

    assert is_finite(0.999 * transition.MAX_STEPS * kernel.REACH / 0.1)
    assert not is_finite(1.001 * transition.MAX_STEPS * kernel.REACH / 0.1)
    assert (transition.MAX_STEPS, kernel.REACH) == (400, 0.4)
    assert not is_finite(PACE, np.array([2e6, *X[1:]]))
    F, late, x = np.zeros((6, 6)), np.zeros((6, 6)), np.array([2e6, *X[1:]])
    assert not step(BOAT, THETA, *masses(THETA), x, F, late, 0.0, 0.1, 0, T_IN, INPUTS, NONE, PACE, scratch())[0]


@pytest.mark.parametrize("stop", [0.05, 0.15, 0.6, 1.3])
def test_a_step_gives_the_transition_of_the_whole_and_of_its_second_half(stop: float) -> None:
    free = ints(-1, 6, -1, -1, 7, -1, -1)
    x, F, late = X.copy(), np.full((6, 8), 9.0), np.full((6, 6), 9.0)
    finite, rate, row = step(
        BOAT, THETA, *masses(THETA), x, F, late, 0.0, stop, 0, T_IN, INPUTS, free, 12.0, scratch(8)
    )
    assert finite and row == row_at(stop) and rate > 0.0
    assert x == pytest.approx(moved(X, 0.0, stop, pace=12.0), abs=1e-6)
    whole = differences(lambda z: moved(z, 0.0, stop, pace=12.0), X)
    by_theta = differences(lambda theta: moved(X, 0.0, stop, theta, pace=12.0), THETA)
    assert F == pytest.approx(np.hstack([whole, by_theta[:, [1, 4]]]), abs=2e-6)
    if rate * stop < transition.SHORT:  # over a short interval the half is the root of the whole
        assert late @ late == pytest.approx(F[:, :6], abs=2e-5)
    else:
        middle = moved(X, 0.0, 0.5 * stop, pace=12.0)
        half = differences(lambda z: moved(z, 0.5 * stop, stop, pace=12.0), middle)
        assert late == pytest.approx(half, abs=2e-6)
        room, fastest = kernel.scratch(6, 0), []
        for start, begin, end in ((X, 0.0, 0.5 * stop), (middle, 0.5 * stop, stop)):
            fastest.append(
                carried(THETA, start.copy(), np.zeros((6, 0)), begin, end, row_at(begin), NONE, 12.0, room)[1]
            )
        assert rate == pytest.approx(max(fastest), rel=1e-6)


def test_short_and_long_intervals_are_both_tested() -> None:
    assert transition.SHORT == 0.3
    rates = []
    for stop in (0.05, 1.3):
        x, F, late = X.copy(), np.zeros((6, 6)), np.zeros((6, 6))
        rates.append(
            step(BOAT, THETA, *masses(THETA), x, F, late, 0.0, stop, 0, T_IN, INPUTS, NONE, 12.0, scratch())[1] * stop
        )
    assert rates[0] < transition.SHORT < rates[1]


def test_the_inverse_of_the_inertia_and_whether_it_is_positive() -> None:
    M, M_inverse = np.full((6, 6), 9.0), np.full((3, 3), 9.0)
    assert inertia(BOAT, THETA, M, M_inverse)
    assert pytest.approx(masses(THETA)[0]) == M
    assert M_inverse == pytest.approx(masses(THETA)[1], abs=1e-12)
    for place, value in ((6, -0.5), (5, 4.9), (5, 5.0)):
        other = THETA.copy()
        other[place] = value
        assert inertia(BOAT, other, M, M_inverse) is (value == 4.9 and 3.0 * 2.0 > (0.5 * value) ** 2)
        assert M_inverse == pytest.approx(masses(other)[1], rel=1e-9)
    other = THETA.copy()
    other[6] = 0.0
    assert not inertia(BOAT, other, M, M_inverse)
    assert np.all(np.isfinite(M_inverse))


@pytest.mark.parametrize("code", [0, 1, 5, 6, 7, 11])
@pytest.mark.parametrize("current", [(3, 4), (3, -1), (-1, 4), (-1, -1)])
def test_measurements_are_velocity_over_ground_or_position(code: int, current: tuple[int, int]) -> None:
    boat = BOAT._replace(current_x=current[0], current_y=current[1])
    free = ints(-1, -1, -1, 6, 7, -1, -1)

    def output(z: Array) -> Array:
        u, v, r = z[3:6]
        north, east = (z[6] if current[0] >= 0 else 0.0), (z[7] if current[1] >= 0 else 0.0)
        c, s = np.cos(z[2]), np.sin(z[2])
        ground = {0: u + north * c + east * s, 1: v - north * s + east * c, 5: r, 6: z[0], 7: z[1], 11: z[2]}
        return np.array([ground[code]])

    z, H = np.concatenate([X, THETA[3:5]]), np.full(8, 9.0)
    assert measure(boat, THETA, X, code, free, H) == pytest.approx(output(z)[0], abs=1e-12)
    assert pytest.approx(differences(output, z)[0], abs=1e-8) == H
    assert measure(boat, THETA, X, code, NONE, H) == pytest.approx(output(z)[0], abs=1e-12)
    assert not H[6:].any()


def test_the_time_update_of_a_covariance_matches_the_dense_formula() -> None:
    rng = np.random.default_rng(2)
    F, late = rng.standard_normal((3, 6)), rng.standard_normal((3, 3))
    q, h = np.array([0.2, 0.0, 0.5]), 0.7
    walk, decay = np.array([0.1, 0.3, 0.2]), np.array([0.0, 0.9, 2.0])
    kept = np.exp(-decay * h)
    cov = covariance(6)
    whole = np.vstack([F, np.hstack([np.zeros((3, 3)), np.diag(kept)])])
    Q = np.diag(q)
    expected = whole @ cov @ whole.T
    expected[:3, :3] += h / 6.0 * (F[:, :3] @ Q @ F[:, :3].T + 4.0 * late @ Q @ late.T + Q)
    # An Ornstein-Uhlenbeck process that has walked for ever has the variance walk / (2 decay), and keeps it.
    forever = walk[1:] / (2.0 * decay[1:])
    expected[3:, 3:] += np.diag([h * walk[0], *(forever * (1.0 - kept[1:] ** 2))])
    sweep._time_update(cov, F, late, q, walk, decay, h)
    assert cov == pytest.approx(expected, abs=1e-12)


def test_the_measurement_update_of_a_covariance_has_josephs_form() -> None:
    cov, K, H, r = covariance(4), np.array([0.3, -0.2, 0.5, 0.1]), np.array([1.0, 0.0, -0.4, 0.6]), 0.02
    rest = np.eye(4) - np.outer(K, H)
    expected = rest @ cov @ rest.T + r * np.outer(K, K)
    sweep._measurement_update(cov, K, H, r)
    assert cov == pytest.approx(expected, abs=1e-14)
    assert np.array_equal(cov, cov.T)


FREE = ints(6, -1, -1, 7, -1, -1, -1)
FREE_PLACES = ints(0, 3)
Q_STATES = np.array([0.0, 0.0, 0.0, 0.04, 0.02, 0.05])
WALK = np.array([0.01, 0.02])


def test_sigma_points_propagate_mean_and_covariance_by_central_differences() -> None:
    mean, cov, t, stop = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8), 0.1, 0.8
    cov[:, 4] = cov[4, :] = 0.0  # a state that is known
    theta = THETA.copy()

    def ends(z: Array) -> Array:
        own = theta.copy()
        own[FREE_PLACES] = z[6:]
        return moved(z[:6], t, stop, own)

    x, F, late = X.copy(), np.zeros((6, 8)), np.zeros((6, 6))
    step(BOAT, THETA, *masses(THETA), x, F, late, t, stop, row_at(t), T_IN, INPUTS, FREE, PACE, scratch(8))
    kept = [i for i in range(8) if i != 4]
    L = np.zeros((8, 8))
    L[np.ix_(kept, kept)] = np.linalg.cholesky(cov[np.ix_(kept, kept)])
    wide = np.sqrt(3.0)
    plus, minus = (np.array([ends(mean + side * wide * L[:, j]) for j in kept]) for side in (1.0, -1.0))
    bent = plus + minus - 2.0 * x
    expected = cov.copy()
    Q = np.diag(Q_STATES)
    expected[:6, :6] = (plus - minus).T @ (plus - minus) / 12.0 + bent.T @ bent * 2.0 / 36.0
    expected[:6, :6] += 0.7 / 6.0 * (F[:, :6] @ Q @ F[:, :6].T + 4.0 * late @ Q @ late.T + Q)
    expected[:6, 6:] = (plus - minus).T @ L[6:, kept].T / (2.0 * wide)
    expected[6:, :6] = expected[:6, 6:].T
    expected[6:, 6:] += 0.7 * np.diag(WALK)
    better = x + bent.sum(axis=0) / 6.0
    assert np.abs(better - x).max() > 1e-4 < np.abs(bent).max()
    assert sigma_step(
        BOAT,
        theta,
        FREE_PLACES,
        mean,
        cov,
        x,
        F,
        late,
        Q_STATES,
        WALK,
        t,
        stop,
        row_at(t),
        T_IN,
        INPUTS,
        PACE,
        scratch(8),
    )
    assert x == pytest.approx(better, abs=1e-10)
    assert cov == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(("far", "place"), [(9.0, 6), (4e6, 0)], ids=["no positive mass", "runs away"])
def test_a_sigma_point_that_cannot_be_propagated_changes_nothing(far: float, place: int) -> None:
    places = ints(6, 0)
    mean, cov = np.concatenate([X, THETA[places]]), np.diag(np.full(8, 1e-4))
    at = 6 if place == 6 else 3
    cov[at, at] = far**2
    x, before, room = X.copy(), cov.copy(), (np.zeros((6, 8)), np.zeros((6, 6)))
    assert not sigma_step(
        BOAT, THETA, places, mean, cov, x, *room, Q_STATES, WALK, 0.0, 0.1, 0, T_IN, INPUTS, PACE, scratch(8)
    )
    assert np.array_equal(x, X) and np.array_equal(cov, before)


STAMPS = np.array([0.05, 0.2, 0.5, 0.6, 1.1])
CODES = ints(5, 6, 0)
R = np.array([0.02, 0.05, 0.03]) ** 2
DECAY, CONSTANT, CALM = np.array([0.8, 0.0]), np.zeros(2), np.zeros(4)
"""One parameter that returns to zero, one that stays; sigma points know constants only."""
READ = np.array(
    [
        [0.31, np.nan, 0.7],
        [np.nan, 0.45, np.nan],
        [0.28, 0.7, 0.75],
        [np.nan, np.nan, np.nan],
        [0.35, np.nan, 0.6],
    ]
)


def result(r: Array = R, q: Array = Q_STATES, **options: Any) -> tuple[float, FilterHistory, Array, Array]:
    """Run the filter with two free parameters; return what it returns, its history, and where it ended."""
    reference = options.get("reference", np.zeros((0, 6)))
    mean, cov = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8)
    history = new_history(5, 3, 6, 8, full=True)
    given, sigma = options.get("given", (T_IN, INPUTS)), options.get("sigma", False)
    rate = forward(
        BOAT, options.get("theta", THETA), FREE_PLACES, FREE, mean, cov, *given, STAMPS,
        options.get("read", READ), CODES, r, q, WALK, CONSTANT if sigma else DECAY, CALM, reference, sigma, PACE,
        history, scratch(8),
    )  # fmt: skip
    return rate, history, mean, cov


def filtered(reference: Array | None = None, *, sigma: bool = False) -> tuple[list[Any], Array, Array]:
    """Return (innovation, variance, gain, H) of each sample, mean and covariance after each stamp, from the pieces."""
    mean, cov, theta = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8), THETA.copy()
    samples, means, covs = [], [], []
    given = np.concatenate([[0.0] * 6, THETA[FREE_PLACES]])
    for s, stamp in enumerate(STAMPS):
        about = None if reference is None else np.concatenate([reference[s], THETA[FREE_PLACES]])
        if s:
            t = STAMPS[s - 1]
            if reference is None:
                theta[FREE_PLACES] = mean[6:]
            start = mean[:6] if reference is None else reference[s - 1]
            x, F, late = start.copy(), np.zeros((6, 8)), np.zeros((6, 6))
            step(BOAT, theta, *masses(theta), x, F, late, t, stamp, row_at(t), T_IN, INPUTS, FREE, PACE, scratch(8))
            if reference is not None:
                x += F @ (mean - given - np.concatenate([reference[s - 1], [0.0, 0.0]]))
            if not sigma or not sigma_step(
                BOAT, theta, FREE_PLACES, mean, cov, x, F, late, Q_STATES, WALK, t, stamp, row_at(t), T_IN, INPUTS,
                PACE, scratch(8),
            ):  # fmt: skip
                sweep._time_update(cov, F, late, Q_STATES, WALK, DECAY, stamp - t)
                mean[6:] *= np.exp(-DECAY * (stamp - t))
            mean[:6] = x
        for i in np.flatnonzero(np.isfinite(READ[s])):
            H = np.zeros(8)
            if about is None:
                theta[FREE_PLACES] = mean[6:]
                error = READ[s, i] - measure(BOAT, theta, mean[:6], CODES[i], FREE, H)
            else:
                error = READ[s, i] - measure(BOAT, theta, about[:6], CODES[i], FREE, H)
                error -= H @ (mean - about)
            S = H @ cov @ H + R[i]
            K = cov @ H / S
            samples.append(((s, int(i)), error, S, K, H))
            mean, cov = mean + K * error, (np.eye(8) - np.outer(K, H)) @ cov
        means.append(mean.copy())
        covs.append(cov.copy())
    return samples, np.array(means), np.array(covs)


PATH = np.array([moved(X, 0.05, s) if s > 0.05 else X for s in STAMPS])


@pytest.mark.parametrize(
    ("about", "sigma"), [(None, False), (None, True), (PATH, False)], ids=["linearised", "sigma points", "about a path"]
)
def test_a_pass_predicts_and_corrects_sample_by_sample(about: Array | None, sigma: bool) -> None:
    samples, means, covs = filtered(about, sigma=sigma)
    rate, history, mean, cov = result(reference=np.zeros((0, 6)) if about is None else about, sigma=sigma)
    assert 0.3 < rate < 5.0
    assert {at for at, *_ in samples} == {tuple(at) for at in np.argwhere(np.isfinite(history.e)).tolist()}
    for (s, i), error, S, K, H in samples:
        assert history.e[s, i] == pytest.approx(error, abs=1e-6)
        assert history.S[s, i] == pytest.approx(S, rel=1e-6)
        assert history.K[s, i] == pytest.approx(K, abs=1e-6)
        assert history.H[s, i] == pytest.approx(H, abs=1e-6)
    assert history.mean == pytest.approx(means, abs=1e-6)
    assert history.covariance == pytest.approx(covs, abs=1e-7)
    assert np.array_equal(mean, history.mean[-1]) and np.array_equal(cov, history.covariance[-1])


def test_inputs_that_end_before_the_first_sample_are_held() -> None:
    t, inputs = np.array([-2.0, -1.0, -0.5, -0.4]), np.tile(INPUTS[0], (4, 1))
    inputs[2:] = 1e6
    held = result(given=(t[1:2], inputs[1:2]))
    before_others = result(given=(t[:2], inputs[:2]))
    assert before_others[2] == pytest.approx(held[2], rel=1e-12)
    assert before_others[3] == pytest.approx(held[3], rel=1e-12)


def test_a_pass_without_a_full_history_gives_the_same_innovations() -> None:
    _, full, mean, _ = result()
    lean = new_history(5, 3, 6, 8, full=False)
    end, cov = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8)
    forward(
        BOAT, THETA, FREE_PLACES, FREE, end, cov, T_IN, INPUTS, STAMPS, READ, CODES, R, Q_STATES, WALK, DECAY,
        CALM, np.zeros((0, 6)), False, PACE, lean, scratch(8),
    )  # fmt: skip
    assert np.array_equal(lean.e, full.e, equal_nan=True) and np.array_equal(lean.S, full.S, equal_nan=True)
    assert np.array_equal(end, mean)
    assert [len(a) for a in lean] == [0, 0, 0, 0, 5, 5, 0, 0]


def test_a_diverging_pass_reports_the_stamp() -> None:
    for s, i in ((0, 0), (2, 1), (4, 0)):
        read = READ.copy()
        read[s, i] = 1e14
        assert result(read=read)[0] == -1.0 - s if s == 4 else result(read=read)[0] <= -1.0 - s


def test_parameters_stop_before_the_inertia_is_not_positive() -> None:
    theta, places = THETA.copy(), ints(6)
    mean, after = np.append(X, 2.0), np.append(X, -5.0)
    M, M_inverse = np.zeros((6, 6)), np.zeros((3, 3))
    assert sweep._move_parameters(BOAT, theta, places, mean, after, 6, M, M_inverse, True)
    assert theta[6] == after[6] == pytest.approx(0.25)  # -5, -1.5, 0.25: half the way back each time
    assert M[0, 0] == theta[6]
    bad = np.append(X, -5.0)
    assert not sweep._move_parameters(BOAT, theta, places, mean, bad, 6, M, M_inverse, False)
    assert theta[6] == bad[6] == -5.0


def likelihood(r: Array = R, q: Array = Q_STATES) -> float:
    _, history, _, _ = result(r, q, reference=PATH)
    seen = np.isfinite(history.e)
    return float(-0.5 * np.sum(history.e[seen] ** 2 / history.S[seen] + np.log(history.S[seen])))


def test_the_adjoint_gives_the_rts_smoother_and_the_derivatives_by_every_noise_level() -> None:
    _, history, _, _ = result(reference=PATH)
    adjoint, information = np.zeros(8), np.zeros((8, 8))
    smoothed, variances = np.zeros((5, 8)), np.zeros((5, 8))
    by_noise, by_drive = np.ones((2, 3)), np.ones((2, 6))
    backward(STAMPS, R, DECAY, CALM, history, adjoint, information, smoothed, variances, by_noise, by_drive)
    x, P = history.mean[-1], history.covariance[-1]
    assert smoothed[-1] == pytest.approx(x, abs=1e-12)
    for s in range(3, -1, -1):
        kept = np.exp(-DECAY * (STAMPS[s + 1] - STAMPS[s]))
        F = np.vstack([history.F[s + 1], np.hstack([np.zeros((2, 6)), np.diag(kept)])])
        ahead, given = history.covariance[s].copy(), np.concatenate([PATH[s], THETA[FREE_PLACES]])
        h = STAMPS[s + 1] - STAMPS[s]
        sweep._time_update(ahead, history.F[s + 1], history.late[s + 1], Q_STATES, WALK, DECAY, h)
        before = np.concatenate([moved(PATH[s], STAMPS[s], STAMPS[s + 1]), kept * THETA[FREE_PLACES]])
        G = history.covariance[s] @ F.T @ np.linalg.inv(ahead)
        x = history.mean[s] + G @ (x - before - F @ (history.mean[s] - given))
        P = history.covariance[s] + G @ (P - ahead) @ G.T
        assert smoothed[s] == pytest.approx(x, abs=3e-6)  # halves of a long step are shorter steps
        assert variances[s] == pytest.approx(np.diag(P), abs=1e-8)
    for i in range(3):
        h = 1e-4 * R[i] * np.eye(3)[i]
        slope = (likelihood(R + h) - likelihood(R - h)) / (2e-4 * R[i])
        assert 0.5 * (by_noise[0, i] - by_noise[1, i]) == pytest.approx(slope, rel=1e-5)
    for i in range(3, 6):
        h = 1e-4 * Q_STATES[i] * np.eye(6)[i]
        slope = (likelihood(q=Q_STATES + h) - likelihood(q=Q_STATES - h)) / (2e-4 * Q_STATES[i])
        assert 0.5 * (by_drive[0, i] - by_drive[1, i]) == pytest.approx(slope, rel=1e-5)


def test_the_adjoint_of_a_later_record_reaches_back_through_the_parameters() -> None:
    """Two records of one craft: the first's smoothed parameters are those that both leave behind."""
    _, history, mean, cov = result(reference=PATH)
    seen, r = np.array([[0.0] * 6 + [1.0, 0.4]]), 0.01
    S = float(seen[0] @ cov @ seen[0] + r)
    e = 0.3
    adjoint, information = -seen[0] * e / S, np.outer(seen[0], seen[0]) / S
    smoothed, variances = np.zeros((5, 8)), np.zeros((5, 8))
    backward(
        STAMPS, R, DECAY, CALM, history, adjoint, information, smoothed, variances, np.zeros((2, 3)), np.zeros((2, 6))
    )
    K = cov @ seen[0] / S
    assert smoothed[-1] == pytest.approx(mean + K * e, abs=1e-12)
    assert variances[-1] == pytest.approx(np.diag(cov - np.outer(K, seen[0] @ cov)), abs=1e-12)


def test_a_model_without_a_delay_applies_inputs_at_their_stamps() -> None:
    prompt = THETA.copy()
    prompt[2] = 0.0
    means = []
    for boat in (BOAT._replace(delay=-1), BOAT):
        mean, cov = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8)
        forward(
            boat, prompt, FREE_PLACES, FREE, mean, cov, T_IN, INPUTS, STAMPS, READ, CODES, R, Q_STATES, WALK, DECAY,
            CALM, np.zeros((0, 6)), False, PACE, new_history(5, 3, 6, 8, full=False), scratch(8),
        )  # fmt: skip
        means.append(mean)
    assert means[0] == pytest.approx(means[1], abs=1e-12)


def test_a_delay_as_the_first_parameter_delays_the_inputs_as_any_other() -> None:
    """The second input is given before the first sample and arrives after it."""
    turned = ints(2, 1, 0, 3, 4, 5, 6)
    first = BOAT._replace(delay=0, pars=ints(2, 2, 1, -1, -1))
    means = []
    t_in = np.array([-1.0, 0.0, 0.9])
    for boat, theta, places, free, given in (
        (BOAT._replace(delay=-1), THETA, FREE_PLACES, FREE, t_in + THETA[2]),
        (BOAT, THETA, FREE_PLACES, FREE, t_in),
        (first, THETA[turned], ints(2, 3), FREE[turned], t_in),
    ):
        mean, cov = np.concatenate([X, THETA[FREE_PLACES]]), covariance(8)
        forward(
            boat, theta, places, free, mean, cov, given, INPUTS[:3], STAMPS, READ, CODES, R,
            Q_STATES, WALK, DECAY, CALM, np.zeros((0, 6)), False, PACE, new_history(5, 3, 6, 8, full=False), scratch(8),
        )  # fmt: skip
        means.append(mean)
    assert means[1] == pytest.approx(means[0], abs=1e-12)
    assert means[2] == pytest.approx(means[0], abs=1e-12)


def test_a_parameter_step_is_halved_until_the_inertia_is_positive() -> None:
    places = ints(0, 6, 5)
    mean, moved_to = np.concatenate([X, [0.9, 2.0, 0.4]]), np.concatenate([X, [1.7, -1.0, 1.2]])
    theta, M, M_inverse = THETA.copy(), *(a.copy() for a in masses(THETA))
    assert sweep._move_parameters(BOAT, theta, places, mean, moved_to, 6, M, M_inverse, True)
    assert moved_to[6:] == pytest.approx([1.3, 0.5, 0.8])
    assert theta[places] == pytest.approx(moved_to[6:])
    assert pytest.approx(masses(theta)[0]) == M
    stuck = np.concatenate([X, [1.7, -1.0, 1.2]])
    assert not sweep._move_parameters(BOAT, theta, places, mean, stuck, 6, M, M_inverse, False), "it was not before"
    assert stuck[6:].tolist() == [1.7, -1.0, 1.2]
    hopeless = np.concatenate([X, [1.7, -1e30, 1.2]])
    assert sweep._move_parameters(BOAT, theta, places, mean, hopeless, 6, M, M_inverse, True)
    assert hopeless[6:].tolist() == mean[6:].tolist()


@pytest.mark.parametrize("current", [(0, -1), (-1, 0)])
def test_a_current_may_be_the_first_parameter(current: tuple[int, int]) -> None:
    boat = BOAT._replace(current_x=current[0], current_y=current[1])
    along = np.array([np.cos(X[2]), -np.sin(X[2])] if current[0] == 0 else [np.sin(X[2]), np.cos(X[2])])
    for code in (0, 1):
        found = measure(boat, THETA, X, code, NONE, np.zeros(6))
        assert found == pytest.approx(X[3 + code] + THETA[0] * along[code])


@pytest.mark.parametrize(("surge", "least"), [(0.8, 0.1), (40.0, 0.1), (0.8, 2.0)])
def test_steps_with_rates_above_twice_their_pace_are_repeated_and_the_pace_adapts(surge: float, least: float) -> None:
    """Again at 1.2 times the rate met (four times the pace where the motion ran away); then 1.5 times a rate above the
    pace, or 0.7 of the pace, and never below the least."""
    stamps = np.array([0.05, 0.5, 0.9, 1.6, 1.7])
    start = np.concatenate([X[:3], [surge], X[4:]])
    mean, cov, history = start.copy(), covariance(6), new_history(5, 3, 6, 6, full=True)
    fastest = forward(
        BOAT, THETA, ints(), NONE, mean, cov, T_IN, INPUTS, stamps, np.full((5, 3), np.nan), CODES, R, Q_STATES,
        np.zeros(0), np.zeros(0), CALM, np.zeros((0, 6)), False, least, history, scratch(6),
    )  # fmt: skip
    pace, x, met, again, lost = least, start, 0.0, 0, 0
    for s in range(1, 5):
        for _ in range(8):
            y, F, late = x.copy(), np.zeros((6, 6)), np.zeros((6, 6))
            finite, rate, _ = step(
                BOAT, THETA, *masses(THETA), y, F, late, stamps[s - 1], stamps[s], row_at(stamps[s - 1]), T_IN,
                INPUTS, NONE, pace, scratch(6),
            )  # fmt: skip
            if finite and rate <= 2.0 * pace:
                break
            again, lost = again + 1, lost + (not finite)
            pace = 1.2 * rate if finite else 4.0 * pace
        x, met = y, max(met, rate)
        pace = max(least, 1.5 * rate if rate > pace else 0.7 * pace)
        assert history.mean[s] == pytest.approx(x, abs=1e-11, rel=1e-11)
    assert fastest == pytest.approx(met, rel=1e-9)
    assert (again > 0) is (least < 1.0) and (lost > 0) is (surge > 1.0)


def test_a_craft_without_a_heading_points_north() -> None:
    column = BOAT.column.copy()
    column[11] = -1
    boat, free = BOAT._replace(column=column), ints(-1, -1, -1, 6, 7, -1, -1)
    for code, current, own in ((0, 3, 6), (1, 4, 7)):
        H, wanted = np.full(8, 9.0), np.zeros(8)
        wanted[[3 + code, own]] = 1.0
        assert measure(boat, THETA, X, code, free, H) == pytest.approx(X[3 + code] + THETA[current])
        assert np.array_equal(H, wanted)
