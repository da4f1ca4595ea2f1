"""The vehicle's time stamps, made continuous."""

from __future__ import annotations

import math

__all__ = ["BootClock", "Unwrapper", "gyro_lag"]

_WRAP_MS = 2**32 * 1e-3
_WRAP_US = 2**32 * 1e-6


def gyro_lag(cutoff: float) -> float:
    """Return how late [s] turn rates come out of a gyro filter of *cutoff* [Hz] (INS_GYRO_FILTER); 0 for no filter.

    The filter is a second-order Butterworth low-pass, ``w0^2 / (s^2 + sqrt(2) w0 s + w0^2)``: slow motion comes
    ``sqrt(2) / w0`` late, and at half the cutoff still only 8 % later than that.
    """
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff) if cutoff > 0.0 else 0.0


class BootClock:
    """Seconds since boot from the 32-bit counters in messages.

    ``time_boot_ms`` wraps after 49.7 days, SERVO_OUTPUT_RAW's microseconds after 71.6 minutes; both are
    unwrapped to lie nearest to the last stamp.
    """

    def __init__(self) -> None:
        self.now = math.nan

    @property
    def is_set(self) -> bool:
        """Whether any stamp has been seen."""
        return not math.isnan(self.now)

    def from_ms(self, time_boot_ms: int) -> float:
        """Return the time [s] of a ``time_boot_ms``, and take it as the present when it is the latest."""
        t = self._near(time_boot_ms * 1e-3, _WRAP_MS)
        if not self.now >= t:
            self.now = t
        return t

    def from_us(self, time_usec: int) -> float:
        """Return the time [s] of a 32-bit microsecond stamp; NaN before any ``time_boot_ms`` was seen."""
        if not self.is_set:
            return math.nan
        return self._near((time_usec % 2**32) * 1e-6, _WRAP_US)

    def _near(self, t: float, period: float) -> float:
        if not self.is_set:
            return t
        turns = round((self.now - t) / period)
        return t + turns * period if turns else t


class Unwrapper:
    """Makes an angle [rad] continuous, starting from its first value."""

    def __init__(self) -> None:
        self._last = math.nan

    def unwrap(self, angle: float) -> float:
        """Return *angle* plus the turns that bring it nearest to the last one."""
        if not math.isnan(self._last):
            angle += 2.0 * math.pi * round((self._last - angle) / (2.0 * math.pi))
        self._last = angle
        return angle
