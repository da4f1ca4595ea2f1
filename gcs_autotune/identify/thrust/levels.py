"""The thrust of a boat at each level of its throttle steps: a pull test under way, relative to the boat's inertia.

``du/dt = T(p(t - L)) - b (u - c) - q (u - c)|u - c|``, where ``p`` is the measured output and ``T`` is piecewise linear
between the outputs of the levels, with ``T(0) = 0``. ``c`` is a current along the track. The equation is multiplied by
smooth windows and integrated by parts, so that the speed is never differentiated (modulating functions, Shinbrot 1957).
It is then linear in all unknowns but the lag ``L`` and ``c``. For these the best of a grid is taken, and ``c`` is
refined. The noise of neighbouring windows is correlated, and the least squares are weighted accordingly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.trial import Trial

__all__ = ["LevelForces", "level_forces"]

Array = NDArray[np.float64]

WINDOW, PER_WINDOW = 2.0, 4
"""Length of a window [s], and number of windows that begin within one. Project choice: about a boat's shortest
response."""
LAGS = np.arange(0.0, 1.55, 0.1)
"""Lags of the speed behind the output that are tried [s]: link, thruster and the filter of a receiver."""
CURRENTS = np.linspace(-0.5, 0.5, 11)
"""Currents that are tried, as fractions of the fastest speed."""
STEPS, MOST_STEP = 4, 0.2
"""Number of Gauss-Newton steps for the current, and the largest of them [m/s]."""
SAME = 0.015
"""Difference of two outputs [fraction of full] below which they are one output of the thrust curve."""
LEAST_LEVELS = 4


@dataclass(frozen=True, slots=True, eq=False)
class LevelForces:
    """Thrust at each throttle command, per inertia.

    ``commands``, ``outputs``, ``forces``, ``stds`` (n,): commanded throttle and measured output [fraction of full],
    thrust [m/s^2] and its standard error. ``drag``: linear [1/s] and quadratic [1/m] drag. ``lag`` [s]: of the speed
    behind the output. ``current`` [m/s]: along the track.
    """

    commands: Array
    outputs: Array
    forces: Array
    stds: Array
    drag: tuple[float, float]
    lag: float
    current: float


def level_forces(trial: Trial) -> LevelForces:
    """Return the thrust at each level of the throttle steps *trial*, which has ``u`` [m/s] and ``X`` [fraction].

    Raises
    ------
    NotInformative
        There are too few levels, or too little was recorded.
    """
    t, u, X = trial["u"].t, trial["u"].values, trial["X"]
    commands, outputs = _levels(trial)
    knots = _knots(outputs)
    if len(commands) < LEAST_LEVELS or t[-1] - t[0] < WINDOW * (len(knots) + 3):
        raise NotInformative(
            f"{trial.name}: {len(commands)} throttle levels in {t[-1] - t[0]:.0f} s do not show the thrust curve. Use "
            "a larger --max-distance"
        )
    starts = np.arange(t[0], t[-1] - WINDOW, WINDOW / PER_WINDOW)
    weight = np.gradient(t)  # trapezoids
    phase = (t[None, :] - starts[:, None]) / WINDOW
    inside = (phase > 0.0) & (phase < 1.0)
    window = np.where(inside, np.sin(np.pi * phase) ** 2, 0.0) * weight
    slope = np.where(inside, -np.pi / WINDOW * np.sin(2.0 * np.pi * phase), 0.0) * weight  # minus its derivative
    noise = slope @ slope.T
    whiten = np.linalg.inv(np.linalg.cholesky(noise + 1e-9 * np.max(noise) * np.eye(len(starts))))
    window, wanted = whiten @ window, whiten @ (slope @ u)
    best: _Solved | None = None
    for lag in LAGS:
        hats = window @ _hats(np.interp(t - lag, X.t, X.values), knots)
        solved = _solved(hats, window, u, wanted, float(lag))
        if solved is not None and (best is None or solved.rss < best.rss):
            best = solved
    if best is None:
        raise NotInformative(f"{trial.name}: the throttle levels do not separate thrust from drag. Fly longer levels")
    rows, solution = best.rows, best.solution
    covariance = np.linalg.pinv(rows.T @ rows) * best.rss / max(len(wanted) - rows.shape[1], 1)
    at = np.array([int(np.argmin(np.abs(knots - p))) if abs(p) > SAME else -1 for p in outputs])
    thrust = [np.append(solution[: len(knots)], 0.0), np.append(np.sqrt(np.diag(covariance)[: len(knots)]), 0.0)]
    b, q = solution[len(knots) : len(knots) + 2]
    return LevelForces(commands, outputs, thrust[0][at], thrust[1][at], (float(b), float(q)), best.lag, best.current)


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    rss: float
    rows: Array
    solution: Array
    lag: float
    current: float


def _solved(hats: Array, window: Array, u: Array, wanted: Array, lag: float) -> _Solved | None:
    """Return the least squares for one lag, with the best current; None if the record does not determine them.

    The equation is not linear in the current: the best of a grid is refined by Gauss-Newton steps.
    """
    best: _Solved | None = None
    for current in CURRENTS * np.max(np.abs(u)):
        rows = np.column_stack([hats, window @ _drag(u - current)])
        solution, rss = _least_squares(rows, wanted)
        if best is None or rss < best.rss:
            best = _Solved(rss, rows, solution, lag, float(current))
    for _ in range(STEPS):
        assert best is not None
        b, q = best.solution[hats.shape[1] : hats.shape[1] + 2]
        water = u - best.current
        rows = np.column_stack([hats, window @ np.column_stack([_drag(water), b + 2.0 * q * np.abs(water)])])
        solution, rss = _least_squares(rows, wanted)
        moved = float(np.clip(solution[-1], -MOST_STEP, MOST_STEP))
        best = _Solved(rss, rows, solution, lag, best.current + moved)
    return best if best is not None and math.isfinite(best.rss) else None


def _least_squares(rows: Array, wanted: Array) -> tuple[Array, float]:
    """Return the solution and its sum of squares, which is infinite if *rows* do not determine it."""
    solution, rss, rank, _ = np.linalg.lstsq(rows, wanted, rcond=None)
    return solution.astype(np.float64), float(rss[0]) if rank == rows.shape[1] else math.inf


def _drag(u: Array) -> Array:
    """Return the regressors (n, 2) of the drag at the speed through the water *u* (n,) [m/s]."""
    return np.column_stack([-u, -u * np.abs(u)])


def _levels(trial: Trial) -> tuple[Array, Array]:
    """Return each command that was flown, rising, and the output it had."""
    seen: dict[float, list[float]] = {}
    orders = [(m.t, float(m.detail["X"])) for m in trial.marks if m.kind == "level"]
    for (begin, command), end in zip(orders, [*(t for t, _ in orders[1:]), trial.end], strict=True):
        held = trial["X"].between(0.5 * (begin + end), end).values
        if command and len(held):
            seen.setdefault(command, []).append(float(np.median(held)))
    commands = sorted(seen)
    return np.array(commands), np.array([float(np.mean(seen[c])) for c in commands])


def _knots(outputs: Array) -> Array:
    """Return the different outputs, rising, without 0."""
    groups: list[list[float]] = []
    for output in np.sort(outputs[np.abs(outputs) > SAME]):
        if groups and output - groups[-1][0] < SAME:
            groups[-1].append(float(output))
        else:
            groups.append([float(output)])
    return np.array([float(np.mean(group)) for group in groups])


def _hats(p: Array, knots: Sequence[float] | Array) -> Array:
    """Return the values (n, k) of the piecewise linear functions that are 1 at one knot and 0 at the others and at 0.

    Beyond the outermost knots they are constant.
    """
    places = np.sort(np.append(knots, 0.0))
    basis = np.column_stack([np.interp(p, places, row) for row in np.eye(len(places))])
    result: Array = np.delete(basis, int(np.searchsorted(places, 0.0)), axis=1)
    return result
