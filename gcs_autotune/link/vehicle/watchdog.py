"""Check telemetry for NaN, a frozen attitude, and a stopped or jumping clock. Make its time stamps continuous.

A fault is stored, not raised where it is detected, because the clean-up still has to communicate with the vehicle. The
craft raises it at the next observation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gcs_autotune.clock import Clock
from gcs_autotune.errors import TelemetryFault

__all__ = ["BootClock", "Unwrapper", "Watchdog", "gyro_lag"]

_WRAP_MS = 2**32 * 1e-3
_WRAP_US = 2**32 * 1e-6


def gyro_lag(cutoff: float) -> float:
    """Return the delay [s] of turn rates due to a gyro filter of *cutoff* [Hz] (INS_GYRO_FILTER); 0 without filter.

    The filter is a second-order Butterworth low-pass, ``w0^2 / (s^2 + sqrt(2) w0 s + w0^2)``. It delays slow motion by
    ``sqrt(2) / w0``. At half the cutoff the delay is only 8 % longer.
    """
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff) if cutoff > 0.0 else 0.0


class BootClock:
    """Converts the 32-bit time counters in messages to seconds since boot.

    ``time_boot_ms`` wraps after 49.7 days, SERVO_OUTPUT_RAW's microseconds after 71.6 minutes; both are unwrapped to
    the value nearest to the last stamp.
    """

    def __init__(self) -> None:
        self.now = math.nan

    @property
    def is_set(self) -> bool:
        """Whether any time stamp was received."""
        return not math.isnan(self.now)

    def from_ms(self, time_boot_ms: int) -> float:
        """Return the time [s] of a ``time_boot_ms``, and store it as the present time if it is the latest."""
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
        """Return *angle* [rad] plus the number of full turns that brings it nearest to the last result."""
        if not math.isnan(self._last):
            angle += 2.0 * math.pi * round((self._last - angle) / (2.0 * math.pi))
        self._last = angle
        return angle


_ACTING = 0.05
"""Fraction of full output above which the craft must move. Project choice."""
_FROZEN_TURNING = 3.0
_FROZEN = 10.0
"""Time [s] of bit-identical attitude that proves a fault while turning or acting; real gyros never repeat exactly.
Project choice."""
_STANDING = 2.0
_JUMP = 5.0
_SLACK = 1.5
"""Factor by which the vehicle's clock may advance more than ours over a silence.

A larger one means that it jumped. Project choice.
"""
_LATE = 1.0
"""Age [s] up to which an older stamp counts as a datagram out of order.

If it is older, the clock jumped back. Project choice.
"""
_BOOT_SLACK = 2.0
"""Tolerated difference [s] between the delays of two time stamps. Project choice."""


class Watchdog:
    """Checks every ATTITUDE and the measured outputs for faults of the telemetry.

    Attributes
    ----------
    fault : the first fault detected; None if there is none.
    has_restarted : whether the fault is a restart of the autopilot. stamps : number of ATTITUDE time stamps checked.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._attitude: Sequence[float] = ()
        self._since = math.nan
        self._acting_since = math.nan
        self._turning_since = math.nan
        self._stamp = math.nan
        self._stamp_received = clock.now()
        self._first = (math.nan, math.nan)
        self._pace = 1.0
        self.stamps = 0
        self.has_restarted = False
        self.fault: TelemetryFault | None = None

    def _keep_pace(self, t: float, now: float) -> None:
        """Measure the pace of a simulation: seconds of its time per second of our time."""
        begun, heard = self._first
        if now - heard > _STANDING:
            self._pace = max((t - begun) / (now - heard), 1.0)

    def check(self) -> None:
        """Raise the stored fault as ``TelemetryFault``, if there is one."""
        if self.fault is not None:
            raise TelemetryFault(str(self.fault))

    def check_stamp(self, t: float) -> bool:
        """Check the stamp [s] of an ATTITUDE; return whether the message is usable."""
        before, now = self._stamp, self._clock.now()
        self.stamps += 1
        if math.isnan(before):
            self._stamp, self._stamp_received = t, now
            self._first = (t, now)
            return True
        if t > before:
            if t - before > _JUMP + _SLACK * self._pace * (now - self._stamp_received):
                self._report(f"its clock jumped from {before:.1f} s to {t:.1f} s between two ATTITUDE messages")
            self._keep_pace(t, now)
            self._stamp, self._stamp_received = t, now
            return True
        if before - t > _LATE:
            self._report_back(before, t)
            self._stamp, self._stamp_received = t, now
            return True
        if now - self._stamp_received > _STANDING:
            self._report(f"its clock stopped at {t:.2f} s while messages arrive")
        return False

    def check_boot_time(self, t: float) -> None:
        """Check the time [s] since boot in a rare message, only to detect a restart of the autopilot."""
        self.stamps += 1
        if self._stamp - t > _LATE and self._may_have_booted(t):
            self._report_back(self._stamp, t)

    def _may_have_booted(self, t: float) -> bool:
        """Return whether a boot *t* [s] ago is later than the last received stamp; otherwise the message was late."""
        return t <= self._pace * (self._clock.now() - self._stamp_received) + _BOOT_SLACK

    def _report_back(self, before: float, t: float) -> None:
        if self.fault is None and self._may_have_booted(t):
            self.has_restarted = True
            self.fault = TelemetryFault(
                f"the autopilot has restarted: its time since boot went from {before:.1f} s to {t:.1f} s. A restart "
                "disarms it and resets its message rates. Check its power and its log, and start again"
            )
        self._report(f"its clock jumped back: timestamps went from {before:.1f} s to {t:.1f} s")

    def check_attitude(self, t: float, attitude: Sequence[float]) -> None:
        """Check one ATTITUDE for NaN and a frozen attitude: angles and rates [rad, rad/s], stamped *t* [s]."""
        if not all(math.isfinite(value) for value in attitude):
            self._report("the attitude is not a number: the autopilot's estimator has failed")
            return
        if attitude != self._attitude:
            self._attitude, self._since = attitude, t
            return
        for start, limit in ((self._turning_since, _FROZEN_TURNING), (self._acting_since, _FROZEN)):
            if not math.isnan(start) and t - max(self._since, start) > limit:
                self._report(f"the attitude has been frozen for {t - self._since:.1f} s while the actuators move")

    def note_outputs(self, t: float, forces: Mapping[str, float]) -> None:
        """Record the measured outputs (fractions), stamped *t* [s]."""
        turning = abs(forces.get("N", 0.0)) > _ACTING
        acting = turning or any(abs(force) > _ACTING for force in forces.values())
        self._turning_since = _start(self._turning_since, turning, t)
        self._acting_since = _start(self._acting_since, acting, t)

    def _report(self, what: str) -> None:
        if self.fault is None:
            self.fault = TelemetryFault(
                f"the vehicle's telemetry is not reliable: {what}. No more commands are sent. "
                "Check the vehicle and start again"
            )


def _start(since: float, is_so: bool, t: float) -> float:
    if not is_so:
        return math.nan
    return t if math.isnan(since) else since
