"""The coupled kernel against its equations written down once more with matrices: small enough to run uncompiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.models import (
    COS_PSI,
    ETA,
    INPUT,
    INPUT_SIZE,
    NEAR,
    NU_SIZE,
    SIN_PHI,
    SIN_PSI,
    SIN_THETA,
    Program,
    balance_of,
)
from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.kernel import NU

Array = NDArray[np.float64]

# Tested in and by the kernel: longest step times the fastest rate; where a motion is given up.
LONGEST, FAR = 0.4, 1e6


def program(
    active: list[int],
    terms: list[tuple[Any, ...]],
    inertia: list[tuple[Any, ...]],
    payload: tuple[int, ...] = 6 * (-1,),
    **places: int,
) -> Program:
    """Return a program of terms (row, parameter, second, coefficient, factors), inertia (row, column, par, coef)."""
    k = len(active)
    column = np.full(12, -1, dtype=np.int64)
    for i, d in enumerate(active):
        column[6 + d], column[d] = i, k + i
    factors = np.full((len(terms), 3), -1, dtype=np.int64)
    for t, term in enumerate(terms):
        factors[t, : len(term[4])] = term[4]
    absent = dict.fromkeys(
        ("delay", "lag", "current_x", "current_y", "drift_x", "drift_y", "reach", "bottom", "depth"), -1
    )
    return Program(
        np.array(active, dtype=np.int64),
        column,
        np.array([t[0] for t in terms], dtype=np.int64),
        np.array([t[1] for t in terms], dtype=np.int64),
        np.array([t[2] for t in terms], dtype=np.int64),
        np.array([t[3] for t in terms], dtype=np.float64),
        factors,
        np.array([e[:3] for e in inertia], dtype=np.int64),
        np.array([e[3] for e in inertia], dtype=np.float64),
        payload=np.array(payload, dtype=np.int64),
        **{"coriolis": 0, "spatial": 0, "m": 1, **absent, **places},
    )


@dataclass
class Case:
    """A program at one point, everything of it away from zero."""

    P: Program
    theta: Array
    x: Array
    u: Array

    @property
    def k(self) -> int:
        return len(self.P.active)


SPATIAL = Case(
    program(
        [0, 1, 2, 3, 4, 5],
        [
            (0, 0, -1, -1.5, (NU + 0, NU_SIZE + 0)),
            (1, 1, 2, 0.7, (NU + 1, NU_SIZE + 5, NU + 3)),
            (2, 3, -1, -1.0, (SIN_PHI,)),
            (3, 4, -1, 2.0, (SIN_THETA, NU_SIZE + 4)),
            (4, -1, 5, 1.2, (NEAR, NU + 2)),
            (5, 6, -1, 1.0, (INPUT + 1,)),
            (0, 7, 0, 0.4, (INPUT_SIZE + 1, INPUT + 1)),
            (2, -1, -1, 0.3, (ETA + 2,)),
            (5, 7, -1, -0.6, (SIN_PSI, COS_PSI)),
            (1, 3, -1, 0.8, ()),
            (4, 6, -1, 0.5, (INPUT_SIZE,)),
        ],
        [
            *((d, d, -1, 8.0 + d) for d in range(6)),
            (0, 0, 8, -1.0),
            (1, 5, 9, 0.5),
            (5, 1, 9, 0.5),
            (2, 4, -1, 0.4),
            (3, 3, 8, 0.3),
        ],
        lag=10,
        current_x=11,
        current_y=12,
        drift_x=13,
        drift_y=14,
        reach=15,
        bottom=16,
        payload=(0, 1, 0, 0, -1, 1),
        coriolis=1,
        spatial=1,
        m=2,
    ),
    np.array([1.1, -0.8, 0.6, 0.9, -1.2, 0.7, 1.3, -0.5, 0.4, 0.6, 0.35, 0.2, -0.3, 0.15, 0.25, 1.7, 2.2]),
    np.array([0.3, -0.4, 1.1, 0.2, -0.35, 0.6, 0.9, -0.7, 0.5, -0.6, 0.45, 0.8, 1.2, -0.65]),
    np.array([1.4, -0.9]),
)
FLAT = Case(
    program(
        [0, 1, 5],
        [
            (0, 0, -1, -1.0, (NU + 0, NU_SIZE + 0)),
            (1, 1, -1, -1.0, (NU + 1,)),
            (5, 2, -1, -1.0, (NU_SIZE + 5, NU + 5)),
            (0, 3, -1, 1.0, (INPUT,)),
            (5, 3, 4, 0.5, (INPUT_SIZE, INPUT)),
            (1, 4, -1, 0.7, (NEAR,)),
            (5, -1, -1, 0.1, (ETA + 5,)),
            (1, -1, -1, 0.2, (ETA + 0,)),
        ],
        [(0, 0, 5, 1.0), (1, 1, 6, 1.0), (5, 5, -1, 2.5), (1, 5, 7, 1.0)],
        current_y=8,
        drift_x=9,
        reach=10,
        bottom=11,
        delay=12,
        depth=1,
        coriolis=1,
        m=2,
    ),
    np.array([0.8, 0.9, 0.5, 1.1, -0.6, 3.0, 4.0, 0.3, 0.25, -0.2, 1.4, 2.0, 0.13]),
    np.array([0.2, -0.3, 0.7, 0.9, -0.4, 0.5]),
    np.array([-0.8, 1.2]),
)
HEAVE = Case(
    program(
        [0, 2],
        [
            (0, 0, -1, -1.0, (NU,)),
            (2, 0, 1, -1.0, (NU + 2, NU_SIZE + 2)),
            (2, -1, -1, 1.0, (INPUT,)),
            (2, -1, -1, 0.2, (ETA + 2,)),
        ],
        [(0, 0, -1, 2.0), (2, 2, -1, 3.0)],
        current_x=2,
        drift_y=1,
        depth=0,
    ),
    np.array([0.6, 0.9, 0.4]),
    np.array([0.1, 0.2, -0.5, -0.7]),
    np.array([0.5]),
)
PITCHLESS = Case(HEAVE.P._replace(coriolis=1), HEAVE.theta, HEAVE.x, HEAVE.u)
"""The degrees of freedom that are missing would turn its momenta."""
CASES = {"spatial": SPATIAL, "flat": FLAT, "heave": HEAVE, "pitchless": PITCHLESS}


def matrix(P: Program, theta: Array) -> Array:
    M = np.zeros((6, 6))
    for (row, col, par), coef in zip(P.inertia, P.inertia_coefs, strict=True):
        M[row, col] += coef * (theta[par] if par >= 0 else 1.0)
    return M


def force(P: Program, theta: Array, nu: Array, eta: Array, u: Array, acting: Array) -> Array:
    reach = theta[P.reach] if P.reach >= 0 else 1.0
    bottom = theta[P.bottom] if P.bottom >= 0 else 0.0

    def factor(code: int) -> float:
        if code >= INPUT_SIZE:
            return abs(acting[code - INPUT_SIZE])
        if code >= INPUT:
            return acting[code - INPUT]
        fixed = {
            SIN_PHI: np.sin(eta[3]),
            SIN_THETA: np.sin(eta[4]),
            SIN_PSI: np.sin(eta[5]),
            COS_PSI: np.cos(eta[5]),
            NEAR: np.exp(min((eta[2] - bottom) / reach, 50.0)),
        }
        return float([*nu, *np.abs(nu), *eta][code] if code < SIN_PHI else fixed[code])

    F = np.zeros(6)
    for t in range(len(P.rows)):
        product = P.coefs[t] * np.prod([factor(c) for c in P.factors[t] if c >= 0])
        for par in (P.pars[t], P.scales[t]):
            product *= theta[par] if par >= 0 else 1.0
        F[P.rows[t]] += product
    return F / np.array([u[i] if i >= 0 else 1.0 for i in P.payload])


def rates(P: Program, theta: Array, x: Array, u: Array) -> Array:
    """Return the state's rate, by Fossen's vectors: rotation matrices, cross products of momenta, solve."""
    k = len(P.active)
    full = np.array([x[c] if c >= 0 else 0.0 for c in P.column])
    nu, eta = full[:6], full[6:].copy()
    if P.depth >= 0 and P.column[8] < 0:
        eta[2] = u[P.depth]
    acting = x[2 * k :] if P.lag >= 0 else u
    F = force(P, theta, nu, eta, u, acting)
    M = matrix(P, theta)
    if P.coriolis:
        a, b = np.split(M @ nu, 2)
        v, w = np.split(nu, 2)
        F -= np.concatenate([np.cross(w, a), np.cross(v, a) + np.cross(w, b)])
    inside = np.ix_(P.active, P.active)
    nu_dot = np.linalg.solve(M[inside], F[P.active])
    (sp, st, sn), (cp, ct, cn) = np.sin(eta[3:]), np.cos(eta[3:])
    R_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    R_y = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    R_z = np.array([[cn, -sn, 0], [sn, cn, 0], [0, 0, 1]])
    T = np.array([[1, sp * st / ct, cp * st / ct], [0, cp, -sp], [0, sp / ct, cp / ct]])
    eta_dot = np.concatenate([R_z @ R_y @ R_x @ nu[:3], T @ nu[3:]])
    for row, pars in ((0, (P.current_x, P.drift_x)), (1, (P.current_y, P.drift_y))):
        eta_dot[row] += sum(theta[par] for par in pars if par >= 0)
    lag = (u - acting) / theta[P.lag] if P.lag >= 0 else np.zeros(0)
    return np.concatenate([eta_dot[P.active], nu_dot, lag])


def differences(function: Callable[[Array], Array], at: Array, h: float = 1e-6) -> Array:
    """Return the derivatives (n, len(at)) of *function* by central differences."""
    return np.stack([(function(at + h * e) - function(at - h * e)) / (2.0 * h) for e in np.eye(len(at))], axis=1)


def inverse(P: Program, theta: Array) -> Array:
    return np.linalg.inv(matrix(P, theta)[np.ix_(P.active, P.active)])


@njit
def at_once(
    P: Program, theta: Array, M: Array, M_inverse: Array, x: Array, u: Array,
    free: NDArray[np.int64], deriv: bool, f: Array, A: Array, B: Array, W: kernel.Scratch,
) -> None:  # fmt: skip
    """Call what only compiled functions may call."""
    kernel.evaluate(P, theta, M, M_inverse, x, u, free, deriv, f, A, B, W)


def evaluated(case: Case, free: NDArray[np.int64], q: int, *, deriv: bool) -> tuple[Array, Array, Array]:
    n = len(case.x)
    f, A, B = np.full(n, 7.0), np.full((n, n), 7.0), np.full((n, q), 7.0)
    M = matrix(case.P, case.theta)
    W = kernel.scratch(n, q)
    at_once(case.P, case.theta, M, inverse(case.P, case.theta), case.x, case.u, free, deriv, f, A, B, W)
    return f, A, B


@pytest.mark.parametrize("name", CASES)
def test_rates_and_derivatives_match_the_equations(name: str) -> None:
    case = CASES[name]
    P, p = case.P, len(case.theta)
    f, A, B = evaluated(case, np.arange(p), p, deriv=True)
    assert f == pytest.approx(rates(P, case.theta, case.x, case.u), abs=1e-12)
    assert pytest.approx(differences(lambda x: rates(P, case.theta, x, case.u), case.x), abs=1e-7) == A
    by_theta = differences(lambda theta: rates(P, theta, case.x, case.u), case.theta)
    assert pytest.approx(by_theta, abs=1e-7) == B


@pytest.mark.parametrize("name", CASES)
def test_fixed_parameters_do_not_move_the_columns_of_others(name: str) -> None:
    case = CASES[name]
    p = len(case.theta)
    _, _, every = evaluated(case, np.arange(p), p, deriv=True)
    for required in (range(0, p, 2), range(1, p, 2), range(0)):
        free = np.full(p, -1, dtype=np.int64)
        for column, par in enumerate(required):
            free[par] = len(required) - 1 - column
        _, _, some = evaluated(case, free, len(required), deriv=True)
        assert some == pytest.approx(every[:, list(required)[::-1]], abs=1e-12)


def test_the_factor_codes_match_the_kernel() -> None:
    codes = (NU, NU_SIZE, ETA, SIN_PHI, SIN_THETA, SIN_PSI, COS_PSI, NEAR, INPUT, INPUT_SIZE)
    assert codes == (0, 6, 12, 18, 19, 20, 21, 22, 30, 60)


PLACES = ("delay", "lag", "current_x", "current_y", "drift_x", "drift_y", "reach", "bottom")


def with_first(case: Case, place: str) -> tuple[Case, NDArray[np.int64]]:
    """Return the same with the parameter of a *place* before all others, and where each parameter now is (p,)."""
    P, at = case.P, getattr(case.P, place)
    turned = np.arange(len(case.theta))
    if at > 0:
        turned[[0, at]] = at, 0
    moved = np.append(turned, -1)  # what is absent stays so
    inertia = P.inertia.copy()
    inertia[:, 2] = moved[inertia[:, 2]]
    indices = {n: int(moved[getattr(P, n)]) for n in PLACES}
    program = P._replace(pars=moved[P.pars], scales=moved[P.scales], inertia=inertia, **indices)
    return Case(program, case.theta[turned], case.x, case.u), turned


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", CASES)
def test_the_order_of_parameters_does_not_matter(name: str, place: str) -> None:
    case = CASES[name]
    at, p = getattr(case.P, place), len(case.theta)
    first, turned = with_first(case, place)
    f, A, B = evaluated(first, np.arange(p), p, deriv=True)
    g, C, D = evaluated(case, np.arange(p), p, deriv=True)
    assert (at <= 0) or getattr(first.P, place) == 0
    assert f == pytest.approx(g, abs=1e-12) and pytest.approx(C, abs=1e-12) == A
    assert B[:, turned] == pytest.approx(D, abs=1e-12)


def test_a_sweep_is_the_same_with_the_delay_as_the_first_parameter() -> None:
    p, found = len(FLAT.theta), []
    first, turned = with_first(FLAT, "delay")
    assert first.P.delay == 0
    for case in (first, FLAT):
        X, S = np.zeros((len(T_OUT), 6)), np.zeros((len(T_OUT), 6, p))
        kernel.sweep(
            case.P, case.theta, matrix(case.P, case.theta), inverse(case.P, case.theta), case.x, T_IN, INPUTS, T_OUT,
            np.arange(p), np.full(6, -1), 1.5, 1e3, X, S,
        )  # fmt: skip
        found.append((X, S))
    assert found[0][0] == pytest.approx(found[1][0], abs=1e-12)
    assert found[0][1][:, :, turned] == pytest.approx(found[1][1], abs=1e-11)
    assert np.abs(found[0][1][-1, :, 0]).max() > 0.05, "by the delay"


@pytest.mark.parametrize("name", CASES)
def test_an_evaluation_without_derivatives_gives_only_the_same_rate(name: str) -> None:
    case = CASES[name]
    p = len(case.theta)
    f, A, B = evaluated(case, np.arange(p), p, deriv=False)
    assert f == pytest.approx(rates(case.P, case.theta, case.x, case.u), abs=1e-12)
    assert np.all(A == 7.0) and np.all(B == 7.0)


def test_nearness_is_limited_far_below_the_bottom() -> None:
    below = Case(FLAT.P, FLAT.theta, FLAT.x, np.array([-0.8, 500.0]))
    f, _, _ = evaluated(below, np.full(13, -1), 1, deriv=False)
    assert f == pytest.approx(rates(FLAT.P, FLAT.theta, FLAT.x, below.u), rel=1e-12)


def runge_kutta(case: Case, theta: Array, x: Array, u: Array, span: float, pace: float) -> Array:
    steps = max(int(np.ceil(span * pace / LONGEST)), 1)
    h = span / steps
    for _ in range(steps):
        a = rates(case.P, theta, x, u)
        b = rates(case.P, theta, x + 0.5 * h * a, u)
        c = rates(case.P, theta, x + 0.5 * h * b, u)
        d = rates(case.P, theta, x + h * c, u)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return x


def swept(case: Case, t_in: Array, inputs: Array, t_out: Array, **options: Any) -> tuple[bool, float, Array, Array]:
    """Sweep with all parameters but the first and all initial states but the second free."""
    n, p = len(case.x), len(case.theta)
    deriv, pace, most = options.get("deriv", True), options.get("pace", 1.5), options.get("most", 1e3)
    theta = options.get("theta", case.theta)
    free = np.arange(p) - 1 if deriv else np.full(p, -1)
    states = np.full(n, -1)
    states[[i for i in range(n) if i != 1]] = p - 1 + np.arange(n - 1)
    X, S = np.zeros((len(t_out), n)), np.zeros((len(t_out), n, p + n - 2 if deriv else 0))
    M = matrix(case.P, theta)
    done, fastest = kernel.sweep(
        case.P, theta, M, inverse(case.P, theta), case.x, t_in, inputs, t_out,
        free, states, pace, most, X, S, options.get("abandon_rate", np.inf),
    )  # fmt: skip
    return done, fastest, X, S


T_IN = np.array([-1.0, -0.2, -0.05, 0.31, 0.31, 0.57, 0.6, 2.0])
INPUTS = np.array([[9.0, 9.0], [0.6, 1.2], [0.8, 1.15], [-0.4, 1.3], [0.9, 1.1], [0.2, 1.25], [-0.7, 1.4], [5.0, 9.0]])
T_OUT = np.array([0.0, 0.1, 0.7, 0.73, 0.9])


def held(t: float, delay: float) -> Array:
    return INPUTS[max(int(np.searchsorted(T_IN + delay, t, side="right")) - 1, 0)]


def by_pieces(case: Case, theta: Array, x: Array, pace: float) -> Array:
    """Return the states at ``T_OUT``: from jump to jump and stamp to stamp."""
    delay = theta[case.P.delay] if case.P.delay >= 0 else 0.0
    found, t = [x], T_OUT[0]
    for stamp in T_OUT[1:]:
        for stop in [*sorted({j for j in T_IN + delay if t < j < stamp}), stamp]:
            x, t = runge_kutta(case, theta, x, held(t, delay)[: case.P.m], stop - t, pace), stop
        found.append(x)
    return np.array(found)


@pytest.mark.parametrize("pace", [1.5, 6.0])
def test_a_sweep_takes_runge_kutta_steps_between_jumps_and_stamps(pace: float) -> None:
    expected = by_pieces(FLAT, FLAT.theta, FLAT.x, pace)
    for deriv in (True, False):
        done, fastest, X, S = swept(FLAT, T_IN, INPUTS, T_OUT, pace=pace, deriv=deriv)
        assert done
        assert pytest.approx(expected, abs=1e-11) == X
        assert fastest > 0.3
        assert deriv or not S.any()
    assert pytest.approx(FLAT.x) == X[0]


def test_sensitivities_are_abandoned_above_a_rate_and_the_motion_continues() -> None:
    done, fastest, X, S = swept(FLAT, T_IN, INPUTS, T_OUT)
    again = swept(FLAT, T_IN, INPUTS, T_OUT, abandon_rate=0.99 * fastest)
    assert again[:2] == (done, fastest)
    assert np.array_equal(again[2], X)
    assert S[-1].any() and not again[3][-1].any()
    assert np.array_equal(swept(FLAT, T_IN, INPUTS, T_OUT, abandon_rate=fastest)[3], S)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["flat", "heave"])
def test_sensitivities_of_a_sweep_match_differences_including_the_delay(name: str) -> None:
    case = CASES[name]
    n, p = len(case.x), len(case.theta)
    _, _, _, S = swept(case, T_IN, INPUTS[:, : case.P.m].copy(), T_OUT, pace=12.0)
    assert not S[0, :, : p - 1].any()
    assert S[0, :, p - 1 :] == pytest.approx(np.delete(np.eye(n), 1, axis=1))
    by_theta = differences(lambda theta: by_pieces(case, theta, case.x, 12.0)[-1], case.theta)
    by_x = differences(lambda x: by_pieces(case, case.theta, x, 12.0)[-1], case.x)
    late = case.P.delay if case.P.delay >= 0 else p
    plain = [par for par in range(1, p) if par != late]
    assert S[-1, :, [par - 1 for par in plain]].T == pytest.approx(by_theta[:, plain], abs=1e-6)
    if late < p:  # a delay moves the steps as well
        assert S[-1, :, late - 1] == pytest.approx(by_theta[:, late], abs=2e-4)
        assert np.abs(by_theta[:, late]).max() > 0.05
    assert S[-1, :, p - 1 :] == pytest.approx(np.delete(by_x, 1, axis=1), abs=1e-6)


def test_an_input_that_arrives_at_the_first_stamp_acts_from_then_on() -> None:
    """One that arrives a little earlier gives the same; one a little later has a part in the delay's sensitivity."""
    delay = FLAT.theta[FLAT.P.delay]
    found = []
    for ahead in (1e-3, 0.0, -1e-6):
        t_in = np.array([-9.0, -delay - ahead])
        found.append(swept(FLAT, t_in, INPUTS[1:3], T_OUT, pace=12.0)[2:])
    (early, S_early), (exact, S_exact), (late, S_late) = found
    assert pytest.approx(early, abs=1e-12) == exact
    assert S_exact == pytest.approx(S_early, abs=1e-12)
    assert late[-1] == pytest.approx(exact[-1], abs=1e-5)
    assert np.abs(S_late[-1] - S_exact[-1]).max() > 0.01


@pytest.mark.parametrize("pace", [2.0, 0.0])
def test_one_span_returns_state_sensitivities_and_the_fastest_initial_rate(pace: float) -> None:
    case, span = HEAVE, 0.9
    free, states = np.arange(3), np.full(4, -1)
    X, S_out = np.empty((2, 4)), np.empty((2, 4, 3))
    done, fastest = kernel.sweep(
        case.P, case.theta, matrix(case.P, case.theta), inverse(case.P, case.theta), case.x, np.zeros(1), case.u[None],
        np.array([0.0, span]), free, states, pace, 1e9, X, S_out,
    )  # fmt: skip
    x, S = X[1], S_out[1]
    assert done
    assert x == pytest.approx(runge_kutta(case, case.theta, case.x, case.u, span, pace), abs=1e-12)
    by_theta = differences(lambda theta: runge_kutta(case, theta, case.x, case.u, span, pace), case.theta)
    assert pytest.approx(by_theta, abs=1e-7) == S
    by_x = differences(lambda state: rates(case.P, case.theta, state, case.u), case.x)
    assert fastest == pytest.approx(np.sqrt(np.abs(by_x * by_x.T)).sum(axis=1).max(), rel=1e-6)


def test_a_motion_that_diverges_or_needs_too_many_steps_is_abandoned() -> None:
    late = np.array([0.0, 0.2, 0.4])
    at = np.array([0.0])
    quiet = np.array([[0.5]])
    assert swept(HEAVE, at, quiet, late, pace=10.0, most=10.01)[0]
    assert not swept(HEAVE, at, quiet, late, pace=10.0, most=9.99)[0]
    assert not swept(HEAVE, at, np.array([[2e8]]), late)[0]
    for speed, is_done in ((0.999 * FAR, True), (-0.999 * FAR, True), (1.001 * FAR, False), (-1.001 * FAR, False)):
        still = Case(HEAVE.P, HEAVE.theta, np.array([speed, 0.0, 0.0, 0.0]), HEAVE.u)
        assert swept(still, at, np.zeros((1, 1)), late)[0] is is_done


@pytest.mark.parametrize("name", CASES)
def test_imbalances_are_inertia_times_the_missing_acceleration(name: str) -> None:
    case = CASES[name]
    P, k = case.P, case.k
    M = matrix(P, case.theta)
    nu_dot = rates(P, case.theta, case.x, case.u)[k : 2 * k]
    missing = 0.1 * np.arange(1, k + 1)
    states = np.stack([case.x, case.x])
    inputs = np.stack([case.u, case.u])
    out, by = balance_of(P, case.theta, states, np.stack([nu_dot, nu_dot - missing]), inputs)
    second = {int(s) for s in P.scales}
    for par in range(len(case.theta)):
        more = case.theta + np.eye(len(case.theta))[par]
        if par not in {*second, P.lag, P.current_x, P.current_y, P.drift_x, P.drift_y, P.reach, P.bottom, P.delay}:
            changed = balance_of(P, more, states, np.stack([nu_dot, nu_dot - missing]), inputs).values - out
            assert pytest.approx(changed, abs=1e-12) == by[:, :, par]
    assert out[0] == pytest.approx(np.zeros(k), abs=1e-12)
    assert out[1] == pytest.approx(M[np.ix_(P.active, P.active)] @ missing, abs=1e-12)
