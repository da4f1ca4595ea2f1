"""What a craft answered to a short pulse one way and back: did it move, and which way?

Pure arithmetic on what was observed; :mod:`~gcs_autotune.manoeuvres.sign_check` flies the pulses. A craft that was
turning already, drifts, or coasts on after a pulse must not be misread, nor one sample of a noisy compass be believed:
``nudot = -a nu + b u + c`` with a *b* for each direction of the output is fitted to the whole record, integrated twice
so that nothing is differentiated: linear in all it does not know. What drifts (buoyancy, wind, current) is in *c*, and
is taken off how far the craft went; and because a craft can drift against the surface, a quay or a net in the midst of
it, which no constant *c* is, the pulse and the pulse back are also compared with each other: one *b* for both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Pulse", "PulseResponse", "Tick", "pulse_response"]

Array = NDArray[np.float64]
Tick = tuple[float, float, float]
"""Time [s], position [rad or m], measured output [fraction of full]."""

FOLLOWS = 0.5
"""Fraction of the commanded output that must be measured; holding loops and rounding reduce it slightly. Chosen."""
SURE = 4.0
"""A fitted motion must be so many times its standard error to count, ..."""
MOST_COLOUR = 0.9
"""Largest correlation of neighbouring residuals that a short record can determine."""
CLEAR = 3.0
"""... or the craft must plainly have gone that way, by so many thresholds: a quick one leaves few ticks to fit."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """A pulse: ``moved`` [rad or m] is what it alone did in its ``seconds``, fitted, with standard error; ``went`` how
    far the craft really got beyond where it was drifting; mean ``output``.
    """

    command: float
    moved: float
    error: float
    went: float
    output: float
    seconds: float

    @property
    def obeyed(self) -> float:
        """Measured output relative to the command; 1 if equal, negative if reversed."""
        return self.output / self.command


@dataclass(frozen=True, slots=True)
class PulseResponse:
    """Both pulses judged, each by itself and against each other.

    ``threshold`` [rad or m] is the least motion that counts. ``compared`` and its standard error ``compared_error``
    [rad or m] are what the first pulse moved if one gain holds for both; ``drift`` [rad/s or m/s] is the motion before.
    """

    forward: Pulse
    back: Pulse
    threshold: float
    compared: float
    compared_error: float
    drift: float

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
        """Whether what was seen of it is the wrong way round, and the two pulses differ accordingly."""
        if self.signs not in ((-1, -1), (-1, 0), (0, -1)):
            return False
        return self.signs == (-1, -1) or (
            self.compared * self.forward.command < 0.0 and abs(self.compared) >= SURE * self.compared_error
        )

    @property
    def is_silent(self) -> bool:
        """Whether neither pulse moved it."""
        return self.signs == (0, 0)

    @property
    def unheeded(self) -> Pulse | None:
        """The pulse that did not reach the outputs, if one did not."""
        return next((s for s in (self.forward, self.back) if not s.obeyed >= FOLLOWS), None)

    def _sign(self, stretch: Pulse) -> int:
        is_clear = stretch.went * stretch.moved > 0.0 and abs(stretch.went) >= CLEAR * self.threshold
        is_sure = abs(stretch.moved) >= SURE * stretch.error
        if abs(stretch.moved) < self.threshold or not (is_sure or is_clear):
            return 0
        return 1 if stretch.moved * stretch.command > 0.0 else -1


def pulse_response(
    command: float, rest: Sequence[Tick], forward: Sequence[Tick], back: Sequence[Tick], threshold: float
) -> PulseResponse:
    """Judge a pulse of *command* [fraction of full] and one of ``-command``; ticks before, and during each of them."""
    t, x, u = (np.array(column) for column in zip(*rest, *forward[1:], *back[1:], strict=True))
    idle = float(np.mean([output for _, _, output in rest]))
    drift = _slope(rest)
    drag, gains, errors = _fitted(t - t[0], x - x[0], u - idle)
    there = _pulse(command, forward, idle, drift, drag, float(gains[0]), float(errors[0]))
    again = _pulse(-command, back, idle, drift, drag, float(gains[1]), float(errors[1]))
    drag, gains, errors = _fitted(t - t[0], x - x[0], u - idle, each=False)
    both = _pulse(command, forward, idle, drift, drag, float(gains[0]), float(errors[0]))
    return PulseResponse(there, again, threshold, both.moved, both.error, drift)


def _slope(ticks: Sequence[Tick]) -> float:
    """Return the mean rate of the position over *ticks*, 0 if there are too few."""
    t, x = (np.array([tick[i] for tick in ticks]) for i in (0, 1))
    t = t - np.mean(t)
    spread = float(t @ t)
    return float(t @ x) / spread if spread > 0.0 else 0.0


def _pulse(
    command: float, ticks: Sequence[Tick], idle: float, drift: float, drag: float, gain: float, error: float
) -> Pulse:
    seconds = ticks[-1][0] - ticks[0][0]
    outputs = [output - idle for _, _, output in ticks]
    output = float(np.mean(outputs[len(outputs) // 2 :]))
    reach = abs(command) * _response(drag, seconds)
    went = ticks[-1][1] - ticks[0][1] - drift * seconds
    return Pulse(command, math.copysign(gain * reach, gain * command), error * reach, went, output, seconds)


def _response(drag: float, seconds: float) -> float:
    """Return how far ``nudot = -drag nu + 1`` gets in *seconds* from rest."""
    if drag * seconds < 1e-3:
        return 0.5 * seconds**2
    return (seconds + math.expm1(-drag * seconds) / drag) / drag


def _fitted(t: Array, x: Array, u: Array, *, each: bool = True) -> tuple[float, Array, Array]:
    """Return drag *a* [1/s], gains *b* and their standard errors: of the first pulse's direction and the other, or of
    both (not *each*).
    """
    first = _first_sign(u)
    ways = (np.where(u * first > 0.0, u, 0.0), np.where(u * first < 0.0, u, 0.0)) if each else (u,)
    columns = [np.ones_like(t), t, 0.5 * t**2, *(_integral(t, _integral(t, way)) for way in ways)]
    for with_drag in (True, False):
        matrix = np.column_stack([*columns, -_integral(t, x)] if with_drag else columns)
        scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
        solution, *_ = np.linalg.lstsq(matrix / scale, x, rcond=1e-10)
        residual = x - (matrix / scale) @ solution
        drag = float(solution[-1] / scale[-1]) if with_drag else 0.0
        if drag >= 0.0:
            break
    freedom = max(len(t) - matrix.shape[1], 1)
    variance = float(residual @ residual) / freedom * _inflation(residual)
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv((matrix / scale).T @ (matrix / scale))) * variance, 0.0))
    found = slice(3, 3 + len(ways))
    return drag, (solution / scale)[found], (errors / scale)[found]


def _inflation(residual: Array) -> float:
    """Return the variance inflation by correlation of neighbouring residuals (first-order autoregression)."""
    power = float(residual @ residual)
    if power <= 0.0:
        return 1.0
    share = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), MOST_COLOUR)
    return (1.0 + share) / (1.0 - share)


def _first_sign(u: Array) -> float:
    """Return the sign of the first pulse among the outputs; 1 when there is none."""
    large = np.flatnonzero(np.abs(u) > 0.5 * np.max(np.abs(u), initial=0.0))
    return float(np.sign(u[large[0]])) if len(large) and u[large[0]] != 0.0 else 1.0


def _integral(t: Array, values: Array) -> Array:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])
