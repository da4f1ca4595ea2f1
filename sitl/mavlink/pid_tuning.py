"""PID_TUNING: the parts of the control loops, one message per set bit of GCS_PID_MASK."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from sitl.autopilot.pid import Pid
from sitl.autopilot.rover import Rover
from sitl.autopilot.sub import Sub
from sitl.mavlink.dialect import Message, fit_float, mavlink
from sitl.vehicle import Vehicle

__all__ = ["make_pid_tuning"]

_YAW_AXIS, _ACCZ_AXIS, _STEER_AXIS = 3, 4, 5
_ROVER_STEER, _ROVER_SPEED = 1, 2
_SUB_YAW, _SUB_ACCZ = 4, 8
_HUNDREDTH = 0.01
"""ArduSub scales these as if they still were centidegrees; the desired rate comes out in hundredths of rad/s."""


def make_pid_tuning(vehicle: Vehicle) -> Iterable[Message]:
    """Return the messages GCS_PID_MASK asks for; values are stale while a loop does not run."""
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
    if mask & _SUB_YAW:
        pid = sub.yaw.pid
        achieved = math.degrees(sub.estimate.yaw_rate)
        yield _message(_YAW_AXIS, _HUNDREDTH * pid.target, achieved, pid.feed_forward, pid, _HUNDREDTH)
    if mask & _SUB_ACCZ:
        pid = sub.depth.acceleration
        achieved = sub.estimate.climb_acceleration
        yield _message(_ACCZ_AXIS, _HUNDREDTH * pid.target, achieved, pid.feed_forward, pid, _HUNDREDTH)
