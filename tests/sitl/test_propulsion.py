"""Thrusters, propellers with motors, and rudders: each alone against its printed equation, then composed in a file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import sitl
from sitl import BadVehicle, load_vehicle
from sitl.actuators import FRAMES, ThrusterSet
from sitl.craft import Craft
from sitl.modelfile import BadModel, FlownModel
from sitl.plants import AxisDynamics, RigidBody, Wrench, kernel
from sitl.plants.propulsion import propeller_rows, rudder_rows, static_thrust
from sitl.plants.rigid_body import DOFS
from sitl.setting import setting_of

SIX = Path(sitl.__file__).parent / "vehicles" / "bluerov2_6dof.toml"
LAW = {"a_ahead": 0.05, "b_ahead": 0.1, "advance_ahead": 0.4, "a_astern": 0.03, "b_astern": 0.05, "advance_astern": 0.2}


def pushed(nu=(0.0,) * 6, command: float = 1.0, rudders=None, angle: float = 0.0, **thruster) -> np.ndarray:
    """Return the forces (6,) on a body of unit inertia and no drag with one thruster."""
    rows = propeller_rows({"full_n": 20.0, **LAW, **thruster}, {}, {})
    return forces(rows, nu, command, rudders, angle)


def forces(rows, nu, command, rudders=None, angle=0.0) -> np.ndarray:
    unit = dict.fromkeys(DOFS, AxisDynamics(1.0, 0.0, 0.0))
    body = RigidBody(unit, propellers=rows, rudders=rudders)
    body.commands[: len(rows)], body.rotors[:] = command, command * rows[:, 16]
    body.commands[len(rows) :] = angle
    return np.array(body.acceleration(nu, Wrench()))


@pytest.mark.parametrize("command", [0.7, -0.7])
@pytest.mark.parametrize("u", [0.0, 0.8, -0.5])
def test_a_thruster_follows_the_bilinear_law_in_both_directions(command, u):
    """Miskovic2010, (2.4), (2.5), (2.8)."""
    n, way = 20.0 * command, "ahead" if command > 0.0 else "astern"
    expected = (LAW[f"a_{way}"] * abs(n) + LAW[f"b_{way}"]) * n - LAW[f"advance_{way}"] * abs(n) * (1.0 - 0.2) * u
    assert pushed((u, 0.0, 0.0, 0.0, 0.0, 0.0), command, wake=0.2)[0] == pytest.approx(expected)


def test_a_thruster_meets_the_water_at_its_own_place_and_along_its_shaft():
    nu, place, n = (0.6, -0.4, 0.3, 0.5, -0.2, 0.7), (0.5, -0.3, 0.2), 20.0
    along = np.array([math.cos(2.0) * math.cos(0.4), math.sin(2.0) * math.cos(0.4), math.sin(0.4)])
    flow = along @ (nu[:3] + np.cross(nu[3:], place))
    still = pushed((0.0,) * 6, azimuth=2.0, dip=0.4, **dict(zip("xyz", place, strict=True)))[:3]
    moving = pushed(nu, azimuth=2.0, dip=0.4, **dict(zip("xyz", place, strict=True)))[:3]
    own = forces(propeller_rows({}, {}, {}), nu, 0.0)[:3]
    assert moving - own - still == pytest.approx(-LAW["advance_ahead"] * n * flow * along)


def test_four_thrusters_with_arms_give_the_printed_wrench():
    """Gomes2003, (9), with all arms that a force along its axis can have."""
    D = {(1, "y"): 0.2, (1, "z"): 0.1, (2, "y"): -0.25, (2, "z"): 0.15, (3, "x"): 0.3, (3, "z"): -0.1}
    D |= {(4, "x"): -0.05, (4, "y"): 0.07}
    place = {axis: [D.get((i, axis), 0.0) for i in range(1, 5)] for axis in "xyz"}
    rows = propeller_rows(
        {**place, "azimuth": [0.0, 0.0, math.pi / 2, 0.0], "dip": [0.0, 0.0, 0.0, math.pi / 2], "a_ahead": 1.0}, {}, {}
    )
    F = np.array([3.0, 5.0, 2.0, 4.0])
    F1, F2, F3, F4 = F
    expected = [
        F1 + F2, F3, F4, -F3 * D[3, "z"] + F4 * D[4, "y"], F1 * D[1, "z"] + F2 * D[2, "z"] - F4 * D[4, "x"],
        -F1 * D[1, "y"] - F2 * D[2, "y"] + F3 * D[3, "x"],
    ]  # fmt: skip
    assert forces(rows, (0.0,) * 6, np.sqrt(F)) == pytest.approx(expected, abs=1e-12)


def test_a_propeller_has_k_t_and_k_q_by_its_advance_number():
    """Gomes2003, (12), (16), (17)."""
    values = {"density": 1000.0, "diameter": 0.2, "K_T0": 0.4, "K_TJ": -0.35, "K_Q0": 0.05, "K_QJ": -0.03}
    rows = propeller_rows({"full_n": 12.0}, values, {})
    V, n = 0.9, 12.0
    J = V / (n * 0.2)
    at = forces(rows, (V, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0)
    assert at[0] == pytest.approx(1000.0 * 0.2**4 * (0.4 - 0.35 * J) * n * n)
    assert at[3] == pytest.approx(-1000.0 * 0.2**5 * (0.05 - 0.03 * J) * n * n)
    weak = propeller_rows({"full_n": 12.0}, {**values, "astern": 0.8}, {})
    assert forces(weak, (-V, 0.0, 0.0, 0.0, 0.0, 0.0), -1.0)[0] == pytest.approx(-0.8 * at[0])


DC = {"inertia": 0.002, "constant": 0.1, "resistance": 0.5, "voltage": 24.0, "friction": 1e-4}
SHAFT = {"a_ahead": 0.05, "torque": 0.002, "full_n": 30.0}


def test_the_spin_up_of_a_dc_motor_agrees_with_another_integrator():
    rows = propeller_rows(SHAFT, {}, DC)
    body = RigidBody({}, propellers=rows)
    body.commands[0] = 0.8

    def spin(_, s):
        current = (0.8 * 24.0 - 0.1 * 2.0 * math.pi * s[0]) / 0.5
        return [(0.1 * current - 0.002 * abs(s[0]) * s[0] - 1e-4 * 2.0 * math.pi * s[0]) / (2.0 * math.pi * 0.002)]

    for seconds in (0.05, 0.2, 1.0):
        end = solve_ivp(spin, (0.0, seconds), [0.0], rtol=1e-10, atol=1e-12).y[0, -1]
        body.rotors[0] = 0.0
        for _ in range(round(seconds / 0.001)):
            body.step(Wrench(), 0.001)
        assert body.rotors[0] == pytest.approx(end, rel=1e-7)
    assert static_thrust(rows[0], 0.8)[1] == pytest.approx(body.rotors[0], rel=1e-3)


def test_a_motor_is_limited_by_its_voltage_and_current():
    rows, limited = (propeller_rows(SHAFT, {}, {**DC, **more}) for more in ({}, {"most_current": 4.0}))
    assert static_thrust(rows[0], 3.0) == static_thrust(rows[0], 1.0)
    n = static_thrust(limited[0], 1.0)[1]
    assert 0.1 * 4.0 == pytest.approx(0.002 * n * n + 1e-4 * 2.0 * math.pi * n)
    for row, command in ((rows, 1.0), (rows, -3.0), (limited, 1.0), (limited, -1.0)):
        body = RigidBody({}, propellers=row)
        body.commands[0] = command
        for _ in range(4000):
            body.step(Wrench(), 0.001)
        assert body.rotors[0] == pytest.approx(static_thrust(row[0], command)[1], rel=1e-6)


def test_a_shaft_with_a_lag_follows_its_command_exponentially():
    body = RigidBody({}, propellers=propeller_rows(SHAFT, {}, {"time_constant": 0.2}))
    body.commands[0] = 1.0
    for _ in range(40):
        body.step(Wrench(), 0.005)
    assert body.rotors[0] == pytest.approx(30.0 * (1.0 - math.exp(-1.0)), rel=1e-6)


RUDDER = {"x": -1.2, "coefficient": 15.0, "stall": 0.8, "C_T": 0.05, "wake": 0.1}


def rudder_force(delta: float, nu=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), command=1.0, **more) -> np.ndarray:
    own = forces(propeller_rows({"a_ahead": 40.0}, {}, {}), nu, command)
    rows = propeller_rows({"a_ahead": 40.0}, {}, {})
    return forces(rows, nu, command, rudder_rows({**RUDDER, **more}, 1), delta) - own


@pytest.mark.parametrize("delta", [0.3, -0.5, 0.9])
def test_a_rudder_has_the_sine_law_its_stall_and_the_slipstream(delta):
    """Miskovic2010, (2.9), (2.10), (2.35)."""
    square = 0.9**2 + 0.05 * 40.0
    lift = math.sin(0.5 * math.pi * delta / 0.8) if abs(delta) < 0.8 else math.sin(delta)
    tau = 15.0 * square * lift
    expected = [-tau * math.sin(delta), -tau * math.cos(delta), 0.0, 0.0, 0.0, 1.2 * tau * math.cos(delta)]
    assert rudder_force(delta) == pytest.approx(expected, abs=1e-12)


def test_a_rudder_amidships_damps_sway_and_turning():
    assert rudder_force(0.0, (1.0, 0.2, 0.0, 0.0, 0.0, 0.0))[1] < 0.0
    assert rudder_force(0.0, (1.0, 0.0, 0.0, 0.0, 0.0, 0.2))[5] < 0.0
    assert rudder_force(0.0, (1.0, 0.2, 0.0, 0.0, 0.0, 0.2), flow=0.0) == pytest.approx(np.zeros(6))


def test_the_attack_of_a_rudder_is_its_angle_and_that_of_the_water_there():
    u, v, r, delta = 1.0, 0.2, 0.3, 0.1
    square = (0.9 * math.hypot(u, v)) ** 2 + 0.05 * 40.0
    attack = delta + math.atan((v - 1.2 * r) / math.sqrt(square))
    tau = 15.0 * square * math.sin(0.5 * math.pi * attack / 0.8)
    X, Y, _, _, _, N = rudder_force(delta, (u, v, 0.0, 0.0, 0.0, r))
    assert (X, Y, N) == pytest.approx((-tau * math.sin(delta), -tau * math.cos(delta), 1.2 * tau * math.cos(delta)))


def test_a_rudder_in_flow_from_astern_acts_in_reverse():
    ahead, astern = (rudder_force(0.2, (0.0,) * 6, command)[5] for command in (1.0, -1.0))
    assert astern == pytest.approx(-ahead)


def test_small_angles_of_charlies_rudders_brake_and_turn_with_n_squared_and_u_squared():
    """Miskovic2010, (2.37) and (2.38) with the erratum: delta^2 in surge, delta in yaw."""
    craft = Craft(load_vehicle("charlie-rudders"))
    plant, wrench = craft.plant, Wrench()

    def total(n: float, delta: float, u: float) -> np.ndarray:
        plant.commands[:], plant.rotors[:] = (n / 8.0, n / 8.0, delta, delta), n
        masses = np.array([plant.axis(dof).alpha for dof in ("surge", "sway", "yaw")])
        return np.array(plant.acceleration((u, 0.0, 0.0, 0.0, 0.0, 0.0), wrench))[[0, 1, 5]] * masses

    for n, u in ((6.0, 0.0), (6.0, 0.9), (0.0, 0.9)):
        straight = total(n, 0.0, u)
        small, double = (total(n, delta, u) - straight for delta in (0.02, 0.04))
        assert small[0] < 0.0 < small[2] and small[1] < 0.0
        assert double / small == pytest.approx([4.0, 2.0, 2.0], rel=5e-3)
    at = np.array([total(n, 0.02, 0.0)[2] for n in (3.0, 6.0)])
    assert at[1] / at[0] == pytest.approx(4.0)


@pytest.mark.parametrize("command", [1.0, -1.0])
@pytest.mark.parametrize(("name", "full"), [("launch", 35.0), ("vectored-boat", 45.0)])
def test_a_steered_motor_pushes_along_its_axis(name, full, command):
    """The force of the file's rudder and thruster together: along the motor, T cos delta."""
    tables = load_vehicle(name).tables
    thruster, rudder = ({k: v["value"] for k, v in tables[h].items()} for h in ("thrusters", "rudder"))
    assert math.degrees(rudder["full"]) == pytest.approx(full)
    rows, rudders = propeller_rows(thruster, {}, {}), rudder_rows(rudder, 1)
    T = static_thrust(rows[0], command)[0]
    for delta in (-rudder["full"], 0.2, rudder["full"]):
        X, Y, _, _, _, N = forces(rows, (0.0,) * 6, command, rudders, delta)
        assert (X, Y) == pytest.approx((T * math.cos(delta) ** 2, -T * math.cos(delta) * math.sin(delta)))
        assert N == pytest.approx(thruster["x"][0] * Y)
    drifting = forces(rows, (0.0, 0.5, 0.0, 0.0, 0.0, 0.2), 0.0, rudders, 0.3)
    assert drifting[5] == pytest.approx(forces(rows, (0.0, 0.5, 0.0, 0.0, 0.0, 0.2), 0.0)[5]), "no thrust, no steering"


@pytest.mark.parametrize("name", ["launch", "vectored-boat"])
def test_the_cruise_throttle_of_a_boat_with_steered_thrust_gives_its_cruise_speed(name):
    data = load_vehicle(name)
    craft = Craft(data)
    craft.begin("0")
    pwm = craft.actuators.write([1500] * 16, {"X": data.parameters["CRUISE_THROTTLE"] / 100.0, "N": 0.0})
    for k in range(3000):
        craft.move(0.02 * (k + 1), 0.02, pwm)
    assert craft.plant.state.u == pytest.approx(data.parameters["CRUISE_SPEED"], rel=0.02)


def test_the_slew_of_a_rudder_is_the_effect_of_that_name_on_the_vehicle():
    data = load_vehicle("charlie-rudders")
    assert [(effect.slug, effect["rate"]) for effect in data.make_effects()] == [
        ("rate-limit", pytest.approx(0.7 / math.radians(30.0)))
    ]
    craft = Craft(data)
    craft.begin("1")
    craft.move(0.0, 0.02, [1500, 1500, 1500, 1500])
    for k in range(1, 11):
        craft.move(0.02 * k, 0.02, [2000, 1500, 1500, 1500])
    assert craft.plant.commands[2] == pytest.approx(0.7 * 0.19, rel=1e-6)


@pytest.mark.parametrize("name", ["bluerov2-6dof", "bluerov2-standard", "ies-rov", "tugboat"])
def test_pulses_become_outputs_and_back(name):
    craft = Craft(load_vehicle(name))
    still = [1500] * 8
    asked = {axis: 0.05 * (1 + k) for k, axis in enumerate(craft.actuators.read(still))}
    pulses = craft.actuators.write(still, asked)
    assert craft.actuators.read(pulses) == pytest.approx(asked, abs=4e-3)
    by_pulse, by_output = (np.zeros(len(craft.plant.commands)) for _ in range(2))
    craft.actuators.drive(pulses, craft.plant.parameters, Wrench())
    by_pulse[:] = craft.plant.commands
    craft.actuators.apply(craft.actuators.read(pulses), craft.plant.parameters, Wrench())
    by_output[:] = craft.plant.commands
    assert by_output == pytest.approx(by_pulse, abs=1e-9)


@pytest.mark.parametrize(("axis", "row"), [("K", 3), ("M", 4), ("N", 5), ("X", 0), ("Y", 1), ("Z", 2)])
def test_each_axis_of_the_vectored_frame_pushes_in_its_own_direction(axis, row):
    craft = Craft(load_vehicle("bluerov2-6dof"))
    craft.actuators.apply({axis: 0.5}, craft.plant.parameters, Wrench())
    craft.plant.rotors[:] = craft.plant.commands
    craft.plant.state.z = 50.0
    body = craft.plant.body[:6]
    found = body @ craft.plant.acceleration((0.0,) * 6, Wrench())
    weight = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])  # buoyancy beyond the weight
    rest = np.abs(found - weight)
    assert found[row] > 0.5
    assert np.delete(rest, row).max() < 0.02 * rest[row]


def test_a_set_of_thrusters_and_its_frame_must_have_the_same_number(tmp_path: Path):
    text = SIX.read_text(encoding="utf-8")
    mine = tmp_path / "mine.toml"
    mine.write_text(text.replace(', 0.12, -0.12, -0.12], unit = "m"', ', 0.12, -0.12], unit = "m"'))
    with pytest.raises(BadVehicle, match="thrusters: lists of different length"):
        load_vehicle(str(mine))
    with pytest.raises(ValueError, match="the frame has 6"):
        ThrusterSet(FRAMES["vectored"], range(1, 9), 400.0, np.zeros((8, kernel.PROPELLER)), {})


def test_a_model_does_not_replace_thrusters_with_a_place():
    with pytest.raises(BadModel, match="thrusters of its own"):
        Craft(load_vehicle("charlie-rudders"), model=FlownModel({}, {}, {}))


def test_a_body_whose_mass_contradicts_its_inertia_is_rejected(tmp_path: Path):
    text = SIX.read_text(encoding="utf-8")
    mine = tmp_path / "mine.toml"
    mine.write_text(text.replace("\n[body]", '\n[body]\nx_G = { value = 3.0, unit = "m", source = "x" }'))
    with pytest.raises(BadVehicle, match="the inertia has the eigenvalue -"):
        load_vehicle(str(mine))


def started(name: str) -> Craft:
    craft = Craft(load_vehicle(name))
    craft.begin("0")
    return craft


def test_the_tugboat_floats_and_rights_itself():
    craft = started("tugboat")
    at = craft.plant.state
    at.phi, at.theta, at.z = 0.2, 0.05, 0.02
    for k in range(1000):
        craft.move(0.02 * k, 0.02, [1500] * 4)
    assert (at.phi, at.theta, at.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_the_tugboat_reaches_two_metres_per_second():
    """Erunsal2017, section 2; before it turns by itself."""
    craft = started("tugboat")
    for k in range(500):
        craft.move(0.02 * k, 0.02, [2000, 1500, 2000, 1500])
    assert craft.plant.state.u == pytest.approx(2.0, abs=0.1)


def test_the_air_drags_the_tugboat_by_its_printed_coefficient():
    """Erunsal2017, table 1: C_DA 0.6487, here over 0.04 m^2 ahead."""
    (air,) = load_vehicle("tugboat").make_effects()
    craft = started("tugboat")
    craft.plant.state.u, pushed = 1.5, Wrench()
    air.begin(setting_of(craft.plant, craft.actuators, is_boat=True, mass=11.0, seed="0"))
    air.alter_force(0.0, pushed)
    assert pushed.X == pytest.approx(-0.5 * 1.225 * 0.6487 * 0.04 * 1.5**2)
    assert pushed.N == 0.0


@pytest.mark.parametrize("name", ["bluerov2-standard", "launch", "vectored-boat"])
def test_a_craft_with_cancelled_munk_moment_keeps_its_course(name):
    craft = started(name)
    at, wrench = craft.plant.state, Wrench()
    craft.actuators.apply({"X": 0.5, "N": 0.0}, craft.plant.parameters, wrench)
    wrench.N, at.z, at.r = 0.0, 0.0 if craft.plant.water.floats else 5.0, 0.02
    for _ in range(1500):
        craft.plant.step(wrench, 0.02)
    assert at.u > 0.6 and abs(at.r) < 1e-3


def test_more_propellers_than_the_kernel_supports_are_rejected():
    with pytest.raises(ValueError, match="at most 16 propellers, not 17"):
        RigidBody({}, propellers=np.zeros((17, kernel.PROPELLER)))
