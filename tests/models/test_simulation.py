"""The kernel against an independent integrator and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.models import SingleDof
from gcs_autotune.models.simulation import COLUMNS, simulate, simulate_explicit

T_IN = np.array([0.0, 0.7, 1.93, 2.5, 4.1])
TAU = np.array([1.0, -1.0, 0.4, -0.7, 1.2])
RNG = np.random.default_rng(5)
T_OUT = np.sort(np.concatenate([[0.0], RNG.uniform(0.0, 6.0, 60)]))
CASES = {
    "affine": (2.0, 0.8, 1.5, 0.1, 0.137, 0.2, -0.5),
    "linear": (2.0, 0.8, 0.0, 0.1, 0.0, 0.2, -0.5),
    "quadratic": (20.0, 0.0, 15.0, -0.3, 0.05, 0.0, 3.0),
    "stiff": (50.0, 40.0, 5.0, 0.1, 0.2, 0.0, 0.0),
    "reversed": (-3.0, 0.5, 0.4, 0.1, 0.1, 0.0, 0.3),
    "unstable": (1.0, -0.3, 0.2, 0.0, 0.1, 0.0, 0.1),
}


def integrated(p: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The same motion from scipy, restarted at every input jump."""
    b, a, c, d, delay, eta, nu = p
    edges = np.concatenate([[T_OUT[0]], T_IN[1:] + delay, [T_OUT[-1]]])
    out = np.empty((2, len(T_OUT)))
    state = [eta, nu]
    for start, end, tau in zip(edges[:-1], edges[1:], TAU, strict=True):
        inside = (start <= T_OUT) & (end >= T_OUT)
        sol = solve_ivp(
            lambda _, s, tau=tau: [s[1], b * tau - a * s[1] - c * abs(s[1]) * s[1] + d],
            (start, end),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            dense_output=True,
            max_step=0.02,
        )
        out[:, inside] = sol.sol(T_OUT[inside])
        state = [float(v) for v in sol.y[:, -1]]
    return out[0], out[1]


@pytest.mark.parametrize("case", CASES)
def test_motion_agrees_with_an_independent_integrator_to_nine_digits(case: str) -> None:
    motion = simulate_explicit(CASES[case], T_IN, TAU, T_OUT)
    eta, nu = integrated(CASES[case])
    assert np.max(np.abs(motion.eta - eta)) < 2e-9 * np.max(np.abs(eta))
    assert np.max(np.abs(motion.nu - nu)) < 2e-9 * np.max(np.abs(nu))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("column", range(7))
def test_sensitivities_agree_with_finite_differences(case: str, column: int) -> None:
    p = np.array(CASES[case])
    if COLUMNS[column] == "delay" and p[column] == 0.0:
        p[column] = 0.01
    h = 1e-6
    up, down = p.copy(), p.copy()
    up[column] += h
    down[column] -= h
    motion = simulate_explicit(p, T_IN, TAU, T_OUT)
    high, low = (simulate_explicit(q, T_IN, TAU, T_OUT) for q in (up, down))
    wanted = (high.eta - low.eta) / (2 * h)
    assert np.allclose(motion.eta_by[:, column], wanted, rtol=1e-6, atol=1e-6 * (1 + np.max(np.abs(wanted))))
    wanted = (high.nu - low.nu) / (2 * h)
    assert np.allclose(motion.nu_by[:, column], wanted, rtol=1e-6, atol=1e-6 * (1 + np.max(np.abs(wanted))))


def test_the_steady_velocity_of_the_model_is_reached() -> None:
    model = SingleDof("yaw", "N m", 0.5, 0.3, 0.2, delta=0.05)
    motion = simulate(model, np.array([0.0]), np.array([0.7]), np.linspace(0, 60, 20))
    assert motion.nu[-1] == pytest.approx(model.steady_velocity(0.7), rel=1e-12)


def test_a_runaway_is_reported_and_not_returned_as_numbers() -> None:
    motion = simulate_explicit((1.0, 0.1, -2.0, 0.0, 0.0, 0.0, 1.0), T_IN, TAU, T_OUT)
    assert not motion.finite
    assert np.all(np.isnan(motion.eta))


def test_sampling_the_output_more_densely_does_not_change_the_motion() -> None:
    dense = np.unique(np.concatenate([T_OUT, np.linspace(0.0, T_OUT[-1], 5000)]))
    coarse = simulate_explicit(CASES["affine"], T_IN, TAU, T_OUT)
    fine = simulate_explicit(CASES["affine"], T_IN, TAU, dense)
    assert np.allclose(fine.eta[np.searchsorted(dense, T_OUT)], coarse.eta, rtol=0, atol=1e-11)
