"""Two rangefinders that look to port and to starboard: distance and angle to a wall."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.link.vehicle.wall_beams import WallBeams, yaw_of
from tests.sitl.ground import Ground


def message(orientation: int, quaternion: tuple[float, ...] = (0.0,) * 4) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_distance_sensor_message(0, 10, 1000, 200, 0, 0, orientation, 0, quaternion=quaternion)


def about(axis: int, angle: float) -> tuple[float, ...]:
    vector = [0.0, 0.0, 0.0]
    vector[axis] = math.sin(0.5 * angle)
    return (math.cos(0.5 * angle), *vector)


def test_the_orientation_of_a_forward_sensor_is_its_yaw() -> None:
    assert yaw_of(message(0)) == 0.0
    assert yaw_of(message(1)) == pytest.approx(math.pi / 4)
    assert yaw_of(message(7)) == pytest.approx(-math.pi / 4)
    assert yaw_of(message(100, about(2, -0.3))) == pytest.approx(-0.3)
    down, to_the_side, astern = message(25), message(2), message(4)
    assert [yaw_of(m) for m in (down, to_the_side, astern)] == [None] * 3
    assert yaw_of(message(100, about(1, 0.5))) is None
    assert yaw_of(message(100)) is None


@pytest.mark.parametrize("angle", [-0.4, 0.0, 0.25])
@pytest.mark.parametrize("aside", [0.3, math.pi / 4])
def test_two_beams_give_distance_and_angle_of_the_wall(angle: float, aside: float) -> None:
    beams, wall = WallBeams(), 2.0
    assert beams.add(1.0, -aside, wall / math.cos(angle - aside)) is None
    found = beams.add(1.0, aside, wall / math.cos(angle + aside))
    assert found == pytest.approx((wall / math.cos(angle), angle))
    assert beams.add(1.5, -aside, wall) is None
    assert beams.add(2.0, aside, wall) is None, "the beams measured at different times"
    assert beams.add(2.0, -aside, math.nan) is not None


def test_the_simulated_beams_are_sent_with_their_orientation() -> None:
    ground = Ground("videoray-beams", seed=1)
    ground.command(511, 132, 100000)
    ground.run(0.3)
    heard = [m for m in ground.heard if m.get_type() == "DISTANCE_SENSOR"][-2:]
    assert [yaw_of(m) for m in heard] == pytest.approx([-math.pi / 4, math.pi / 4])
    beams = WallBeams()
    for m in heard:
        found = beams.add(m.time_boot_ms / 1000, yaw_of(m) or 0.0, m.current_distance / 100)
    assert found == pytest.approx((2.0, 0.0), abs=0.02)
