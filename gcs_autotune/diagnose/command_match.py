"""Match the commands of a simulation's file with the run's: clock, order, sign and unit of the channels.

A simulation driven by the run's commands contains the same changes on its own clock. The times of each change in both
files determine the clock to a fraction of a row. Neither a model nor the motion is needed.

**Changes.** A held command changes in steps. The time of a step is only known to lie between two rows, so the midpoint
is used. A command that is never held (a joystick, a controller) is compared by its shape.

**Search.** The first guesses are equal stamps, equal beginnings, and equal beginnings and ends. Otherwise all factors
from 1/5 to 5 and all shifts are tried, by correlation over the overlap.

**Line.** Changes of equal size in both files are paired, nearest first, and a line is fitted to their times. Scale and
shift have the standard errors of that line. The standard errors are raised if neighbouring changes deviate in the same
direction, which indicates an uneven clock. A match is accepted if so many changes would rarely lie so close to one line
by chance.

**Channels.** With the clock known, each channel of the simulation is regressed on each channel of the run. The result
is their order, signs and units. Each channel that changes often enough also gets its own line. It is reported if its
line disagrees with the common clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import linear_sum_assignment

from gcs_autotune.diagnose.command_changes import Command, commands_of
from gcs_autotune.diagnose.command_line import (
    FASTEST,
    FEWEST,
    FREE,
    MARGIN,
    SLOWEST,
    WINDOW,
    Clock,
    Guess,
    Line,
    MatchedCommand,
    Pair,
    agreement,
    compared_commands,
    fitted_line,
    is_looked_for,
)
from gcs_autotune.diagnose.excitation_check import COMMANDS
from gcs_autotune.trial import Trial

__all__ = ["CommandMatch", "match_commands"]

Array = NDArray[np.float64]

FINE = 6.0
"""Number of samples per change in the search by correlation."""

SHARED = 0.35
"""Fraction of the shorter record that both records must have in common."""

PAIRED, ALIKE = 0.7, 0.85
"""PAIRED: least fraction of the changes that must be paired. ALIKE: least correlation of two equal commands."""

SURELY_OTHER = 2.0
"""Log-likelihood per sample and exchanged channel by which a different channel order must be likelier."""

CHANCE, CHANCE_USUAL = 1e-3, 1e-2
"""Largest accepted probability that unrelated changes lie this close to a line.

CHANCE: for an alignment found by search. CHANCE_USUAL: for a usual alignment, such as equal stamps.
"""

AT_ONCE = 3.0
"""Scatter of a line, relative to that of the row interval, up to which it is accepted without trying others."""

EVEN = 0.15
"""Limit for periodic changes: the median deviation of their intervals from the median interval, relative to it."""

UNEVEN = 3.0
"""Scatter of changes about the clock, relative to the scatter that the row interval causes, above which the clock
counts as uneven.
"""

SAME_RATE = 0.002
"""Difference of two clock rates that is ignored."""

APART = 5.0
"""Number of standard errors above which the clocks of two channels contradict each other."""


@dataclass(frozen=True, slots=True)
class CommandMatch:
    """Result of the comparison of the commands of both files.

    ``kind``: ``absent`` (a file contains no command), ``constant`` (they do not change, or too rarely), ``repeating``
    (periodic in both, so that any clock fits), ``different`` (the commands change differently), ``matched``.
    ``scatter`` [s of the run]: deviation of single changes from the clock, beyond the row interval. ``is_uneven``:
    whether the scatter is several row intervals. ``changes``: number of paired changes. ``period`` [s of the run]:
    shift of the clock that matches equally well; 0 if there is none. ``others``: channels whose own changes indicate
    another clock.
    """

    kind: Literal["absent", "constant", "repeating", "different", "matched"]
    clock: Clock | None = None
    channels: tuple[MatchedCommand, ...] = ()
    scatter: float = 0.0
    is_uneven: bool = False
    changes: int = 0
    period: float = 0.0
    others: tuple[tuple[str, Clock], ...] = ()


def match_commands(simulation: Trial, run: Trial, *, steady: bool = False) -> CommandMatch:
    """Return the result of comparing the commands of *simulation* with those of *run*.

    steady : whether both clocks are known to run at one rate.
    """
    both = [commands_of(trial) for trial in (simulation, run)]
    if not all(any(n in t for n in COMMANDS) for t in (simulation, run)):
        return CommandMatch("absent")
    if not all(both):
        return CommandMatch("constant")
    theirs, ours = both
    for pair in _candidates(theirs, ours):
        matched = _matched_pair(pair, _natural(simulation, run, pair), steady)
        if matched is not None:
            return _whole(matched, theirs, ours, steady)
    few = max(max(len(c.times) for c in side.values()) for side in both) < FEWEST
    even = any(_is_even(theirs[n].times) and _is_even(ours[n].times) for n in theirs if n in ours)
    return CommandMatch("constant" if few else "repeating" if even else "different")


def _candidates(theirs: Mapping[str, Command], ours: Mapping[str, Command]) -> Iterator[Pair]:
    """Yield pairs of commands to derive a clock from, those that change often first.

    Pairs of the same name come before all others.
    """

    def often(pair: Pair) -> int:
        return -min(len(c.times) for c in pair)

    same = [(theirs[n], ours[n]) for n in theirs if n in ours]
    yield from sorted(same, key=often)[:2]
    busiest = max(theirs.values(), key=lambda c: len(c.times))
    yield from sorted([(busiest, c) for n, c in ours.items() if n != busiest.name], key=often)


def _reach(trial: Trial) -> tuple[float, float]:
    stamps = np.concatenate([c.t[np.isfinite(c.t)] for c in trial.channels.values() if len(c)])
    return float(stamps.min()), float(stamps.max())


def _natural(simulation: Trial, run: Trial, pair: Pair) -> list[Guess]:
    """Return the usual alignments of two files: equal stamps, equal beginnings, or equal beginnings and ends."""
    (s0, s1), (r0, r1) = _reach(simulation), _reach(run)
    guesses: list[Guess] = []
    overlap = min(s1, r1) - max(s0, r0) > SHARED * min(s1 - s0, r1 - r0)
    if overlap:
        guesses.append(Guess(1.0, max(s0, r0), max(s0, r0), is_usual=True, is_stamped=True))
    guesses.append(Guess(1.0, r0, s0, is_usual=True, is_stamped=not overlap))
    guesses.append(Guess((s1 - s0) / max(r1 - r0, 1e-9), r0, s0, is_usual=True))
    theirs, ours = pair[0].times, pair[1].times
    if len(theirs) == len(ours) > 1:
        scale = float(np.ptp(theirs) / max(np.ptp(ours), 1e-9))
        guesses.append(Guess(scale, float(ours[0]), float(theirs[0]), is_usual=True))
    return [g for g in guesses if is_looked_for(g.scale)]


def _matched_pair(pair: Pair, natural: Sequence[Guess], steady: bool) -> tuple[Line, Pair] | None:
    """Return the clock from one pair of commands, and the pair; return None if the two change differently."""
    lines: list[Line] = []
    for guess in natural:
        line = fitted_line([pair], guess, steady) if not steady or guess.scale == 1.0 else None
        if line is not None and _is_believed(line, pair, is_usual=True):
            if line.scatter <= AT_ONCE * line.expected and _sign(line, pair) > 0.0:
                return line, pair
            lines.append(line)
    for guess in _by_correlation(pair, steady):
        line = fitted_line([pair], guess, steady)
        if line is not None and _is_believed(line, pair, is_usual=False):
            lines.append(line)
    best = max(lines, key=lambda line: len(line.t) * agreement(compared_commands(*pair, line)), default=None)
    return None if best is None else (_nearest_shift(best, pair, natural), pair)


# -- where it may lie


def _by_correlation(pair: Pair, steady: bool) -> list[Guess]:
    """Return the likeliest scales and shifts, from up to three windows of the run."""
    theirs, ours = pair
    usual = ours.usual
    lasts = float(np.ptp(ours.t))
    width = min(WINDOW * usual, lasts)
    starts = [float(ours.t[0])]
    if lasts > 1.2 * width:
        starts += [float(ours.t[0]) + 0.5 * (lasts - width), float(ours.t[-1]) - width]
    scored: list[tuple[float, Guess]] = []
    for start in starts:
        scored += _in_window(theirs, ours, start, width, usual / FINE, steady)
    scored.sort(key=lambda f: -f[0])
    chosen: list[Guess] = []
    for _, guess in scored:
        if all(
            abs(g.scale / guess.scale - 1.0) > 0.3 * usual / width or abs(g.theirs - guess.theirs) > usual
            for g in chosen
        ):
            chosen.append(guess)
        if len(chosen) == 8:
            break
    return chosen


def _in_window(
    theirs: Command, ours: Command, start: float, width: float, step: float, steady: bool
) -> list[tuple[float, Guess]]:
    """Return the score and the guess of the best shift for every scale."""
    t = start + step * np.arange(max(int(width / step), 8), dtype=np.float64)
    y = ours.at(t)
    y = y - y.mean()
    busy = _busy(ours.times, t)
    apart = 0.5 * ours.usual / width
    many = 1 if steady else int(math.log(MARGIN**2 * FASTEST / SLOWEST) / apart) + 2
    scales = np.array([1.0]) if steady else np.geomspace(SLOWEST / MARGIN, FASTEST * MARGIN, many)
    guesses = []
    for scale in scales.tolist():
        at = float(theirs.t[0]) + scale * step * np.arange(max(int(np.ptp(theirs.t) / (scale * step)), 2))
        x = theirs.at(at)
        score, lag = _best_lag(x - x.mean(), _busy(theirs.times, at), y, busy)
        if score > 0.0:
            middle = 0.5 * (t[0] + t[-1])
            guesses.append((score, Guess(scale, middle, float(theirs.t[0] + scale * (middle - t[0] - lag * step)))))
    return guesses


def _busy(times: Array, t: Array) -> Array:
    """Return the cumulative number of *times* before each of *t* (n,) and before the end: (n + 1,)."""
    ends = np.append(t, t[-1] + (t[1] - t[0] if len(t) > 1 else 1.0))
    return np.searchsorted(times, ends).astype(float)


def _best_lag(x: Array, busy_x: Array, y: Array, busy_y: Array) -> tuple[float, int]:
    """Return the score and the lag, in samples, at which *x* (m,) best matches *y* (n,) up to factor and offset.

    The score is the number of changes in the overlap, times minus the logarithm of the fraction of variance that the
    correlation leaves.
    """
    m, n = len(x), len(y)
    size = next_fast_len(m + n, real=True)
    cross = irfft(rfft(y, size) * np.conj(rfft(x, size)), size)
    lags = np.arange(-(m - 1), n)
    cross = cross[lags % size]
    first, last = np.maximum(lags, 0), np.minimum(n, lags + m)
    begin, end = first - lags, last - lags
    count = last - first
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (y, y * y, x, x * x)]
    sy, syy = (s[last] - s[first] for s in sums[:2])
    sx, sxx = (s[end] - s[begin] for s in sums[2:])
    both = np.maximum(count, 1)
    vy, vx = syy - sy * sy / both, sxx - sx * sx / both
    inside = np.minimum(busy_y[last] - busy_y[first], busy_x[end] - busy_x[begin])
    moving = (vy > 1e-9 * sums[1][-1]) & (vx > 1e-9 * sums[3][-1]) & (inside >= FEWEST)
    allowed = moving & (count >= SHARED * min(m, n))
    if not allowed.any():
        return 0.0, 0
    square = np.where(allowed, (cross - sx * sy / both) ** 2 / np.where(moving, vx * vy, 1.0), 0.0)
    score = inside * -np.log1p(-0.99 * np.minimum(square, 1.0))
    k = int(np.argmax(np.where(allowed, score, 0.0)))
    return float(score[k]), int(lags[k])


# -- whether it is believed


def _is_believed(line: Line, pair: Pair, *, is_usual: bool) -> bool:
    """Return whether a match is unlikely to be chance, and the commands between the changes are equal.

    Periodic changes always lie on some line. They are accepted if both clocks run at one rate, or if all changes of
    both files are paired. In both cases the run's commands have almost certainly driven the simulation.
    """
    paired, there = _coverage(line, pair)
    if paired < FEWEST or paired < PAIRED * there:
        return False
    tries = 1 if is_usual else max(len(c.times) for c in pair)
    if _nats(line) - math.log(tries) < -math.log(CHANCE_USUAL if is_usual else CHANCE):
        alike = abs(line.clock.scale - 1.0) <= max(APART * _scale_std(line.clock), SAME_RATE)
        whole = paired >= max(FREE, *(len(c.times) for c in pair))
        if line.scatter > AT_ONCE * line.expected or not (alike or whole):
            return False
    compared = compared_commands(*pair, line)
    return compared is not None and abs(compared.correlation) >= ALIKE


def _scale_std(clock: Clock) -> float:
    return clock.scale_std if clock.has_scale else 0.0


def _nats(line: Line) -> float:
    """Return how improbable it is that the changes lie on one line by chance, in nats.

    Equal intervals between the changes contribute nothing.
    """
    between = np.diff(np.unique(line.t))
    if not len(between):
        return 0.0
    off = np.abs(between - np.median(between))
    # If any shift fits, an uneven clock does not explain the difference.
    scatter = line.scatter if _is_even(np.unique(line.t)) else line.local_scatter
    return float(np.sum(np.log(np.maximum(off * line.clock.scale / (1.5 * scatter), 1.0))))


def _is_even(times: Array) -> bool:
    """Return whether changes at *times* (n,) are periodic."""
    between = np.diff(times)
    if len(between) < FEWEST:
        return False
    usual = float(np.median(between))
    return float(np.median(np.abs(between - usual))) < EVEN * usual


def _coverage(line: Line, pair: Pair) -> tuple[int, int]:
    """Return the number of paired changes, and the larger number of changes in either file within the overlap."""
    theirs, ours = pair
    placed = line.clock.on_run(theirs.times)
    start = max(ours.t[0], float(line.clock.on_run(theirs.t[:1])[0]))
    end = min(ours.t[-1], float(line.clock.on_run(theirs.t[-1:])[0]))
    margin = 0.5 * pair[1].usual
    inside = [int(np.sum((t > start + margin) & (t < end - margin))) for t in (placed, ours.times)]
    return len(line.t), max(inside)


def _nearest_shift(line: Line, pair: Pair, natural: Sequence[Guess]) -> Line:
    """Return the line nearest to the natural alignment of the files, of all shifts that match equally well.

    Lines without a change of sign come first, because half a period and a change of sign look alike.
    """
    own = [g for g in natural if g.is_stamped]
    every = [line, *_equals(line, pair)]
    upright = [shifted for shifted in every if _sign(shifted, pair) > 0.0]
    best, least = line, math.inf
    for shifted in upright or every:
        off = min((abs(float(shifted.clock.in_simulation(np.array([g.ours]))[0]) - g.theirs) for g in own), default=0.0)
        if off < least - 0.25 * pair[1].usual * line.clock.scale:
            best, least = shifted, off
    return best


def _sign(line: Line, pair: Pair) -> float:
    matched = compared_commands(*pair, line)
    return 0.0 if matched is None else math.copysign(1.0, matched.correlation)


def _equals(line: Line, pair: Pair) -> list[Line]:
    """Return lines of other shifts that pair as large a fraction of the common changes, nearest first."""
    theirs, ours = pair
    if not (theirs.is_held and ours.is_held):
        return []
    clock, least = line.clock, 0.8 * agreement(compared_commands(*pair, line))
    apart = np.subtract.outer(ours.times, ours.times).ravel()
    apart = apart[np.abs(apart) > 0.5 * ours.usual]
    width = max(4.0 * line.scatter / clock.scale, 2.0 * ours.row, 0.02 * ours.usual)
    tried, counts = np.unique(np.round(apart / width).astype(int), return_counts=True)
    often = tried[counts >= 0.5 * counts.max(initial=0)]
    lines = []
    for shift in (width * often[np.argsort(np.abs(often), kind="stable")]).tolist()[:60]:
        guess: Guess = Guess(clock.scale, clock.ours, clock.theirs + clock.scale * shift)
        other = fitted_line([pair], guess, steady=clock.scale == 1.0)
        if other is None or abs(other.clock.scale / clock.scale - 1.0) > 0.02 or other.scatter > 1.5 * line.scatter:
            continue
        moved = abs(float(other.clock.in_simulation(np.array([clock.ours]))[0]) - clock.theirs)
        paired, there = _coverage(other, pair)
        far = moved > 0.5 * ours.usual * clock.scale
        if (
            far
            and paired >= max(FREE, 0.9 * there, 0.5 * len(line.t))
            and agreement(compared_commands(*pair, other)) >= least
        ):
            lines.append(other)
    return lines


# -- all channels


def _whole(
    matched: tuple[Line, Pair], theirs: Mapping[str, Command], ours: Mapping[str, Command], steady: bool
) -> CommandMatch:
    """Return the match of all channels, starting from the clock of one channel."""
    line, pair = matched
    channels = _ordered(theirs, ours, line)
    pairs = [(theirs[c.theirs], ours[c.ours]) for c in channels] or [pair]
    others = _on_other_clocks(pairs, line, theirs, ours, steady)
    agreeing = [p for p in pairs if p[0].name not in others] or [pair]
    clock = line.clock if pair[0].name not in others else _own(agreeing[0], line, steady).clock
    whole = fitted_line(agreeing, Guess(clock.scale, clock.ours, clock.theirs), steady) or line
    if len(agreeing) == len(pairs) and abs(whole.clock.scale / line.clock.scale - 1.0) > 0.05:
        whole = line
    channels = [c for c in _ordered(theirs, ours, whole) if c.theirs not in others]
    channels += [
        c for n, o in others.items() for c in (compared_commands(theirs[n], ours[o[1]], o[0]),) if c is not None
    ]
    here = np.array([whole.clock.theirs])
    sign = _sign(whole, pair)
    equal = [e.clock for e in _equals(whole, pair) if _sign(e, pair) == sign] if pair[0].name not in others else []
    shifts = [abs(float(c.on_run(here)[0]) - whole.clock.ours) for c in equal]
    scatter = math.sqrt(_beyond_rows(whole)) / whole.clock.scale if pair[0].is_held and pair[1].is_held else 0.0
    return CommandMatch(
        "matched",
        whole.clock,
        tuple(channels),
        scatter,
        scatter > UNEVEN * whole.expected / whole.clock.scale,
        len(whole.t),
        min(shifts, default=0.0),
        tuple((name, other.clock) for name, (other, _) in others.items()),
    )


def _on_other_clocks(
    pairs: Sequence[Pair],
    line: Line,
    theirs: Mapping[str, Command],
    ours: Mapping[str, Command],
    steady: bool,
) -> dict[str, tuple[Line, str]]:
    """Return the channels of the simulation whose own clock disagrees with that of most channels.

    Each has its own line and the name of the run's channel that it matches.
    """
    paired = {name for p in pairs for name in (p[0].name, p[1].name)}
    rest = [(theirs[n], ours[n]) for n in theirs if n in ours and n not in paired]
    own = [(p, _own(p, line, steady)) for p in [*pairs, *rest]]
    known = [(p, o) for p, o in own if o is not line and len(o.t) >= max(FREE, 0.9 * _coverage(o, p)[1])]
    if len(known) < 2:
        return {}
    alike = [[not _disagrees(o, other, p) for _, other in known] for p, o in known]
    most = max(range(len(known)), key=lambda k: (sum(alike[k]), len(known[k][1].t)))
    return {p[0].name: (o, p[1].name) for k, (p, o) in enumerate(known) if not alike[k][most]}


def _own(pair: Pair, line: Line, steady: bool) -> Line:
    """Return the line of one channel, started from *line*; return *line* if the channel has no credible line of its
    own."""
    clock = line.clock
    guess = Guess(clock.scale, clock.ours, clock.theirs)
    own = fitted_line([pair], guess, steady)
    if own is None or not _is_believed(own, pair, is_usual=True):
        return line
    return own


def _beyond_rows(line: Line) -> float:
    """Return the squared deviation of changes from a line, beyond that of the row interval [s^2 of the simulation]."""
    return max(float(np.mean(line.left**2)) - line.expected**2, 0.0)


def _disagrees(own: Line, other: Line, pair: Pair) -> bool:
    """Return whether the clocks of two channels differ by more than an uneven clock deviates from a line."""
    a, b = own.clock, other.clock
    strays = math.sqrt(max(_beyond_rows(own), _beyond_rows(other)))
    lasts = max(min(float(np.ptp(own.t)), float(np.ptp(other.t))), 1e-9)
    std = math.sqrt(a.scale_std**2 + b.scale_std**2 + (2.0 * strays / lasts) ** 2)
    if a.has_scale and b.has_scale and abs(a.scale - b.scale) > APART * std:
        return True
    off = abs(float(b.in_simulation(np.array([a.ours]))[0]) - a.theirs)
    far = b.scale_std * abs(a.ours - b.ours) if b.has_scale else 0.0
    row = max(pair[0].row, a.scale * pair[1].row)
    return off > row + APART * math.sqrt(a.shift_std**2 + b.shift_std**2 + far**2 + strays**2)


def _ordered(theirs: Mapping[str, Command], ours: Mapping[str, Command], line: Line) -> list[MatchedCommand]:
    """Return the matching channel of the run for each channel of the simulation.

    Channels of the same name match, unless another order fits far better.
    """
    rows, columns = list(theirs), list(ours)
    matched = {(s, o): compared_commands(theirs[s], ours[o], line) for s in rows for o in columns}
    nats = {k: agreement(c) for k, c in matched.items()}
    table = np.array([[nats[s, o] for o in columns] for s in rows])
    i, j = linear_sum_assignment(-table)
    best = {rows[a]: columns[b] for a, b in zip(i, j, strict=True)}
    same = {s: s for s in rows if s in ours}
    moved = [s for s, o in best.items() if o != s]
    gain = sum(nats[s, best[s]] - (nats[s, s] if s in same else 0.0) for s in moved)
    if gain <= SURELY_OTHER * len(moved):
        best = same
    chosen = [matched[s, o] for s, o in best.items()]
    return [c for c in chosen if c is not None and abs(c.correlation) >= ALIKE]
