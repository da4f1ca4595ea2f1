"""A vehicle whose parameters switch off GPS or battery monitor, as on ArduPilot."""

from __future__ import annotations

from typing import Any

import pytest

from tests.sitl.ground import ACRO, Ground

NO_GPS, NO_BATTERY = {"GPS1_TYPE": 0}, {"BATT_MONITOR": 0}
_GPS, _BATTERY = 0x20, 0x2000000
_POSITION = 0x08 | 0x10
"""Bits of EKF_STATUS_REPORT.flags: relative and absolute horizontal position."""


def test_without_a_battery_monitor_the_battery_is_unknown_and_does_not_prevent_arming() -> None:
    ground = Ground("bluerov2", parameters={**NO_BATTERY, "BATT_ARM_VOLT": 12.0, "SIM_BATT_VOLTAGE": 11.0})
    ground.run(50.0)
    status = ground.last("SYS_STATUS")
    assert (status.voltage_battery, status.current_battery, status.battery_remaining) == (0, -1, -1)
    assert not status.onboard_control_sensors_present & _BATTERY
    assert ground.vehicle.autopilot.arming_fault(arming=True) is None


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("charlie", {"parameters": NO_GPS}),
        ("bluerov2", {"parameters": NO_GPS}),
        ("blueboat-nav", {"parameters": NO_GPS}),
        ("charlie", {"parameters": {"GPS_TYPE": 0}, "names": "4.5"}),
    ],
)
def test_without_a_gps_there_is_neither_position_nor_speed(name: str, options: dict[str, Any]) -> None:
    ground = Ground(name, **options)
    ground.run(50.0)
    assert not ground.last("SYS_STATUS").onboard_control_sensors_present & _GPS
    assert not ground.last("EKF_STATUS_REPORT").flags & _POSITION
    place = ground.last("GLOBAL_POSITION_INT")
    assert (place.lat, place.lon, place.vx, place.vy) == (0, 0, 0, 0)
    assert ground.last("VFR_HUD").groundspeed == 0.0
    assert [m for m in ground.heard if m.get_type() == "LOCAL_POSITION_NED"] == []
    assert {m.fix_type for m in ground.heard if m.get_type() == "GPS_RAW_INT"} <= {0}


def test_a_boat_without_a_gps_takes_the_throttle_stick_directly_in_acro() -> None:
    ground = Ground("charlie", parameters=NO_GPS)
    ground.run(12.0)
    autopilot = ground.vehicle.autopilot
    assert autopilot.set_mode(ACRO)
    assert autopilot.arm(force=True)
    ground.sticks = {1: 1500, 3: 1700}
    ground.run(5.0)
    assert autopilot.throttle_percent == pytest.approx(40, abs=5)


def test_the_switches_take_effect_at_the_next_boot() -> None:
    ground = Ground("charlie")
    ground.run(2.0)
    ground.set("BATT_MONITOR", 0)
    ground.run(2.0)
    assert ground.last("SYS_STATUS").voltage_battery > 0
    ground.command(246, 1)
    ground.run(2.0)
    assert ground.last("SYS_STATUS").voltage_battery == 0
