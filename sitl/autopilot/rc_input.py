"""RC channels: overrides from the ground station, their expiry, and an optional receiver.

Without a receiver a channel keeps its last value when its override is released or expires. Only the radio failsafe then
brings the outputs to neutral. The real firmware does the same, so neutral sticks must be sent before a release.
"""

from __future__ import annotations

from sitl.autopilot.parameters import ParameterStore

__all__ = ["CHANNELS", "RcInput"]

CHANNELS = 18
_STICK_PWM = 1500
_IGNORE_OVERRIDES = 2
"""Bit 1 of RC_OPTIONS: ignore overrides."""
_KEYS = {n: (f"RC{n}_MIN", f"RC{n}_TRIM", f"RC{n}_MAX", f"RC{n}_REVERSED") for n in range(1, 9)}


class RcInput:
    """The RC channels as read by the firmware. Channels are numbered from 1; times are milliseconds since boot."""

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self._parameters, self._version = parameters, -1
        self._ends: dict[int, tuple[float, float, float, int]] = {}
        self.pwm = [_STICK_PWM] * (CHANNELS + 1)
        self._override = [0] * (CHANNELS + 1)
        self._stamp = [0] * (CHANNELS + 1)
        self._new = False
        self._had_receiver = False

    @property
    def has_receiver(self) -> bool:
        """Whether an RC receiver delivers frames (SIM_RC_FAIL 0)."""
        return self._values["SIM_RC_FAIL"] == 0.0

    def override(self, channel: int, pwm: int, ms: int) -> None:
        """Store the override *pwm* [us] of *channel*, received at *ms*; 0 releases the channel."""
        self._override[channel] = max(0, min(65535, pwm))
        self._stamp[channel] = ms
        self._new = True

    def is_overridden(self, ms: int) -> bool:
        """Return whether any channel is overridden at *ms* [ms] since boot."""
        return any(self._in_force(channel, ms) for channel in range(1, CHANNELS + 1))

    def clear_overrides(self) -> None:
        """Release the overrides of all channels, as a failsafe does."""
        self._override = [0] * (CHANNELS + 1)

    def update(self, ms: int) -> bool:
        """Update the channels. Return whether a valid input has arrived since the last call."""
        if self.has_receiver:
            self._had_receiver = True
        elif not self._new:
            return False
        self._new = False
        valid = False
        for channel in range(1, CHANNELS + 1):
            if self._in_force(channel, ms):
                self.pwm[channel] = self._override[channel]
                valid = True
            elif self._had_receiver:
                self.pwm[channel] = _STICK_PWM
                valid = True
        return valid

    def _in_force(self, channel: int, ms: int) -> bool:
        if self._override[channel] == 0 or int(self._values["RC_OPTIONS"]) & _IGNORE_OVERRIDES:
            return False
        timeout = self._values["RC_OVERRIDE_TIME"]
        return timeout < 0.0 or ms - self._stamp[channel] < timeout * 1000.0

    def angle(self, channel: int, full: int, dead_zone: float) -> int:
        """Return a channel's stick position as a whole number within -full..full. It is 0 within *dead_zone* [us] of
        the trim.
        """
        if self._version != self._parameters.version:
            self._read_ends()
        low, trim, high, sign = self._ends[channel]
        pwm = self.pwm[channel]
        if pwm == trim and dead_zone >= 0.0:  # as in most loops
            return 0
        above, below = trim + dead_zone, trim - dead_zone
        if pwm > above and high != above:
            out = int(full * (pwm - above) / (high - above))
        elif pwm < below and below != low:
            out = -int(full * (below - pwm) / (below - low))
        else:
            return 0
        return sign * max(-full, min(full, out))

    def fraction(self, channel: int) -> float:
        """Return a channel's stick position (-1 to 1) relative to its trim, without a dead zone."""
        if self._version != self._parameters.version:
            self._read_ends()
        low, trim, high, sign = self._ends[channel]
        pwm = self.pwm[channel]
        if pwm == trim:  # as in most loops
            return 0.0
        span = high - trim if pwm >= trim else trim - low
        return 0.0 if span <= 0.0 else max(-1.0, min(1.0, sign * (pwm - trim) / span))

    def _read_ends(self) -> None:
        values = self._values
        self._version = self._parameters.version
        self._ends = {
            n: (values[low], values[trim], values[high], -1 if values[reverse] else 1)
            for n, (low, trim, high, reverse) in _KEYS.items()
        }
