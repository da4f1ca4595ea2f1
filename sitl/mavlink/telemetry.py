"""The messages that the vehicle can send, each built from its present state. This module uses MAVLink's units.

PID_TUNING contains the terms of the control loops, with one message per set bit of GCS_PID_MASK.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping

from sitl.autopilot import Pid, Rover, Sub
from sitl.mavlink.dialect import Message, fit_float, mavlink
from sitl.mavlink.instrument_messages import INSTRUMENT_MESSAGES, fresh
from sitl.place import to_globe
from sitl.vehicle import Vehicle

__all__ = ["MESSAGES", "available_messages", "make_heartbeat", "make_mission_current", "make_pid_tuning"]

_ROLL_AXIS, _PITCH_AXIS, _YAW_AXIS, _ACCZ_AXIS, _STEER_AXIS = 1, 2, 3, 4, 5
_ROVER_STEER, _ROVER_SPEED = 1, 2
_SUB_ROLL, _SUB_PITCH, _SUB_YAW, _SUB_ACCZ = 1, 2, 4, 8
_HUNDREDTH = 0.01
"""Scale of ArduSub's values, as if they still were centidegrees. The desired rate is then in hundredths of rad/s."""


def make_pid_tuning(vehicle: Vehicle) -> Iterable[Message]:
    """Return the PID_TUNING messages requested by GCS_PID_MASK. Values are outdated while a loop does not run."""
    autopilot, mask = vehicle.autopilot, int(vehicle.parameters["GCS_PID_MASK"])
    if isinstance(autopilot, Rover):
        return _rover(autopilot, mask)
    return _sub(autopilot, mask) if isinstance(autopilot, Sub) else ()


def _message(axis: int, desired: float, achieved: float, ff: float, pid: Pid, scale: float = 1.0) -> Message:
    parts = (desired, achieved, scale * ff, scale * pid.p_part, scale * pid.integrator, scale * pid.d_part)
    return mavlink.MAVLink_pid_tuning_message(axis, *map(fit_float, parts))


def _rover(rover: Rover, mask: int) -> Iterator[Message]:
    if mask & _ROVER_STEER:
        pid = rover.steering.pid
        yield _message(_STEER_AXIS, math.degrees(pid.target), math.degrees(pid.measured), pid.feed_forward, pid)
    if mask & _ROVER_SPEED:
        pid = rover.speed.pid
        yield _message(_ACCZ_AXIS, pid.target, pid.measured, rover.speed.feed_forward, pid)


def _sub(sub: Sub, mask: int) -> Iterator[Message]:
    at = sub.estimate
    for bit, axis, loop, rate in (
        (_SUB_ROLL if sub.tilts else 0, _ROLL_AXIS, sub.roll, at.roll_rate),
        (_SUB_PITCH if sub.tilts else 0, _PITCH_AXIS, sub.pitch, at.pitch_rate),
        (_SUB_YAW, _YAW_AXIS, sub.yaw, at.yaw_rate),
    ):
        if mask & bit:
            pid = loop.pid
            yield _message(axis, _HUNDREDTH * pid.target, math.degrees(rate), pid.feed_forward, pid, _HUNDREDTH)
    if mask & _SUB_ACCZ:
        pid = sub.depth.acceleration
        achieved = at.climb_acceleration
        yield _message(_ACCZ_AXIS, _HUNDREDTH * pid.target, achieved, pid.feed_forward, pid, _HUNDREDTH)


_SURFACE_HPA = 1013.25
_HPA_PER_METRE = 98.0665
"""Pressure per depth in fresh water [hPa/m], to be multiplied by BARO_SPEC_GRAV."""
_EPOCH_US = 1_767_225_600_000_000
"""Start of simulated time [us since 1970]: 2026-01-01, UTC. Project choice."""
_FIRMWARE_VERSION = 4 << 24 | 7 << 16
"""Version 4.7.0, development. Parameter names are those of mid-2025."""
_CAPABILITIES = 2 | 4 | 8 | 64 | 128 | 256 | 8192
"""Capability bits: float parameters, MISSION_INT, COMMAND_INT, attitude target, local and global position target,
MAVLink 2."""
_ESTIMATOR_ALIGNED, _ESTIMATOR_READY = 167, 831
"""Values of EKF_STATUS_REPORT.flags in ArduRover 4.7 on its simulator: from 6 s after boot, and from its first position
on."""
_CUSTOM_MODE, _ARMED = 1, 128
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
_GPS, _BATTERY = 0x20, 0x2000000
_SENSORS = 0x01 | 0x02 | 0x04 | 0x08 | _GPS | 0x8000 | _BATTERY
"""Sensor bits: gyro, accelerometer, compass, pressure, GPS, motor outputs, battery."""
_RC_RECEIVER, _PREARM = 0x10000, 0x10000000


def make_heartbeat(vehicle: Vehicle) -> Message:
    """Return the HEARTBEAT message of the present state."""
    autopilot = vehicle.autopilot
    base = _CUSTOM_MODE | autopilot.mode.flags | (_ARMED if autopilot.armed else 0)
    status = _CRITICAL if autopilot.failsafe else _ACTIVE if autopilot.armed else _STANDBY
    return mavlink.MAVLink_heartbeat_message(autopilot.mav_type, 3, base, autopilot.mode.number, status, 3)


def _attitude(vehicle: Vehicle) -> Message:
    e = vehicle.autopilot.estimate
    return mavlink.MAVLink_attitude_message(vehicle.ms, e.roll, e.pitch, e.yaw, e.roll_rate, e.pitch_rate, e.yaw_rate)


def _vfr_hud(vehicle: Vehicle) -> Message:
    e = vehicle.autopilot.estimate
    heading = int(math.degrees(e.yaw)) % 360
    speed = abs(e.speed)
    return mavlink.MAVLink_vfr_hud_message(speed, speed, heading, vehicle.autopilot.throttle_percent, -e.z, e.climb)


def _global_position(vehicle: Vehicle) -> Message:
    e = vehicle.autopilot.estimate
    altitude = round(-1000.0 * e.z)
    place = to_globe(e.place) if vehicle.has_motion_sensor else (0, 0)
    return mavlink.MAVLink_global_position_int_message(
        vehicle.ms,
        *place,
        altitude,
        altitude,
        round(100.0 * e.vx),
        round(100.0 * e.vy),
        round(100.0 * e.vz),
        round(math.degrees(e.yaw) * 100.0) % 36000,
    )


def _local_position(vehicle: Vehicle) -> Iterable[Message]:
    """Return LOCAL_POSITION_NED. A filter that never had a position has no origin and sends none."""
    e = vehicle.autopilot.estimate
    if not vehicle.has_motion_sensor:
        return ()
    return (mavlink.MAVLink_local_position_ned_message(vehicle.ms, e.x, e.y, e.z, e.vx, e.vy, e.vz),)


def _servo_output(vehicle: Vehicle) -> Message:
    return mavlink.MAVLink_servo_output_raw_message(vehicle.boot_us & 0xFFFFFFFF, 0, *vehicle.autopilot.pwm)


def _rc_channels(vehicle: Vehicle) -> Message:
    rc = vehicle.autopilot.rc
    count = 16 if rc.has_receiver else 0
    return mavlink.MAVLink_rc_channels_message(vehicle.ms, count, *rc.pwm[1:19], 255 if count else 0)


def _sys_status(vehicle: Vehicle) -> Message:
    autopilot, battery = vehicle.autopilot, vehicle.battery
    fitted = _SENSORS & ~(0 if autopilot.has_gps else _GPS) & ~(0 if autopilot.battery.is_fitted else _BATTERY)
    present = fitted | _RC_RECEIVER | _PREARM
    health = fitted
    health |= _RC_RECEIVER if autopilot.rc.has_receiver else 0
    health |= _PREARM if autopilot.prearm_ok else 0
    millivolts, current, remaining = 0, -1, -1
    if autopilot.battery.is_fitted:
        millivolts = max(0, min(65534, round(1000.0 * autopilot.battery.voltage)))
        current = round(100.0 * battery.current)
        remaining = battery.remaining_percent(vehicle.parameters["BATT_CAPACITY"])
    return mavlink.MAVLink_sys_status_message(
        present, present, health, 100, millivolts, current, remaining, 0, 0, 0, 0, 0, 0
    )


def _water_pressure(vehicle: Vehicle) -> Iterator[Message]:
    """Yield SCALED_PRESSURE2, of the pressure gauge if there is one."""
    if "pressure" in vehicle.suite.instruments:
        taken = fresh(vehicle, "pressure", mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2)
        depths = [(stamp // 1000, sample.values[0]) for sample, stamp in taken if sample.valid]
    else:
        depths = [(vehicle.ms, vehicle.autopilot.estimate.z)]
    for stamp, depth in depths:
        pressure = _SURFACE_HPA + _HPA_PER_METRE * vehicle.parameters["BARO_SPEC_GRAV"] * depth
        yield mavlink.MAVLink_scaled_pressure2_message(stamp, fit_float(pressure), 0.0, 2000)


_NEAREST_CM, _FURTHEST_CM = 10, 1000
"""Range of the rangefinder [cm]. Beyond the range, the reported distance is one centimetre more than the limit. Project
choice.
"""
_LASER, _CUSTOM = 0, 100
_EIGHTH = 0.25 * math.pi


def _distance(vehicle: Vehicle) -> Iterable[Message]:
    """Return a message per rangefinder, that of port first."""
    if vehicle.rangefinder is None:
        return ()
    estimate = vehicle.autopilot.estimate
    beams = zip((estimate.distance, estimate.distance_starboard), vehicle.rangefinder.yaws, strict=False)
    return [_reported(vehicle.ms, number, distance, yaw) for number, (distance, yaw) in enumerate(beams)]


def _reported(ms: int, number: int, distance: float, yaw: float) -> Message:
    """Return the message of a beam at *yaw* [rad]: an orientation by eighths of a turn, or else a quaternion."""
    cm = max(0, min(_FURTHEST_CM + 1, round(100.0 * distance))) if math.isfinite(distance) else _FURTHEST_CM + 1
    turned = math.remainder(yaw, _EIGHTH)
    is_eighth = abs(turned) < 1e-6  # rounding
    orientation = round(yaw / _EIGHTH) % 8 if is_eighth else _CUSTOM
    q = (0.0,) * 4 if is_eighth else (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
    return mavlink.MAVLink_distance_sensor_message(
        ms, _NEAREST_CM, _FURTHEST_CM, cm, _LASER, number, orientation, 0, quaternion=q
    )


def _estimator(vehicle: Vehicle) -> Message:
    flags = _ESTIMATOR_READY if vehicle.autopilot.position_ok else _ESTIMATOR_ALIGNED
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.05, 0.05, 0.05, 0.0)


def _system_time(vehicle: Vehicle) -> Message:
    return mavlink.MAVLink_system_time_message(_EPOCH_US + vehicle.us, vehicle.ms)


def _autopilot_version(vehicle: Vehicle) -> Message:
    uid = zlib.crc32(vehicle.data.name.encode())
    nothing = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        _CAPABILITIES, _FIRMWARE_VERSION, 0, 0, 0, nothing, nothing, nothing, 0, 0, uid
    )


_NO_MISSION = 1
_ONLY_POSITION = 0xFDF8
"""POSITION_TARGET_TYPEMASK: velocity, acceleration and yaw mean nothing, nor do the four highest bits."""
_MOST_DISTANCE = 65535


def make_mission_current(vehicle: Vehicle, seq: int | None = None) -> Message:
    """Return MISSION_CURRENT; *seq* instead of the present item answers a station that has set that one."""
    autopilot, mission = vehicle.autopilot, vehicle.autopilot.mission
    total = max(len(mission.items) - 1, 0)
    state = int(mission.progress) if total else _NO_MISSION
    return mavlink.MAVLink_mission_current_message(
        mission.current if seq is None else seq, total, state, int(autopilot.mode.in_mission)
    )


def _nav_controller_output(vehicle: Vehicle) -> Iterable[Message]:
    way = vehicle.autopilot.mode.report()
    if way is None:
        return ()
    heading, bearing = (round(math.degrees(angle)) for angle in (way.heading, way.bearing))
    distance = min(round(way.distance), _MOST_DISTANCE)
    return (
        mavlink.MAVLink_nav_controller_output_message(
            0.0, 0.0, heading, bearing % 360, distance, 0.0, 0.0, fit_float(way.cross_track)
        ),
    )


def _position_target(vehicle: Vehicle) -> Iterable[Message]:
    way = vehicle.autopilot.mode.report()
    if way is None:
        return ()
    frame, nothing = mavlink.MAV_FRAME_GLOBAL, [0.0] * 8
    where = (*to_globe(way.destination), 0.0)
    return (mavlink.MAVLink_position_target_global_int_message(vehicle.ms, frame, _ONLY_POSITION, *where, *nothing),)


_ESC_GROUP = 4
"""ESCs per message. This is the telemetry of ArduPilot's own dialect, which has no ESC_STATUS."""
_MINUTE = 60.0
_LARGEST_16 = 65535


def _shafts(vehicle: Vehicle) -> list[float]:
    """Return the speed of each propeller [1/min], none on a craft whose file gives no thrusters with a place."""
    rotors = getattr(vehicle.plant, "rotors", ())
    return [_MINUTE * float(n) for n in rotors]


def _esc_telemetry(vehicle: Vehicle) -> Iterable[Message]:
    """Return ESC_TELEMETRY_1_TO_4 and _5_TO_8. Like the firmware's, it has no direction of turning."""
    voltage = vehicle.battery.voltage(vehicle.parameters["SIM_BATT_VOLTAGE"])  # an ESC measures it by itself
    centivolts = max(0, min(_LARGEST_16, round(100.0 * voltage)))
    kinds = (mavlink.MAVLink_esc_telemetry_1_to_4_message, mavlink.MAVLink_esc_telemetry_5_to_8_message)
    speeds, nothing = _shafts(vehicle), [0] * _ESC_GROUP
    for make, first in zip(kinds, range(0, len(speeds), _ESC_GROUP), strict=False):
        rpm = [min(_LARGEST_16, round(abs(speed))) for speed in speeds[first : first + _ESC_GROUP]]
        filled = [*rpm, *[0] * (_ESC_GROUP - len(rpm))]
        yield make(nothing, [centivolts * (k < len(rpm)) for k in range(_ESC_GROUP)], nothing, nothing, filled, nothing)


def _rpm(vehicle: Vehicle) -> Iterable[Message]:
    """Return RPM with the first two shafts."""
    speeds = [*_shafts(vehicle), 0.0, 0.0]
    return (mavlink.MAVLink_rpm_message(fit_float(speeds[0]), fit_float(speeds[1])),)


def _one(make: Callable[[Vehicle], Message]) -> Callable[[Vehicle], Iterable[Message]]:
    return lambda vehicle: (make(vehicle),)


_OF_SHAFTS = {
    mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
    mavlink.MAVLINK_MSG_ID_RPM,
}
_SUB_ONLY = mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2

MESSAGES: Mapping[int, tuple[Callable[[Vehicle], Iterable[Message]], float]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (_one(make_heartbeat), 1.0),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (_one(_sys_status), 1.0),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (_one(_system_time), 1.0),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (_one(_attitude), 2.0),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (_local_position, 2.0),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (_one(_global_position), 2.0),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: (_one(_servo_output), 1.0),
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: (_one(_rc_channels), 1.0),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (_one(_vfr_hud), 2.0),
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2: (_water_pressure, 1.0),
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: (_distance, 0.0),
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: (_one(_estimator), 1.0),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: (_one(make_mission_current), 1.0),
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: (_nav_controller_output, 1.0),
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: (_position_target, 1.0),
    mavlink.MAVLINK_MSG_ID_PID_TUNING: (make_pid_tuning, 2.0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (_one(_autopilot_version), 0.0),
    mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4: (_esc_telemetry, 1.0),
    mavlink.MAVLINK_MSG_ID_RPM: (_rpm, 1.0),
    **{number: (build, rate) for number, (_, build, rate) in INSTRUMENT_MESSAGES.items()},
}
"""Message id -> (builder, rate [Hz] at boot; 0: only on request)."""


def available_messages(vehicle: Vehicle) -> Iterable[int]:
    """Return the ids of the messages that this craft sends.

    Only Sub sends water pressure. Only a craft with a rangefinder or an instrument sends what that measures. Only one
    with thrusters in their places sends the speeds of its shafts.
    """
    without = set() if isinstance(vehicle.autopilot, Sub) else {_SUB_ONLY}
    without |= set() if vehicle.rangefinder is not None else {mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR}
    without |= set() if _shafts(vehicle) else _OF_SHAFTS
    without |= {m for m, (of, _, _) in INSTRUMENT_MESSAGES.items() if of not in vehicle.suite.instruments}
    return [m for m in MESSAGES if m not in without]
