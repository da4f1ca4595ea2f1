"""The coupled simulation against equations written out by hand and SciPy's integrator, and against physics."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.models import CoupledModel, Form, Simulator, form_from
from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.model import PATIENCE, STEPS, TRIES

STEP = 0.25
T_IN = np.arange(0.0, 12.0, STEP)
T_OUT = np.sort(np.concatenate([np.arange(0.0, 12.0, 0.2), [3.33, 7.77]]))
INPUTS = np.column_stack([8.0 + 4.0 * np.sin(1.1 * T_IN), 2.0 * np.sign(np.sin(0.7 * T_IN))])


def held(t: float, delay: float = 0.0) -> np.ndarray:
    return INPUTS[max(int(np.searchsorted(T_IN + delay, t, side="right")) - 1, 0)]


def by_scipy(rates: Callable[[float, np.ndarray], np.ndarray], s_0: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """Integrate from jump to jump, so that the solver never steps over one."""
    borders = np.unique(np.concatenate([[0.0], T_IN + delay, T_OUT]))
    out, s = {0.0: np.asarray(s_0, dtype=float)}, np.asarray(s_0, dtype=float)
    for a, b in itertools.pairwise(borders):
        middle = 0.5 * (a + b)
        s = solve_ivp(lambda _, x, m=middle: rates(m, x), (a, b), s, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        out[float(b)] = s
    return np.array([out[float(t)] for t in T_OUT])


def form(**changes: object) -> Form:
    data = {
        "name": "test",
        "dofs": ["surge", "sway", "yaw"],
        "free": [],
        "known": {},
        "inputs": {"X": {"X": 1.0}, "N": {"N": 1.0}},
        **changes,
    }
    return form_from(data, "test")


def motion(model: CoupledModel, s_0: np.ndarray) -> np.ndarray:
    names = ("x", "y", "psi", "u", "v", "r")
    found = model.simulate(
        T_IN, {"X": INPUTS[:, 0], "N": INPUTS[:, 1]}, T_OUT, dict(zip(names, s_0.tolist(), strict=True))
    )
    assert found.finite
    return np.column_stack([found.values[n] for n in names])


START = np.array([1.0, -2.0, 0.4, 0.6, -0.1, 0.15])


def test_an_underwater_vehicle_with_an_offset_centre_of_gravity_matches_the_equations() -> None:
    """Miskovic2007, equations (3) and (4), with linear drag."""
    m, I_z, x_G, y_G = 8.0, 0.30, 0.10, -0.06
    X_udot, Y_vdot, N_rdot, X_u, Y_v, N_r = -1.3, -2.1, -0.15, -4.4, -12.0, -0.9
    M = np.array([[m - X_udot, 0.0, -m * y_G], [0.0, m - Y_vdot, m * x_G], [-m * y_G, m * x_G, I_z - N_rdot]])

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        _, _, psi, u, v, r = s
        c_13 = -m * (x_G * r + v) + Y_vdot * v
        c_23 = -m * (y_G * r - u) - X_udot * u
        C = np.array([[0.0, 0.0, c_13], [0.0, 0.0, c_23], [-c_13, -c_23, 0.0]])
        X, N = held(t)
        force = np.array([X + X_u * u, Y_v * v, N + N_r * r])
        turn = np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])
        return np.concatenate([turn @ [u, v, r], np.linalg.solve(M, force - C @ [u, v, r])])

    known = {"m": m, "I_z": I_z, "x_G": x_G, "y_G": y_G, "X_udot": X_udot, "Y_vdot": Y_vdot, "N_rdot": N_rdot}
    model = CoupledModel(form(known={**known, "X_u": X_u, "Y_v": Y_v, "N_r": N_r}), {})
    assert motion(model, START) == pytest.approx(by_scipy(rates, START), abs=2e-4)


def surface_vessel(t: float, s: np.ndarray, delay: float = 0.0, V: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """ZhaoUSV, equations (1)-(3), with numbers of a two-metre boat."""
    _, _, psi, u, v, r = s
    m_11, m_22, m_23, m_33 = 25.8, 33.8, 6.2, 4.8
    d_11 = 0.72 + 1.33 * abs(u)
    d_22, d_23 = 7.9 + 36.5 * abs(v), 0.4 + 2.0 * abs(r)
    d_32, d_33 = 0.1 + 0.9 * abs(v), 2.9 + 1.7 * abs(r)
    X, N = held(t, delay)
    X += (m_22 * v + m_23 * r) * r - d_11 * u
    Y = -m_11 * u * r - d_22 * v - d_23 * r
    N += (m_11 - m_22) * u * v - m_23 * u * r - d_32 * v - d_33 * r
    v_dot, r_dot = np.linalg.solve([[m_22, m_23], [m_23, m_33]], [Y, N])
    c, n = np.cos(psi), np.sin(psi)
    return np.array([u * c - v * n + V[0], u * n + v * c + V[1], r, X / m_11, v_dot, r_dot])


VESSEL = {
    "X_udot": -25.8, "Y_vdot": -33.8, "Y_rdot": -6.2, "N_rdot": -4.8, "X_u": -0.72, "X_uu": -1.33, "Y_v": -7.9,
    "Y_vv": -36.5, "Y_r": -0.4, "Y_rr": -2.0, "N_v": -0.1, "N_vv": -0.9, "N_r": -2.9, "N_rr": -1.7,
}  # fmt: skip


def test_a_surface_vessel_with_mirrored_added_mass_matches_the_equations() -> None:
    assert motion(CoupledModel(form(known=VESSEL), {}), START) == pytest.approx(
        by_scipy(surface_vessel, START), abs=2e-4
    )


def test_a_delay_shifts_the_inputs() -> None:
    late = by_scipy(lambda t, s: surface_vessel(t, s, 0.37), START, 0.37)
    assert motion(CoupledModel(form(known={**VESSEL, "delay": 0.37}), {}), START) == pytest.approx(late, abs=2e-4)


def test_a_current_carries_the_craft_and_shows_in_speeds_over_ground() -> None:
    V = (0.3, -0.2)
    through_water = by_scipy(lambda t, s: surface_vessel(t, s, V=V), START)
    found = motion(CoupledModel(form(known={**VESSEL, "V_x": V[0], "V_y": V[1]}), {}), START)
    psi = through_water[:, 2]
    over_ground = through_water.copy()
    over_ground[:, 3] += V[0] * np.cos(psi) + V[1] * np.sin(psi)
    over_ground[:, 4] += V[1] * np.cos(psi) - V[0] * np.sin(psi)
    assert found == pytest.approx(over_ground, abs=2e-4)


def test_a_motion_too_stiff_for_the_allowed_steps_is_abandoned_early(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stiff = Simulator(form(free=["X_udot", "Y_vdot", "N_rdot", "X_u"]), ("X_u",))
    theta = np.array([{"X_u": -1e7}.get(n, -1.0) for n in stiff.form.parameters])
    sweep, paces = kernel.sweep, []

    def counted(*given: Any) -> tuple[bool, float]:
        paces.append(given[10])
        return sweep(*given)

    monkeypatch.setattr(kernel, "sweep", counted)
    assert stiff.run(theta, np.full(6, 0.1), T_IN, INPUTS, T_OUT) is None
    needed = np.array(paces) * (T_OUT[-1] - T_OUT[0]) / kernel.REACH
    assert 1 < len(paces) < TRIES
    assert needed.max() < STEPS + PATIENCE * len(T_OUT)
    gentle = np.where(theta < -1.0, -2.0, theta)
    assert stiff.run(gentle, np.full(6, 0.1), T_IN, INPUTS, T_OUT) is not None


def test_a_lag_smooths_the_inputs_by_a_first_order_actuator() -> None:
    T = 0.6

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        acted = s[6:]
        dry = surface_vessel(t, s[:6])
        m_22, m_23, m_33 = 33.8, 6.2, 4.8
        X, N = held(t)
        dry[3] += (acted[0] - X) / 25.8
        dry[4:] += np.linalg.solve([[m_22, m_23], [m_23, m_33]], [0.0, acted[1] - N])
        return np.concatenate([dry, ([X, N] - acted) / T])

    lagged = by_scipy(rates, np.concatenate([START, [0.0, 0.0]]))[:, :6]
    assert motion(CoupledModel(form(known={**VESSEL, "lag": T}), {}), START) == pytest.approx(lagged, abs=3e-4)


SIX = ["surge", "sway", "heave", "roll", "pitch", "yaw"]
BODY = {
    "m": 30.0, "I_x": 2.0, "I_y": 3.5, "I_z": 4.1, "I_xz": 0.3, "x_G": 0.05, "y_G": 0.02, "z_G": 0.08,
    "X_udot": -6.0, "Y_vdot": -9.0, "Z_wdot": -11.0, "K_pdot": -0.4, "M_qdot": -0.9, "N_rdot": -0.7, "Y_rdot": -0.5,
    "Z_qdot": 0.6,
}  # fmt: skip


def test_energy_and_momentum_are_conserved_without_drag_and_force() -> None:
    body = form(dofs=SIX, known=BODY, inputs={})
    start = {"u": 0.8, "v": -0.3, "w": 0.2, "p": 0.7, "q": -0.5, "r": 0.9, "phi": 0.2, "theta": -0.1}
    model = CoupledModel(body, {})
    t = np.linspace(0.0, 3.0, 61)
    found = model.simulate(np.zeros(1), {}, t, start)
    nu = np.column_stack([found.values[n] for n in "uvwpqr"])
    energy = 0.5 * np.einsum("ti,ij,tj->t", nu, model.inertia, nu)
    assert energy == pytest.approx(np.full(61, energy[0]), rel=1e-5)
    momentum = np.einsum("ij,tj->ti", model.inertia, nu)[:, :3]
    turned = [
        rotation(*(float(found.values[n][i]) for n in ("phi", "theta", "psi"))) @ p for i, p in enumerate(momentum)
    ]
    assert np.array(turned) == pytest.approx(np.tile(turned[0], (61, 1)), rel=1e-4, abs=1e-4)


def rotation(phi: float, theta: float, psi: float) -> np.ndarray:
    """Body to NED, as the product of the three turns."""
    c, s = np.cos, np.sin
    about_z = np.array([[c(psi), -s(psi), 0.0], [s(psi), c(psi), 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[c(theta), 0.0, s(theta)], [0.0, 1.0, 0.0], [-s(theta), 0.0, c(theta)]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c(phi), -s(phi)], [0.0, s(phi), c(phi)]])
    return np.asarray(about_z @ about_y @ about_x)


def test_the_position_follows_the_rotated_velocity() -> None:
    body = form(dofs=SIX, known={**BODY, "K_p": -1.0, "K_sinphi": -15.0, "M_sintheta": -20.0, "Z_0": 3.0}, inputs={})
    t = np.linspace(0.0, 3.0, 3001)
    found = CoupledModel(body, {}).simulate(np.zeros(1), {}, t, {"u": 1.0, "p": 0.5, "r": 0.4, "q": 0.3})
    nu = np.column_stack([found.values[n] for n in "uvw"])
    angles = np.column_stack([found.values[n] for n in ("phi", "theta", "psi")])
    speed = np.array([rotation(*a) @ v for a, v in zip(angles, nu, strict=True)])
    for i, name in enumerate("xyz"):
        assert np.gradient(found.values[name], t)[5:-5] == pytest.approx(speed[5:-5, i], abs=1e-4)


SENSITIVE = [
    ("horizontal", ["surge", "sway", "yaw"], {**VESSEL, "V_x": 0.2, "V_y": -0.1, "lag": 0.5, "N_uv": 0.3}, ("X", "N")),
    (
        "6dof",
        SIX,
        {**{k: v for k, v in BODY.items() if k not in ("x_G", "y_G", "z_G")}, "X_u": -3.0, "Y_|v|r": -1.0, "K_p": -1.0,
         "K_sinphi": -9.0, "M_q": -1.4, "M_sintheta": -12.0, "N_r": -2.0, "Z_w": -8.0, "Z_z": -2.0, "N_XX": 0.01},
        ("X", "N"),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "dofs", "values", "channels"), SENSITIVE, ids=[s[0] for s in SENSITIVE])
def test_sensitivities_match_difference_quotients(
    name: str, dofs: list[str], values: dict[str, float], channels: tuple[str, ...]
) -> None:
    model = form(name=name, dofs=dofs, free=list(values), inputs={c: {c: 1.0} for c in channels})
    states = Simulator(model).states
    simulator = Simulator(model, model.free, states)
    rng = np.random.default_rng(3)
    theta, x_0 = np.array([values[n] for n in model.parameters]), rng.uniform(-0.3, 0.3, len(states))
    t_out = np.linspace(0.0, 4.0, 33)
    # One coarse run settles the step ladder, so that all others take the same steps.
    simulator.run(theta, x_0, T_IN, INPUTS, t_out)

    def outcome(at: np.ndarray) -> np.ndarray:
        found = simulator.run(at[: len(theta)], at[len(theta) :], T_IN, INPUTS, t_out)
        assert found is not None
        return np.stack(
            [simulator.outputs(at[: len(theta)], *found, n)[0] for n in states if "lagged" not in n], axis=1
        )

    point = np.concatenate([theta, x_0])
    X, S = simulator.run(theta, x_0, T_IN, INPUTS, t_out) or (None, None)
    assert X is not None
    assert S is not None
    exact = np.stack([simulator.outputs(theta, X, S, n)[1] for n in states if "lagged" not in n], axis=1)
    for i in range(len(point)):
        h = 1e-5 * max(abs(point[i]), 0.1)
        step = np.eye(len(point))[i] * h
        numeric = (outcome(point + step) - outcome(point - step)) / (2.0 * h)
        largest = max(float(np.abs(exact[:, :, i]).max()), 1e-6)
        assert exact[:, :, i] == pytest.approx(numeric, abs=2e-5 * largest), model.parameters[i : i + 1]


def test_the_sensitivity_to_a_delay_matches_shifted_jumps() -> None:
    model = form(free=["delay"], known=VESSEL)
    simulator = Simulator(model, ("delay",))
    t_out = np.linspace(0.0, 6.0, 31) + 0.0123

    def at(delay: float) -> tuple[np.ndarray, np.ndarray]:
        theta = np.array([{"delay": delay, **VESSEL}[n] for n in model.parameters])
        found = simulator.run(theta, START, T_IN, INPUTS, t_out)
        assert found is not None
        return found

    at(0.3)
    numeric = (at(0.3 + 1e-5)[0] - at(0.3 - 1e-5)[0]) / 2e-5
    assert at(0.3)[1][:, :, 0] == pytest.approx(numeric, abs=1e-4)


def test_a_diverging_motion_is_reported_without_an_exception() -> None:
    wild = CoupledModel(form(known={**VESSEL, "X_u": 400.0, "X_uu": 400.0}), {})
    found = wild.simulate(T_IN, {"X": INPUTS[:, 0], "N": INPUTS[:, 1]}, T_OUT)
    assert not found.finite


def test_stiff_drag_is_simulated_without_sensitivities() -> None:
    stiff = CoupledModel(form(known={**VESSEL, "X_u": -2000.0}), {})
    found = stiff.simulate(T_IN, {"X": INPUTS[:, 0], "N": np.zeros(len(T_IN))}, T_OUT)
    expected = INPUTS[np.maximum(np.searchsorted(T_IN, T_OUT - 0.1, side="right") - 1, 0), 0] / 2000.0
    assert found.finite
    late = T_OUT % STEP > 0.15
    assert found.values["u"][late] == pytest.approx(expected[late], rel=1e-3)


def test_a_run_without_sensitivities_gives_the_same_motion() -> None:
    model = form(free=list(VESSEL))
    simulator = Simulator(model, model.free, ("u", "v", "r", "psi"))
    theta = np.array([VESSEL[n] for n in model.parameters])
    with_them = simulator.run(theta, START, T_IN, INPUTS, T_OUT)
    without = simulator.run(theta, START, T_IN, INPUTS, T_OUT, sensitivities=False)
    assert with_them is not None
    assert without is not None
    assert without[0] == pytest.approx(with_them[0], abs=1e-12)
    assert without[1].size == 0
