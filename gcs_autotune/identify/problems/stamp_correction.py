"""Decide at which autopilot loop an input changed, if the stamps allow several.

For example, messages 40 ms apart on a 20 ms loop allow two loops. The change is then time-stamped between the two
loops. Its stamp is wrong by 10 ms, while other stamps of the run are correct. The wrong stamp colours the residuals and
doubles the standard errors. With a precise gyro it looks like a sensor fault.

The record itself can show the right loop. Every uncertain change gets its own time shift in addition to the fitted
parameters, in one Gauss-Newton step of the joint fit. The change is moved to the nearest loop if that loop is more
likely than the next one by three standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.simulators import simulator_of
from gcs_autotune.identify.problems.solution import Solution
from gcs_autotune.identify.signals.preparation import WITHIN_LOOP
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form

__all__ = ["Switches", "corrected", "switches_of"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOST = 120
"""Maximum number of uncertain changes.

Project choice. A run with more changes is not a relay experiment, and each change costs a simulation.
"""

WIDE = 2.0
"""Prior standard deviation of a shift, in units of the range that the stamps allow.

Project choice: it is wide, as for the common shift.
"""

SURELY = 9.0
"""Smallest difference, in squared standard errors, between the nearest loop and the next.

It corresponds to three standard errors. Project choice.
"""

ROUNDS = 5

NUDGE = 1e-4
"""Time shift [s] for the numerical derivative by the stamp of an input change.

Project choice. It is short compared with a loop, and long compared with rounding.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Switches:
    """Response of the signals of a segment to a later stamp of each uncertain input change.

    - ``by``: name of the signal -> derivatives (n, k) by the stamps.
    - ``which`` (k,): indices of the changes in ``t_in``.
    """

    by: dict[str, Array]
    which: Index

    @property
    def finite(self) -> bool:
        """Whether all simulations for the derivatives succeeded."""
        return all(bool(np.isfinite(table).all()) for table in self.by.values())


def switches_of(
    form: Form,
    segment: Segment,
    theta: Array,
    initial: Array,
    shift: float = 0.0,
    effects: Sequence[EffectInstance] = (),
) -> Switches:
    """Return the derivatives of the signals of *segment* by the stamp of each uncertain input change.

    initial : state (n,) at ``segment.start``.
    """
    delay = float(theta[form.parameters.index("delay")]) if "delay" in form.parameters else 0.0
    at = segment.t_in + delay + shift
    which = np.flatnonzero((segment.slack > 0.0) & (at > segment.start) & (at < segment.stamps[-1]))
    if len(which) > MOST:
        which = which[:0]
    simulator = simulator_of(form, effects, (), (), (), typical=(), data_summary=None, dated=False, patience=None)

    def moved(j: int, by: float) -> Segment:
        t_in = segment.t_in.copy()
        t_in[j] += by
        return replace(segment, t_in=t_in)

    here = simulator.predict(theta, effects, initial, segment, shift, sensitivities=False)
    by = {n: np.full((len(s.t), len(which)), np.nan) for n, s in segment.signals.items()}
    for column, j in enumerate(which):
        after = simulator.predict(theta, effects, initial, moved(int(j), NUDGE), shift, sensitivities=False)
        if here is None or after is None:
            break
        for name, table in by.items():
            table[:, column] = (after[name][0] - here[name][0]) / NUDGE
    return Switches(by, which)


def corrected(segments: Sequence[Segment], fitted: Sequence[Segment], solution: Solution) -> tuple[Segment, ...] | None:
    """Return *segments* with the uncertain input changes moved to their loops, or None if there is no such change.

    A change is moved only if its loop is clear from *solution*. *fitted* are the segments of *solution*. They may begin
    later and contain fewer signals, but are otherwise the same as *segments*.
    """
    if not any(s.slack.any() for s in fitted):
        return None
    tables = [
        switches_of(solution.form, s, solution.theta, x_0, solution.shift)
        for s, x_0 in zip(fitted, solution.initial, strict=True)
    ]
    sizes = [len(t.which) for t in tables]
    if not sum(sizes) or not all(t.finite for t in tables):
        return None
    shifts = _moves(fitted, solution, tables)
    if not np.isfinite(shifts).any():
        return None
    return tuple(
        _moved(segment, table.which, moves)
        for segment, table, moves in zip(segments, tables, np.split(shifts, np.cumsum(sizes)[:-1]), strict=True)
    )


def _moves(segments: Sequence[Segment], solution: Solution, tables: Sequence[Switches]) -> Array:
    """Return the shift [s] of every uncertain change, NaN for those that remain uncertain."""
    offsets = np.concatenate([[0], np.cumsum([len(t.which) for t in tables])])
    slack = np.concatenate([s.slack[t.which] for s, t in zip(segments, tables, strict=True)])
    loop = np.concatenate([np.full(len(t.which), s.loop) for s, t in zip(segments, tables, strict=True)])
    columns = []
    for residual, rows in zip(solution.rests, solution.rows, strict=True):
        own = np.zeros((len(rows), int(offsets[-1])))
        by = tables[residual.segment].by[residual.signal][residual.known]
        own[:, offsets[residual.segment] : offsets[residual.segment + 1]] = (
            by / solution.noise_models[residual.signal].std
        )
        columns.append(own)
    S, J, score = np.vstack(columns), np.vstack(solution.rows), np.concatenate(solution.scores)
    shifts = np.full(len(slack), np.nan)
    for _ in range(ROUNDS):
        open_ = np.isnan(shifts)
        if not open_.any():
            break
        left = score - S[:, ~open_] @ shifts[~open_]
        mean, std = _posterior(J, S[:, open_], left, WIDE * slack[open_], solution)
        nearest = _nearest(mean, std, slack[open_], loop[open_])
        if np.isnan(nearest).all():
            break
        shifts[open_] = nearest
    return shifts


def _posterior(J: Array, S: Array, score: Array, wide: Array, solution: Solution) -> tuple[Array, Array]:
    """Return the shifts and their standard errors, with all fitted parameters free too."""
    p, table = J.shape[1], np.hstack([J, S])
    known = np.concatenate([solution.prior, wide**-2.0])
    covariance = inverse_of(table.T @ table + np.diag(known))
    x = covariance @ (table.T @ score)
    rest = score - table @ x
    scatter = float(rest @ rest) / max(len(rest) - p, 1)
    return x[p:], np.sqrt(scatter * np.diag(covariance)[p:])


def _nearest(mean: Array, std: Array, slack: Array, loop: Array) -> Array:
    """Return the time of the most likely loop relative to each stamp.

    It is NaN if two loops are about equally likely.
    """
    times = np.full(len(mean), np.nan)
    for i in range(len(mean)):
        places = np.arange(-slack[i], slack[i] + 0.5 * loop[i], loop[i])
        away = np.sort(((mean[i] - places) / std[i]) ** 2)
        if len(away) > 1 and away[1] - away[0] > SURELY:
            times[i] = places[np.argmin(np.abs(mean[i] - places))]
    return times


def _moved(segment: Segment, which: Index, moves: Array) -> Segment:
    clear = np.isfinite(moves)
    t_in, slack = segment.t_in.copy(), segment.slack.copy()
    t_in[which[clear]] += moves[clear]
    slack[which[clear]] = 0.0
    dating = segment.dating if slack.any() else min(segment.dating, WITHIN_LOOP * segment.loop)
    return replace(segment, t_in=t_in, slack=slack, dating=dating)
