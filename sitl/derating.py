"""Loss of thrust of warm motors and of a battery under load, for each motor separately.

Heat: the winding of a motor is one thermal mass. Its temperature above that of the water obeys ``tau theta' = rise P -
theta``, with P the power as a fraction of full power. Above ``limit`` the thrust falls by ``loss`` per kelvin. The
first-order model is the textbook one of a machine's thermal overload protection; the linear loss is assumed.

Battery: the voltage under load is ``V = V_0 - R I``. The speed of a motor is proportional to the voltage, and the
thrust to the square of the speed. So the thrust falls by ``(V / V_0)^2``. The power of a propeller is proportional to
the cube of its speed, so P is the thrust fraction to the power 1.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sitl.actuators import MotorDrive
from sitl.battery import FULL_CURRENT, IDLE_CURRENT

__all__ = ["LEAST", "Derating"]

LEAST = 0.05
"""Smallest fraction of the thrust that a hot motor or an empty battery leaves. Project choice."""

_NEUTRAL_PWM = 1500


class Derating:
    """The motors of a craft, weakened by heat and by the battery.

    Parameters
    ----------
    drive : the motors' channels and law of thrust.
    heat : ``time_constant`` [s], ``rise`` [K], ``limit`` [K], ``loss`` [1/K]. Empty: motors stay cold.
    battery : ``voltage`` [V], ``resistance`` [ohm], ``full_current`` [A] of one motor. Empty: the voltage is constant.

    ``current`` [A]: total current of the last step. ``warmth`` [K]: channel -> temperature above that of the water.
    """

    def __init__(self, drive: MotorDrive, heat: Mapping[str, float], battery: Mapping[str, float]) -> None:
        self._drive, self._heat, self._battery = drive, heat, battery
        self.warmth = dict.fromkeys(drive.channels, 0.0)
        self.current = IDLE_CURRENT

    def weaken(self, dt: float, pwm: Sequence[float]) -> list[float]:
        """Return the pulses [us] that act in the next *dt* [s] if *pwm* [us] are commanded. They may be fractions."""
        acting, span, exponent = list(pwm), self._drive.span, self._drive.exponent
        sag, power = self._sag(), 0.0
        for channel, warmth in self.warmth.items():
            pulse = pwm[channel - 1]
            output = 0.0 if pulse == 0 else max(-1.0, min(1.0, (pulse - _NEUTRAL_PWM) / span))
            left = max(sag * self._cooled(warmth), LEAST)
            if output != 0.0:
                acting[channel - 1] = _NEUTRAL_PWM + span * output * left ** (1.0 / exponent)
            own = (left * abs(output) ** exponent) ** 1.5
            power += own * self._drive.channels.count(channel)
            if self._heat:
                kept = math.exp(-dt / self._heat["time_constant"])
                self.warmth[channel] = kept * warmth + (1.0 - kept) * self._heat["rise"] * own
        self.current = IDLE_CURRENT + self._battery.get("full_current", FULL_CURRENT) * power
        return acting

    def _sag(self) -> float:
        """Return the fraction of the thrust that the voltage under the last current leaves."""
        if not self._battery:
            return 1.0
        return max(1.0 - self._battery["resistance"] * self.current / self._battery["voltage"], 0.0) ** 2

    def _cooled(self, warmth: float) -> float:
        """Return the fraction of the thrust of a motor that is *warmth* [K] above the water."""
        return 1.0 - self._heat["loss"] * max(warmth - self._heat["limit"], 0.0) if self._heat else 1.0
