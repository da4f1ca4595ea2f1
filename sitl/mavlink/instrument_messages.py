"""Messages with the instruments' own measurements, as ArduPilot sends them. This module uses MAVLink's units.

Each measurement is sent once, at the first time that its message is due. Its time stamp is when the instrument
reported it, so the lag of an instrument is not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping

from sitl.instruments import Sample
from sitl.mavlink.dialect import Message, mavlink
from sitl.place import to_globe
from sitl.plants import GRAVITY
from sitl.vehicle import Vehicle

__all__ = ["INSTRUMENT_MESSAGES", "fresh"]

_RATE = 50.0
"""Rate [Hz] at which a message is due, if nothing else is requested: above that of most instruments."""
_MILLI = 1000.0
_FIX_3D, _NO_FIX, _NO_GPS, _UNKNOWN = 3, 1, 0, 65535
_SATELLITES = 12
_SMALLEST_16, _LARGEST_16 = -32768, 32767
_HAS_MOTION, _HAS_FIELD = 0x3F, 0x1C0
"""Bits of HIGHRES_IMU.fields_updated: accelerometer and gyro, magnetic field."""


def fresh(vehicle: Vehicle, heading: str, message: int) -> Iterator[tuple[Sample, int]]:
    """Yield the last measurement of an instrument and its time stamp [us since boot], unless *message* has sent it."""
    instrument, sent = vehicle.suite.instruments[heading], vehicle.suite.sent
    if instrument.sample is None or sent.get(message) == instrument.count:
        return
    sent[message] = instrument.count
    booted = vehicle.us - vehicle.boot_us
    yield instrument.sample, max(0, round(1e6 * instrument.sample.t) - booted)


def _imu(vehicle: Vehicle, message: int) -> Iterator[tuple[int, tuple[float, ...], tuple[float, ...]]]:
    """Yield time stamp, motion (6,) and magnetic field (3,), each empty if it is not valid."""
    compass = vehicle.suite.instruments.get("compass")
    field = compass.sample.values if compass and compass.sample and compass.sample.valid else ()
    for sample, stamp in fresh(vehicle, "imu", message):
        if sample.valid:
            yield stamp, sample.values, field


def _raw_imu(vehicle: Vehicle) -> Iterable[Message]:
    """Return RAW_IMU, in thousandths of gravity, of rad/s and of a gauss."""
    for stamp, motion, field in _imu(vehicle, mavlink.MAVLINK_MSG_ID_RAW_IMU):
        force = [_whole(value * _MILLI / GRAVITY) for value in motion[:3]]
        rates = [_whole(value * _MILLI) for value in motion[3:]]
        yield mavlink.MAVLink_raw_imu_message(stamp, *force, *rates, *(_whole(value) for value in field or (0.0,) * 3))


def _highres_imu(vehicle: Vehicle) -> Iterable[Message]:
    """Return HIGHRES_IMU, in SI units and gauss."""
    for stamp, motion, field in _imu(vehicle, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU):
        gauss = [value / _MILLI for value in field or (0.0,) * 3]
        known = _HAS_MOTION | (_HAS_FIELD if field else 0)
        yield mavlink.MAVLink_highres_imu_message(stamp, *motion, *gauss, 0.0, 0.0, 0.0, 0.0, known)


def _whole(value: float) -> int:
    return max(_SMALLEST_16, min(_LARGEST_16, round(value)))


def _gps(vehicle: Vehicle) -> Iterable[Message]:
    """Return GPS_RAW_INT, which without a fix has no position."""
    for sample, stamp in fresh(vehicle, "gps", mavlink.MAVLINK_MSG_ID_GPS_RAW_INT):
        has_gps = vehicle.autopilot.has_gps
        if not (has_gps and sample.valid):
            unknown = (_UNKNOWN,) * 4
            yield mavlink.MAVLink_gps_raw_int_message(stamp, _NO_FIX if has_gps else _NO_GPS, 0, 0, 0, *unknown, 0)
            continue
        north, east, down, *velocity = sample.values
        course = round(100.0 * math.degrees(math.atan2(velocity[1], velocity[0]))) % 36000
        speed = round(100.0 * math.hypot(velocity[0], velocity[1]))
        noise, of_speed = (vehicle.suite.instruments["gps"].numbers.get(name, 0.0) for name in ("noise", "speed_noise"))
        accuracy = [round(_MILLI * std) for std in (noise, noise, of_speed)]
        where = (*to_globe(complex(north, east)), round(-_MILLI * down))
        yield mavlink.MAVLink_gps_raw_int_message(
            stamp, _FIX_3D, *where, 80, 120, min(speed, _UNKNOWN - 1), course, _SATELLITES, where[2], *accuracy
        )


def _dvl(vehicle: Vehicle) -> Iterable[Message]:
    """Return VISION_POSITION_DELTA, as a companion computer with a DVL sends it; nothing without bottom lock."""
    instrument = vehicle.suite.instruments["dvl"]
    for sample, stamp in fresh(vehicle, "dvl", mavlink.MAVLINK_MSG_ID_VISION_POSITION_DELTA):
        if sample.valid:
            passed = [value * instrument.period for value in sample.values]
            yield mavlink.MAVLink_vision_position_delta_message(
                stamp, round(1e6 * instrument.period), [0.0] * 3, passed, 100.0
            )


INSTRUMENT_MESSAGES: Mapping[int, tuple[str, Callable[[Vehicle], Iterable[Message]], float]] = {
    mavlink.MAVLINK_MSG_ID_RAW_IMU: ("imu", _raw_imu, _RATE),
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: ("imu", _highres_imu, 0.0),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: ("gps", _gps, _RATE),
    mavlink.MAVLINK_MSG_ID_VISION_POSITION_DELTA: ("dvl", _dvl, _RATE),
}
"""Message id -> (heading of its instrument, builder, rate [Hz] at boot; 0: only on request)."""
