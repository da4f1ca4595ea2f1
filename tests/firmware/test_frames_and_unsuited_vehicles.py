"""Output mixing of every frame, and the vehicles that are not supported."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pytest

from gcs_autotune.errors import ParameterMissing, PreconditionFailed, WrongVehicle
from gcs_autotune.firmware import FIRMWARE, read_servo_map
from gcs_autotune.link import MemoryLink, Session, open_craft
from sitl import open_vehicle
from sitl.autopilot import FIRMWARE as SIMULATED
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.sub_motors import SubMotors

SUB, ROVER = FIRMWARE["ardusub"], FIRMWARE["ardurover"]
FRAMES = {
    "BlueROV1": 0,
    "Vectored": 1,
    "Vectored_6DOF": 2,
    "Vectored_6DOF_90": 3,
    "SimpleROV-3": 4,
    "SimpleROV-4": 5,
    "SimpleROV-5": 6,
    "Custom": 7,
}
"""ArduSub's own list of FRAME_CONFIG."""


class Recorded:
    """Parameters of an arbitrary vehicle."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values = values

    def read(self, name: str) -> float:
        if name not in self.values:
            raise ParameterMissing(name)
        return self.values[name]

    def read_all(self, names: Iterable[str]) -> dict[str, float]:
        return {name: self.read(name) for name in names}

    def read_existing(self, names: Iterable[str]) -> dict[str, float]:
        return {name: self.values[name] for name in names if name in self.values}


def mixed(frame: int, **demands: float) -> list[int]:
    """Return the pulses of our simulated ArduSub for *demands* on *frame*."""
    _, definitions = SIMULATED["sub"]
    parameters = ParameterStore(definitions)
    parameters.preset("FRAME_CONFIG", float(frame))
    for n in range(1, 9):
        parameters.preset(f"SERVO{n}_FUNCTION", 32.0 + n)
    motors, rail = SubMotors(parameters, 0.02), ServoRail(parameters)
    for name, value in demands.items():
        setattr(motors, name, value)
    motors.output(rail, armed=True)
    return list(rail.pwm)


def read_frame(frame: int, **others: float) -> Any:
    functions = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 9)}
    return read_servo_map(Recorded({"FRAME_CONFIG": float(frame), **functions, **others}), SUB)


@pytest.mark.parametrize("frame", FRAMES.values(), ids=FRAMES)
def test_the_forces_of_every_ardusub_frame_are_recovered_from_its_outputs(frame: int) -> None:
    servos = read_frame(frame)
    for name, demands in {
        "N": {"yaw": 0.25},
        "X": {"forward": -0.25},
        "Z": {"throttle": 0.4, "throttle_in": 0.4},
    }.items():
        expected = {"N": 0.25, "X": -0.25, "Z": 0.2}[name]
        forces = servos.forces(mixed(frame, **demands))
        assert forces[name] == pytest.approx(expected, abs=0.004)
        assert all(abs(value) < 0.004 for other, value in forces.items() if other != name)


@pytest.mark.parametrize(
    ("frame", "pulses"),
    [(0, [1500, 1500, 1540, 1540, 1420, 1500]), (2, [1500] * 4 + [1420, 1420, 1580, 1580])],
    ids=["BlueROV1", "Vectored_6DOF"],
)
def test_levelling_is_not_mistaken_for_thrust(frame: int, pulses: list[int]) -> None:
    assert read_frame(frame).forces([*pulses, 1500, 1500])["Z"] == pytest.approx(0.0, abs=1e-9)


def test_the_outputs_that_drive_a_force_are_listed_with_their_factors() -> None:
    found = {output.channel: factor for output, factor in read_frame(0).driving("Z")}
    assert found == {3: -0.45, 4: -0.45, 5: -1.0}


def test_a_motor_whose_output_has_another_function_is_refused_with_its_cure() -> None:
    with pytest.raises(PreconditionFailed, match=r"motor 8 of FRAME_CONFIG 2 .* SERVO8_FUNCTION is 7. Set .* to 40"):
        read_frame(2, SERVO8_FUNCTION=7.0)


def test_one_vertical_thruster_drives_depth_and_a_motor_without_an_output_is_omitted() -> None:
    servos = read_frame(6, SERVO4_FUNCTION=37.0, SERVO5_FUNCTION=0.0)  # motors 1, 2, 3 and 5 of SimpleROV-5
    assert servos.names == ("X", "Y", "Z", "N")
    assert [(output.channel, factor) for output, factor in servos.driving("Z")] == [(3, 1.0)]
    assert [output.channel for output, _ in servos.driving("Y")] == [4]
    forces = servos.forces([1500, 1500, 1560, 1580, 1500, 1500, 1500, 1500])
    assert (forces["Z"], abs(forces["Y"])) == (pytest.approx(0.15), pytest.approx(0.2))


UNSUITED = {
    "sailboat": ({"SAIL_ENABLE": 1.0}, "SAIL_ENABLE is 1: a sailboat", "SAIL_ENABLE to 0"),
    "omni": ({"FRAME_TYPE": 4.0}, "FRAME_TYPE is 4: an omni frame", "set FRAME_TYPE to 0"),
    "balance bot": ({"FRAME_CLASS": 3.0}, "FRAME_CLASS is 3: a balance bot", "set FRAME_CLASS to 2"),
}


@pytest.mark.parametrize(("parameters", "cause", "cure"), UNSUITED.values(), ids=UNSUITED)
def test_an_unsupported_vehicle_is_rejected_on_connection(parameters: dict[str, float], cause: str, cure: str) -> None:
    server = open_vehicle("charlie", parameters=parameters)
    with pytest.raises(WrongVehicle) as caught:
        open_craft(Session(MemoryLink(server)))
    assert cause in str(caught.value)
    assert cure in str(caught.value)
    assert server.now < 5.0
    assert not server.vehicle.autopilot.armed


def test_omni_frame_motors_are_distinguished_from_a_missing_output() -> None:
    functions = {"SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 34.0, "SERVO3_FUNCTION": 35.0}
    with pytest.raises(PreconditionFailed, match=r"assigned to motors \(33, 34, 35\), as on an omni frame"):
        read_servo_map(Recorded(functions), ROVER)


def test_inactive_sailboat_parameters_are_accepted() -> None:
    assert ROVER.misfit({"SAIL_ENABLE": 0.0, "FRAME_TYPE": 0.0, "FRAME_CLASS": 2.0}) == ""
