"""Two independent implementations of physics and wiring must agree: the tuner's and the simulator's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof
from sitl import load_vehicle
from sitl.actuators import FRAMES, ThrusterFrame
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.sub_motors import SubMotors
from sitl.autopilot.sub_parameters import SUB_PARAMETERS
from sitl.plants import Wrench

DT = 0.02
CASES = [(name, dof) for name in ("videoray", "automarine", "falcon") for dof in ("yaw", "heave")]


def _model(name: str, dof: str) -> SingleDof:
    table = {key: entry["value"] for key, entry in load_vehicle(name).tables[dof].items()}
    return SingleDof(dof, "N m" if dof == "yaw" else "N", table["alpha"], table["beta"], table["beta2"])


@pytest.mark.parametrize(("name", "dof"), CASES)
def test_a_switched_force_moves_both_models_the_same_way(name, dof):
    model = _model(name, dof)
    authority = load_vehicle(name).tables[dof]["authority"]["value"]
    body = load_vehicle(name).make_plant()
    start = body.state.psi if dof == "yaw" else body.state.z
    nu = eta = 0.0
    for period in range(6):
        force = 0.6 * authority * (-1) ** period
        wrench = Wrench(N=force) if dof == "yaw" else Wrench(Z=force)
        for _ in range(40):
            body.step(wrench, DT)

        def slope(t, state, force=force):
            drag = (model.beta + model.beta_quadratic * abs(state[1])) * state[1]
            return [state[1], (force - drag) / model.alpha]

        eta, nu = solve_ivp(slope, (0.0, 0.8), [eta, nu], rtol=1e-10, atol=1e-12).y[:, -1]
        simulated = (body.state.psi, body.state.r) if dof == "yaw" else (body.state.z, body.state.w)
        assert simulated == pytest.approx((start + eta, nu), abs=2e-6)


@pytest.mark.parametrize(("name", "dof"), CASES)
def test_both_models_settle_at_the_same_velocity(name, dof):
    model = _model(name, dof)
    force = 0.5 * load_vehicle(name).tables[dof]["authority"]["value"]
    body = load_vehicle(name).make_plant()
    wrench = Wrench(N=force) if dof == "yaw" else Wrench(Z=force)
    nu = [0.0] * 6
    nu[5 if dof == "yaw" else 2] = model.steady_velocity(force)
    assert body.acceleration(nu, wrench) == pytest.approx([0.0] * 6, abs=1e-9)


FRAME_CONFIGS = {
    "bluerov1": 0, "vectored": 1, "vectored-6dof": 2, "vectored-6dof-90": 3, "simple-rov-3": 4, "simple-rov-5": 5,
    "rov-4-fore-aft": 5,
}  # fmt: skip


ARDUSUB: dict[int, tuple[tuple[float, ...], ...]] = {
    0: ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (-0.5, 0.5, 0, 0.45, 0, 0), (0.5, 0.5, 0, 0.45, 0, 0),
        (0, -1, 0, 1, 0, 0), (-0.25, 0, 0, 0, 0, 1)),
    1: ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1), (1, 0, 0, -1, 0, 0),
        (-1, 0, 0, -1, 0, 0)),
    2: ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1), (1, -1, 0, -1, 0, 0),
        (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0), (-1, 1, 0, -1, 0, 0)),
    3: ((1, 1, 0, 1, 0, 0), (0, 0, 1, 0, 1, 0), (1, -1, 0, 1, 0, 0), (0, 0, 0, 0, 0, 1), (0, 0, 0, 0, 0, 1),
        (-1, 1, 0, 1, 0, 0), (0, 0, -1, 0, 1, 0), (-1, -1, 0, 1, 0, 0)),
    4: ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (0, 0, 0, -1, 0, 0)),
    5: ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0), (0, 0, 0, 0, 0, 1)),
}  # fmt: skip
"""FRAME_CONFIG -> factors (roll, pitch, yaw, throttle, forward, lateral) of each motor in ArduSub 4.1 and later
(AP_Motors6DOF.cpp, setup_motors). 6 is as 5, 7 (custom) is as 4."""
ARDUSUB |= {6: ARDUSUB[5], 7: ARDUSUB[4]}
DEMANDS = ("roll", "pitch", "yaw", "throttle", "forward", "lateral")


def motor_outputs(config: int, **demands: float) -> list[float]:
    """Return what the simulated firmware makes of *demands* on a frame with eight motors."""
    parameters = ParameterStore(SUB_PARAMETERS)
    parameters.preset("FRAME_CONFIG", config)
    for n in range(1, 9):
        parameters.preset(f"SERVO{n}_FUNCTION", 32 + n)
    motors, rail = SubMotors(parameters, DT), ServoRail(parameters)
    for name, value in demands.items():
        if name == "throttle":
            motors.set_throttle(0.5 + 0.5 * value, 0.0)
        else:
            setattr(motors, name, value)
    motors.output(rail, armed=True)
    return [(pulse - 1500) / 400 for pulse in rail.pwm[: len(ARDUSUB[config])]]


@pytest.mark.parametrize("config", ARDUSUB)
@pytest.mark.parametrize("column", range(6), ids=DEMANDS)
def test_firmware_and_tuner_have_the_factors_of_ardusub(config, column):
    printed = [row[column] for row in ARDUSUB[config]]
    assert motor_outputs(config, **{DEMANDS[column]: 0.4}) == pytest.approx([0.4 * f for f in printed], abs=0.003)
    sign = -1.0 if DEMANDS[column] == "throttle" else 1.0  # Z points down
    assert [sign * factors["KMNZXY"[column]] for factors in FIRMWARE["ardusub"].mixing[config]] == printed


MISKOVIC = {
    "simple-rov-3": ("XZN", [[1, 1, 0], [0, 0, 1], [-1, 1, 0]]),
    "simple-rov-5": ("XYN", [[1, 1, 0, 0, 0], [0, 0, 0, 0, 1], [-1, 1, 0, 0, 0]]),
    "vectored": ("XYN", [[-1, -1, 1, 1, 0, 0], [1, -1, 1, -1, 0, 0], [1, -1, -1, 1, 0, 0]]),
    "vectored-6dof-90": ("XYN", [[0, 1, 0, 0, 0, 0, 1, 0], [0, 0, 0, 1, 1, 0, 0, 0], [0, 1, 0, 1, -1, 0, -1, 0]]),
    "rov-4-fore-aft": ("XZMN", [[1, 1, 0, 0], [0, 0, 1, 1], [0, 0, -1, 1], [-1, 1, 0, 0]]),
}
"""Frame -> signs of the rows of Miskovic2010, table 2.2 (a) to (e), in ArduSub's order and directions of motors.

There the pair ahead is port first (N = d, -d), here starboard first; (c) has all four thrusters pushing ahead, here
the front two push astern. (f), a thruster and a rudder, is in ``test_propulsion``."""


@pytest.mark.parametrize("frame", MISKOVIC)
def test_a_frame_has_the_signs_of_its_printed_allocation(frame):
    names, rows = MISKOVIC[frame]
    for name, row in zip(names, rows, strict=True):
        assert [float(np.sign(getattr(motor, name))) for motor in FRAMES[frame]] == row
    assert np.linalg.matrix_rank([[getattr(motor, name) for motor in FRAMES[frame]] for name in names]) == len(names)


TILTING = [
    (frame, force)
    for frame in FRAME_CONFIGS
    for force in "KM"
    if frame != "rov-4-fore-aft" and any(getattr(motor, force) for motor in FRAMES[frame])
]
"""Frames that roll or pitch by their thrusters, without (e), whose vertical thrusters ArduSub cannot distinguish."""


@pytest.mark.parametrize(("frame", "force"), TILTING)
def test_a_roll_or_pitch_demand_gives_only_that_moment(frame, force):
    config, demand = FRAME_CONFIGS[frame], {"K": "roll", "M": "pitch"}[force]
    outputs = motor_outputs(config, **{demand: 0.4})
    wrench = {
        name: sum(getattr(motor, name) * output for motor, output in zip(FRAMES[frame], outputs, strict=False))
        for name in "XZKMN"
    }
    assert wrench.pop(force) == pytest.approx(0.4, abs=0.003)
    assert list(wrench.values()) == pytest.approx([0.0] * 4, abs=0.003)


@pytest.mark.parametrize(("frame", "config"), FRAME_CONFIGS.items(), ids=FRAME_CONFIGS)
def test_each_force_is_wired_the_same_way_in_firmware_frame_and_tuner(frame, config):
    hull = load_vehicle("falcon").make_plant()
    physics = ThrusterFrame(FRAMES[frame], 1.0, 1.0, 1.0, 0.0, 0.0)
    mixing = FIRMWARE["ardusub"].mixing[config]
    for force, demand in (("N", "yaw"), ("X", "forward"), ("Z", "throttle")):
        wanted = -0.4 if demand == "throttle" else 0.4
        seen = motor_outputs(config, **{demand: wanted})
        wrench = Wrench()
        physics.drive([1500 + 400 * output for output in seen], hull, wrench)
        for name in ("N", "X", "Z"):
            assert getattr(wrench, name) == pytest.approx(0.4 if name == force else 0.0, abs=0.003)
        used = [factors[force] for factors in mixing]
        believed = sum(f * s for f, s in zip(used, seen, strict=False)) / sum(f * f for f in used)
        assert believed == pytest.approx(0.4, abs=0.003)
