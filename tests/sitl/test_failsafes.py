from __future__ import annotations

import pytest

from tests.sitl.ground import GUIDED, HOLD, MANUAL, Ground, boat, rov

DRIVING = {1: 1700, 3: 1700}
WITH_RECEIVER = {"SIM_RC_FAIL": 0}


def _driving(**parameters: float) -> Ground:
    ground = boat(parameters=parameters)
    ground.sticks = DRIVING
    ground.run(2.0)
    assert ground.servos[2] == 1680
    return ground


def _time_until(ground: Ground, happened, limit: float = 12.0) -> float:
    start = ground.t
    while not happened():
        assert ground.t - start < limit, "it never happened"
        ground.run(0.02)
    return ground.t - start


@pytest.mark.parametrize(("parameters", "after"), [({}, 3.0), ({"RC_OVERRIDE_TIME": 1}, 1.0)])
def test_with_a_receiver_overrides_expire_after_rc_override_time(parameters, after):
    ground = _driving(**WITH_RECEIVER, MOT_SLEWRATE=0, **parameters)
    ground.sticks = None
    assert _time_until(ground, lambda: ground.servos[0] == 1500) == pytest.approx(after - 0.1, abs=0.06)
    assert ground.mode_number == MANUAL


@pytest.mark.parametrize("parameters", [{**WITH_RECEIVER, "RC_OVERRIDE_TIME": -1}, {"FS_THR_ENABLE": 0}])
def test_a_negative_expiry_time_and_a_failsafe_that_is_off_keep_the_last_override(parameters):
    ground = _driving(**parameters)
    ground.sticks = None
    ground.run(20.0)
    assert ground.servos[0] != 1500


@pytest.mark.parametrize(
    ("parameters", "throttle"),
    [({**WITH_RECEIVER, "RC_OVERRIDE_TIME": 0}, 1700), ({**WITH_RECEIVER, "RC_OPTIONS": 2}, 1700), ({}, 900)],
    ids=["no expiry time", "overrides ignored", "throttle below the failsafe value"],
)
def test_disabled_or_lost_overrides_have_no_effect(parameters, throttle):
    ground = boat(parameters=parameters)
    ground.sticks = {1: 1700, 3: throttle}
    ground.run(1.0)
    assert ground.servos[0] == 1500


def test_a_released_channel_returns_to_the_receiver():
    ground = _driving(**WITH_RECEIVER)
    ground.sticks = {1: 0, 3: 1700}
    ground.run(0.1)
    assert ground.servos[0] == 1500


def test_an_ignored_channel_keeps_its_override():
    ground = _driving(**WITH_RECEIVER)
    ground.sticks = {3: 1700}
    ground.run(0.5)
    assert ground.servos[0] != 1500


def test_without_a_receiver_the_outputs_are_neutral_half_a_second_after_the_last_override():
    ground = _driving(MOT_SLEWRATE=0)
    ground.sticks = None
    assert _time_until(ground, lambda: ground.servos[0] == 1500) == pytest.approx(1.0 - 0.1 + 0.04, abs=0.05)
    assert ground.servos[2] == 1500
    assert ground.mode_number == MANUAL


def test_without_a_receiver_a_boat_holds_two_seconds_after_the_last_override():
    ground = _driving()
    ground.sticks = None
    assert _time_until(ground, lambda: ground.mode_number == HOLD) == pytest.approx(2.54 - 0.1, abs=0.06)
    ground.run(0.1)
    assert "Radio Failsafe" in ground.texts()
    assert ground.armed
    ground.run(1.0)
    assert ground.last("HEARTBEAT").system_status == 5


def test_the_failsafe_clears_when_sticks_return_and_the_mode_stays():
    ground = _driving()
    ground.sticks = None
    ground.run(3.0)
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(0.5)
    assert "Radio Failsafe Cleared" in ground.texts()
    assert ground.mode_number == HOLD
    assert ground.mode(MANUAL) == 0


def test_released_without_a_receiver_a_channel_keeps_its_last_value_until_the_failsafe():
    ground = _driving(MOT_SLEWRATE=0)
    ground.sticks = None
    ground.override({1: 0, 3: 0})
    ground.run(0.8)
    assert ground.servos[0] != 1500
    ground.run(0.4)
    assert ground.servos[0] == 1500


def test_the_radio_failsafe_acts_in_guided():
    ground = boat(mode=GUIDED)
    ground.sticks = None
    ground.hold_heading(0.6)
    ground.run(3.0)
    assert ground.mode_number == HOLD


@pytest.mark.parametrize(("action", "mode", "armed"), [(0, MANUAL, True), (2, HOLD, True), (5, MANUAL, False)])
def test_the_failsafe_action_follows_its_parameter(action, mode, armed):
    ground = _driving(FS_ACTION=action)
    ground.sticks = None
    ground.run(3.0)
    assert (ground.mode_number, ground.armed) == (mode, armed)


def test_a_receiver_lost_while_driving_triggers_the_radio_failsafe():
    ground = boat(parameters=WITH_RECEIVER)
    ground.sticks = None
    ground.run(2.0)
    ground.set("SIM_RC_FAIL", 1)
    ground.run(3.0)
    assert ground.mode_number == HOLD


def test_the_ground_station_failsafe_holds_after_timeout_and_delay_as_radio_failsafe():
    ground = _driving(**WITH_RECEIVER, FS_GCS_ENABLE=1)
    ground.sticks, ground._heartbeats = None, False
    assert _time_until(ground, lambda: ground.mode_number == HOLD) == pytest.approx(6.6 - 0.1, abs=0.15)
    ground.run(0.1)
    assert "Radio Failsafe" in ground.texts()


@pytest.mark.parametrize(
    ("parameters", "sticks"), [(WITH_RECEIVER, None), ({"FS_GCS_ENABLE": 1}, DRIVING)], ids=["off", "sticks alone"]
)
def test_a_silent_ground_station_triggers_no_failsafe_by_default_or_while_moving_sticks(parameters, sticks):
    ground = _driving(**parameters)
    ground.sticks, ground._heartbeats = sticks, False
    ground.run(15.0)
    assert ground.mode_number == MANUAL


def test_a_ground_station_never_received_triggers_no_failsafe():
    ground = Ground("charlie", heartbeats=False, parameters={**WITH_RECEIVER, "FS_GCS_ENABLE": 1})
    ground.run(15.0)
    assert ground.mode_number == MANUAL


def test_an_rov_disarms_when_its_pilot_is_lost():
    ground = rov()
    ground.sticks = None
    assert _time_until(ground, lambda: not ground.armed) == pytest.approx(3.1, abs=0.25)
    ground.run(0.1)
    assert "Lost manual control" in ground.texts()
    assert set(ground.servos[:6]) == {1500}


def test_the_pilot_failsafe_of_an_rov_can_be_limited_to_a_warning_and_neutral_sticks():
    ground = rov(parameters={"FS_PILOT_INPUT": 1})
    ground.sticks = {4: 1800, 3: 1500}
    ground.run(1.0)
    ground.sticks = None
    ground.run(4.0)
    assert ground.armed
    assert set(ground.servos[:6]) == {1500}


def test_with_a_receiver_the_sticks_of_an_rov_return_to_neutral():
    ground = rov(parameters=WITH_RECEIVER)
    ground.sticks = {4: 1800}
    ground.run(1.0)
    ground.sticks = None
    assert _time_until(ground, lambda: ground.servos[0] == 1500) == pytest.approx(3.0 - 0.1, abs=0.06)
    ground.run(5.0)
    assert ground.armed


@pytest.mark.parametrize(("action", "armed", "mode"), [(0, True, 19), (1, True, 19), (2, False, 19), (3, True, 2)])
def test_an_rov_acts_on_a_lost_ground_station_by_its_parameter(action, armed, mode):
    ground = rov(parameters={**WITH_RECEIVER, "FS_GCS_ENABLE": action})
    ground.sticks, ground._heartbeats = None, False
    ground.run(6.5)
    assert (ground.armed, ground.mode_number) == (armed, mode)
    assert ("MYGCS: heartbeat lost" in ground.texts()) == (action > 0)


def test_manual_control_counts_as_a_heartbeat():
    ground = rov()
    ground.sticks, ground._heartbeats = None, False
    for _ in range(80):
        ground.manual_control(z=500)
        ground.run(0.1)
    assert ground.armed


@pytest.mark.parametrize(("action", "mode", "armed"), [(0, MANUAL, True), (2, HOLD, True), (5, MANUAL, False)])
def test_a_low_battery_is_acted_on_after_its_timer(action, mode, armed):
    ground = _driving(BATT_LOW_VOLT=11, BATT_LOW_TIMER=2, BATT_FS_LOW_ACT=action)
    ground.set("SIM_BATT_VOLTAGE", 10.5)
    ground.run(1.5)
    assert (ground.mode_number, ground.armed) == (MANUAL, True)
    ground.run(1.5)
    assert (ground.mode_number, ground.armed) == (mode, armed)
    assert any(text.startswith("Battery 1 is low") for text in ground.texts())


def test_an_rov_with_a_low_battery_disarms_by_its_parameter():
    ground = rov(parameters={"BATT_LOW_VOLT": 13, "BATT_LOW_TIMER": 1, "BATT_FS_LOW_ACT": 2}, armed=False)
    assert ground.command(400, 1) == 4
    assert ground.command(400, 1, 21196) == 0


def test_a_boat_without_messages_enters_hold():
    ground = Ground("charlie", heartbeats=False)
    ground.run(3.0)
    assert ground.mode_number == HOLD
    assert "Radio Failsafe" in ground.texts()
