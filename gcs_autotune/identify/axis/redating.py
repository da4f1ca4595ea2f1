"""At which of the autopilot's loops did the input change, where the stamps leave several?

Messages 40 ms apart on a 20 ms loop leave two: such a change is dated between them and is 10 ms wrong, others of the
same run are right. That colours the residuals, doubles the standard errors, and on a precise gyro looks like a fault
of the gyro's. The record itself tells: every doubtful change gets a time shift of its own beside the fitted numbers
(one Gauss-Newton step of the joint fit), and is moved to the loop the shift points to when the next one is
three standard errors less likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.objective import DELAY
from gcs_autotune.identify.axis.output_error import Solution
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.preparation import WITHIN_LOOP
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.simulation import simulate_explicit

__all__ = ["by_shifts", "redated"]

Array = NDArray[np.float64]

MOST = 120
"""Doubtful changes beyond which nothing is tried: that is no relay, and each costs a simulation."""

WIDE = 2.0
"""Standard deviation of a shift before the data, in units of what the stamps allow: weak, as for the common one."""

SURELY = 9.0
"""Difference of squared standard errors by which a loop must be likelier than the next: three standard errors."""

ROUNDS = 5


@dataclass(frozen=True, slots=True, eq=False)
class _Shifts:
    """Derivatives by the shifts of doubtful changes: position (n, k) and velocity (n, k); ``which`` changes (k,)."""

    position: Array
    velocity: Array
    which: NDArray[np.int_]


def by_shifts(record: Segment, theta: Array, initial: Array, stamps: Array) -> _Shifts:
    """Return how the motion at *stamps* (n,) [s] answers to a later stamp of each doubtful change of the input.

    *initial* is the state at ``record.main.t[0]``, as everywhere.
    """
    start, delay = float(record.main.t[0]), float(theta[DELAY])
    at = record.t_in + delay
    which = np.flatnonzero((record.slack > 0.0) & (at > start) & (at < stamps[-1]))
    if len(which) > MOST:
        which = which[:0]
    position, velocity = np.zeros((len(stamps), len(which))), np.zeros((len(stamps), len(which)))
    grid = np.union1d([start], at[which])
    motion = simulate_explicit(np.concatenate([theta, initial]), record.t_in, record.tau, grid)
    for column, j in enumerate(which):
        here = np.searchsorted(grid, at[j])
        later = stamps > at[j]
        state = (*theta, motion.eta[here], motion.nu[here])
        after = simulate_explicit(state, record.t_in, record.tau, np.concatenate([at[j : j + 1], stamps[later]]))
        lost = -float(theta[0]) * (record.tau[j] - record.tau[j - 1])
        position[later, column] = lost * after.eta_by[1:, 6]
        velocity[later, column] = lost * after.nu_by[1:, 6]
    return _Shifts(position, velocity, which)


def redated(records: Sequence[Segment], solution: Solution) -> tuple[Segment, ...] | None:
    """Return *records* with those changes moved whose loop is clear from *solution*; None when there is none such.

    The stretches of *solution* may begin later than *records* do, nothing else may differ.
    """
    if not any(r.slack.any() for r in records):
        return None
    tables = [by_shifts(r, solution.theta, s, _stamps(r)) for r, s in zip(records, solution.initial, strict=True)]
    sizes = [len(t.which) for t in tables]
    if not sum(sizes) or not all(np.isfinite(t.position).all() and np.isfinite(t.velocity).all() for t in tables):
        return None
    found = _moves(records, solution, tables)
    if not np.isfinite(found).any():
        return None
    return tuple(
        _moved(record, table.which, moves)
        for record, table, moves in zip(records, tables, np.split(found, np.cumsum(sizes)[:-1]), strict=True)
    )


def _stamps(record: Segment) -> Array:
    return record.stamps


def _moves(records: Sequence[Segment], solution: Solution, tables: Sequence[_Shifts]) -> Array:
    """Return the move [s] of every doubtful change, NaN for those that stay doubtful."""
    offsets = np.concatenate([[0], np.cumsum([len(t.which) for t in tables])])
    slack = np.concatenate([r.slack[t.which] for r, t in zip(records, tables, strict=True)])
    loop = np.concatenate([np.full(len(t.which), r.loop) for r, t in zip(records, tables, strict=True)])
    columns = []
    for residual, rows in zip(solution.residuals, solution.rows, strict=True):
        record, table, own = records[residual.record], tables[residual.record], np.zeros((len(rows), int(offsets[-1])))
        angle = residual.signal.name == record.dof.position
        at = np.searchsorted(_stamps(record), residual.signal.t)
        scale = solution.laws[residual.signal.name].std
        own[:, offsets[residual.record] : offsets[residual.record + 1]] = (table.position if angle else table.velocity)[
            at
        ] / scale
        columns.append(own)
    S, J, score = np.vstack(columns), np.vstack(solution.rows), np.concatenate(solution.scores)
    found = np.full(len(slack), np.nan)
    for _ in range(ROUNDS):
        open_ = np.isnan(found)
        if not open_.any():
            break
        left = score - S[:, ~open_] @ found[~open_]
        mean, std = _posterior(J, S[:, open_], left, WIDE * slack[open_], solution)
        told = _nearest(mean, std, slack[open_], loop[open_])
        if np.isnan(told).all():
            break
        found[open_] = told
    return found


def _posterior(J: Array, S: Array, score: Array, wide: Array, solution: Solution) -> tuple[Array, Array]:
    """Return the shifts and their standard errors, everything that was fitted left free to move with them."""
    p, table = J.shape[1], np.hstack([J, S])
    known = np.zeros(len(wide) + p)
    known[p:] = wide**-2.0
    if solution.timing is not None:
        known[int(solution.free[:DELAY].sum())] = solution.timing.std**-2
    covariance = inverse_of(table.T @ table + np.diag(known))
    x = covariance @ (table.T @ score)
    rest = score - table @ x
    scatter = float(rest @ rest) / max(len(rest) - p, 1)
    return x[p:], np.sqrt(scatter * np.diag(covariance)[p:])


def _nearest(mean: Array, std: Array, slack: Array, loop: Array) -> Array:
    """Return the loop each shift points to, relative to the stamp, NaN where two are about as likely."""
    told = np.full(len(mean), np.nan)
    for i in range(len(mean)):
        places = np.arange(-slack[i], slack[i] + 0.5 * loop[i], loop[i])
        away = np.sort(((mean[i] - places) / std[i]) ** 2)
        if len(away) > 1 and away[1] - away[0] > SURELY:
            told[i] = places[np.argmin(np.abs(mean[i] - places))]
    return told


def _moved(record: Segment, which: NDArray[np.int_], moves: Array) -> Segment:
    clear = np.isfinite(moves)
    t_in, slack = record.t_in.copy(), record.slack.copy()
    t_in[which[clear]] += moves[clear]
    slack[which[clear]] = 0.0
    dating = record.dating if slack.any() else min(record.dating, WITHIN_LOOP * record.loop)
    return replace(record, t_in=t_in, slack=slack, dating=dating)
