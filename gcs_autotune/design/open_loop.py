"""A loop opened at the actuator, and how far it is from instability."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.result import Margins

if TYPE_CHECKING:
    from control import TransferFunction

__all__ = [
    "NO_CROSSING",
    "OpenLoop",
    "Rational",
    "constant",
    "first_order",
    "integrator",
    "margins_of",
    "open_loop",
    "second_order",
    "slow",
    "worst",
]

NO_CROSSING = 1000.0
"""What a margin is called when no crossing limits it (a ratio, or seconds); finite, so that files can hold it."""

PADE_ORDER = 4
GRID = np.logspace(-3.0, 2.7, 700)
"""Frequencies [rad/s] at which margins are looked for; boats and ROVs live in the middle of it."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rational:
    """``num(s)/den(s)``, coefficients in falling powers of s."""

    num: Array
    den: Array

    def __add__(self, other: Rational) -> Rational:
        """Add; integrators the two have in common are counted once, so that no false pole at zero appears."""
        mine, n = _split(self.den)
        theirs, m = _split(other.den)
        left = _raise(np.convolve(self.num, theirs), max(m - n, 0))
        right = _raise(np.convolve(other.num, mine), max(n - m, 0))
        return Rational(
            np.asarray(np.polyadd(left, right), dtype=np.float64), _raise(np.convolve(mine, theirs), max(n, m))
        )

    def __mul__(self, other: Rational) -> Rational:
        return Rational(np.convolve(self.num, other.num), np.convolve(self.den, other.den))

    def at(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the value at complex frequencies *s* (n,) [rad/s]."""
        value: NDArray[np.complex128] = np.polyval(self.num, s) / np.polyval(self.den, s)
        return value


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoop:
    """``L(s) = rational(s) * exp(-delay*s)`` with negative feedback around it; ``delay`` [s]."""

    rational: Rational
    delay: float

    def response(self, omega: Array) -> NDArray[np.complex128]:
        """Return ``L(j omega)``, (n,), the delay exactly."""
        s = (1j * omega).astype(np.complex128)
        value: NDArray[np.complex128] = self.rational.at(s) * np.exp(-self.delay * s)
        return value

    def closed_loop_poles(self, order: int = PADE_ORDER) -> NDArray[np.complex128]:
        """Return the poles of the closed loop [rad/s], with a Pade delay of *order*."""
        num, den = self.rational.num, self.rational.den
        if self.delay > 0.0:
            top, bottom = _pade(self.delay, order)
            num, den = np.convolve(num, top), np.convolve(den, bottom)
        poles: NDArray[np.complex128] = np.roots(np.polyadd(num, den)).astype(np.complex128)
        return poles

    def to_control(self, order: int = PADE_ORDER) -> TransferFunction:
        """Return python-control's transfer function, with a Pade delay of *order*."""
        from control import TransferFunction

        top, bottom = _pade(self.delay, order)
        return TransferFunction(np.convolve(self.rational.num, top), np.convolve(self.rational.den, bottom))


def open_loop(controller: Rational, alpha: float, drag: float, delay: float) -> OpenLoop:
    """Open the loop of *controller* (velocity to output) around ``1/(alpha s + drag)`` with *delay* [s]."""
    plant = Rational(np.array([1.0]), np.array([alpha, drag]))
    return OpenLoop(plant * controller, delay)


def constant(gain: float) -> Rational:
    """Return a pure gain."""
    return Rational(np.array([gain]), np.array([1.0]))


def integrator(gain: float = 1.0) -> Rational:
    """Return ``gain/s``."""
    return Rational(np.array([gain]), np.array([1.0, 0.0]))


def first_order(cutoff: float) -> Rational:
    """Return a low-pass of *cutoff* [Hz]; zero means none, as in ArduPilot's filter parameters."""
    return constant(1.0) if cutoff <= 0.0 else Rational(np.array([1.0]), np.array([1.0 / (math.tau * cutoff), 1.0]))


def slow(time_constant: float) -> Rational:
    """Return a first-order lag of *time_constant* [s]; none when it is zero."""
    return first_order(1.0 / (math.tau * time_constant)) if time_constant > 0.0 else constant(1.0)


def second_order(cutoff: float) -> Rational:
    """Return a Butterworth low-pass of *cutoff* [Hz] (the gyro filter); zero means none."""
    if cutoff <= 0.0:
        return constant(1.0)
    w = math.tau * cutoff
    return Rational(np.array([1.0]), np.array([1.0 / w**2, math.sqrt(2.0) / w, 1.0]))


def margins_of(loop: OpenLoop) -> Margins:
    """Return gain, phase and delay margin; all zero when the closed loop is unstable.

    The gain margin counts both ways: how much more *or less* gain (a craft that answers weaker) the loop stands.
    """
    if not np.all(loop.closed_loop_poles().real < 0.0):
        return Margins(0.0, 0.0, 0.0, stable=False)
    value = loop.response(GRID)
    size = np.log(np.abs(value))
    gain = NO_CROSSING
    for i in np.flatnonzero((value.imag[:-1] * value.imag[1:] <= 0.0) & (value.real[:-1] < 0.0)):
        rise = value.imag[i + 1] - value.imag[i]
        share = -value.imag[i] / rise if rise else 0.0
        gain = min(gain, math.exp(abs(size[i] + share * (size[i + 1] - size[i]))))
    phase, delay = math.pi, NO_CROSSING
    for i in np.flatnonzero(size[:-1] * size[1:] <= 0.0):
        rise = size[i + 1] - size[i]
        share = -size[i] / rise if rise else 0.0
        crossing = value[i] + share * (value[i + 1] - value[i])
        omega = GRID[i] + share * (GRID[i + 1] - GRID[i])
        angle = float(np.angle(-crossing))
        phase = min(phase, abs(angle))
        delay = min(delay, (angle % math.tau) / float(omega))
    return Margins(gain, phase, delay, stable=True)


def worst(margins: list[Margins]) -> Margins:
    """Return the least of each margin over several loops."""
    return Margins(
        min(m.gain for m in margins),
        min(m.phase for m in margins),
        min(m.delay for m in margins),
        all(m.stable for m in margins),
    )


def _split(den: Array) -> tuple[Array, int]:
    """Return *den* without its poles at zero, and how many there are."""
    count = len(den) - 1 - int(np.flatnonzero(den)[-1])
    return den[: len(den) - count], count


def _raise(polynomial: Array, power: int) -> Array:
    """Return the polynomial times ``s**power``."""
    return np.concatenate([polynomial, np.zeros(power)])


def _pade(delay: float, order: int) -> tuple[Array, Array]:
    """Pade approximation of ``exp(-delay*s)``: numerator and denominator in falling powers."""
    if delay <= 0.0:
        return np.ones(1), np.ones(1)
    terms = [1.0]
    for k in range(1, order + 1):
        terms.append(terms[-1] * delay * (order - k + 1) / ((2 * order - k + 1) * k))
    bottom = np.array(terms[::-1])
    signs = np.array([(-1.0) ** k for k in range(order, -1, -1)])
    return bottom * signs, bottom
