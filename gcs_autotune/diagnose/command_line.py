"""Fit the line that relates a simulation's clock to the run's, from the changes of their commands.

Changes of equal size in both files are paired, nearest first, and a line is fitted to their times. Scale and shift have
the standard errors of that line. The standard errors are raised if neighbouring changes deviate in the same direction,
which indicates an uneven clock. Commands that are never held are aligned by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import least_squares

from gcs_autotune.diagnose.command_changes import CHANGE, Command

__all__ = [
    "FASTEST",
    "FEWEST",
    "FREE",
    "MARGIN",
    "SLOWEST",
    "WINDOW",
    "Clock",
    "Guess",
    "Line",
    "MatchedCommand",
    "Pair",
    "agreement",
    "compared_commands",
    "fitted_line",
    "is_looked_for",
]

Array = NDArray[np.float64]

SLOWEST, FASTEST, MARGIN = 0.2, 5.0, 1.05
"""Lower and upper limit of the clock factor that is searched, and factor by which the result may exceed the limits."""

NEAR, SIZES = 0.4, 0.25
"""Limits for the first pairing of changes.

NEAR: largest distance, relative to the usual interval between changes. SIZES: largest relative difference in size.
"""

FEWEST, FREE = 3, 4
"""Minimum number of paired changes to fit an offset (FEWEST), and to fit a scale as well (FREE).

More changes are required than the line has parameters, so that the fit can be checked.
"""

NEIGHBOURS = 5
"""Number of neighbouring changes whose median deviation from the line predicts the deviation of the next one."""

ROUNDS = 12
"""Maximum number of iterations in which pairs and line are updated."""

WINDOW = 100.0
"""Number of changes of the run in one search window. The line is then extended to the other changes."""

Pair = tuple[Command, Command]
"""A command of the simulation and the matching command of the run."""


@dataclass(frozen=True, slots=True)
class Clock:
    """Relation between a simulation's stamps and its run's: ``t_simulation = theirs + scale (t_run - ours)``, [s].

    ``scale_std`` is infinite if there are too few changes to determine the scale, which is then 1. ``shift_std`` [s] is
    the standard error of ``theirs``, and includes the unknown time of a change between two rows.
    """

    scale: float
    scale_std: float
    ours: float
    theirs: float
    shift_std: float

    @property
    def has_scale(self) -> bool:
        """Whether the scale is known."""
        return math.isfinite(self.scale_std)

    def on_run(self, t: Array) -> Array:
        """Convert stamps (n,) of the simulation to the run's clock."""
        placed: Array = self.ours + (t - self.theirs) / self.scale
        return placed

    def in_simulation(self, t: Array) -> Array:
        """Convert stamps (n,) of the run to the simulation's clock."""
        placed: Array = self.theirs + self.scale * (t - self.ours)
        return placed


@dataclass(frozen=True, slots=True)
class MatchedCommand:
    """A channel of the simulation and the matching one of the run: ``theirs = factor ours + zero`` plus noise."""

    ours: str
    theirs: str
    factor: float
    zero: float
    correlation: float


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A fitted clock line with the changes that it was fitted to.

    ``t`` (n,): times of the run's changes. ``left``: their deviations from the line [s of the simulation]. ``expected``
    [s]: deviation that the row interval alone explains.
    """

    clock: Clock
    t: Array
    left: Array
    expected: float

    @property
    def scatter(self) -> float:
        """Rms deviation of the changes from the line [s of the simulation]."""
        return max(float(np.sqrt(np.mean(self.left**2))), self.expected)

    @property
    def local_scatter(self) -> float:
        """Rms deviation of the changes from the median deviation of their neighbours [s of the simulation].

        Unlike :attr:`scatter`, it stays small if the clock runs unevenly.
        """
        return max(float(np.sqrt(np.mean((self.left - self._astray()) ** 2))), self.expected)

    def near(self, t: Array) -> Array:
        """Return the median deviation from the line of the changes near *t* (n,) [s of the simulation]."""
        astray: Array = np.interp(t, self.t, self._astray())
        return astray

    def _astray(self) -> Array:
        if len(self.left) < 2 * NEIGHBOURS:
            return np.zeros_like(self.left)
        half = NEIGHBOURS // 2
        padded = np.pad(self.left, half, mode="edge")
        middle: Array = np.median(np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS), axis=1)
        return middle


class Guess(NamedTuple):
    """A first guess of the clock: scale, a time on the run's clock, and the same time on the simulation's clock [s].

    ``is_usual``: the alignment is one of the usual ones (equal stamps, equal beginnings). ``is_stamped``: the alignment
    is that of equal stamps.
    """

    scale: float
    ours: float
    theirs: float
    is_usual: bool = False
    is_stamped: bool = False


def is_looked_for(scale: float) -> bool:
    """Return whether a ratio of two clocks is within the searched range."""
    return SLOWEST / MARGIN <= scale <= FASTEST * MARGIN


def fitted_line(pairs: Sequence[Pair], guess: Guess, steady: bool) -> Line | None:
    """Return the line through the changes of *pairs*, started from a guess; return None if no line fits."""
    held = [p for p in pairs if p[0].is_held and p[1].is_held]
    return _by_switches(held, guess, steady) if held else _by_shape(pairs, guess, steady)


def _by_switches(pairs: Sequence[Pair], guess: Guess, steady: bool) -> Line | None:
    """Pair changes and fit their line, over a wider range around the guess in each iteration."""
    scale, ours, theirs, *_ = guess
    usual = max(ours_.usual for _, ours_ in pairs)
    every = np.concatenate([o.times for _, o in pairs])
    far = float(np.abs(every - ours).max()) + usual
    reach, near = 10.0 * usual, NEAR * usual * scale
    rows = math.sqrt(sum(t.row**2 + (scale * o.row) ** 2 for t, o in pairs) / len(pairs) / 12.0)
    line, anchor = None, ours
    for _ in range(ROUNDS):
        paired = [_paired(t, o, (scale, ours, theirs), line, near, anchor, reach) for t, o in pairs]
        ts, tr = np.concatenate([f[0] for f in paired]), np.concatenate([f[1] for f in paired])
        if len(tr) >= FEWEST:
            before: Line | None = line
            line = _line(ts, tr, rows, steady)
            if not is_looked_for(line.clock.scale):
                return None
            scale, ours, theirs = line.clock.scale, line.clock.ours, line.clock.theirs
            near = min(NEAR * usual * scale, max(6.0 * line.local_scatter, 2.0 * rows, 0.25 * usual * scale))
            if before is not None and reach > far and len(before.t) == len(line.t) and before.clock == line.clock:
                break
        elif reach > far:
            return None
        reach = min(2.0 * reach, 2.0 * far)
    return line


def _paired(
    theirs: Command,
    ours: Command,
    at: tuple[float, float, float],
    line: Line | None,
    near: float,
    anchor: float,
    reach: float,
) -> tuple[Array, Array]:
    """Return the times (n,) of matching changes in the simulation and in the run.

    Two changes match if each is the other's nearest of equal size. The expected time follows from the clock *at*, plus
    the deviation of neighbouring changes from the previous *line*.
    """
    scale, here, there = at
    wanted = np.flatnonzero(np.abs(ours.times - anchor) <= reach)
    if not len(wanted):
        return np.zeros(0), np.zeros(0)
    expected = there + scale * (ours.times[wanted] - here)
    expected = expected if line is None else expected + line.near(ours.times[wanted])
    off = np.abs(theirs.times[:, None] - expected[None, :])
    best: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
    for sign in (1.0, -1.0):
        sizes = sign * theirs.sizes
        times = 1.0
        for _ in range(2):
            unlike = np.abs(sizes[:, None] - times * ours.sizes[None, wanted])
            fits = (off <= near) & (unlike <= SIZES * np.maximum(times * np.abs(ours.sizes[None, wanted]), CHANGE))
            if times == 1.0:  # ranges differ where a file holds only some of the changes
                fits = (off <= near) & (sizes[:, None] * ours.sizes[None, wanted] > 0.0)
            cost = np.where(fits, off, np.inf)
            i = np.argmin(cost, axis=0)
            j = np.arange(len(wanted))
            mutual = np.isfinite(cost[i, j]) & (np.argmin(cost, axis=1)[i] == j)
            i, j = i[mutual], j[mutual]
            if not len(i):
                break
            times = float(np.median(sizes[i] / ours.sizes[wanted][j])) + 1e-12
        if len(i) > len(best[0]):
            best = theirs.times[i], ours.times[wanted][j]
    return best


def _line(ts: Array, tr: Array, rows: float, steady: bool) -> Line:
    """Return the line through pairs of times without outliers.

    rows [s] : smallest scatter of a change, from the row interval.
    """
    order = np.argsort(tr)
    ts, tr = ts[order], tr[order]
    keep = np.ones(len(tr), dtype=bool)
    free = len(tr) >= FREE and not steady
    scale = 1.0
    for _ in range(3):
        ours, theirs = float(tr[keep].mean()), float(ts[keep].mean())
        d = tr[keep] - ours
        scale = float(d @ (ts[keep] - theirs) / max(float(d @ d), 1e-300)) if free else 1.0
        left = ts - theirs - scale * (tr - ours)
        rough = 1.4826 * float(np.median(np.abs(left[keep] - np.median(left[keep]))))
        now = np.abs(left) <= max(5.0 * rough, 2.0 * rows, 1e-9)
        if now.sum() < max(FEWEST, 0.8 * len(tr)) or np.array_equal(now, keep):
            break
        keep = now
    left, tr = left[keep], tr[keep]
    n, d = len(tr), tr - ours
    sigma = max(math.sqrt(float(left @ left) / max(n - 1 - free, 1)), rows)
    raised = math.sqrt(_lasting(left))
    known = free and len(np.unique(np.round(tr / max(rows, 1e-6)))) >= FREE
    return Line(
        Clock(
            scale,
            raised * sigma / math.sqrt(max(float(d @ d), 1e-300)) if known else math.inf,
            ours,
            theirs,
            math.hypot(raised * sigma / math.sqrt(n), rows),
        ),
        tr,
        left,
        rows,
    )


def _lasting(left: Array) -> float:
    """Return the factor by which correlated deviations of neighbours raise the variance of a mean."""
    if len(left) < 8 or not float(left @ left):
        return 1.0
    rho = min(max(float(left[1:] @ left[:-1]) / float(left @ left), 0.0), 0.9)
    return (1.0 + rho) / (1.0 - rho)


def _by_shape(pairs: Sequence[Pair], guess: Guess, steady: bool) -> Line | None:
    """Return the clock for which commands that are never held have the same shape.

    The first fit uses samples near the guess, the second uses all.
    """
    at = (guess.scale, guess.ours, guess.theirs)
    usual = max(o.usual for _, o in pairs)
    line = None
    for reach in (0.5 * WINDOW * usual, math.inf):
        t = _grid(pairs, at, reach)
        line = None if t is None else _same_shape(pairs, t, at, steady)
        if line is None or not is_looked_for(line.clock.scale):
            return None
        at = (line.clock.scale, line.clock.ours, line.clock.theirs)
    return line


def _same_shape(pairs: Sequence[Pair], t: Array, at: tuple[float, float, float], steady: bool) -> Line | None:
    """Return the clock that minimises the residual of the run's commands regressed on the simulation's.

    at : the clock to start from. t (n,) : stamps of the run to compare at.
    """
    usual = max(o.usual for _, o in pairs)
    middle, lasts = float(t.mean()), float(np.ptp(t))
    scale, there = at[0], at[2] + at[0] * (middle - at[1])
    stretch = 0.0 if steady else usual / lasts

    row = max(max(s.row, scale * o.row) for s, o in pairs)
    size = 1 if steady else 2
    step = min(max(row / (usual * scale), 1e-3), 0.1)  # no finer than the rows: between two of them is only noise

    def error(by: Array) -> Array:
        p = by - 1.0
        shifted = there + usual * scale * p[-1] + scale * math.exp(min(max(stretch * p[0], -4.0), 4.0)) * (t - middle)
        return np.concatenate([_unlike(s.at(shifted), o.at(t)) for s, o in pairs])

    solution = least_squares(error, np.ones(size), method="lm", diff_step=np.full(size, step), max_nfev=60)
    moved = solution.x - 1.0
    left, slopes = np.asarray(solution.fun, dtype=np.float64), np.asarray(solution.jac, dtype=np.float64)
    noise = float(left @ left) / max(len(left) - 4, 1) * _colour(left)
    std = np.sqrt(np.maximum(np.diag(np.linalg.pinv(slopes.T @ slopes)) * noise, 0.0))
    now = scale * math.exp(min(max(stretch * float(moved[0]), -4.0), 4.0))
    row /= math.sqrt(12.0)
    scale_std = math.inf if steady else math.hypot(now * stretch * float(std[0]), row / lasts)
    shift_std = math.hypot(usual * scale * float(std[-1]), row)
    times = np.concatenate([o.times[(o.times >= t[0]) & (o.times <= t[-1])] for _, o in pairs])
    if len(times) < FREE:
        return None
    clock = Clock(now, scale_std, middle, there + usual * scale * float(moved[-1]), shift_std)
    slope = float(np.sqrt(np.mean(slopes[:, -1] ** 2))) / (usual * scale)
    off = float(np.sqrt(np.mean(left**2))) / max(slope, 1e-300)
    return Line(clock, np.sort(times), np.full(len(times), off), row)


def _grid(pairs: Sequence[Pair], at: tuple[float, float, float], reach: float) -> Array | None:
    """Return stamps (n,) of the run that both commands of every pair cover, within *reach* [s] of the reference time
    *at*."""
    scale, ours, theirs = at
    start = max(max(o.t[0], ours + (s.t[0] - theirs) / scale) for s, o in pairs)
    end = min(min(o.t[-1], ours + (s.t[-1] - theirs) / scale) for s, o in pairs)
    start, end = max(start, ours - reach), min(end, ours + reach)
    if end <= start:
        return None
    fine = min(max(o.row, s.row / scale, 1e-3) for s, o in pairs)
    return np.linspace(start, end, int(min(max((end - start) / fine, 50.0), 3000.0)))


def _unlike(x: Array, y: Array) -> Array:
    """Return the residual of *y* (n,) after a linear regression on *x* (n,)."""
    x, y = x - x.mean(), y - y.mean()
    left: Array = y - x * (float(x @ y) / max(float(x @ x), 1e-300))
    return left


def _colour(left: Array) -> float:
    """Return the factor by which autocorrelation of the residuals raises a variance.

    Lags are summed up to the first negative correlation.
    """
    left = left - left.mean()
    power = float(left @ left)
    if power <= 0.0:
        return 1.0
    n = next_fast_len(2 * len(left), real=True)
    spectrum = rfft(left, n)
    rho = irfft(np.abs(spectrum) ** 2, n)[: len(left) // 4] / power
    ends = np.flatnonzero(rho < 0.0)
    last = int(ends[0]) if len(ends) else len(rho)
    return float(max(1.0 + 2.0 * rho[1:last].sum(), 1.0))


def compared_commands(theirs: Command, ours: Command, line: Line) -> MatchedCommand | None:
    """Return the regression of a simulation's command on a run's, without the samples near changes of the command.

    Return None if either command is constant.
    """
    clock = line.clock
    t = _grid([(theirs, ours)], (clock.scale, clock.ours, clock.theirs), math.inf)
    if t is None:
        return None
    at = clock.in_simulation(t) + line.near(t)
    x, y = ours.at(t), theirs.at(at)
    if ours.is_held and theirs.is_held:
        margin = max(0.15 * ours.usual, 2.0 * ours.row, 2.0 * theirs.row / clock.scale)
        changes = np.sort(np.concatenate([ours.times, clock.on_run(theirs.times)]))
        k = np.searchsorted(changes, t)
        after = t - changes[np.maximum(k - 1, 0)]
        before = changes[np.minimum(k, len(changes) - 1)] - t
        away = ((after < 0.0) | (after > margin)) & ((before < 0.0) | (before > margin))
        if away.sum() >= 0.2 * len(t):
            x, y = x[away], y[away]
    dx, dy = x - x.mean(), y - y.mean()
    xx, yy, xy = float(dx @ dx), float(dy @ dy), float(dx @ dy)
    if xx < 1e-6 * len(x) or yy < 1e-6 * len(y):
        return None
    factor = xy / xx * theirs.span / ours.span
    zero = theirs.low + theirs.span * float(y.mean()) - factor * (ours.low + ours.span * float(x.mean()))
    return MatchedCommand(ours.name, theirs.name, factor, zero, xy / math.sqrt(xx * yy))


def agreement(match: MatchedCommand | None) -> float:
    """Return the log-likelihood per sample that two commands are equal up to factor and offset."""
    return 0.0 if match is None else -math.log(1.001 - min(match.correlation**2, 1.0))
