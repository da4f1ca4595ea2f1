"""Small signal shapers that the control loops share: limits, square-root controller, filters."""

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
    """Return *value* kept within [low, high]."""
    return low if value < low else high if value > high else value


def step_towards(value: float, target: float, change: float) -> float:
    """Return *target*, or as near to it as *change* allows from *value*."""
    return clamp(target, value - change, value + change)


def sqrt_controller(error: float, p: float, limit: float, dt: float) -> float:
    """Return the rate that brings *error* to zero: ``p*error``, or the square root that ``limit`` can still brake.

    ``limit`` is the deceleration in error units per s^2 (0 or less: none). ArduPilot's law of the same name.
    """
    size = abs(error)
    if limit <= 0.0:
        rate = size * p
    elif p <= 0.0:
        rate = math.sqrt(2.0 * limit * size)
    else:
        linear = limit / (p * p)
        rate = math.sqrt(2.0 * limit * (size - 0.5 * linear)) if size > linear else size * p
    return math.copysign(min(rate, size / dt), error)


def invert_sqrt_controller(rate: float, p: float, limit: float) -> float:
    """Return the error at which :func:`sqrt_controller` asks for *rate* (all positive, ``limit`` > 0)."""
    if p <= 0.0:
        return rate * rate / (2.0 * limit)
    if rate <= limit / p:
        return rate / p
    return rate * rate / (2.0 * limit) + limit / (2.0 * p * p)


def low_pass_share(cutoff: float, dt: float) -> float:
    """Return how much of a new sample a one-pole filter of *cutoff* [Hz] takes in; 1 when there is no filter."""
    return 1.0 if cutoff <= 0.0 else dt / (dt + 1.0 / (math.tau * cutoff))


class TwoPoleLowPass:
    """Second-order Butterworth low-pass (bilinear, pre-warped), the one in front of ArduPilot's gyro."""

    __slots__ = ("_a1", "_a2", "_b0", "_b1", "_cutoff", "_s1", "_s2", "_started")

    def __init__(self) -> None:
        self._cutoff = -1.0
        self._b0, self._b1, self._a1, self._a2 = 1.0, 0.0, 0.0, 0.0
        self._s1 = self._s2 = 0.0
        self._started = False

    def apply(self, value: float, cutoff: float, dt: float) -> float:
        """Return the filtered *value*; *cutoff* [Hz] of 0, or beyond 0.45 of the sample rate, does not filter."""
        if cutoff <= 0.0 or cutoff * dt > 0.45:
            self._started = False
            return value
        if cutoff != self._cutoff:
            self._tune(cutoff, dt)
        if not self._started:
            self._started = True
            self._s2 = value * (self._b0 - self._a2)
            self._s1 = value * (self._b1 - self._a1) + self._s2
        out = self._b0 * value + self._s1
        self._s1 = self._b1 * value - self._a1 * out + self._s2
        self._s2 = self._b0 * value - self._a2 * out
        return out

    def _tune(self, cutoff: float, dt: float) -> None:
        self._cutoff = cutoff
        self._started = False
        warped = math.tan(math.pi * cutoff * dt)
        scale = 1.0 + math.sqrt(2.0) * warped + warped * warped
        self._b0 = warped * warped / scale
        self._b1 = 2.0 * self._b0
        self._a1 = 2.0 * (warped * warped - 1.0) / scale
        self._a2 = (1.0 - math.sqrt(2.0) * warped + warped * warped) / scale
