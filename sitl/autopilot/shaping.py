"""Functions shared by the control loops: limits, square-root controller, filters."""

from __future__ import annotations

import math

__all__ = [
    "TwoPoleLowPass",
    "clamp",
    "invert_sqrt_controller",
    "low_pass_share",
    "sqrt_controller",
    "step_towards",
    "wrap_pi",
]


def wrap_pi(angle: float) -> float:
    """Return *angle* [rad] in [-pi, pi]."""
    return math.remainder(angle, math.tau)


def clamp(value: float, low: float, high: float) -> float:
    """Return *value* limited to [low, high]."""
    return low if value < low else high if value > high else value


def step_towards(value: float, target: float, change: float) -> float:
    """Return *target*, or the nearest value to it within *change* of *value*."""
    return clamp(target, value - change, value + change)


def sqrt_controller(error: float, p: float, limit: float, dt: float) -> float:
    """Return the rate [error units per s] that brings *error* to zero: ``p*error``, or for large errors the square-root
    law that respects ``limit``.

    ``limit`` is the deceleration in error units per s^2 (0 or less: none). With ``dt`` [s] the rate does not pass the
    goal within one step (0: no such limit). ArduPilot's law of the same name.
    """
    size = abs(error)
    if limit <= 0.0:
        rate = size * p
    elif p <= 0.0:
        rate = math.sqrt(2.0 * limit * size)
    else:
        linear = limit / (p * p)
        rate = math.sqrt(2.0 * limit * (size - 0.5 * linear)) if size > linear else size * p
    if dt > 0.0 and size / dt < rate:
        rate = size / dt
    return math.copysign(rate, error)


def invert_sqrt_controller(rate: float, p: float, limit: float) -> float:
    """Return the error for which :func:`sqrt_controller` returns *rate* (all positive, ``limit`` > 0)."""
    if p <= 0.0:
        return rate * rate / (2.0 * limit)
    if rate <= limit / p:
        return rate / p
    return rate * rate / (2.0 * limit) + limit / (2.0 * p * p)


def low_pass_share(cutoff: float, dt: float) -> float:
    """Return the weight (0 to 1) of a new sample in a one-pole low-pass of *cutoff* [Hz]; 1 without a filter."""
    return 1.0 if cutoff <= 0.0 else dt / (dt + 1.0 / (math.tau * cutoff))


_ROOT_2 = math.sqrt(2.0)


class TwoPoleLowPass:
    """Second-order Butterworth low-pass, like ArduPilot's filter of gyro and accelerometer.

    ArduPilot filters at the sensor's rate of at least 1 kHz, independent of its main loop. So this is the analogue
    filter, solved exactly for an input that is linear between two calls. Its delay is ``sqrt(2)/w_c``.
    """

    __slots__ = ("_cutoff", "_dt", "_fade", "_input", "_pole", "_w", "_wave", "output", "slope")

    def __init__(self) -> None:
        self._cutoff = self._w = self._pole = self._dt = -1.0
        self._fade, self._wave = 0.0, (1.0, 0.0)
        self._input = self.output = self.slope = math.nan

    def apply(self, value: float, cutoff: float, dt: float) -> float:
        """Return the filtered *value*, *dt* [s] after the last. A *cutoff* [Hz] of 0 passes it unfiltered."""
        before = self._input
        if cutoff <= 0.0 or before != before:  # NaN: this is the first value
            self._input, self.output, self.slope = value, value, 0.0
            return value
        if cutoff != self._cutoff or dt != self._dt:
            self._cutoff, self._w, self._dt = cutoff, math.tau * cutoff, dt
            self._pole, decay = self._w / _ROOT_2, self._w * dt / _ROOT_2
            self._fade, self._wave = math.exp(-decay), (math.cos(decay), math.sin(decay))
        climb = (value - before) / dt
        late, pole, fade, (c, s) = _ROOT_2 * climb / self._w, self._pole, self._fade, self._wave
        error, change = self.output - (before - late), self.slope - climb
        self.output = output = value - late + fade * (error * c + (change / pole + error) * s)
        self.slope = climb + fade * (change * c - (change + 2.0 * pole * error) * s)
        self._input = value
        return output
