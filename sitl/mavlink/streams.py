"""Which messages go out how often."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sitl.mavlink.dialect import mavlink
from sitl.mavlink.telemetry import MESSAGES

__all__ = ["STREAM_GROUPS", "Streams"]

_LONGEST_US = 2**31 - 1
_DENY_SHARE = 0.8
"""ArduPilot denies an interval when 0.8 of it is shorter than its loop."""

STREAM_GROUPS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (mavlink.MAVLINK_MSG_ID_SYS_STATUS,),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_PID_TUNING),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,),
}
"""REQUEST_DATA_STREAM's groups, as far as we send their messages."""


class Streams:
    """Intervals in microseconds. A message falls due at the first tick at or after each multiple of its interval.

    So 40 Hz comes as gaps of 20 and 40 ms on a 50 Hz loop, and 10 Hz falls on whole tenths of a second. *rate*: of the
    loop [Hz].
    """

    def __init__(self, available: Iterable[int], rate: int) -> None:
        self.available = frozenset(available)
        self._loop_us = 1e6 / rate
        self._soonest = 0
        self._interval: dict[int, int] = {}
        self._next: dict[int, int] = {}
        for message in MESSAGES:
            if message in self.available:
                self._set(message, self._default(message), 0)

    def interval(self, message: int) -> int | None:
        """Return the interval [us] of *message*, -1 when it is off, None when we have no such message."""
        return self._interval.get(message, -1) if message in self.available else None

    def is_too_fast(self, interval: float) -> bool:
        """Return whether *interval* [us] is denied."""
        return 0.0 < interval * _DENY_SHARE < self._loop_us

    def request(self, message: int, interval: float, now_us: int) -> None:
        """Send *message* every *interval* [us]; 0 is its default, negative turns it off."""
        if interval == 0.0:
            self._set(message, self._default(message), now_us)
        else:
            self._set(message, int(min(interval, _LONGEST_US)) if interval > 0.0 else -1, now_us)

    def due(self, now_us: int) -> Iterator[int]:
        """Yield the messages due at *now_us*, in a fixed order."""
        if now_us < self._soonest:
            return
        for message, when in self._next.items():
            if now_us >= when:
                interval = self._interval[message]
                self._next[message] = (now_us // interval + 1) * interval
                yield message
        self._soonest = min(self._next.values(), default=_LONGEST_US)

    @staticmethod
    def _default(message: int) -> int:
        rate = MESSAGES[message][1]
        return int(1e6 / rate) if rate else -1

    def _set(self, message: int, interval: int, now_us: int) -> None:
        if interval < 0:
            self._interval.pop(message, None)
            self._next.pop(message, None)
            return
        self._interval[message] = interval
        self._soonest = 0
        self._next[message] = (now_us // interval + 1) * interval
