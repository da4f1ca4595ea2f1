"""Bottom, heading, payload and current in the coupled simulation, against SciPy and difference quotients."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.models import Form, Simulator, unit_of

T_IN = np.array([0.0, 1.5, 3.1, 4.0, 6.2])
T_OUT = np.linspace(0.0, 8.0, 33)
PLANE = ("surge", "sway", "yaw")
DRIVEN = {"X": (("X", 1.0),), "N": (("N", 1.0),)}
HULL = {"X_udot": -4.0, "Y_vdot": -7.0, "N_rdot": -1.5, "X_u": -2.0, "Y_v": -5.0, "N_r": -1.1}
PUSHES = {"X": np.array([3.0, -1.0, 4.0, 2.0, 0.0]), "N": np.array([0.8, -0.9, 1.2, 0.3, -0.6])}
START = np.array([0.5, -0.3, 0.4, 0.6, -0.1, 0.15])

Rates = Callable[[np.ndarray, Mapping[str, float]], list[float]]


def by_scipy(rates: Rates, s_0: np.ndarray, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    """Integrate from jump to jump."""
    borders = np.unique(np.concatenate([T_IN, T_OUT]))
    s, out = s_0, {0.0: s_0}
    for a, b in itertools.pairwise(borders[borders <= T_OUT[-1]]):
        held = {n: float(v[np.searchsorted(T_IN, 0.5 * (a + b)) - 1]) for n, v in inputs.items()}
        s = solve_ivp(lambda _, x, h=held: rates(x, h), (a, b), s, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        out[float(b)] = s
    return np.array([out[float(t)] for t in T_OUT])


def simulated(form: Form, s_0: np.ndarray, inputs: Mapping[str, np.ndarray], **values: float) -> np.ndarray:
    simulator = Simulator(form)
    theta = np.array([{**form.known, **values}[n] for n in form.parameters])
    found = simulator.run(theta, s_0, T_IN, np.column_stack([inputs[n] for n in form.inputs]), T_OUT)
    assert found is not None
    return np.column_stack([simulator.outputs(theta, *found, n)[0] for n in simulator.states])


def check_sensitivities(form: Form, s_0: np.ndarray, inputs: Mapping[str, np.ndarray]) -> None:
    """Hold the sensitivities to all parameters and initial states against central differences."""
    names = tuple(form.known)
    simulator = Simulator(form, names, Simulator(form).states)
    theta, table = np.array([form.known[n] for n in names]), np.column_stack([inputs[n] for n in form.inputs])

    def outputs(theta: np.ndarray, x: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        found = simulator.run(theta, x, T_IN, table, T_OUT)
        assert found is not None
        return {n: simulator.outputs(theta, *found, n) for n in simulator.states}

    exact, x = outputs(theta, s_0), np.concatenate([theta, s_0])
    for j in range(len(x)):
        h = 1e-5 * max(abs(x[j]), 1.0)
        up, down = (outputs((x + s * h * (np.arange(len(x)) == j))[: len(theta)],
                            (x + s * h * (np.arange(len(x)) == j))[len(theta) :]) for s in (1.0, -1.0))  # fmt: skip
        for n, (_, by) in exact.items():
            assert by[:, j] == pytest.approx((up[n][0] - down[n][0]) / (2.0 * h), abs=2e-6, rel=2e-5), (n, j)


def in_the_plane(known: Mapping[str, float], inputs: tuple[str, ...] = (), *, coriolis: bool = False) -> Form:
    return Form("t", "", PLANE, (), {**HULL, **known}, {**DRIVEN, **dict.fromkeys(inputs, ())}, coriolis=coriolis)


def plane_rates(
    force: Callable[[np.ndarray, Mapping[str, float]], tuple[float, float, float]],
    *,
    coriolis: bool = False,
    V: tuple[float, float] = (0.0, 0.0),
) -> Rates:
    """Return equations of motion of ``HULL`` with more *force*; inertia times the input ``payload`` if there is one."""

    def rates(s: np.ndarray, held: Mapping[str, float]) -> list[float]:
        psi, u, v, r = s[2:]
        k = held.get("payload", 1.0)
        X, Y, N = force(s, held)
        X, Y, N = X + held["X"] - 2.0 * u, Y - 5.0 * v, N + held["N"] - 1.1 * r
        if coriolis:
            X, Y, N = X + k * 7.0 * v * r, Y - k * 4.0 * u * r, N + k * (4.0 - 7.0) * u * v
        c, n = np.cos(psi), np.sin(psi)
        return [u * c - v * n + V[0], u * n + v * c + V[1], r, X / (k * 4.0), Y / (k * 7.0), N / (k * 1.5)]

    return rates


def no_more(s: np.ndarray, held: Mapping[str, float]) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def test_forces_may_depend_on_heading_and_position() -> None:
    more = {"N_sinpsi": -0.7, "N_cospsi": 0.4, "X_xcospsi": -0.6, "Y_xsinpsi": 0.6, "N_psi": -0.2}
    form = in_the_plane(more)

    def force(s: np.ndarray, held: Mapping[str, float]) -> tuple[float, float, float]:
        x, psi = s[0], s[2]
        return -0.6 * x * np.cos(psi), 0.6 * x * np.sin(psi), -0.7 * np.sin(psi) + 0.4 * np.cos(psi) - 0.2 * psi

    assert simulated(form, START, PUSHES) == pytest.approx(by_scipy(plane_rates(force), START, PUSHES), abs=2e-5)
    check_sensitivities(form, START, PUSHES)


@pytest.mark.parametrize("coriolis", [False, True])
def test_a_payload_multiplies_inertia_and_coriolis_forces(coriolis: bool) -> None:
    inputs = {**PUSHES, "payload": np.array([1.0, 1.0, 1.7, 1.7, 0.6])}
    form = in_the_plane({}, ("payload",), coriolis=coriolis)
    truth = by_scipy(plane_rates(no_more, coriolis=coriolis), START, inputs)
    assert simulated(form, START, inputs) == pytest.approx(truth, abs=2e-5)
    check_sensitivities(form, START, inputs)


def test_a_payload_of_one_changes_nothing() -> None:
    inputs = {**PUSHES, "payload": np.ones(len(T_IN))}
    plain = simulated(in_the_plane({}, coriolis=True), START, PUSHES)
    assert simulated(in_the_plane({}, ("payload",), coriolis=True), START, inputs) == pytest.approx(plain, rel=1e-12)


def test_a_current_shows_in_speeds_over_ground_and_a_drift_does_not() -> None:
    V = (0.3, -0.2)
    truth = by_scipy(plane_rates(no_more, V=V), START, PUSHES)
    drifting = in_the_plane({"drift_x": V[0], "drift_y": V[1]})
    assert simulated(drifting, START, PUSHES) == pytest.approx(truth, abs=1e-4)
    check_sensitivities(drifting, START, PUSHES)
    psi = truth[:, 2]
    truth[:, 3] += V[0] * np.cos(psi) + V[1] * np.sin(psi)
    truth[:, 4] += V[1] * np.cos(psi) - V[0] * np.sin(psi)
    assert simulated(in_the_plane({"V_x": V[0], "V_y": V[1]}), START, PUSHES) == pytest.approx(truth, abs=1e-4)


DIVER = {"Z_wdot": -9.0, "Z_w": -3.0, "Z_ww": -8.0, "wall_Z": 1.4, "reach": 0.8, "bottom": 31.0}
DIVES = {"Z": np.array([6.0, 9.0, -7.0, 8.0, 2.0])}
DEEP = np.array([30.0, 0.1])


def test_the_bottom_raises_linear_and_quadratic_drag() -> None:
    form = Form("t", "", ("heave",), (), DIVER, {"Z": (("Z", 1.0),)})

    def rates(s: np.ndarray, held: Mapping[str, float]) -> list[float]:
        z, w = s
        return [w, (held["Z"] - (3.0 + 8.0 * abs(w)) * w * (1.0 + 1.4 * np.exp(-(31.0 - z) / 0.8))) / 9.0]

    assert simulated(form, DEEP, DIVES) == pytest.approx(by_scipy(rates, DEEP, DIVES), abs=2e-5)
    check_sensitivities(form, DEEP, DIVES)


def test_a_term_with_near_in_its_name_equals_a_wall_parameter() -> None:
    named = {n: v for n, v in DIVER.items() if n != "wall_Z"} | {"Z_nearw": -1.4 * 3.0, "Z_near|w|w": -1.4 * 8.0}
    heave = {"Z": (("Z", 1.0),)}
    by_name = simulated(Form("t", "", ("heave",), (), named, heave), DEEP, DIVES)
    assert by_name == pytest.approx(simulated(Form("t", "", ("heave",), (), DIVER, heave), DEEP, DIVES), abs=1e-12)
    check_sensitivities(Form("t", "", ("heave",), (), named, heave), DEEP, DIVES)


def test_a_recorded_depth_replaces_a_heave_that_is_not_simulated() -> None:
    inputs = {**PUSHES, "depth": np.array([4.0, 4.4, 4.9, 5.0, 4.6])}
    form = in_the_plane({"wall_N": 2.0, "reach": 0.5, "bottom": 5.0, "N_rr": -0.3}, ("depth",))

    def force(s: np.ndarray, held: Mapping[str, float]) -> tuple[float, float, float]:
        r, near = s[5], 2.0 * np.exp((held["depth"] - 5.0) / 0.5)
        return 0.0, 0.0, -0.3 * abs(r) * r * (1.0 + near) - 1.1 * r * near

    assert simulated(form, START, inputs) == pytest.approx(by_scipy(plane_rates(force), START, inputs), abs=2e-5)
    check_sensitivities(form, START, inputs)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("N_sinpsi", "N m"), ("X_xcospsi", "N/m"), ("Z_nearw", "N s/m"), ("wall_Z", "1"), ("reach", "m"),
        ("bottom", "m"), ("drift_y", "m/s"), ("N_depth", "N m/m"), ("N_psi", "N m/rad"), ("N_payload", "N m"),
    ],
)  # fmt: skip
def test_parameters_of_the_surroundings_have_their_units(name: str, unit: str) -> None:
    assert unit_of(name, {"N": "N m", "depth": "m", "payload": "1"}) == unit
