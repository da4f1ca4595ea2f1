"""Evaluate the response to a short pulse in each direction: whether the craft moved, and in which direction.

The module only computes; :mod:`~gcs_autotune.manoeuvres.sign_check` flies the pulses. The evaluation must tolerate a
craft that already turns, drifts or coasts, and a noisy compass. So ``nudot = -a nu + b u + c`` with a *b* for each
direction of the output is fitted to the whole record. It is integrated twice, so that nothing is differentiated and the
fit is linear in all unknowns.

A constant drift (buoyancy, wind, current) is described by *c*, and is subtracted from the distance moved. But a craft
may touch the surface, a quay or a net during the pulse, which a constant *c* does not describe. So both pulses are also
compared with each other, with one *b* for both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CLEAR", "Pulse", "PulseResponse", "Tick", "pulse_response"]

Array = NDArray[np.float64]
Tick = tuple[float, float, float]
"""One sample: time [s], position [rad or m], measured output [fraction of full]."""

FOLLOWS = 0.5
"""Smallest measured output, as a fraction of the commanded output, that counts as following.

Holding loops and rounding reduce it slightly. Project choice.
"""
SURE = 4.0
"""Smallest significant motion, in multiples of its standard error. Project choice."""
MOST_COLOUR = 0.9
"""Largest correlation of neighbouring residuals that can be estimated from a short record. Project choice."""
CLEAR = 3.0
"""Actual motion that is significant without regard to the fit, in multiples of the threshold.

For a fast craft the pulse has few samples to fit. Project choice.
"""


@dataclass(frozen=True, slots=True)
class Pulse:
    """One pulse of a check.

    ``command``: commanded output [fraction of full].
    ``moved`` [rad or m]: fitted motion due to the pulse alone during its ``seconds``; ``error``: its standard error.
    ``went`` [rad or m]: actual motion in addition to the drift.
    ``output``: mean measured output [fraction of full].
    """

    command: float
    moved: float
    error: float
    went: float
    output: float
    seconds: float

    @property
    def obeyed(self) -> float:
        """Ratio of measured output to commanded output; 1 if equal, negative if reversed."""
        return self.output / self.command


@dataclass(frozen=True, slots=True)
class PulseResponse:
    """Evaluation of both pulses, separately and compared with each other.

    ``threshold`` [rad or m]: smallest significant motion. ``compared`` [rad or m]: motion due to the first pulse if one
    gain applies to both, with standard error ``compared_error``. ``drift`` [rad/s or m/s]: motion before the pulses.
    """

    forward: Pulse
    back: Pulse
    threshold: float
    compared: float
    compared_error: float
    drift: float

    @property
    def signs(self) -> tuple[int, int]:
        """For the pulse in each direction: 1 if it moved the craft as commanded, -1 if in the other direction, 0 if not
        significant.
        """
        return self._sign(self.forward), self._sign(self.back)

    @property
    def is_right(self) -> bool:
        """Whether both pulses moved the craft as commanded."""
        return self.signs == (1, 1)

    @property
    def is_reversed(self) -> bool:
        """Whether all significant motion is in the wrong direction, and the comparison of the two pulses
        confirms this.
        """
        if self.signs not in ((-1, -1), (-1, 0), (0, -1)):
            return False
        return self.signs == (-1, -1) or (
            self.compared * self.forward.command < 0.0 and abs(self.compared) >= SURE * self.compared_error
        )

    @property
    def is_silent(self) -> bool:
        """Whether neither pulse moved the craft."""
        return self.signs == (0, 0)

    @property
    def unheeded(self) -> Pulse | None:
        """The pulse whose command did not reach the outputs, or None."""
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
    """Return the evaluation of a pulse of *command* [fraction of full] and one of ``-command``, from the samples before
    and during each pulse. Outputs that the vehicle does not report (NaN) count as idle in the fit.
    """
    t, x, u = (np.array(column) for column in zip(*rest, *forward[1:], *back[1:], strict=True))
    idle = float(np.mean([output for _, _, output in rest]))
    u, drift = np.nan_to_num(u - idle), _slope(rest)
    drag, gains, errors = _fitted(t - t[0], x - x[0], u)
    there = _pulse(command, forward, idle, drift, drag, float(gains[0]), float(errors[0]))
    again = _pulse(-command, back, idle, drift, drag, float(gains[1]), float(errors[1]))
    drag, gains, errors = _fitted(t - t[0], x - x[0], u, each=False)
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
    """Return the motion according to ``nudot = -drag nu + 1`` after *seconds* from rest."""
    if drag * seconds < 1e-3:
        return 0.5 * seconds**2
    return (seconds + math.expm1(-drag * seconds) / drag) / drag


def _fitted(t: Array, x: Array, u: Array, *, each: bool = True) -> tuple[float, Array, Array]:
    """Return the fitted drag *a* [1/s], the gains *b* and their standard errors.

    There is a gain for the first pulse's direction and one for the other, or one for both (not *each*).
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
    """Return the factor on the variance due to correlated neighbouring residuals (first-order autoregression)."""
    power = float(residual @ residual)
    if power <= 0.0:
        return 1.0
    share = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), MOST_COLOUR)
    return (1.0 + share) / (1.0 - share)


def _first_sign(u: Array) -> float:
    """Return the sign of the first pulse in the outputs; 1 if there is none."""
    large = np.flatnonzero(np.abs(u) > 0.5 * np.max(np.abs(u), initial=0.0))
    return float(np.sign(u[large[0]])) if len(large) and u[large[0]] != 0.0 else 1.0


def _integral(t: Array, values: Array) -> Array:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])
