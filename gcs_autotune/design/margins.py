"""Gain, phase and delay margin of one loop, or of many plants with one controller.

A design calculates the margins of a few dozen plants thousands of times. Responses that depend on the plants alone are
cached, and a compiled function reads off the margins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.open_loop import OpenLoop, Rational, differentiated, pade
from gcs_autotune.design.result import Margins
from gcs_autotune.jit import entry

__all__ = ["NO_CROSSING", "Crossings", "Plant", "crossings", "margins_of", "margins_of_each", "worst"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]

NO_CROSSING = 1000.0
"""Value of a margin (a ratio, or seconds) that no crossing limits.

Project choice: it is finite, so that files can contain it.
"""

GRID = np.logspace(-3.0, 2.7, 700)
"""Frequencies [rad/s] at which margins are searched. Project choice: boats and ROVs are in the middle of the range."""

_NONE = Margins(0.0, 0.0, 0.0, stable=False)
_S: Complex = (1j * GRID).astype(np.complex128)


class Plant(NamedTuple):
    """Plant of a velocity controller, ``gain / (alpha s + drag + restoring / s) * exp(-delay s)``, with ``delay`` in
    s. ``restoring`` is the moment per angle that pulls the craft back, or 0.
    """

    gain: float
    alpha: float
    drag: float
    delay: float
    restoring: float = 0.0


def margins_of(loop: OpenLoop) -> Margins:
    """Return the gain, phase and delay margin of *loop*. All are zero if the closed loop is unstable.

    The gain margin covers both directions: the increase *or decrease* of gain that the loop tolerates.
    """
    if not np.all(loop.closed_loop_poles().real < 0.0):
        return _NONE
    gain, phase, delay = NO_CROSSING, math.pi, NO_CROSSING
    turned, unity = crossings(loop.response(GRID)[None, :], GRID)
    gain = min([gain, *np.exp(np.abs(turned.value)).tolist()])
    phase = min([phase, *np.abs(unity.value).tolist()])
    delay = min([delay, *((unity.value % math.tau) / unity.at).tolist()])
    return Margins(gain, phase, delay, stable=True)


def margins_of_each(controller: Rational, plants: Sequence[Plant]) -> list[Margins]:
    """Return the result of :func:`margins_of` for *controller* (velocity to output) with each of *plants*.

    Stability is that of Routh's array, with the delay approximation of :meth:`OpenLoop.closed_loop_poles`.
    """
    if not plants:
        return []
    found = np.empty((len(plants), 4))
    response = controller.at(_S)
    paths = controller, differentiated(controller)
    plain, without_zero = ((np.array(path.num), np.array(path.den)) for path in paths)
    for row, plant in zip(found, plants, strict=True):
        num, den = without_zero if plant.restoring else plain
        top, bottom = _delayed(*plant[1:])
        closed = np.zeros(max(len(top) + len(num), len(bottom) + len(den)) - 1)
        rational = (num, den, top, bottom, float(plant.gain), closed)
        _read_off(*rational, response, _response(*plant[1:]), GRID, row)
    return [Margins(g, p, d, stable=True) if stable else _NONE for g, p, d, stable in found.tolist()]


def worst(margins: list[Margins]) -> Margins:
    """Return the smallest gain, phase and delay margin over several loops. The result is stable if all loops are."""
    return Margins(
        min(m.gain for m in margins),
        min(m.phase for m in margins),
        min(m.delay for m in margins),
        all(m.stable for m in margins),
    )


class Crossings(NamedTuple):
    """Crossings of the frequency responses of several loops.

    - ``row`` (k,): index of the loop.
    - ``at`` (k,): frequency [rad/s].
    - ``value`` (k,): at 180 degrees of phase, the logarithm of the magnitude; at magnitude one, the angle from 180
      degrees [rad].
    """

    row: Index
    at: Array
    value: Array


def crossings(value: Complex, omega: Array) -> tuple[Crossings, Crossings]:
    """Return the crossings of 180 degrees of phase, and those of magnitude one.

    value : (k, n) frequency responses at *omega* (n,) [rad/s].
    """
    real, imaginary = value.real, value.imag
    power = real * real + imaginary * imaginary
    row, i = np.nonzero((imaginary[:, :-1] * imaginary[:, 1:] <= 0.0) & (real[:, :-1] < 0.0))
    share = _zero_between(imaginary[row, i], imaginary[row, i + 1])
    before, after = _sizes(power, row, i)
    turned = Crossings(row, _between(omega, i, share), before + share * (after - before))
    beyond = power - 1.0
    row, i = np.nonzero(beyond[:, :-1] * beyond[:, 1:] <= 0.0)
    share = _zero_between(*_sizes(power, row, i))
    there = value[row, i] + share * (value[row, i + 1] - value[row, i])
    return turned, Crossings(row, _between(omega, i, share), np.arctan2(-there.imag, -there.real))


@entry
def _read_off(
    num: Array,
    den: Array,
    top: Array,
    bottom: Array,
    gain: float,
    closed: Array,
    controller: Complex,
    plant: Complex,
    omega: Array,
    found: Array,
) -> None:
    """Fill *found* (4,) with the margins of one loop, and with 1 if it is stable.

    num, den : controller as a rational function. top, bottom : plant of gain one, likewise. gain : gain of the plant.
    closed : (m,) zeros, which receive the characteristic polynomial.
    controller, plant : (n,) their frequency responses at *omega* (n,) [rad/s].
    """
    found[0], found[1], found[2], found[3] = NO_CROSSING, math.pi, NO_CROSSING, 0.0
    # Whether it is stable.
    last = len(closed) - 1
    for i in range(len(num)):
        for j in range(len(top)):
            closed[last - len(num) - len(top) + 2 + i + j] += gain * num[i] * top[j]
    for i in range(len(den)):
        for j in range(len(bottom)):
            closed[last - len(den) - len(bottom) + 2 + i + j] += den[i] * bottom[j]
    first = 0
    while first < last and closed[first] == 0.0:
        first += 1
    sign = 1.0 if closed[first] > 0.0 else -1.0
    for k in range(first, last):  # the first column of Routh's array, in place
        if not sign * closed[k + 1] > 0.0:
            return
        ratio = closed[k] / closed[k + 1]
        for j in range(k + 2, last, 2):
            closed[j] -= ratio * closed[j + 1]
    if first == last:
        return
    found[3] = 1.0
    # Its crossings, as in :func:`crossings`.
    before = gain * controller[0] * plant[0]
    power_before = before.real * before.real + before.imag * before.imag
    for i in range(1, len(omega)):
        value = gain * controller[i] * plant[i]
        power = value.real * value.real + value.imag * value.imag
        if before.imag * value.imag <= 0.0 and before.real < 0.0:
            rise = value.imag - before.imag
            share = -before.imag / rise if rise != 0.0 else 0.0
            size = 0.5 * math.log(power_before)
            size = math.exp(abs(size + share * (0.5 * math.log(power) - size)))
            found[0] = size if size < found[0] else found[0]
        if (power_before - 1.0) * (power - 1.0) <= 0.0:
            size = 0.5 * math.log(power_before)
            rise = 0.5 * math.log(power) - size
            share = -size / rise if rise != 0.0 else 0.0
            there = before + share * (value - before)
            angle = math.atan2(-there.imag, -there.real)
            found[1] = abs(angle) if abs(angle) < found[1] else found[1]
            late = (angle % math.tau) / (omega[i - 1] + share * (omega[i] - omega[i - 1]))
            found[2] = late if late < found[2] else found[2]
        before, power_before = value, power


def _between(omega: Array, i: Index, share: Array) -> Array:
    """Return the frequencies at the fraction *share* (n,) between column *i* (n,) and the next."""
    found: Array = omega[i] + share * (omega[i + 1] - omega[i])
    return found


def _sizes(power: Array, row: Index, i: Index) -> tuple[Array, Array]:
    """Return the logarithm of the magnitude of responses at columns *i* and at the next columns.

    power : squared magnitudes.
    """
    with np.errstate(divide="ignore"):
        return 0.5 * np.log(power[row, i]), 0.5 * np.log(power[row, i + 1])


def _zero_between(before: Array, after: Array) -> Array:
    """Return the fraction between two columns at which a value is zero; it is *before* and *after* (n,) there."""
    rise = after - before
    return np.divide(-before, rise, out=np.zeros(len(rise)), where=rise != 0.0)


@lru_cache(maxsize=2048)
def _response(alpha: float, drag: float, delay: float, restoring: float) -> Complex:
    """Return the frequency response (n,) of a plant of gain one."""
    response: Complex = np.exp(-delay * _S) / (alpha * _S + drag + restoring / _S)
    return response


@lru_cache(maxsize=2048)
def _delayed(alpha: float, drag: float, delay: float, restoring: float) -> tuple[Array, Array]:
    """Return numerator and denominator of a plant of gain one, including its delay, from output to velocity.

    With a restoring moment it is the plant from output to angle, so that the zero at s = 0 is in the controller.
    """
    top, bottom = pade(delay)
    return top, np.convolve(np.array([alpha, drag, restoring] if restoring else [alpha, drag]), bottom)
