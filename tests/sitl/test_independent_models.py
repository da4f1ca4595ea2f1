"""Two independent writings of the same physics and the same wiring must agree: the tuner's and the simulator's."""

from __future__ import annotations

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
def test_a_switched_force_moves_both_alike(name, dof):
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
def test_both_settle_at_the_same_velocity(name, dof):
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


@pytest.mark.parametrize(("frame", "config"), FRAME_CONFIGS.items(), ids=FRAME_CONFIGS)
def test_each_force_is_wired_the_same_way_in_firmware_frame_and_tuner(frame, config):
    parameters = ParameterStore(SUB_PARAMETERS)
    parameters.preset("FRAME_CONFIG", config)
    for n in range(1, 9):
        parameters.preset(f"SERVO{n}_FUNCTION", 32 + n)
    motors, rail = SubMotors(parameters, DT), ServoRail(parameters)
    hull = load_vehicle("falcon").make_plant()
    physics = ThrusterFrame(FRAMES[frame], 1.0, 1.0, 1.0, 0.0, 0.0)
    mixing = FIRMWARE["ardusub"].mixing[config]
    for force, demand in (("N", "yaw"), ("X", "forward"), ("Z", "throttle")):
        motors.stop()
        if demand == "throttle":
            motors.set_throttle(0.3, 0.0)
        else:
            setattr(motors, demand, 0.4)
        motors.output(rail, armed=True)
        wrench = Wrench()
        physics.drive(rail.pwm, hull, wrench)
        for name in ("N", "X", "Z"):
            assert getattr(wrench, name) == pytest.approx(0.4 if name == force else 0.0, abs=0.003)
        seen = [(pwm - 1500) / 400 for pwm in rail.pwm]
        used = [factors[force] for factors in mixing]
        believed = sum(f * s for f, s in zip(used, seen, strict=False)) / sum(f * f for f in used)
        assert believed == pytest.approx(0.4, abs=0.003)
