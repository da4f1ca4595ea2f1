"""Rover goes to a position and holds it: GUIDED, LOITER, pivot turns, the laws of the position controller."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.place import to_globe
from tests.sitl.ground import GUIDED, Ground, boat
from tests.sitl.missions import AUTO, LOITER, place, run_until_reached, speed, twin, upload, waypoint

TUNED = {"ATC_STR_RAT_FF": 3.0, "ATC_STR_RAT_P": 2.0, "ATC_STR_ANG_P": 1.0}
ONLY_PLACE, VELOCITY = 0b110111111000, 0b110111000111
LOCAL, OFFSET, BODY = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED, mavlink.MAV_FRAME_BODY_NED


def _guided(**parameters: float) -> Ground:
    ground = boat(mode=GUIDED, parameters={**TUNED, **parameters})
    ground.run(1.0)
    return ground


def _go(ground: Ground, x: float, y: float, frame: int = LOCAL, mask: int = ONLY_PLACE) -> None:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, x, y, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    ground.send(message)


def _go_globe(ground: Ground, target: complex, frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT) -> None:
    ground.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, frame, ONLY_PLACE, *to_globe(target), 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )


@pytest.mark.parametrize("option", [0, 64])
def test_guided_goes_to_a_position_and_stays_there(option):
    ground = _guided(GUID_OPTIONS=option)
    _go_globe(ground, 25 + 10j)
    run_until_reached(ground, 0)
    assert abs(place(ground) - (25 + 10j)) < 3.0
    ground.run(20.0)
    assert abs(place(ground) - (25 + 10j)) < 6.0
    assert speed(ground) < 0.2 and ground.mode_number == GUIDED


def test_a_position_target_needs_no_repetition():
    ground = _guided()
    _go(ground, 40.0, 0.0)
    ground.run(15.0)
    assert "target not received last 3secs, stopping" not in ground.texts()
    assert speed(ground) > 0.8


@pytest.mark.parametrize("frame", [LOCAL, OFFSET, BODY])
def test_every_frame_of_a_position_target_is_supported(frame):
    ground = _guided()
    ground.vehicle.state.x, ground.vehicle.state.y = 5.0, -3.0
    ground.run(0.2)
    _go(ground, 20.0, 10.0, frame)
    ground.run(1.1)
    here = 0j if frame == LOCAL else 5 - 3j
    ahead = ground.vehicle.state.psi if frame == BODY else 0.0
    wanted = here + (20 + 10j) * complex(math.cos(ahead), math.sin(ahead))
    target = ground.last("POSITION_TARGET_GLOBAL_INT")
    assert (target.lat_int, target.lon_int) == pytest.approx(to_globe(wanted), abs=20)


def test_a_position_target_in_an_unknown_frame_is_ignored():
    ground = _guided()
    _go(ground, 20.0, 0.0, mavlink.MAV_FRAME_LOCAL_FRD)
    _go_globe(ground, 20 + 0j, mavlink.MAV_FRAME_LOCAL_NED)
    ground.run(3.0)
    assert ground.servos[2] == 1500


def test_a_position_target_outside_guided_is_ignored():
    ground = boat(mode=LOITER)
    _go(ground, 20.0, 0.0)
    ground.run(3.0)
    assert ground.servos[2] == 1500


def test_a_velocity_target_replaces_a_position_target_and_times_out():
    ground = _guided()
    _go(ground, 60.0, 0.0)
    ground.run(10.0)
    ground.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, BODY, VELOCITY, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
        )
    )
    ground.run(2.0)
    assert not ground.texts().count("target not received last 3secs, stopping")
    ground.run(2.0)
    assert "target not received last 3secs, stopping" in ground.texts()
    assert ground.mode_number == GUIDED


def test_a_velocity_is_limited_to_wp_speed():
    ground = _guided()
    ground.repeated = lambda: mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, BODY, VELOCITY, 0, 0, 0, 9.0, 0, 0, 0, 0, 0, 0, 0
    )
    ground.run(30.0)
    assert ground.vehicle.state.u == pytest.approx(1.2, abs=0.06)


def test_a_loitering_boat_drifts_within_its_radius_and_returns_in_a_current():
    ground = boat(mode=LOITER, parameters=TUNED)
    ground.run(1.0)
    home = place(ground)
    ground.vehicle.plant.water.V_x = 0.3
    away = []
    for _ in range(240):
        ground.run(1.0)
        away.append(abs(place(ground) - home))
    assert 2.0 < max(away) < 9.0
    assert max(away[-60:]) < 7.0


@pytest.mark.parametrize(("kind", "astern"), [(0, True), (1, False), (2, True)])
def test_a_loitering_boat_returns_ahead_or_astern_by_its_parameter(kind, astern):
    ground = boat(mode=LOITER, parameters={**TUNED, "LOIT_TYPE": kind})
    ground.run(1.0)
    ground.vehicle.state.x += 20.0 * math.cos(ground.vehicle.state.psi)
    ground.vehicle.state.y += 20.0 * math.sin(ground.vehicle.state.psi)
    ground.run(4.0)
    assert (ground.vehicle.state.u < 0.0) == astern


def test_a_stopped_boat_drifts_without_throttle():
    ground = boat(parameters={**TUNED, "ATC_STOP_SPEED": 0.1})
    upload(ground, [waypoint(12 + 0j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    ground.run(20.0)
    ground.vehicle.plant.water.V_x = 0.4
    ground.run(5.0)
    assert ground.servos[2] == 1500 and speed(ground) == pytest.approx(0.4, abs=0.1)


def test_a_boat_with_two_thrusters_pivots_at_a_sharp_corner():
    ground = twin()
    upload(ground, [waypoint(15 + 0j), waypoint(15 + 20j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    slowest, inside = 9.0, True
    while abs(math.remainder(ground.vehicle.state.psi - 0.5 * math.pi, math.tau)) > math.radians(5.0):
        ground.run(0.1)
        slowest = min(slowest, speed(ground))
        inside = inside and abs(place(ground) - 15.0) < 4.0
    assert slowest < 0.2 and inside


def test_a_flat_corner_is_rounded_without_a_pivot_turn():
    ground = twin()
    upload(ground, [waypoint(15 + 0j), waypoint(30 + 8j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    slowest = 9.0
    for _ in range(40):
        ground.run(0.1)
        slowest = min(slowest, speed(ground))
    assert slowest > 0.7


def test_a_pivot_angle_of_zero_disables_pivot_turns():
    ground = twin(WP_PIVOT_ANGLE=0)
    upload(ground, [waypoint(15 + 0j), waypoint(15 + 20j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    slowest = 9.0
    for _ in range(30):
        ground.run(0.1)
        slowest = min(slowest, speed(ground))
    assert slowest > 0.3


def test_a_pivot_turn_is_followed_by_its_delay():
    ground = twin(WP_PIVOT_DELAY=4)
    upload(ground, [waypoint(15 + 0j), waypoint(15 + 20j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    while abs(math.remainder(ground.vehicle.state.psi - 0.5 * math.pi, math.tau)) > math.radians(5.0):
        ground.run(0.1)
    ground.run(2.5)
    assert ground.vehicle.autopilot.helm.waypoints.pivot.active
    ground.run(4.0)
    assert not ground.vehicle.autopilot.helm.waypoints.pivot.active


def test_a_rudder_boat_keeps_its_speed_in_a_turn():
    ground = boat(parameters={**TUNED, "TURN_RADIUS": 0.9})
    upload(ground, [waypoint(-40 + 0j)])
    ground.mode(AUTO)
    ground.run(0.1)
    waypoints = ground.vehicle.autopilot.helm.waypoints
    ground.run(8.0)
    behind = abs(math.remainder(ground.vehicle.state.psi - math.pi, math.tau)) > math.radians(60.0)
    assert behind and waypoints.speed > 0.1


def test_the_integral_of_the_velocity_is_kept_across_the_hull_only():
    ground = twin(PSC_VEL_I=0.3)
    upload(ground, [waypoint(80 + 0j)])
    ground.mode(AUTO)
    ground.vehicle.plant.water.V_y = 0.3
    largest = 0.0
    for _ in range(40):
        ground.run(1.0)
        integral = ground.vehicle.autopilot.helm.waypoints.position.velocity_integral
        yaw = ground.vehicle.autopilot.estimate.yaw
        turned = integral * complex(math.cos(yaw), -math.sin(yaw))
        assert abs(turned.real) < 1e-9
        largest = max(largest, abs(turned.imag))
    assert largest > 0.05


def test_a_leg_is_followed_in_a_current():
    ground = boat(parameters=TUNED)
    ground.vehicle.plant.water.V_y = 0.2
    upload(ground, [waypoint(15 + 0j), waypoint(90 + 0j)])
    ground.mode(AUTO)
    run_until_reached(ground, 1)
    ground.run(40.0)
    assert place(ground).real > 40.0 and abs(place(ground).imag) < 3.0


def test_the_speed_limit_of_a_mission_is_wp_speed():
    ground = boat(parameters={**TUNED, "WP_SPEED": 0.8})
    upload(ground, [waypoint(90 + 0j)])
    ground.mode(AUTO)
    fastest = 0.0
    for _ in range(60):
        ground.run(1.0)
        fastest = max(fastest, speed(ground))
    assert fastest < 1.05
