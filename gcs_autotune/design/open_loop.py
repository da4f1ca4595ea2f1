"""A loop opened at the actuator: rational functions of s, and a delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.jit import entry
from gcs_autotune.notebook import Displayed

if TYPE_CHECKING:
    from control import TransferFunction

__all__ = [
    "OpenLoop",
    "Rational",
    "constant",
    "differentiated",
    "first_order",
    "integral_over_proportional",
    "integrator",
    "open_loop",
    "pade",
    "pid_path",
    "second_order",
    "slow",
]

PADE_ORDER = 4

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rational(Displayed):
    """Rational function ``num(s)/den(s)``, with coefficients in falling powers of s."""

    num: Sequence[float]
    den: Sequence[float]

    def __add__(self, other: Rational) -> Rational:
        """Return the sum; common integrators are counted once, so that no false pole at zero appears."""
        mine, n = _split(self.den)
        theirs, m = _split(other.den)
        left = _product(self.num, theirs) + [0.0] * (m - n)
        right = _product(other.num, mine) + [0.0] * (n - m)
        return Rational(_sum(left, right), _product(mine, theirs) + [0.0] * max(n, m))

    def __mul__(self, other: Rational) -> Rational:
        return Rational(_product(self.num, other.num), _product(self.den, other.den))

    def at(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the values (n,) of the function at the complex frequencies *s* (n,) [rad/s]."""
        num, den = (np.array(each, dtype=np.float64) for each in (self.num, self.den))
        value = np.empty_like(s)
        _evaluate(num, den, s, value)
        return value


@dataclass(frozen=True, slots=True, eq=False)
class OpenLoop(Displayed):
    """Open loop ``L(s) = rational(s) * exp(-delay*s)`` with negative feedback, and ``delay`` in s."""

    rational: Rational
    delay: float

    def response(self, omega: Array) -> NDArray[np.complex128]:
        """Return the frequency response ``L(j omega)``, (n,), with the exact delay."""
        s = (1j * omega).astype(np.complex128)
        value: NDArray[np.complex128] = self.rational.at(s) * np.exp(-self.delay * s)
        return value

    def closed_loop_poles(self, order: int = PADE_ORDER) -> NDArray[np.complex128]:
        """Return the poles of the closed loop [rad/s], with a Pade approximation of the delay of *order*."""
        top, bottom = pade(self.delay, order)
        num, den = np.convolve(self.rational.num, top), np.convolve(self.rational.den, bottom)
        poles: NDArray[np.complex128] = np.roots(np.polyadd(num, den)).astype(np.complex128)
        return poles

    def to_control(self, order: int = PADE_ORDER) -> TransferFunction:
        """Return the loop as a transfer function of python-control, with a Pade approximation of the delay of
        *order*.
        """
        from control import TransferFunction

        top, bottom = pade(self.delay, order)
        return TransferFunction(np.convolve(self.rational.num, top), np.convolve(self.rational.den, bottom))


def open_loop(controller: Rational, alpha: float, drag: float, delay: float, restoring: float = 0.0) -> OpenLoop:
    """Return the open loop of *controller* (velocity to output) with the plant ``s/(alpha s^2 + drag s + restoring)``
    and *delay* [s]. Without a restoring moment the plant is ``1/(alpha s + drag)``.
    """
    if not restoring:
        return OpenLoop(Rational((1.0,), (alpha, drag)) * controller, delay)
    return OpenLoop(Rational((1.0,), (alpha, drag, restoring)) * differentiated(controller), delay)


def differentiated(rational: Rational) -> Rational:
    """Return *rational* times s. A pole at zero is cancelled, so that no false pole of a closed loop appears."""
    if rational.den[-1] == 0.0:
        return Rational(rational.num, rational.den[:-1])
    return Rational((*rational.num, 0.0), rational.den)


def constant(gain: float) -> Rational:
    """Return a constant gain as a rational function."""
    return Rational((gain,), (1.0,))


def integrator(gain: float = 1.0) -> Rational:
    """Return the integrator ``gain/s``."""
    return Rational((gain,), (1.0, 0.0))


def first_order(cutoff: float) -> Rational:
    """Return a first-order low-pass of *cutoff* [Hz]. Zero means no filter, as in ArduPilot's parameters."""
    return constant(1.0) if cutoff <= 0.0 else Rational((1.0,), (1.0 / (math.tau * cutoff), 1.0))


def slow(time_constant: float) -> Rational:
    """Return a first-order lag of *time_constant* [s]. Zero means no lag."""
    return first_order(1.0 / (math.tau * time_constant)) if time_constant > 0.0 else constant(1.0)


def second_order(cutoff: float) -> Rational:
    """Return a second-order Butterworth low-pass of *cutoff* [Hz] (the gyro filter). Zero means no filter."""
    if cutoff <= 0.0:
        return constant(1.0)
    w = math.tau * cutoff
    return Rational((1.0,), (1.0 / w**2, math.sqrt(2.0) / w, 1.0))


@entry
def _evaluate(num: Array, den: Array, s: NDArray[np.complex128], value: NDArray[np.complex128]) -> None:
    """Fill *value* (n,) with ``num(s)/den(s)`` at *s* (n,)."""
    for i in range(len(s)):
        top, bottom = 0.0j, 0.0j
        for c in num:
            top = top * s[i] + c
        for c in den:
            bottom = bottom * s[i] + c
        value[i] = top / bottom


def _split(den: Sequence[float]) -> tuple[Sequence[float], int]:
    """Return *den* without its poles at zero, and the number of these poles."""
    count = 0
    while den[-1 - count] == 0.0:
        count += 1
    return den[: len(den) - count], count


def _product(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Return the product of two short polynomials, ten times as fast as NumPy."""
    product = [0.0] * (len(one) + len(other) - 1)
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            product[i + j] += a * b
    return product


def _sum(one: list[float], other: list[float]) -> list[float]:
    """Return the sum of two polynomials."""
    longer, shorter = (one, other) if len(one) >= len(other) else (other, one)
    ahead = len(longer) - len(shorter)
    return longer[:ahead] + [a + b for a, b in zip(longer[ahead:], shorter, strict=True)]


def pade(delay: float, order: int = PADE_ORDER) -> tuple[Array, Array]:
    """Return numerator and denominator, in falling powers, of the Pade approximation of ``exp(-delay*s)`` of
    *order*.
    """
    if delay <= 0.0:
        return np.ones(1), np.ones(1)
    terms = [1.0]
    for k in range(1, order + 1):
        terms.append(terms[-1] * delay * (order - k + 1) / ((2 * order - k + 1) * k))
    bottom = np.array(terms[::-1])
    signs = np.array([(-1.0) ** k for k in range(order, -1, -1)])
    return bottom * signs, bottom


def pid_path(p: float, i: float = 0.0, d: float = 0.0, *, error_cutoff: float, slope_cutoff: float = 0.0) -> Rational:
    """Return the transfer function, without the sign, from measured value to output of a PID on a filtered error.

    error_cutoff, slope_cutoff : cut-off frequencies [Hz] of the filters on the error and on its slope. 0 means no
        filter.
    """
    pid = constant(p)
    if i > 0.0:
        pid = pid + integrator(i)
    if d > 0.0:
        pid = pid + Rational((d, 0.0), (1.0,)) * first_order(slope_cutoff)
    return pid * first_order(error_cutoff)


def integral_over_proportional(outer: float, proportional: float, integral: float) -> float:
    """Return ``A I / (A P + I)`` [1/s] of a PI on a velocity, with an *outer* gain A on the position."""
    return outer * integral / max(outer * proportional + integral, 1e-12)
