"""Sticks and targets from the ground station: overrides, MANUAL_CONTROL, attitude and position targets."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from sitl.autopilot import STEERING_CHANNEL, THROTTLE_CHANNEL, GuidedTarget, Rover, Sub
from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port
from sitl.place import to_plane

__all__ = [
    "handle_attitude_target",
    "handle_global_target",
    "handle_local_target",
    "handle_manual_control",
    "handle_override",
]

_IGNORE, _RELEASE, _RELEASE_HIGH = 65535, 0, 65534
_FIRST_HIGH_CHANNEL = 9
_UNUSED_AXIS = 32767
_NEUTRAL_PWM = 1500
_PITCH_SENT, _ROLL_SENT = 1, 2
"""Bits of MANUAL_CONTROL.enabled_extensions: ``s`` is the pitch, ``t`` the roll."""
_ALT_HOLD, _GUIDED_SUB = 2, 4
_RATE_IGNORED, _THROTTLE_IGNORED, _ATTITUDE_IGNORED = 4, 64, 128
_Z_IGNORED, _POSITION_IGNORED, _VELOCITY_IGNORED, _ACCELERATION_IGNORED = 4, 7, 56, 448
"""Of a group the firmware ignores all when one bit is set."""
_YAW_IGNORED, _YAW_RATE_IGNORED = 1024, 2048
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_GLOBAL_FRAMES = (
    mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)
_MOST_LATITUDE, _MOST_LONGITUDE = 900_000_000, 1_800_000_000


def handle_override(port: Port, message: Message) -> None:
    """Process RC_CHANNELS_OVERRIDE from the ground station. It also resets the ground station's time-out."""
    autopilot = port.vehicle.autopilot
    if not port.is_from_gcs(message):
        return
    for channel in range(1, 19):
        pwm = getattr(message, f"chan{channel}_raw")
        if channel >= _FIRST_HIGH_CHANNEL:
            pwm = {_RELEASE: _IGNORE, _RELEASE_HIGH: _RELEASE}.get(pwm, pwm)
        if pwm != _IGNORE:
            autopilot.rc.override(channel, pwm, autopilot.ms)
    autopilot.note_gcs()
    if isinstance(autopilot, Sub):
        autopilot.note_pilot()


def handle_manual_control(port: Port, message: Message) -> None:
    """Convert the joystick axes in MANUAL_CONTROL from the ground station to channel overrides."""
    autopilot = port.vehicle.autopilot
    if not port.is_from_gcs(message):
        return
    autopilot.note_gcs()
    if isinstance(autopilot, Rover):
        _override_axis(autopilot, STEERING_CHANNEL, message.y)
        _override_axis(autopilot, THROTTLE_CHANNEL, message.z)
    elif isinstance(autopilot, Sub):
        autopilot.note_pilot()
        _override_sub_sticks(autopilot, message)


def _override_axis(rover: Rover, channel: int, value: int) -> None:
    if value == _UNUSED_AXIS:
        rover.rc.override(channel, _RELEASE, rover.ms)
        return
    low, high = (rover.parameters[f"RC{channel}_{end}"] for end in ("MIN", "MAX"))
    pwm = low + (high - low) * (value + 1000) / 2000.0
    rover.rc.override(channel, int(max(low, min(high, pwm))), rover.ms)


def _override_sub_sticks(sub: Sub, message: Message) -> None:
    side, up = 0.4 * sub.gain, 0.8 * sub.gain * sub.parameters["JS_THR_GAIN"]
    sticks = ((5, side * message.x), (6, side * message.y), (4, side * message.r), (3, up * (message.z - 500)))
    extended = message.enabled_extensions
    tilts = ((1, side * message.s * bool(extended & _PITCH_SENT)), (2, side * message.t * bool(extended & _ROLL_SENT)))
    for channel, offset in (*sticks, *tilts):
        sub.rc.override(channel, int(max(1100.0, min(1900.0, _NEUTRAL_PWM + offset))), sub.ms)


def _all_finite(*numbers: float) -> bool:
    return all(math.isfinite(number) for number in numbers)


def _angles_of(q: Sequence[float]) -> tuple[float, float, float] | None:
    """Return roll, pitch and yaw [rad] of a quaternion (w, x, y, z), or None if it is invalid."""
    if not _all_finite(*q) or not any(q):
        return None
    norm = math.hypot(*q)
    w, x, y, z = (part / norm for part in q)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def handle_attitude_target(port: Port, message: Message) -> None:
    """Process SET_ATTITUDE_TARGET: heading (or turn rate) and speed on Rover, attitude on Sub."""
    autopilot, mask = port.vehicle.autopilot, message.type_mask
    angles = _angles_of(message.q)
    if isinstance(autopilot, Sub):
        if angles is not None and mask & _THROTTLE_IGNORED and not mask & _ATTITUDE_IGNORED:
            autopilot.set_attitude_target(*angles)
        return
    if not isinstance(autopilot, Rover) or autopilot.mode is not autopilot.guided:
        return
    if mask & _THROTTLE_IGNORED or not _all_finite(message.thrust, message.body_yaw_rate):
        return
    speed = max(-1.0, min(1.0, message.thrust)) * autopilot.parameters["WP_SPEED"]
    if not mask & _RATE_IGNORED:
        autopilot.guided.follow(GuidedTarget(autopilot.ms, speed, None, message.body_yaw_rate))
    elif angles is not None:
        autopilot.guided.follow(GuidedTarget(autopilot.ms, speed, angles[2]))


def handle_local_target(port: Port, message: Message) -> None:
    """Take SET_POSITION_TARGET_LOCAL_NED in GUIDED: a place, on Rover also a velocity, yaw or yaw rate.

    On Sub a place with a velocity of zero is held with the yaw; other velocities are not simulated.
    """
    autopilot = port.vehicle.autopilot
    if message.coordinate_frame not in (*_BODY_FRAMES, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED):
        return
    estimate, in_body = autopilot.estimate, message.coordinate_frame in _BODY_FRAMES
    place: complex | None = None
    if not message.type_mask & _POSITION_IGNORED and _all_finite(message.x, message.y, message.z):
        place = complex(message.x, message.y) * (cmath.rect(1.0, estimate.yaw) if in_body else 1.0)
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            place += estimate.place
    if isinstance(autopilot, Rover):
        _guide_rover(autopilot, message, place, estimate.yaw if in_body else 0.0)
    elif isinstance(autopilot, Sub) and place is not None and message.type_mask & _ACCELERATION_IGNORED:
        is_offset = message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED
        altitude = -message.z - (estimate.z if is_offset else 0.0)
        if message.type_mask & _VELOCITY_IGNORED:
            autopilot.go(place, altitude)
        elif not (message.vx or message.vy or message.vz):
            autopilot.stay_at(place, altitude, estimate.yaw if message.type_mask & _YAW_IGNORED else message.yaw)


def handle_global_target(port: Port, message: Message) -> None:
    """Take SET_POSITION_TARGET_GLOBAL_INT: on Rover as the local one; on Sub a depth (ALT_HOLD) or a place (GUIDED).

    ``alt`` [m] is negative under water.
    """
    autopilot, mask = port.vehicle.autopilot, message.type_mask
    place: complex | None = None
    if not mask & _POSITION_IGNORED and message.coordinate_frame in _GLOBAL_FRAMES:
        if abs(message.lat_int) > _MOST_LATITUDE or abs(message.lon_int) > _MOST_LONGITUDE:
            return
        place = to_plane(message.lat_int, message.lon_int)
    if isinstance(autopilot, Rover):
        if message.coordinate_frame in _GLOBAL_FRAMES:
            _guide_rover(autopilot, message, place, 0.0)
    elif isinstance(autopilot, Sub) and math.isfinite(message.alt):
        number = autopilot.mode.number
        if number == _GUIDED_SUB and place is not None and _is_place_alone(message):
            autopilot.go(place, message.alt)
        elif not mask & _Z_IGNORED and number in (_ALT_HOLD, _GUIDED_SUB):
            autopilot.set_depth_target(message.alt)


def _is_place_alone(message: Message) -> bool:
    return bool(message.type_mask & _VELOCITY_IGNORED and message.type_mask & _ACCELERATION_IGNORED)


def _guide_rover(rover: Rover, message: Message, place: complex | None, origin: float) -> None:
    """Take a place, else a velocity with yaw, yaw rate or neither, else one of these; *origin* [rad] is yaw's zero."""
    guided, mask = rover.guided, message.type_mask
    if rover.mode is not guided or not _all_finite(message.vx, message.vy, message.yaw, message.yaw_rate):
        return
    if not mask & _POSITION_IGNORED:
        if place is not None:
            guided.go(place)
        return
    moves, turns, heads = (not mask & bit for bit in (_VELOCITY_IGNORED, _YAW_RATE_IGNORED, _YAW_IGNORED))
    if not mask & _ACCELERATION_IGNORED or (turns and heads) or not (moves or turns or heads):
        return
    speed = min(math.hypot(message.vx, message.vy), rover.parameters["WP_SPEED"]) if moves else 0.0
    if (turns or heads) and message.vx < 0.0:
        speed = -speed
    if turns:
        guided.follow(GuidedTarget(rover.ms, speed, None, message.yaw_rate))
    elif heads:
        guided.follow(GuidedTarget(rover.ms, speed, origin + message.yaw))
    else:
        guided.follow(GuidedTarget(rover.ms, speed, origin + math.atan2(message.vy, message.vx)))
