"""Each instrument alone, and the messages of a vehicle with instruments."""

from __future__ import annotations

import math
import statistics
from pathlib import Path

import pytest

from sitl import BadVehicle, load_vehicle
from sitl.instruments import INSTRUMENTS, Instrument, Motion, Sample
from sitl.plants import GRAVITY, quaternion_of
from tests.sitl.ground import Ground

DT = 0.02
NIL = (0.0, 0.0, 0.0)
STILL = Motion(0.0, (1.0, 0.0, 0.0, 0.0), NIL, NIL, NIL, NIL, (0.0, 0.0, -GRAVITY), 0.0)


def _measured(instrument: Instrument, seconds: float, **motion: object) -> list[Sample]:
    """Return what *instrument* reports in a motion that is the same all the time."""
    found: list[Sample] = []
    for tick in range(1, round(seconds / DT) + 1):
        values = {name: getattr(STILL, name) for name in STILL.__slots__} | motion | {"t": tick * DT}
        before = instrument.count
        instrument.step(Motion(**values), DT)
        if instrument.count != before and instrument.sample is not None:
            found.append(instrument.sample)
    return found


@pytest.mark.parametrize("heading", INSTRUMENTS)
def test_every_instrument_measures_at_its_own_rate_and_reports_late(heading: str) -> None:
    samples = _measured(INSTRUMENTS[heading]({"rate": 2.0, "lag": 0.3}, 1), 4.0)
    assert [round(sample.taken, 9) for sample in samples] == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
    assert all(sample.t == pytest.approx(sample.taken + 0.3) for sample in samples)
    assert all(sample.valid for sample in samples)


@pytest.mark.parametrize("heading", INSTRUMENTS)
def test_failures_have_the_frequency_and_duration_of_the_file(heading: str) -> None:
    numbers = {"rate": 5.0, "lost_every": 6.0, "lost_for": 4.0}
    valid = [sample.valid for sample in _measured(INSTRUMENTS[heading](numbers, 3), 300.0)]
    assert statistics.mean(valid) == pytest.approx(0.6, abs=0.12)
    assert all(sample.valid for sample in _measured(INSTRUMENTS[heading]({"rate": 5.0}, 3), 10.0))


def test_an_off_centre_accelerometer_measures_the_turn() -> None:
    imu = INSTRUMENTS["imu"]({"rate": 10.0, "x": 0.5, "bias_y": 0.1, "gyro_bias_z": 0.01}, 1)
    sample = _measured(imu, 0.2, rates=(0.0, 0.0, 2.0), turning=(0.0, 0.0, 1.0))[-1]
    assert sample.values == pytest.approx((-0.5 * 2.0**2, 0.5 * 1.0 + 0.1, -GRAVITY, 0.0, 0.0, 2.01))


def test_an_off_centre_dvl_measures_the_turn_as_sway() -> None:
    east = quaternion_of(0.0, 0.0, math.pi / 2)
    dvl = INSTRUMENTS["dvl"]({"rate": 5.0, "x": 0.4}, 1)
    sample = _measured(dvl, 0.2, attitude=east, velocity=(0.0, 1.5, 0.0), rates=(0.0, 0.0, 0.5))[-1]
    assert sample.values == pytest.approx((1.5, 0.2, 0.0))


def test_gps_measures_its_antenna_and_has_no_fix_below_the_surface() -> None:
    gps = INSTRUMENTS["gps"]({"rate": 5.0, "x": 2.0, "z": -0.5}, 1)
    sample = _measured(gps, 0.2, attitude=quaternion_of(0.0, 0.0, math.pi / 2), rates=(0.0, 0.0, 0.5))[-1]
    assert sample.values == pytest.approx((0.0, 2.0, -0.5, -1.0, 0.0, 0.0))
    assert not _measured(INSTRUMENTS["gps"]({"rate": 5.0, "z": -0.5}, 1), 0.2, position=(0.0, 0.0, 1.0))[-1].valid


def test_a_reflected_gps_signal_displaces_the_position_by_varying_amounts() -> None:
    numbers = {"rate": 5.0, "jump_every": 10.0, "jump_for": 5.0, "jump": 3.0}
    places = [round(sample.values[0], 6) for sample in _measured(INSTRUMENTS["gps"](numbers, 2), 300.0)]
    assert 0.5 < places.count(0.0) / len(places) < 0.8
    assert len(set(places)) > 10


@pytest.mark.parametrize("psi", [0.0, 1.0, -2.0])
def test_iron_and_the_current_of_the_thrusters_deflect_the_compass(psi: float) -> None:
    def shown(current: float, **numbers: float) -> float:
        compass = INSTRUMENTS["compass"]({"rate": 10.0, **numbers}, 1)
        field = _measured(compass, 0.1, attitude=quaternion_of(0.0, 0.0, psi), current=current)[-1].values
        return math.atan2(-field[1], field[0])

    assert shown(20.0) == pytest.approx(psi)
    assert shown(0.0, current_y=0.01) == pytest.approx(psi)
    deflected = shown(10.0, current_y=0.01, iron_x=0.05)
    assert deflected == pytest.approx(math.atan2(math.sin(psi) - 0.1, math.cos(psi) + 0.05))
    step = math.radians(5.0)
    assert shown(0.0, quantum=step) / step == pytest.approx(round(psi / step))


def test_a_pressure_gauge_measures_its_own_depth() -> None:
    gauge = INSTRUMENTS["pressure"]({"rate": 10.0, "x": 1.0, "bias": 0.1}, 1)
    sample = _measured(gauge, 0.1, attitude=quaternion_of(0.0, math.pi / 6, 0.0), position=(0.0, 0.0, 3.0))[-1]
    assert sample.values == pytest.approx((3.0 - 0.5 + 0.1,))


def _sent(vehicle: str, seconds: float) -> list[object]:
    ground = Ground(vehicle)
    return list(ground.run(seconds))


def test_each_measurement_is_sent_once_at_the_instruments_own_rate() -> None:
    kinds = [message.get_type() for message in _sent("bluerov2-nav", 4.0)]
    assert kinds.count("RAW_IMU") == pytest.approx(200, abs=2)
    assert kinds.count("VISION_POSITION_DELTA") == pytest.approx(32, abs=2)
    assert "GPS_RAW_INT" not in kinds
    assert [m.get_type() for m in _sent("blueboat-nav", 4.0)].count("GPS_RAW_INT") == pytest.approx(20, abs=2)


def test_a_craft_at_rest_sends_gravity_its_heading_and_its_place() -> None:
    ground = Ground("blueboat-nav")
    ground.run(1.0)
    imu, gps = ground.last("RAW_IMU"), ground.last("GPS_RAW_INT")
    assert (imu.xacc, imu.yacc, imu.zacc) == pytest.approx((6, 4, -1000), abs=15)
    heading = math.atan2(-imu.ymag, imu.xmag)
    assert heading == pytest.approx(ground.vehicle.state.psi, abs=0.06)
    assert (gps.fix_type, gps.time_usec % 200_000) == (3, 150_000)
    assert gps.lat / 1e7 == pytest.approx(44.4250, abs=2e-5)


def test_instruments_affect_the_estimates_but_not_the_motion() -> None:
    def flown(name: str) -> tuple[object, float]:
        ground = Ground(name)
        ground.run(4.0)
        ground.vehicle.autopilot.set_mode(0)
        ground.vehicle.autopilot.arm(force=True)
        ground.sticks = {1: 1700, 3: 1900}
        ground.run(4.0)
        assert ground.vehicle.state.u > 0.5
        return ground.vehicle.state, ground.vehicle.autopilot.estimate.yaw

    with_instruments, plain = flown("blueboat-nav"), flown("blueboat-sway")
    assert with_instruments[0] == plain[0]
    assert with_instruments[1] != plain[1]


def test_an_instrument_without_a_rate_is_rejected_by_its_name(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('like = "charlie"\n[gps]\nnoise = { value = 1.0, unit = "m", source = "mine" }\n', encoding="utf-8")
    with pytest.raises(BadVehicle, match="gps: the rate is missing"):
        load_vehicle(str(file))
