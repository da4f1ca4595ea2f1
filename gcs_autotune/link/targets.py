"""Set-points for the autopilot's own loops, per kind of vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from gcs_autotune.craft import DepthTarget, HeadingTarget, TurnRateTarget
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["ATTITUDE_TARGETS", "depth_target", "turn_rate_target"]

_IGNORE_BODY_RATES = 0b111
_IGNORE_THRUST = 1 << 6
_YAW_RATE_ONLY = 0b10000011
"""ATTITUDE_TARGET_TYPEMASK: body roll and pitch rate and the attitude ignored, yaw rate and thrust in force."""
_ONLY_Z = 0b110111111011
"""POSITION_TARGET_TYPEMASK: ignore all but z (the force bit says acceleration, which is ignored)."""
_HALF = 0.5
"""Thrust that means "neither up nor down" to ArduSub, should it look."""


def _quaternion(psi: float) -> list[float]:
    """Return (w, x, y, z) of a level attitude with heading *psi* [rad]."""
    half = math.remainder(psi, 2.0 * math.pi) / 2.0
    return [math.cos(half), 0.0, 0.0, math.sin(half)]


def _attitude(ids: tuple[int, int], psi: float, mask: int, thrust: float) -> Message:
    return mavlink.MAVLink_set_attitude_target_message(0, *ids, mask, _quaternion(psi), 0.0, 0.0, 0.0, thrust)


def _share(speed: float, full_speed: float) -> float:
    return max(-1.0, min(1.0, speed / full_speed)) if full_speed > 0.0 else 0.0


def turn_rate_target(ids: tuple[int, int], target: TurnRateTarget, full_speed: float) -> Message:
    """Return what asks a Rover in GUIDED for a turn rate and a speed."""
    thrust = _share(target.speed, full_speed)
    nothing = _quaternion(0.0)
    return mavlink.MAVLink_set_attitude_target_message(0, *ids, _YAW_RATE_ONLY, nothing, 0.0, 0.0, target.r, thrust)


def _boat(ids: tuple[int, int], target: HeadingTarget, full_speed: float) -> Message:
    """Rover in GUIDED: heading from the quaternion, thrust as a fraction of WP_SPEED, both needed."""
    return _attitude(ids, target.psi, _IGNORE_BODY_RATES, _share(target.speed, full_speed))


def _rov(ids: tuple[int, int], target: HeadingTarget, full_speed: float) -> Message:
    """Sub in ALT_HOLD: attitude for five seconds per message while the depth loop goes on."""
    return _attitude(ids, target.psi, _IGNORE_BODY_RATES | _IGNORE_THRUST, _HALF)


ATTITUDE_TARGETS: Mapping[str, Callable[[tuple[int, int], HeadingTarget, float], Message]] = {
    "boat": _boat,
    "rov": _rov,
}
"""Kind of vehicle (``Firmware.kind``) -> how a heading is asked of it."""


def depth_target(ids: tuple[int, int], target: DepthTarget) -> Message:
    """Return SET_POSITION_TARGET_GLOBAL_INT for a depth below the estimator's origin, which is how ArduSub takes it.

    In ALT_HOLD it reads the altitude alone, from its origin, whatever frame the message names.
    """
    nothing = [0.0] * 8
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, *ids, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, _ONLY_Z, 0, 0, -target.z, *nothing
    )
