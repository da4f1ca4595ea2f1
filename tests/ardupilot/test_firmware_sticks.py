"""Overrides, joystick messages, their time-outs and failsafes: our simulator responds as ArduPilot's does."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import ArmingRefused

NEUTRAL = 1500
BEFORE_RC_FS_TIMEOUT = 0.5
"""Seconds until Rover's override time-out where its list has no RC_FS_TIMEOUT (before 4.7; 4.6 answers to its name, yet
heeds it on copters only)."""


def joystick(x=0, y=0, z=0, r=0):
    return lambda: mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0)


def is_still(station):
    return lambda: all(pwm in (0, NEUTRAL) for pwm in station.pwm)


@pytest.mark.parametrize("stick, servo", [(1550, 1521), (1700, 1680), (1750, 1734), (1300, 1319)])
def test_rovers_steering_stick_has_a_dead_zone_of_30_us(boat, stick, servo):
    boat.arm()
    boat.hold(lambda: boat.override({1: stick, 3: NEUTRAL}), 1.0)
    assert boat.pwm[0] == pytest.approx(servo, abs=2)


def test_rovers_throttle_moves_in_whole_percents_and_takes_a_second_to_full(boat):
    boat.arm()
    boat.hold(lambda: boat.override({1: NEUTRAL, 3: 2000}))
    assert boat.wait(lambda: boat.pwm[2] >= 2000, 2.0) == pytest.approx(1.0, abs=0.25)
    boat.hold(lambda: boat.override({1: NEUTRAL, 3: 1750}), 1.5)
    assert boat.pwm[2] == 1730


def test_rovers_joystick_throttle_is_centred_at_zero(boat):
    boat.arm()
    boat.hold(joystick(y=500, z=500), 1.5)
    assert (boat.pwm[0], boat.pwm[2]) == (pytest.approx(1734, abs=2), 1730)
    boat.hold(joystick(), 1.5)
    assert is_still(boat)()


def test_subs_sticks_are_mixed_to_the_motors_of_the_vectored_frame(rov):
    rov.arm()
    rov.hold(lambda: rov.override({3: NEUTRAL, 4: 1600, 5: NEUTRAL, 6: NEUTRAL}), 0.5)
    assert rov.pwm[:6] == (1600, 1400, 1400, 1600, NEUTRAL, NEUTRAL)
    rov.hold(lambda: rov.override({3: 1600, 4: NEUTRAL, 5: NEUTRAL, 6: NEUTRAL}), 0.5)
    assert rov.pwm[:6] == (NEUTRAL, NEUTRAL, NEUTRAL, NEUTRAL, 1400, 1400)
    rov.hold(lambda: rov.override({3: NEUTRAL, 4: NEUTRAL, 5: 1600, 6: NEUTRAL}), 0.5)
    assert rov.pwm[:6] == (1400, 1400, 1600, 1600, NEUTRAL, NEUTRAL)


def test_subs_joystick_is_scaled_by_a_gain_and_its_throttle_is_centred_at_500(rov):
    rov.arm()
    rov.hold(joystick(z=500, r=500), 0.5)
    assert rov.pwm[:6] == (1600, 1400, 1400, 1600, NEUTRAL, NEUTRAL)
    rov.hold(joystick(z=750), 0.5)
    assert rov.pwm[:6] == (NEUTRAL, NEUTRAL, NEUTRAL, NEUTRAL, 1400, 1400)
    rov.hold(joystick(z=500), 0.5)
    assert is_still(rov)()


def test_overrides_of_another_system_are_ignored_without_a_message(craft):
    craft.arm()
    craft.session.port.system = 42
    texts = len(craft.texts)
    craft.hold(lambda: craft.override(dict.fromkeys(craft.firmware.channels.values(), 1700)), 1.5)
    craft.session.port.system = 255
    assert is_still(craft)()
    assert not craft.texts[texts:]


def test_overrides_expire_after_three_seconds(craft):
    craft.arm()
    turning = {**dict.fromkeys(craft.firmware.channels.values(), NEUTRAL), craft.firmware.channels["N"]: 1650}
    craft.hold(lambda: craft.override(turning), 1.0)
    assert not is_still(craft)()
    craft.hold(None)
    assert craft.wait(is_still(craft), 4.0) == pytest.approx(3.0, abs=0.25)


def test_a_released_override_returns_control_to_the_receiver_at_once(craft):
    craft.arm()
    channel = craft.firmware.channels["N"]
    craft.hold(lambda: craft.override({channel: 1650}), 1.0)
    assert not is_still(craft)()
    craft.hold(None)
    craft.session.send(craft.override({channel: 0}))
    assert craft.wait(is_still(craft), 1.0) < 0.4


@pytest.mark.boot(SIM_RC_FAIL=1)
def test_rover_without_a_receiver_arms_when_overrides_flow_and_holds_when_they_stop(boat):
    missed = boat.parameters.read_full().get("RC_FS_TIMEOUT", BEFORE_RC_FS_TIMEOUT)
    boat.run(2.0)
    with pytest.raises(ArmingRefused, match="Radio failsafe"):
        boat.commands.arm()
    boat.hold(boat.neutral, 4.0)
    boat.commands.set_mode("MANUAL")
    boat.commands.arm()
    boat.hold(lambda: boat.override({1: 1700, 3: 1600}), 1.5)
    assert not is_still(boat)()
    boat.hold(None)
    silent = boat.wait(is_still(boat), 3.0)
    assert silent == pytest.approx(missed + 0.15, abs=0.25)
    silent += boat.wait(lambda: boat.mode == "HOLD", 4.0)
    assert silent == pytest.approx(missed + 1.54, abs=1.1)  # heartbeats: 1 Hz
    assert boat.session.armed


@pytest.mark.boot(SIM_RC_FAIL=1)
def test_sub_without_a_receiver_disarms_three_seconds_after_the_last_sticks(rov):
    """Before 4.7 ArduSub's simulator leaves that failsafe out (its boards have it) and goes on with the last sticks."""
    left_out = (
        "SIM_SPEEDUP" in (has := rov.parameters.read_existing(["SIM_SPEEDUP", "FS_THR_ENABLE"])) and len(has) == 1
    )
    rov.hold(rov.neutral, 4.0)
    rov.commands.arm()
    rov.hold(lambda: rov.override({3: NEUTRAL, 4: 1600, 5: NEUTRAL, 6: NEUTRAL}), 1.0)
    assert not is_still(rov)()
    rov.hold(None)
    if left_out:
        rov.run(4.0)
        assert not is_still(rov)()
        return
    assert rov.wait(is_still(rov), 5.0) == pytest.approx(3.2, abs=0.4)
    rov.wait(lambda: not rov.session.armed, 2.0)
    assert any("Lost manual control" in text for _, text in rov.texts)


@pytest.mark.boot(FS_GCS_ENABLE=1)
def test_rover_holds_when_its_ground_station_is_lost(boat):
    boat.arm()
    boat.hold(lambda: boat.override({1: 1600, 3: NEUTRAL}), 1.0)
    boat.session.port.system = 42
    boat.hold(None)
    silent = boat.wait(lambda: boat.mode == "HOLD", 9.0)
    boat.session.port.system = 255
    assert silent == pytest.approx(6.6, abs=1.2)


def test_sub_disarms_when_its_ground_station_is_lost(rov):
    rov.arm()
    rov.session.port.system = 42
    rov.hold(None)
    silent = rov.wait(lambda: not rov.session.armed, 9.0)
    rov.session.port.system = 255
    assert silent == pytest.approx(5.5, abs=1.3)
