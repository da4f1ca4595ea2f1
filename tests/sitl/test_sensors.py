from __future__ import annotations

import dataclasses
import itertools
import math
import statistics

import pytest

from sitl import load_vehicle
from sitl.sensors import SensorData, SensorReading, Sensors

QUIET = SensorData(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _samples(data: SensorData, count: int, seed: int = 1) -> list[SensorReading]:
    body = load_vehicle("videoray").make_plant()
    sensors = Sensors(data, seed, floats=False)
    readings = []
    for _ in range(count):
        reading = SensorReading()
        sensors.sample(body, reading)
        readings.append(reading)
    return readings


def test_without_noise_the_readings_are_true():
    reading = _samples(QUIET, 1)[0]
    assert (reading.psi, reading.z, reading.r) == (0.6, 2.0, 0.0)


def test_the_compass_reading_is_quantised():
    step = math.radians(2)
    readings = list(_samples(dataclasses.replace(QUIET, heading_quantum=step, heading_noise=0.05), 200))
    assert len({round(reading.psi / step) for reading in readings}) > 2
    for reading in readings:
        assert reading.psi / step == pytest.approx(round(reading.psi / step), abs=1e-9)


def test_noise_has_the_stated_size():
    data = dataclasses.replace(QUIET, heading_noise=0.004, gyro_noise=0.002, depth_noise=0.01)
    readings = _samples(data, 4000)
    assert statistics.stdev(r.psi for r in readings) == pytest.approx(0.004, rel=0.05)
    assert statistics.stdev(r.r for r in readings) == pytest.approx(0.002, rel=0.05)
    assert statistics.stdev(r.z for r in readings) == pytest.approx(0.01, rel=0.05)
    assert statistics.mean(r.psi for r in readings) == pytest.approx(0.6, abs=3e-4)


def test_noise_is_white():
    errors = [r.psi - 0.6 for r in _samples(dataclasses.replace(QUIET, heading_noise=0.004), 4000)]
    lagged = sum(a * b for a, b in itertools.pairwise(errors)) / sum(e * e for e in errors)
    assert abs(lagged) < 0.05


def test_the_noise_depends_on_the_seed():
    data = dataclasses.replace(QUIET, heading_noise=0.004)
    assert _samples(data, 3, seed=1) == _samples(data, 3, seed=1)
    assert _samples(data, 3, seed=1) != _samples(data, 3, seed=2)


def test_the_noise_of_one_sensor_does_not_affect_another():
    with_gyro = dataclasses.replace(QUIET, heading_noise=0.004, gyro_noise=0.1)
    without = dataclasses.replace(QUIET, heading_noise=0.004)
    assert [r.psi for r in _samples(with_gyro, 20)] == [r.psi for r in _samples(without, 20)]


def test_heading_is_wrapped():
    body = load_vehicle("videoray").make_plant()
    body.state.psi = 10.0
    reading = SensorReading()
    Sensors(QUIET, 0, floats=False).sample(body, reading)
    assert reading.psi == pytest.approx(10.0 - 4 * math.pi)


def test_a_rangefinder_measures_a_wall_ahead_once_a_period_and_nothing_when_turned_away() -> None:
    vehicle = load_vehicle("videoray-wall")
    body, finder = vehicle.make_plant(), vehicle.make_rangefinder(1)
    assert finder is not None
    (first,) = finder.measure(0.0, body.state)
    assert first == pytest.approx(2.0, abs=0.015)
    body.state.x, body.state.y = 0.5 * math.cos(body.state.psi), 0.5 * math.sin(body.state.psi)
    assert finder.measure(0.9, body.state) == [first]
    assert finder.measure(1.0, body.state) == pytest.approx([1.5], abs=0.015)
    body.state.psi += math.radians(60.0)
    assert finder.measure(2.0, body.state) == pytest.approx([3.0], abs=0.015)
    body.state.psi += math.radians(60.0)
    assert math.isnan(finder.measure(3.0, body.state)[0])
    assert load_vehicle("videoray").make_rangefinder(1) is None


def test_two_rangefinders_give_the_angle_to_the_wall_by_their_difference() -> None:
    vehicle = load_vehicle("videoray-lasers")
    body, finder = vehicle.make_plant(), vehicle.make_rangefinder(1)
    assert finder is not None
    body.state.psi += math.radians(20.0)  # to starboard: the starboard beam is the longer one
    port, starboard = finder.measure(0.0, body.state)
    assert math.degrees(math.atan2(starboard - port, finder.apart)) == pytest.approx(20.0, abs=2.0)
    assert 0.5 * (port + starboard) * math.cos(math.radians(20.0)) == pytest.approx(2.0, abs=0.02)


def test_two_sideways_rangefinders_measure_the_wall_obliquely() -> None:
    vehicle = load_vehicle("videoray-beams")
    body, finder = vehicle.make_plant(), vehicle.make_rangefinder(1)
    assert finder is not None
    assert finder.yaws == pytest.approx([-math.pi / 4, math.pi / 4])
    body.state.psi += math.radians(20.0)
    port, starboard = finder.measure(0.0, body.state)
    assert port == pytest.approx(2.0 / math.cos(math.radians(25.0)), abs=0.015)
    assert starboard == pytest.approx(2.0 / math.cos(math.radians(65.0)), abs=0.015)
    body.state.psi += math.radians(30.0)
    port, starboard = finder.measure(1.0, body.state)
    assert math.isfinite(port)
    assert math.isnan(starboard)
