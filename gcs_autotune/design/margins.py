"""How far a loop is from instability: gain, phase and delay margin, of one loop or of many with one controller.

A design asks for the margins of a few dozen crafts thousands of times; what belongs to a craft alone is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.open_loop import OpenLoop, Rational, pade
from gcs_autotune.design.result import Margins

__all__ = ["NO_CROSSING", "Plant", "margins_of", "margins_of_each", "worst"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

NO_CROSSING = 1000.0
"""What a margin is called when no crossing limits it (a ratio, or seconds); finite, so that files can hold it."""

GRID = np.logspace(-3.0, 2.7, 700)
"""Frequencies [rad/s] at which margins are looked for; boats and ROVs live in the middle of it."""

_S: Complex = (1j * GRID).astype(np.complex128)


class Plant(NamedTuple):
    """``gain / (alpha s + drag) * exp(-delay s)``: what a controller of a velocity acts on; ``delay`` [s]."""

    gain: float
    alpha: float
    drag: float
    delay: float


def margins_of(loop: OpenLoop) -> Margins:
    """Return gain, phase and delay margin; all zero when the closed loop is unstable.

    The gain margin counts both ways: how much more *or less* gain (a craft that answers weaker) the loop stands.
    """
    stable = bool(np.all(loop.closed_loop_poles().real < 0.0))
    return _read_off(loop.response(GRID)[None, :], [stable])[0]


def margins_of_each(controller: Rational, plants: Sequence[Plant]) -> list[Margins]:
    """Return what :func:`margins_of` says of *controller* (velocity to output) around each of *plants*."""
    if not plants:
        return []
    stable = _are_stable(controller, plants)
    response = controller.at(_S)
    return _read_off(np.array([p.gain * response * _response(p.alpha, p.drag, p.delay) for p in plants]), stable)


def worst(margins: list[Margins]) -> Margins:
    """Return the least of each margin over several loops."""
    return Margins(
        min(m.gain for m in margins),
        min(m.phase for m in margins),
        min(m.delay for m in margins),
        all(m.stable for m in margins),
    )


def _read_off(value: Complex, stable: Sequence[bool]) -> list[Margins]:
    """Return the margins of open loops whose responses over the grid are the rows of *value* (k, n)."""
    real, imaginary = value.real, value.imag
    with np.errstate(divide="ignore"):
        size = np.log(np.abs(value))
    found = [[NO_CROSSING, math.pi, NO_CROSSING] for _ in stable]
    turned = (imaginary[:, :-1] * imaginary[:, 1:] <= 0.0) & (real[:, :-1] < 0.0)
    for row, i in np.argwhere(turned).tolist():
        share = _share(imaginary[row, i], imaginary[row, i + 1])
        gain = math.exp(abs(size[row, i] + share * (size[row, i + 1] - size[row, i])))
        found[row][0] = min(found[row][0], gain)
    for row, i in np.argwhere(size[:, :-1] * size[:, 1:] <= 0.0).tolist():
        share = _share(size[row, i], size[row, i + 1])
        crossing = value[row, i] + share * (value[row, i + 1] - value[row, i])
        omega = GRID[i] + share * (GRID[i + 1] - GRID[i])
        angle = math.atan2(-crossing.imag, -crossing.real)
        found[row][1] = min(found[row][1], abs(angle))
        found[row][2] = min(found[row][2], (angle % math.tau) / float(omega))
    none = Margins(0.0, 0.0, 0.0, stable=False)
    return [Margins(m[0], m[1], m[2], stable=True) if good else none for m, good in zip(found, stable, strict=True)]


def _share(before: float, after: float) -> float:
    """Return how far between two values zero lies."""
    rise = after - before
    return -before / rise if rise else 0.0


@lru_cache(maxsize=2048)
def _response(alpha: float, drag: float, delay: float) -> Complex:
    """Return the response (n,) of a plant of gain one."""
    response: Complex = np.exp(-delay * _S) / (alpha * _S + drag)
    return response


def _are_stable(controller: Rational, plants: Sequence[Plant]) -> list[bool]:
    """Return which closed loops are stable, delays as :meth:`OpenLoop.closed_loop_poles` takes them."""
    stable = [False] * len(plants)
    rows: dict[int, list[tuple[int, Array]]] = {}
    for k, plant in enumerate(plants):
        top, bottom = _delayed(plant.alpha, plant.drag, plant.delay)
        closed = np.polyadd(plant.gain * np.convolve(controller.num, top), np.convolve(controller.den, bottom))
        closed = np.trim_zeros(closed, "f")
        if len(closed) > 1 and closed[-1] != 0.0:
            rows.setdefault(len(closed), []).append((k, np.asarray(closed, dtype=np.float64)))
    for length, own in rows.items():
        companion = np.zeros((len(own), length - 1, length - 1))
        companion[:, np.arange(1, length - 1), np.arange(length - 2)] = 1.0
        polynomials = np.array([p for _, p in own])
        companion[:, 0, :] = -polynomials[:, 1:] / polynomials[:, :1]
        poles = np.linalg.eigvals(companion)
        for (k, _), good in zip(own, np.all(poles.real < 0.0, axis=1).tolist(), strict=True):
            stable[k] = good
    return stable


@lru_cache(maxsize=2048)
def _delayed(alpha: float, drag: float, delay: float) -> tuple[Array, Array]:
    """Return numerator and denominator of a plant of gain one with its delay."""
    top, bottom = pade(delay)
    return top, np.convolve(np.array([alpha, drag]), bottom)
