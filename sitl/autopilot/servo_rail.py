"""The servo outputs: the function of each channel, and conversion of a demand to a pulse."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sitl.autopilot.parameters import ParameterStore

__all__ = ["OUTPUTS", "ServoRail"]

OUTPUTS = 16
_PARAMETERISED = 8
_MOST_PWM = 65535


class ServoRail:
    """Pulses [us] of all outputs. The functions and end points of the channels are read again whenever a parameter has
    changed.

    A channel without a function has no pulse (0). A script may override a channel for a number of loops.
    ``is_overridden``: whether it does, or did at the last loop.
    """

    def __init__(self, parameters: ParameterStore) -> None:
        self._parameters = parameters
        self._version = -1
        self._rows: list[tuple[int, int, int, int, int, int]] = []
        self.pwm = [0] * OUTPUTS
        self._overridden: dict[int, tuple[int, int]] = {}
        self.is_overridden = False

    def override(self, index: int, pulse: int, loops: int) -> None:
        """Hold *pulse* [us] on the channel with this *index* (from 0) for that many *loops*."""
        self._overridden[index] = pulse, loops
        self.is_overridden = True

    def write(self, pulse_for: Callable[[int, int, int, int, int], int]) -> None:
        """Set the pulse [us] of each channel with a function to the result of ``pulse_for(function, low, trim, high,
        sign)``.
        """
        if self._version != self._parameters.version:
            self._read_assignments()
        pwm = self.pwm
        for index, function, low, trim, high, sign in self._rows:
            pulse = pulse_for(function, low, trim, high, sign)
            pwm[index] = pulse if 0 <= pulse <= _MOST_PWM else max(0, min(_MOST_PWM, pulse))
        self._override_some()

    def write_motors(self, pulses: Sequence[int], first: int) -> None:
        """Set each channel to the pulse [us] of its motor, the first of which has the function *first*, or to its trim.

        All *pulses* are within MOT_PWM_MIN and MOT_PWM_MAX. It is :meth:`write` without a call per channel, for a loop
        of 400 Hz.
        """
        if self._version != self._parameters.version:
            self._read_assignments()
        pwm, last = self.pwm, first + len(pulses)
        for index, function, _, trim, _, _ in self._rows:
            pulse = pulses[function - first] if first <= function < last else trim
            pwm[index] = pulse if 0 <= pulse <= _MOST_PWM else max(0, min(_MOST_PWM, pulse))
        self._override_some()

    def _override_some(self) -> None:
        pwm = self.pwm
        if self.is_overridden:
            self.is_overridden = bool(self._overridden)
            for index, (pulse, _) in self._overridden.items():
                pwm[index] = pulse
            self._overridden = {i: (pulse, n - 1) for i, (pulse, n) in self._overridden.items() if n > 1}

    def _read_assignments(self) -> None:
        values = self._parameters.values
        self._version = self._parameters.version
        self.pwm = [0] * OUTPUTS
        self._rows = []
        for n in range(1, _PARAMETERISED + 1):
            function, low, trim, high, reverse = (
                int(values[f"SERVO{n}_{key}"]) for key in ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
            )
            if function > 0:
                self._rows.append((n - 1, function, low, trim, high, -1 if reverse else 1))
