"""The open-loop simulator: a bare hull against closed-form solutions, and the file it writes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sitl.effects import make_effect
from sitl.open_loop import Hull, open_loop

FULL = Hull(
    ("surge", "sway", "heave", "yaw"),
    inertia={"surge": 10.0, "sway": 15.0, "heave": 12.0, "yaw": 2.0},
    linear={"surge": 5.0, "sway": 10.0, "heave": 6.0, "yaw": 2.0},
    quadratic={"surge": 3.0, "yaw": 1.0},
)


def turning(time_constant, **more):
    return Hull(("yaw",), inertia={"yaw": time_constant}, linear={"yaw": 1.0}, **more)


@pytest.mark.parametrize("time_constant", [0.1, 1.0, 20.0])
def test_a_step_of_moment_turns_the_hull_as_the_closed_form_solution(time_constant):
    run = open_loop(turning(time_constant), {"N": [(0.0, 0.5)]}, duration=20.0, interval=0.1, measured=("psi", "r"))
    t, T = run["t"], time_constant
    assert len(t) == 200
    assert np.max(np.abs(run["r"] - 0.5 * (1.0 - np.exp(-t / T)))) < 1e-4
    assert np.max(np.abs(run["psi"] - 0.5 * (t - T * (1.0 - np.exp(-t / T))))) < 1e-4


def test_all_degrees_of_freedom_agree_with_an_adaptive_integrator():
    forces = {"X": 4.0, "Y": -2.0, "Z": 1.0, "N": 1.5}
    commands = {name: [(0.0, value), (6.0, -value)] for name, value in forces.items()}
    run = open_loop(FULL, commands, duration=12.0, interval=0.2, measured=("x", "y", "z", "psi", "u", "v", "w", "r"))

    def slope(t, s):
        psi, u, v, w, r = s[3:]
        sign = 1.0 if t < 6.0 else -1.0
        nudot = [
            (sign * forces[f] - (FULL.linear[dof] + FULL.quadratic.get(dof, 0.0) * abs(nu)) * nu) / FULL.inertia[dof]
            for f, dof, nu in (("X", "surge", u), ("Y", "sway", v), ("Z", "heave", w), ("N", "yaw", r))
        ]
        return [u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi), w, r, *nudot]

    exact = solve_ivp(slope, (0.0, 12.0), np.zeros(8), t_eval=run["t"], rtol=1e-9, atol=1e-9, max_step=0.05).y
    for name, truth in zip(("x", "y", "z", "psi", "u", "v", "w", "r"), exact, strict=True):
        assert np.max(np.abs(run[name] - truth)) < 1e-3, name


def test_without_yaw_x_is_the_integral_of_u():
    hull = Hull(("surge",), {"surge": 10.0}, {"surge": 5.0})
    run = open_loop(
        hull, {"X": [(0.0, 5.0)]}, duration=20.0, interval=0.5, measured=("x", "u"), initial={"x": 3.0, "u": 1.0}
    )
    assert run["u"] == pytest.approx(np.ones(40))
    assert run["x"] == pytest.approx(3.0 + run["t"])


def test_a_rudder_turns_the_hull_by_its_gain():
    hull = turning(1.0, gain=3.0)
    run = open_loop(hull, {"delta": [(0.0, 0.1)]}, duration=20.0, interval=0.5, measured=("r",))
    assert run["r"][-1] == pytest.approx(0.3, rel=1e-4)


def test_commands_are_held_between_stamps_and_written_unchanged():
    values = np.where(np.arange(50) % 10 < 5, 1.0, -1.0)
    run = open_loop(turning(0.5), {"N": values}, duration=5.0, interval=0.1, measured=("r",))
    assert np.array_equal(run["N"], values)
    steps = [(k * 0.5, 1.0 if k % 2 == 0 else -1.0) for k in range(10)]
    again = open_loop(turning(0.5), {"N": steps}, duration=5.0, interval=0.1, measured=("r",))
    assert np.array_equal(again["N"], values)
    assert np.array_equal(again["r"], run["r"])


def test_nothing_is_commanded_before_the_first_step():
    run = open_loop(turning(0.5), {"N": [(1.0, 1.0)]}, duration=3.0, interval=0.1, measured=("r",))
    assert not np.any(run["r"][:11])
    assert run["r"][11] > 0.0


def test_noise_is_white_with_the_set_size_and_follows_the_seed():
    def fly(seed):
        return open_loop(
            turning(1.0), {"N": [(0.0, 0.0)]}, duration=100.0, interval=0.1, measured=("psi", "r"),
            noise={"psi": 0.01}, seed=seed,
        )  # fmt: skip

    run = fly(1)
    assert np.std(run["psi"]) == pytest.approx(0.01, rel=0.1)
    assert not np.any(run["r"])
    assert np.array_equal(run["psi"], fly(1)["psi"])
    assert not np.array_equal(run["psi"], fly(2)["psi"])


def test_stamps_can_be_uneven_and_the_motion_matches_them():
    run = open_loop(turning(1.0), {"N": [(0.0, 1.0)]}, duration=10.0, interval=0.1, measured=("r",), stamps_jitter=0.04)
    gaps = np.diff(run["t"])
    assert gaps.min() < 0.08 and gaps.max() > 0.12 and gaps.min() > 0.0
    assert run["r"] == pytest.approx(1.0 - np.exp(-run["t"]), abs=1e-4)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"commands": {"X": [(0.0, 1.0)]}}, "no input 'X'"),
        ({"measured": ("U",)}, "'U' cannot be measured"),
        ({"duration": 0.1}, "two samples"),
        ({"stamps_jitter": 0.06}, "jitter"),
        ({"commands": {"N": [1.0, 2.0, 3.0]}}, "100 values"),
    ],
)
def test_an_impossible_run_is_rejected(change, reason):
    usual = {"commands": {"N": [(0.0, 1.0)]}, "duration": 10.0, "interval": 0.1, "measured": ("r",)}
    with pytest.raises(ValueError, match=reason):
        open_loop(turning(1.0), **{**usual, **change})


def test_neutral_effects_leave_the_file_unchanged():
    usual = {"duration": 20.0, "interval": 0.1, "measured": ("psi", "r")}
    commands = {"N": [(0.0, 1.0), (7.0, -1.0)]}
    plain = open_loop(FULL, commands, **usual)
    nothing = [
        make_effect("dead-zone", "", {"width": 0.0}),
        make_effect("input-delay", "", {"delay": 0.0}),
        make_effect("wind-moment", "", {"strength": 0.0, "direction": 1.0}),
        make_effect("mass-change", "", {"ratio": 1.0, "time": 0.0}),
        make_effect("measurement-delay", "psi", {"delay": 0.0}),
    ]
    altered = open_loop(FULL, commands, effects=nothing, **usual)
    assert set(altered) == set(plain) >= {"t", "psi", "r", "N"}
    for name, values in plain.items():
        assert altered[name] == pytest.approx(values, abs=1e-12), name


def test_the_same_effect_object_flies_again_from_the_start():
    lag = make_effect("actuator-lag", "", {"time_constant": 0.7})
    waves = make_effect("wave-disturbance", "yaw", {"amplitude": 0.2, "frequency": 2.0, "bandwidth": 0.1})
    usual = {"duration": 10.0, "interval": 0.1, "measured": ("r",), "effects": [lag, waves]}
    first, second = (open_loop(turning(1.0), {"N": [(0.0, 0.0), (1.0, 1.0)]}, **usual) for _ in range(2))
    assert np.array_equal(first["r"], second["r"])


def test_a_hull_that_only_turns_keeps_its_initial_speed():
    run = open_loop(
        turning(1.0), {"N": [(0.0, 0.5)]}, duration=10.0, interval=0.1, measured=("x", "r"), initial={"u": 1.0}
    )
    still = open_loop(turning(1.0), {"N": [(0.0, 0.5)]}, duration=10.0, interval=0.1, measured=("x", "r"))
    assert run["r"] == pytest.approx(still["r"], abs=1e-12)
    assert run["x"][10] > 0.5
    assert not np.any(still["x"])
