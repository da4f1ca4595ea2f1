"""A deviating compass: its readings, its sensitivities, and its coefficients identified."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.identify import fit
from gcs_autotune.models import FORMS, Form, Simulator
from gcs_autotune.trial import Channel, Trial

DEVIATION = {"A_psi": 0.02, "B_psi": -0.09, "C_psi": 0.06}
DRIVES = {"force_left": ((("X", 1.0), ("N", "k_N"))), "force_right": ((("X", 1.0), ("N", "-k_N")))}
VALUES = {"X_udot": -30.0, "X_u": -8.0, "k_N": 0.02, "N_r": -0.8, "Y_v": -0.5, "Y_ur": -0.3}
UNITS = {"I_z": 1.0, "Y_vdot": -1.0}
DOFS = ("surge", "sway", "yaw")
FORM = Form("deviating", "", DOFS, (*VALUES, *DEVIATION), UNITS, DRIVES, coriolis=False)


def sailed(seed: int, noise: float) -> Trial:
    """Sail with random thrust through all headings; what a deviating compass makes of it."""
    rng = np.random.default_rng(seed)
    levels = np.repeat(rng.uniform(-10.0, 20.0, (20, 2)), 40, axis=0)
    t = 0.1 * np.arange(len(levels))

    def slope(_: float, x: np.ndarray, F: np.ndarray) -> list[float]:
        _, u, v, r = x
        return [
            r,
            (F[0] + F[1] - 8.0 * u) / 30.0,
            -0.5 * v - 0.3 * u * r,
            0.02 * (F[0] - F[1]) - 0.8 * r,
        ]

    x, rows = np.array([1.0, 0.0, 0.0, 0.0]), []
    for F in levels:
        rows.append(x)
        x = solve_ivp(slope, (0.0, 0.1), x, args=(F,), rtol=1e-8, atol=1e-10).y[:, -1]
    psi, u, v, r = np.array(rows).T
    d = DEVIATION["A_psi"] + DEVIATION["B_psi"] * np.sin(psi) + DEVIATION["C_psi"] * np.cos(psi)
    seen = {
        "psi": ("rad", psi + d),
        "u": ("m/s", u * np.cos(d) + v * np.sin(d)),
        "v": ("m/s", v * np.cos(d) - u * np.sin(d)),
        "r": ("rad/s", r),
    }
    channels = {n: Channel(n, unit, t, y + rng.normal(0.0, noise, len(t))) for n, (unit, y) in seen.items()}
    for i, n in enumerate(("force_left", "force_right")):
        channels[n] = Channel(n, "N", t, levels[:, i])
    return Trial("deviating", channels)


def test_sensitivities_of_a_deviating_compass_are_exact() -> None:
    states = ("psi", "u", "v", "r")
    free = (*VALUES, *DEVIATION)
    simulator = Simulator(FORM, free, states)
    t = np.linspace(0.0, 5.0, 11)
    inputs = np.column_stack([10.0 + 5.0 * np.sin(t), 3.0 * np.cos(t)])
    theta = np.array([{**VALUES, **DEVIATION, **FORM.known}[n] for n in FORM.parameters])
    x_0 = np.array([{"psi": 0.7, "u": 1.0, "v": 0.1, "r": 0.2}.get(n, 0.0) for n in simulator.states])

    def shown(p: np.ndarray) -> dict[str, np.ndarray]:
        values, start = theta.copy(), x_0.copy()
        values[[FORM.parameters.index(n) for n in free]] = p[: len(free)]
        start[[simulator.states.index(n) for n in states]] = p[len(free) :]
        found = simulator.run(values, start, t, inputs, t)
        assert found is not None
        return {n: simulator.outputs(values, *found, n)[0] for n in states}

    p = np.concatenate(
        [theta[[FORM.parameters.index(n) for n in free]], x_0[[simulator.states.index(n) for n in states]]]
    )
    found = simulator.run(theta, x_0, t, inputs, t)
    assert found is not None
    for name in states:
        _, by = simulator.outputs(theta, *found, name)
        for k in range(len(p)):
            h = 1e-5 * max(abs(p[k]), 0.1)
            up, down = p.copy(), p.copy()
            up[k] += h
            down[k] -= h
            assert by[:, k] == pytest.approx((shown(up)[name] - shown(down)[name]) / (2.0 * h), abs=1e-6, rel=1e-5)


@pytest.mark.slow
def test_the_deviation_is_identified_within_its_standard_errors() -> None:
    found = fit([sailed(s, 0.005) for s in (1, 2)], FORM, delay=0.0)
    for name, truth in (DEVIATION | VALUES).items():
        parameter = found.parameters[name]
        assert abs(parameter.value - truth) < 4.0 * parameter.std, name
        assert parameter.std < 0.1 * abs(truth) + 0.005, name
    assert found.fit_percent > 90.0


def test_runs_with_deviation_are_not_fitted_without_its_coefficients() -> None:
    plain = fit(sailed(1, 0.005), FORM.without(*DEVIATION), delay=0.0)
    assert plain.noise["v"] > 5.0 * 0.005


def test_the_shipped_form_for_two_thrusters_includes_the_deviation() -> None:
    assert set(DEVIATION) <= set(FORMS["twin-thruster"].free)
