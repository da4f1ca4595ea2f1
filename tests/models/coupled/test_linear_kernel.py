"""Exact transitions of one linear degree of freedom: the same motion as by Runge-Kutta steps that are short enough."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gcs_autotune.models import Form, Simulator, program_of
from gcs_autotune.models.coupled.linear_kernel import linear_program_of

Array = NDArray[np.float64]


def form(dof: str, *free: str, known: Mapping[str, float] | None = None, gain: str | float = 1.0) -> Form:
    force = {"surge": "X", "heave": "Z", "yaw": "N"}[dof]
    return Form("plain", "one axis", (dof,), free, dict(known or {}), {force: ((force, gain),)}, coriolis=False)


TWIN = Form(
    "plain", "two thrusters", ("yaw",), ("k_N", "N_r", "N_0", "N_r|delta|"), {"I_z": 0.7},
    {"force_left": (("N", "k_N"),), "delta": (("N", "-k_N"),)}, coriolis=False,
)  # fmt: skip
CASES: Mapping[str, tuple[Form, dict[str, float]]] = {
    "late": (
        form("yaw", "k_N", "N_r", "N_0", "I_z", "delay", gain="k_N"),
        {"k_N": 0.5, "N_r": -0.8, "N_0": 0.1, "I_z": 1.3, "delay": 0.33},
    ),
    "turned round": (form("yaw", "k_N", "N_r", "N_rdot", gain="-k_N"), {"k_N": 0.5, "N_r": -0.01, "N_rdot": -1.0}),
    "unstable": (form("heave", "Z_w", "Z_wdot", "Z_0"), {"Z_w": 0.05, "Z_wdot": -1.0, "Z_0": 0.02}),
    "without drag": (form("surge", "X_u", "X_udot", known={"m": 3.0}), {"X_u": 0.0, "X_udot": -1.0, "m": 3.0}),
    "two inputs, drag by one": (TWIN, {"k_N": 0.4, "N_r": -0.5, "N_0": -0.1, "N_r|delta|": -0.6, "I_z": 0.7}),
}
T_OUT = np.sort(np.random.default_rng(1).uniform(0.0, 30.0, 80))
T_IN = np.sort(np.random.default_rng(2).uniform(-1.0, 30.0, 60))
X_0 = np.array([0.2, -0.4])


def simulators(name: str) -> tuple[Simulator, Simulator, Array, Array]:
    """Return one that takes exact transitions, one that takes short steps, parameters and inputs."""
    own, values = CASES[name]
    exact, stepped = (Simulator(own, own.free, ("psi", "r") if own.dofs == ("yaw",) else ()) for _ in range(2))
    assert exact._linear is not None
    stepped._linear, stepped.patience, stepped._max_rate = None, 2000, 64.0
    inputs = np.random.default_rng(3).uniform(-1.0, 1.0, (len(T_IN), len(own.inputs)))
    return exact, stepped, np.array([values[n] for n in own.parameters]), inputs


@pytest.mark.parametrize("name", CASES)
def test_motion_and_sensitivities_match_short_runge_kutta_steps(name: str) -> None:
    exact, stepped, theta, inputs = simulators(name)
    found, expected = (s.run(theta, X_0, T_IN, inputs, T_OUT) for s in (exact, stepped))
    assert found is not None and expected is not None
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-8, atol=1e-9 * np.abs(other).max())
    assert np.abs(found[1]).max(axis=(0, 1)).min() > 0.0, "every parameter moves something"
    without = exact.run(theta, X_0, T_IN, inputs, T_OUT, sensitivities=False)
    assert without is not None and np.array_equal(without[0], found[0])


@pytest.mark.parametrize("name", CASES)
def test_sensitivities_match_differences_of_the_motion(name: str) -> None:
    exact, _, theta, inputs = simulators(name)
    found = exact.run(theta, X_0, T_IN, inputs, T_OUT)
    assert found is not None
    seen = ~np.isin(T_OUT, T_IN)
    for k, parameter in enumerate(exact.free):
        i, h = exact.form.parameters.index(parameter), 1e-6
        ends = [
            exact.run(theta + s * h * np.eye(len(theta))[i], X_0, T_IN, inputs, T_OUT, sensitivities=False)
            for s in (1, -1)
        ]
        by_difference = (ends[0][0] - ends[1][0]) / (2.0 * h)  # type: ignore[index]
        np.testing.assert_allclose(found[1][seen, :, k], by_difference[seen], rtol=1e-4, atol=1e-5)


def test_a_craft_far_quicker_than_its_samples_is_simulated_and_a_diverging_one_is_not() -> None:
    own = form("surge", "X_u", "X_udot")
    simulator = Simulator(own, own.free)
    quick = simulator.run(np.array([-1e5, -1.0]), np.zeros(2), np.array([0.0]), np.array([[2e5]]), np.arange(5.0))
    assert quick is not None
    np.testing.assert_allclose(quick[0][1:, 1], 2.0)
    assert simulator.run(np.array([8.0, -1.0]), np.zeros(2), np.array([0.0]), np.array([[1.0]]), np.arange(9.0)) is None


def test_series_and_closed_form_agree_at_their_border() -> None:
    own = form("surge", "X_u", "X_udot")
    simulator = Simulator(own, own.free)

    def sensitivities(drag: float) -> Array:
        found = simulator.run(np.array([drag, -1.0]), X_0, np.array([0.0]), np.array([[1.0]]), np.array([0.0, 1.0]))
        assert found is not None
        return np.concatenate([found[0][1], found[1][1].ravel()])

    below, above = (sensitivities(-0.5 * (1.0 + side * 1e-12)) for side in (-1, 1))
    np.testing.assert_allclose(below, above, rtol=1e-11)


def test_an_independent_integrator_agrees() -> None:
    exact, _, theta, inputs = simulators("two inputs, drag by one")
    k_N, N_r, N_0, N_rdelta, I_z = theta

    def rate(t: float, x: Array) -> list[float]:
        u = inputs[max(int(np.searchsorted(T_IN, t, side="right")) - 1, 0)]
        return [x[1], (k_N * (u[0] - u[1]) + N_0 + (N_r + N_rdelta * abs(u[1])) * x[1]) / I_z]

    found = exact.run(theta, X_0, T_IN, inputs, T_OUT, sensitivities=False)
    assert found is not None
    other = solve_ivp(rate, (T_OUT[0], T_OUT[-1]), X_0, t_eval=T_OUT, max_step=0.02, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found[0].T, other.y, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    "other",
    [
        form("yaw", "N_r", "N_rr", "I_z"),
        form("yaw", "N_r", "I_z", "lag"),
        form("yaw", "N_r", "N_psi", "I_z"),
        Form("plain", "two", ("surge", "yaw"), ("X_u", "N_r"), {"m": 1.0, "I_z": 1.0}, {"N": (("N", 1.0),)}),
    ],
    ids=["quadratic", "lagged", "spring", "two"],
)
def test_forms_not_linear_in_one_velocity_use_short_steps(other: Form) -> None:
    assert linear_program_of(program_of(other)) is None
