"""Gain, phase and delay margin of one loop, or of many plants with one controller.

A design calculates the margins of a few dozen plants thousands of times. Responses that depend on the plants alone are
cached.
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
    stable = bool(np.all(loop.closed_loop_poles().real < 0.0))
    return _read_off(loop.response(GRID)[None, :], [stable])[0]


def margins_of_each(controller: Rational, plants: Sequence[Plant]) -> list[Margins]:
    """Return the result of :func:`margins_of` for *controller* (velocity to output) with each of *plants*."""
    if not plants:
        return []
    stable = _are_stable(controller, plants)
    response = controller.at(_S)
    return _read_off(np.array([p.gain * response * _response(*p[1:]) for p in plants]), stable)


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


def _read_off(value: Complex, stable: Sequence[bool]) -> list[Margins]:
    """Return the margins of open loops whose responses over the grid are the rows of *value* (k, n)."""
    gain, phase, delay = (np.full(len(value), most) for most in (NO_CROSSING, math.pi, NO_CROSSING))
    turned, unity = crossings(value, GRID)
    np.minimum.at(gain, turned.row, np.exp(np.abs(turned.value)))
    np.minimum.at(phase, unity.row, np.abs(unity.value))
    np.minimum.at(delay, unity.row, (unity.value % math.tau) / unity.at)
    none = Margins(0.0, 0.0, 0.0, stable=False)
    found = zip(gain.tolist(), phase.tolist(), delay.tolist(), stable, strict=True)
    return [Margins(g, p, d, stable=True) if good else none for g, p, d, good in found]


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


def _are_stable(controller: Rational, plants: Sequence[Plant]) -> list[bool]:
    """Return which closed loops are stable, with the delay approximation of :meth:`OpenLoop.closed_loop_poles`."""
    stable = [False] * len(plants)
    alike: dict[tuple[int, bool], list[int]] = {}
    for k, plant in enumerate(plants):
        alike.setdefault((len(_delayed(*plant[1:])[1]), plant.restoring != 0.0), []).append(k)
    for (_, restored), own in alike.items():
        parts = [_delayed(*plants[k][1:]) for k in own]
        gains = np.array([[plants[k].gain] for k in own])
        path = differentiated(controller) if restored else controller
        forward = gains * _times(path.num, np.array([top for top, _ in parts]))
        closed = _times(path.den, np.array([bottom for _, bottom in parts]))
        if forward.shape[1] > closed.shape[1]:
            forward, closed = closed, forward
        closed[:, closed.shape[1] - forward.shape[1] :] += forward
        whole = (closed[:, 0] != 0.0) & (closed[:, -1] != 0.0)
        poles = _roots(closed[whole])
        good = iter(np.all(poles.real < 0.0, axis=1).tolist())
        for k, polynomial, is_whole in zip(own, closed, whole.tolist(), strict=True):
            stable[k] = next(good) if is_whole else _is_stable(polynomial)
    return stable


def _times(factor: Array, polynomials: Array) -> Array:
    """Return the products of the polynomial *factor* (m,) with each of *polynomials* (k, n): (k, m + n - 1)."""
    product = np.zeros((len(polynomials), len(factor) + polynomials.shape[1] - 1))
    for power, coefficient in enumerate(factor.tolist()):
        product[:, power : power + polynomials.shape[1]] += coefficient * polynomials
    return product


def _roots(polynomials: Array) -> Complex:
    """Return the roots (k, n) of polynomials (k, n + 1) whose first and last coefficients are not zero."""
    length = polynomials.shape[1]
    companion = np.zeros((len(polynomials), length - 1, length - 1))
    companion[:, np.arange(1, length - 1), np.arange(length - 2)] = 1.0
    companion[:, 0, :] = -polynomials[:, 1:] / polynomials[:, :1]
    return np.linalg.eigvals(companion).astype(np.complex128)


def _is_stable(polynomial: Array) -> bool:
    """Return whether all roots of a polynomial are in the left half-plane.

    It may have leading zeros, or a root at zero.
    """
    trimmed = np.trim_zeros(polynomial, "f")
    return len(trimmed) > 1 and trimmed[-1] != 0.0 and bool(np.all(_roots(trimmed[None, :]).real < 0.0))


@lru_cache(maxsize=2048)
def _delayed(alpha: float, drag: float, delay: float, restoring: float) -> tuple[Array, Array]:
    """Return numerator and denominator of a plant of gain one, including its delay, from output to velocity.

    With a restoring moment it is the plant from output to angle, so that the zero at s = 0 is in the controller.
    """
    top, bottom = pade(delay)
    return top, np.convolve(np.array([alpha, drag, restoring] if restoring else [alpha, drag]), bottom)
