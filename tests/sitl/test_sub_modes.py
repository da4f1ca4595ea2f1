"""Sub's output mapping and loops, against what was measured on the real firmware."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.ground import SUB_ALT_HOLD, SUB_GUIDED, SUB_STABILIZE, Ground, rov

NEUTRAL = {3: 1500, 4: 1500, 5: 1500, 6: 1500}


def _joystick(ground: Ground, seconds: float, **axes: int) -> list[int]:
    ground.sticks = None
    for _ in range(round(seconds * 10)):
        ground.manual_control(**{"z": 500, **axes})
        ground.run(0.1)
    return ground.servos


@pytest.mark.parametrize(
    ("axes", "motors"),
    [
        ({"r": 1000}, [1700, 1300, 1300, 1700, 1500, 1500]),
        ({"x": 1000}, [1300, 1300, 1700, 1700, 1500, 1500]),
        ({"y": 1000}, [1700, 1300, 1700, 1300, 1500, 1500]),
        ({"z": 1000}, [1500, 1500, 1500, 1500, 1300, 1300]),
        ({"z": 0}, [1500, 1500, 1500, 1500, 1700, 1700]),
        ({"r": 500, "x": 500}, [1500, 1300, 1500, 1700, 1500, 1500]),
    ],
)
def test_the_joystick_drives_the_vectored_motors_as_measured(axes, motors):
    assert _joystick(rov("falcon"), 0.3, **axes)[:6] == motors


def test_the_joystick_gain_counts_at_boot_only():
    ground = rov("falcon")
    ground.set("JS_GAIN_DEFAULT", 1.0)
    assert _joystick(ground, 0.3, r=1000)[0] == 1700
    assert _joystick(rov("falcon", parameters={"JS_GAIN_DEFAULT": 1.0}), 0.3, r=1000)[0] == 1900


@pytest.mark.parametrize(
    ("sticks", "motors"),
    [
        ({4: 1501}, [1501, 1499, 1499, 1501, 1500, 1500]),
        ({4: 1900}, [1900, 1100, 1100, 1900, 1500, 1500]),
        ({3: 1900}, [1500, 1500, 1500, 1500, 1100, 1100]),
        ({5: 1600}, [1400, 1400, 1600, 1600, 1500, 1500]),
        ({4: 1900, 5: 1900}, [1500, 1100, 1500, 1900, 1500, 1500]),
    ],
)
def test_overrides_reach_the_motors_without_gain_or_dead_zone(sticks, motors):
    ground = rov("falcon")
    ground.sticks = {**NEUTRAL, **sticks}
    ground.run(0.3)
    assert ground.servos[:6] == motors


@pytest.mark.parametrize(
    ("sticks", "motors"),
    [
        ({4: 1700}, [1300, 1700, 1500]),
        ({5: 1700}, [1700, 1700, 1500]),
        ({3: 1700}, [1500, 1500, 1300]),
        ({4: 1700, 5: 1600}, [1400, 1800, 1500]),
    ],
)
def test_the_three_thruster_frame_is_mixed(sticks, motors):
    ground = rov("automarine")
    ground.sticks = {**NEUTRAL, **sticks}
    ground.run(0.3)
    assert ground.servos[:3] == motors


def test_the_yaw_stick_turns_to_starboard_the_throttle_stick_lifts_and_forward_drives():
    ground = rov("automarine")
    ground.sticks = {3: 1700, 4: 1700, 5: 1700, 6: 1500}
    ground.run(3.0)
    body = ground.vehicle.state
    assert body.r > 0.1
    assert body.w < -0.05
    assert body.u > 0.1


def test_a_reversed_motor_is_reversed():
    ground = rov("automarine", parameters={"MOT_1_DIRECTION": -1})
    ground.sticks = {**NEUTRAL, 5: 1700}
    ground.run(0.2)
    assert ground.servos[:2] == [1300, 1700]


def test_an_unknown_frame_has_no_outputs():
    ground = rov("automarine", parameters={"FRAME_CONFIG": 99})
    ground.sticks = {**NEUTRAL, 5: 1900}
    ground.run(0.2)
    assert set(ground.servos[:6]) == {1500}


def _depth_target(altitude: float):
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0b111111111011, 0, 0, altitude, 0, 0, 0, 0, 0, 0, 0, 0
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["videoray", "automarine", "falcon"])
@pytest.mark.parametrize("mode", [SUB_ALT_HOLD, SUB_GUIDED])
def test_depth_is_held_and_a_depth_step_followed(name, mode):
    ground = rov(name, mode=mode)
    held = ground.vehicle.state.z
    ground.run(10.0)
    assert ground.vehicle.state.z == pytest.approx(held, abs=0.05)
    ground.repeated = lambda: _depth_target(-3.0)
    ground.run(15.0)
    assert ground.vehicle.state.z == pytest.approx(3.0, abs=0.05)


def test_a_depth_target_is_ignored_in_manual():
    ground = rov("falcon")
    ground.repeated = lambda: _depth_target(-5.0)
    ground.run(5.0)
    assert ground.vehicle.autopilot.depth.target != -500.0


@pytest.mark.slow
def test_a_far_depth_target_sent_once_is_limited_by_the_speed_limit():
    ground = rov("falcon", mode=SUB_ALT_HOLD)
    ground.run(3.0)
    before = ground.vehicle.state.z
    ground.send(_depth_target(-6.0))
    ground.run(15.0)
    assert ground.vehicle.state.z == pytest.approx(before + 1.11, abs=0.1)


@pytest.mark.slow
def test_a_far_depth_target_repeated_is_reached():
    ground = rov("falcon", mode=SUB_ALT_HOLD)
    ground.repeated = lambda: _depth_target(-6.0)
    ground.run(20.0)
    assert ground.vehicle.state.z == pytest.approx(6.0, abs=0.05)


@pytest.mark.slow
def test_a_target_in_the_air_ends_just_under_the_surface():
    ground = rov("falcon", mode=SUB_ALT_HOLD)
    ground.repeated = lambda: _depth_target(1.0)
    ground.run(25.0)
    assert -0.1 < ground.vehicle.state.z < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["videoray", "automarine", "falcon"])
@pytest.mark.parametrize("mode", [SUB_ALT_HOLD, SUB_GUIDED, SUB_STABILIZE])
def test_a_heading_step_is_followed(name, mode):
    ground = rov(name, mode=mode, parameters={"ATC_ANG_YAW_P": 1.5, "ATC_RAT_YAW_P": 0.5})
    ground.hold_heading(1.1)
    ground.run(25.0)
    assert math.degrees(ground.vehicle.state.psi) == pytest.approx(math.degrees(1.1), abs=5.0)


def test_a_heading_target_overrides_the_yaw_stick_for_five_seconds():
    ground = rov("falcon", mode=SUB_STABILIZE)
    ground.hold_heading(0.6)
    ground.run(1.0)
    ground.repeated = None
    ground.sticks = {**NEUTRAL, 4: 1700}
    ground.run(4.5)
    assert ground.vehicle.state.r == pytest.approx(0.0, abs=0.05)
    ground.run(2.0)
    assert ground.vehicle.state.r > 0.3


def test_the_yaw_stick_commands_a_turn_rate():
    ground = rov("falcon", mode=SUB_STABILIZE, parameters={"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.5})
    ground.sticks = {**NEUTRAL, 4: 1500 + 20 + 76}
    ground.run(15.0)
    assert math.degrees(ground.vehicle.state.r) == pytest.approx(0.2 * 45.0 * 3.375, abs=3.0)


def test_releasing_the_yaw_stick_locks_the_heading():
    ground = rov("falcon", mode=SUB_STABILIZE)
    ground.sticks = {**NEUTRAL, 4: 1700}
    ground.run(2.0)
    ground.sticks = NEUTRAL
    ground.run(6.0)
    locked = ground.vehicle.state.psi
    ground.run(5.0)
    assert ground.vehicle.state.psi == pytest.approx(locked, abs=0.05)


def test_the_throttle_stick_commands_a_climb_rate_in_alt_hold():
    ground = rov("falcon", mode=SUB_ALT_HOLD)
    ground.run(3.0)
    ground.sticks = {**NEUTRAL, 3: 1500 - 20 - 57}
    ground.run(6.0)
    assert ground.vehicle.state.w == pytest.approx(0.25, abs=0.1)


def test_the_throttle_stick_has_no_effect_within_its_dead_zone():
    ground = rov("falcon", mode=SUB_ALT_HOLD)
    ground.run(3.0)
    before = ground.vehicle.autopilot.depth.target
    ground.sticks = {**NEUTRAL, 3: 1530}
    ground.run(3.0)
    assert ground.vehicle.autopilot.depth.target == before


def test_yaw_feed_forward_has_no_effect():
    plain, with_ff = (rov("falcon", mode=SUB_STABILIZE, parameters={"ATC_RAT_YAW_FF": ff}) for ff in (0.0, 0.5))
    for ground in (plain, with_ff):
        ground.hold_heading(1.5)
        ground.run(3.0)
    assert plain.vehicle.state.psi == with_ff.vehicle.state.psi


@pytest.mark.parametrize(
    ("name", "value"),
    [("ATC_RAT_YAW_P", 0.5), ("ATC_ANG_YAW_P", 2.0), ("ATC_RAT_YAW_I", 0.05), ("ATC_SLEW_YAW", 500)],
)
def test_each_yaw_parameter_changes_the_motion(name, value):
    headings = []
    for parameters in ({}, {name: value}):
        ground = rov("falcon", mode=SUB_STABILIZE, parameters=parameters)
        ground.hold_heading(1.5)
        ground.run(2.0)
        headings.append(ground.vehicle.state.psi)
    assert abs(headings[0] - headings[1]) > 1e-3


@pytest.mark.parametrize(
    ("name", "value"),
    [("PSC_POSZ_P", 1.0), ("PSC_VELZ_P", 4.0), ("PSC_ACCZ_P", 1.5), ("PSC_ACCZ_I", 3.0), ("PSC_ACCZ_FF", 0.5)],
)
def test_each_depth_parameter_changes_the_motion(name, value):
    depths = []
    for parameters in ({}, {name: value}):
        ground = rov("falcon", mode=SUB_ALT_HOLD, parameters=parameters)
        ground.repeated = lambda: _depth_target(-3.0)
        ground.run(1.5)
        depths.append(ground.vehicle.state.z)
    assert abs(depths[0] - depths[1]) > 1e-3


def test_entering_alt_hold_while_turning_and_sinking_causes_no_jump():
    ground = rov("falcon")
    ground.sticks = {**NEUTRAL, 3: 1300, 4: 1700}
    ground.run(2.0)
    ground.sticks = NEUTRAL
    ground.mode(SUB_ALT_HOLD)
    ground.run(10.0)
    body = ground.vehicle.state
    assert abs(body.r) < 0.05
    assert abs(body.w) < 0.05
    assert body.z < 5.0
