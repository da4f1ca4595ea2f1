"""The estimates of the autopilot from its instruments, and the effect of their failures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import pytest

from sitl.estimator import Estimator
from sitl.instruments import INSTRUMENTS, Instrument, Sample
from sitl.plants import GRAVITY, State
from sitl.sensors import SensorReading
from tests.sitl.ground import MANUAL, Ground

UPRIGHT = (0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0)


def _aboard(**rates: float) -> dict[str, Instrument]:
    return {heading: INSTRUMENTS[heading]({"rate": rate}, 1) for heading, rate in rates.items()}


def _flown(own: Mapping[str, Instrument], seconds: float, values: object) -> list[SensorReading]:
    """Return the readings of a boat at rest, whose instruments measure *values* (t) by heading; None: no fix."""
    estimator, readings = Estimator(own, State()), []
    for tick in range(1, round(seconds * 50) + 1):
        t = tick / 50
        for heading, instrument in own.items():
            if tick % round(50 * instrument.period) == 0:
                measured = values(t).get(heading)  # type: ignore[operator]
                instrument.sample = Sample(t, t, measured or (0.0,) * 6, measured is not None)
                instrument.count += 1
        reading = SensorReading()
        estimator.update(t, reading)
        reading.d = float(estimator.aided)
        readings.append(reading)
    return readings


def _gps(north: float, speed: float = 0.0) -> tuple[float, ...]:
    return (north, 0.0, 0.0, speed, 0.0, 0.0)


def test_without_instruments_the_reading_is_unchanged() -> None:
    reading = SensorReading(psi=0.1, r=0.2, u=0.3, v=0.4, x=0.5, y=0.6, z=0.7)
    Estimator({}, State()).update(1.0, reading)
    assert (reading.psi, reading.r, reading.u, reading.v) == (0.1, 0.2, 0.3, 0.4)
    assert (reading.x, reading.y, reading.z) == (0.5, 0.6, 0.7)


def test_a_compass_turns_the_heading_within_seconds_and_the_gyro_at_once() -> None:
    def field(psi: float) -> tuple[float, ...]:
        return (math.cos(psi), -math.sin(psi), 1.0)

    own = _aboard(imu=50.0, compass=10.0)
    flown = _flown(own, 30.0, lambda t: {"imu": UPRIGHT, "compass": field(0.2 if t > 10.0 else 0.0)})
    assert flown[499].psi == pytest.approx(0.0)
    assert flown[500 + 50].psi == pytest.approx(0.2 * (1.0 - math.exp(-0.2)), abs=0.01)
    assert flown[-1].psi == pytest.approx(0.2, abs=0.03)
    turning = (0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.5)
    flown = _flown(_aboard(imu=50.0, compass=10.0), 1.0, lambda t: {"imu": turning, "compass": field(0.5 * t)})
    assert (flown[-1].psi, flown[-1].r) == pytest.approx((0.5, 0.5), abs=0.01)


def test_a_small_jump_of_the_gps_is_followed_and_a_large_one_rejected_for_ten_seconds() -> None:
    def flown(jump: float) -> list[SensorReading]:
        own = _aboard(imu=50.0, compass=10.0, gps=5.0)
        values = {"imu": UPRIGHT, "compass": (1.0, 0.0, 1.0)}
        return _flown(own, 20.0, lambda t: {**values, "gps": _gps(jump if t > 5.0 else 0.0)})

    assert flown(1.0)[7 * 50].x == pytest.approx(0.65, abs=0.1)
    far = flown(6.0)
    assert far[14 * 50].x == pytest.approx(0.0, abs=0.01)
    assert far[16 * 50].x == pytest.approx(6.0, abs=0.2)


def test_without_a_fix_the_craft_is_dead_reckoned_and_has_no_position_after_ten_seconds() -> None:
    values = {"imu": UPRIGHT, "compass": (1.0, 0.0, 1.0)}
    own = _aboard(imu=50.0, compass=10.0, gps=5.0)
    flown = _flown(own, 35.0, lambda t: {**values, "gps": _gps(0.5 * t, 0.5) if t < 15.0 or t > 30.0 else None})
    assert flown[18 * 50].x == pytest.approx(9.0, abs=0.3)
    assert [flown[s * 50].d for s in (14, 24, 26, 31)] == [1.0, 1.0, 0.0, 1.0]


def test_without_a_gyro_the_compass_gives_heading_and_turn_rate_ten_times_a_second() -> None:
    ground = Ground("charlie-sensors", seed=3)
    ground.run(4.0)
    autopilot, state = ground.vehicle.autopilot, ground.vehicle.state
    autopilot.set_mode(MANUAL)
    autopilot.arm(force=True)
    ground.sticks = {1: 1750, 3: 1800}
    ground.run(12.0)
    assert abs(state.r) > 0.08
    assert ground.vehicle._reading.r == pytest.approx(state.r, abs=0.03)
    assert math.remainder(autopilot.estimate.yaw - state.psi, math.tau) == pytest.approx(0.0, abs=0.05)
    seen = set()
    for _ in range(50):
        ground.run(0.02)
        seen.add(autopilot.estimate.yaw)
    assert len(seen) in (10, 11)


def test_the_current_of_the_thrusters_deflects_the_heading_that_the_autopilot_holds() -> None:
    ground = Ground("blueboat-nav", seed=1)
    ground.run(6.0)
    autopilot, state = ground.vehicle.autopilot, ground.vehicle.state
    before = math.remainder(autopilot.estimate.yaw - state.psi, math.tau)
    autopilot.set_mode(MANUAL)
    autopilot.arm(force=True)
    ground.sticks = {3: 1900}
    ground.run(20.0)
    after = math.remainder(autopilot.estimate.yaw - state.psi, math.tau)
    deflection = 0.002 * ground.vehicle.battery.current
    assert abs(after - before) > 0.5 * deflection * abs(math.cos(state.psi)) > 0.005
    assert autopilot.estimate.speed == pytest.approx(state.u, abs=0.15)


def test_an_rov_estimates_its_depth_and_tilt_from_its_instruments() -> None:
    ground = Ground("bluerov2-nav", seed=2)
    ground.run(8.0)
    estimate, state = ground.vehicle.autopilot.estimate, ground.vehicle.state
    assert estimate.z == pytest.approx(state.z, abs=0.03)
    assert (estimate.roll, estimate.pitch) == pytest.approx((state.phi, state.theta), abs=0.03)


def test_the_vehicle_file_names_the_rate_of_the_filter(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('like = "charlie-sensors"\n[filter]\nrate = { value = 0.0, unit = "Hz", source = "mine" }\n')
    from sitl import BadVehicle, load_vehicle

    with pytest.raises(BadVehicle, match="filter"):
        load_vehicle(str(file))
