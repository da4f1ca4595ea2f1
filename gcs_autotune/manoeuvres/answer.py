"""What a craft answered to a short pulse one way and back: did it move, and which way?

Pure arithmetic on what was observed; :mod:`~gcs_autotune.manoeuvres.sign_check` flies the pulses. A craft that was
turning already, drifts, or coasts on after a pulse must not be misread, nor one sample of a noisy compass be believed:
``nudot = -a nu + b u + c`` with a *b* for each direction of the output is fitted to the whole record, integrated twice
so that nothing is differentiated: linear in all it does not know.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Answer", "Stretch", "Tick", "answer"]

Array = NDArray[np.float64]
Tick = tuple[float, float, float]
"""Time [s], position [rad or m], measured output [fraction of full]."""

FOLLOWS = 0.5
"""Chosen: share of the commanded output that must be measured; keepers and rounding take a little of it."""
SURE = 4.0
"""A fitted motion must be so many times its standard error to count, ..."""
CLEAR = 3.0
"""... or the craft must plainly have gone that way, by so many thresholds: a quick one leaves few ticks to fit."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A pulse: ``moved`` [rad or m] is what it alone did in its ``seconds``, fitted, with standard error; ``went`` how
    far the craft really got; mean ``output``.
    """

    command: float
    moved: float
    error: float
    went: float
    output: float
    seconds: float

    @property
    def obeyed(self) -> float:
        """Share of the command found in the measured output; 1 when all of it, negative when turned round."""
        return self.output / self.command


@dataclass(frozen=True, slots=True)
class Answer:
    """Both pulses judged. ``threshold`` [rad or m] is the least motion that counts."""

    forward: Stretch
    back: Stretch
    threshold: float

    @property
    def signs(self) -> tuple[int, int]:
        """For each pulse: 1 moved as commanded, -1 the other way, 0 not to be seen."""
        return self._sign(self.forward), self._sign(self.back)

    @property
    def is_right(self) -> bool:
        """Whether both pulses moved it as commanded."""
        return self.signs == (1, 1)

    @property
    def is_reversed(self) -> bool:
        """Whether what was seen of it is the wrong way round."""
        return self.signs in ((-1, -1), (-1, 0), (0, -1))

    @property
    def is_silent(self) -> bool:
        """Whether neither pulse moved it."""
        return self.signs == (0, 0)

    @property
    def unheeded(self) -> Stretch | None:
        """The pulse that did not reach the outputs, if one did not."""
        return next((s for s in (self.forward, self.back) if not s.obeyed >= FOLLOWS), None)

    def _sign(self, stretch: Stretch) -> int:
        is_clear = stretch.went * stretch.moved > 0.0 and abs(stretch.went) >= CLEAR * self.threshold
        is_sure = abs(stretch.moved) >= SURE * stretch.error
        if abs(stretch.moved) < self.threshold or not (is_sure or is_clear):
            return 0
        return 1 if stretch.moved * stretch.command > 0.0 else -1


def answer(
    command: float, rest: Sequence[Tick], forward: Sequence[Tick], back: Sequence[Tick], threshold: float
) -> Answer:
    """Judge a pulse of *command* [fraction of full] and one of ``-command``; ticks before, and during each of them."""
    t, x, u = (np.array(column) for column in zip(*rest, *forward[1:], *back[1:], strict=True))
    idle = float(np.mean([output for _, _, output in rest]))
    drag, gains, errors = _fitted(t - t[0], x - x[0], u - idle)
    there = _stretch(command, forward, idle, drag, float(gains[0]), float(errors[0]))
    again = _stretch(-command, back, idle, drag, float(gains[1]), float(errors[1]))
    return Answer(there, again, threshold)


def _stretch(command: float, ticks: Sequence[Tick], idle: float, drag: float, gain: float, error: float) -> Stretch:
    seconds = ticks[-1][0] - ticks[0][0]
    outputs = [output - idle for _, _, output in ticks]
    output = float(np.mean(outputs[len(outputs) // 2 :]))
    reach = abs(command) * _response(drag, seconds)
    went = ticks[-1][1] - ticks[0][1]
    return Stretch(command, math.copysign(gain * reach, gain * command), error * reach, went, output, seconds)


def _response(drag: float, seconds: float) -> float:
    """Return how far ``nudot = -drag nu + 1`` gets in *seconds* from rest."""
    if drag * seconds < 1e-3:
        return 0.5 * seconds**2
    return (seconds + math.expm1(-drag * seconds) / drag) / drag


def _fitted(t: Array, x: Array, u: Array) -> tuple[float, Array, Array]:
    """Return drag *a* [1/s], and gain *b* and its standard error for the first pulse's direction and the other."""
    first = _first_sign(u)
    ways = np.where(u * first > 0.0, u, 0.0), np.where(u * first < 0.0, u, 0.0)
    columns = [np.ones_like(t), t, 0.5 * t**2, *(_integral(t, _integral(t, way)) for way in ways)]
    for with_drag in (True, False):
        matrix = np.column_stack([*columns, -_integral(t, x)] if with_drag else columns)
        scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
        solution, *_ = np.linalg.lstsq(matrix / scale, x, rcond=1e-10)
        residual = x - (matrix / scale) @ solution
        drag = float(solution[5] / scale[5]) if with_drag else 0.0
        if drag >= 0.0:
            break
    freedom = max(len(t) - matrix.shape[1], 1)
    covariance = np.linalg.pinv((matrix / scale).T @ (matrix / scale)) * float(residual @ residual) / freedom
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return drag, (solution / scale)[3:5], (errors / scale)[3:5]


def _first_sign(u: Array) -> float:
    """Return the sign of the first pulse among the outputs; 1 when there is none."""
    large = np.flatnonzero(np.abs(u) > 0.5 * np.max(np.abs(u), initial=0.0))
    return float(np.sign(u[large[0]])) if len(large) and u[large[0]] != 0.0 else 1.0


def _integral(t: Array, values: Array) -> Array:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])
