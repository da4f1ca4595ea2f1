from __future__ import annotations

import pytest

from tests.sitl.ground import MANUAL, Ground, boat, rov

ACCEPTED, FAILED = 0, 4
PREARM = 0x10000000


def _prearm_ok(ground: Ground) -> bool:
    return bool(ground.last("SYS_STATUS").onboard_control_sensors_health & PREARM)


@pytest.mark.parametrize(("name", "fault"), [("charlie", "Accels inconsistent"), ("falcon", "Gyros not calibrated")])
def test_before_its_sensors_are_ready_it_does_not_arm(name, fault):
    ground = Ground(name)
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(1.0)
    assert ground.command(400, 1) == FAILED
    assert f"Arm: {fault}" in ground.texts()
    assert not _prearm_ok(ground)


@pytest.mark.parametrize(("name", "sticks"), [("charlie", {1: 1500, 3: 1500}), ("falcon", {3: 1500})])
def test_prearm_turns_healthy_about_three_seconds_after_boot(name, sticks):
    ground = Ground(name)
    ground.sticks = sticks
    ground.run(2.9)
    assert not _prearm_ok(ground)
    ground.run(1.5)
    assert _prearm_ok(ground)
    assert ground.command(400, 1) == ACCEPTED
    assert ground.armed


def test_without_a_receiver_a_boat_waits_for_overrides():
    ground = Ground("charlie")
    ground.run(6.0)
    assert ground.command(400, 1) == FAILED
    assert "Arm: Radio failsafe on" in ground.texts()
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(1.0)
    assert ground.command(400, 1) == ACCEPTED


def test_failed_prearm_checks_are_reported_without_a_request():
    ground = Ground("charlie")
    ground.run(40.0)
    assert "PreArm: Radio failsafe on" in ground.texts()


def test_a_boat_does_not_arm_with_throttle_on():
    ground = boat(armed=False)
    ground.sticks = {1: 1500, 3: 1600}
    ground.run(0.3)
    assert ground.command(400, 1) == FAILED
    assert "Arm: Throttle (RC3) is not neutral" in ground.texts()
    assert not ground.armed


def test_force_overrides_every_check():
    ground = Ground("charlie")
    ground.run(0.5)
    assert ground.command(400, 1, 21196) == ACCEPTED
    assert ground.armed


def test_checks_can_be_switched_off():
    ground = Ground("charlie", parameters={"ARMING_CHECK": 0})
    assert ground.command(400, 1) == ACCEPTED


def test_a_weak_battery_forbids_arming():
    ground = rov(armed=False, parameters={"BATT_ARM_VOLT": 12.0, "SIM_BATT_VOLTAGE": 11.0})
    assert ground.command(400, 1) == FAILED
    assert "Arm: Battery 1 below minimum arming voltage" in ground.texts()


def test_disarming_brings_the_outputs_to_trim_at_once():
    ground = boat()
    ground.sticks = {1: 1800, 3: 1800}
    ground.run(2.0)
    assert ground.servos[0] != 1500
    assert ground.command(400, 0) == ACCEPTED
    assert (ground.servos[0], ground.servos[2]) == (1500, 1500)


def test_disarmed_outputs_stay_at_trim_for_any_stick_position():
    for ground in (boat(armed=False), rov(armed=False)):
        ground.sticks = {1: 1900, 3: 1900, 4: 1900, 5: 1900}
        ground.run(2.0)
        assert {pwm for pwm in ground.servos if pwm} == {1500}


def test_disarmed_outputs_can_be_silent():
    ground = boat(armed=False, parameters={"MOT_SAFE_DISARM": 1})
    ground.run(0.1)
    assert set(ground.servos) == {0}


def test_arming_twice_and_disarming_twice_is_harmless():
    ground = boat()
    assert ground.command(400, 1) == ACCEPTED
    assert ground.command(400, 0) == ACCEPTED
    assert ground.command(400, 0) == ACCEPTED


def test_values_other_than_arm_and_disarm_are_unsupported():
    assert boat(armed=False).command(400, 2) == 3


def test_arming_keeps_the_mode():
    ground = boat(mode=MANUAL)
    assert ground.mode_number == MANUAL
