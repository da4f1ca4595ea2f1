"""Additional starting points of a search, for runs on which the model fitted to all data fails.

**Without one signal.** A signal with a data error (wrong sign, wrong unit) spoils the whole fit. The base is also
fitted without it.

**Channels permuted.** If commands or signals are exchanged, the base fits nothing. Each wiring that fits short pieces
of the runs is tried by fitting the base with it.

**Segments.** The response to an effect accumulates. A base without drag, or with a rudder that stalls, loses the
craft's heading within seconds. The residuals then contain no information on the cause. Over pieces of a few seconds
that start at the measured state, the base is nearly right and the cause stands out. The numbers fitted there are the
start values for whole runs. Only whole runs decide whether a cause is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.candidates import (
    ROUGH,
    EffectCandidate,
    candidates,
    fitted_roughly,
    fitted_to_the_end,
    screen,
)
from gcs_autotune.diagnose.score import ALIKE
from gcs_autotune.diagnose.undo_data_errors import undo_data_errors
from gcs_autotune.effects import EFFECTS, Drive, EffectInstance
from gcs_autotune.errors import AutotuneError
from gcs_autotune.executor import Executor
from gcs_autotune.identify.problems import Fitted, Limits, Problem, base_limits, fit_base, initial_guess_of
from gcs_autotune.identify.signals import Segment, without_signal
from gcs_autotune.models import Form

__all__ = ["Bases", "lost", "merged", "permuted_channels", "segment_starts", "without_one_signal"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Bases:
    """Fits of the base without each of the signals, evaluated on all signals, and the best fit to all signals."""

    alone: tuple[Fitted, ...]
    best: Fitted


def without_one_signal(problem: Problem, base: Fitted) -> Bases:
    """Return fits of the base to all signals but one, for each signal that can be left out.

    If one of these fits leads to a better base for all signals, that base is the best; otherwise *base* is.
    """
    alone, best = [], base
    names = list(problem.data_summary.signals)
    for name in names if len(names) > 1 else ():
        try:
            _, rest = fit_base(problem.form, without_signal(problem.segments, name), trials=ROUGH)
        except AutotuneError:
            continue
        again = problem.states(rest.theta, (), base.initial)
        if again is None:
            continue
        judged = problem.fit(again.theta, (), again.initial, trials=0, shift=again.shift)
        alone += [] if judged is None else [judged]
        whole = problem.fit(again.theta, (), again.initial, shift=again.shift)
        best = whole if whole is not None and whole.cost < best.cost - ALIKE else best
    return Bases(tuple(alone), best)


TRACK = ("x", "y")
LOST = 0.3
"""Error of a signal, relative to its motion, above which exchanged channels are suspected."""

MOST_WIRINGS = 5
"""Maximum number of wirings that the base is fitted with."""


def lost(present: Fitted, spread: Mapping[str, float]) -> bool:
    """Return whether a model misses some signal completely.

    For a track, only the deviation from a straight line counts. Every model follows a craft that moves steadily away.
    """
    bends = {name: _bend_of(present, name) for name in TRACK if name in present.levels}
    return any(level > LOST * bends.get(name, spread[name]) for name, level in present.levels.items())


def _bend_of(present: Fitted, name: str) -> float:
    """Return the rms distance [m] of the measured positions *name* from a straight line through each run."""
    squares, count = 0.0, 0
    for rest in present.rests:
        if rest.signal == name and len(rest.t) > 2:
            known = np.isfinite(rest.measured)
            t, x = rest.t[known] - rest.t[0], rest.measured[known]
            squares += float(np.sum((x - np.polyval(np.polyfit(t, x, 1), t)) ** 2))
            count += len(x)
    return math.sqrt(squares / count) if count else 0.0


def permuted_channels(
    problem: Problem, present: Fitted, choices: Sequence[Sequence[EffectInstance]]
) -> list[EffectCandidate]:
    """Return the likeliest wiring errors of commands, or of signals of all runs, each with the base refitted.

    A wiring that fits short pieces of the runs worse than the recorded one is excluded. Pieces are too short for the
    base to diverge.
    """
    limits = base_limits(problem.form)
    likely: list[tuple[float, EffectInstance, list[Segment]]] = []
    as_given: float | None = None
    for choice in choices:
        entry, own = EFFECTS[choice[0].slug], choice[0]
        if entry.family != "data errors" or "commands" not in entry.acts_on or own.values:
            continue
        segments = [undo_data_errors([] if "@" in own.place else [own], _through(own, s)) for s in problem.segments]
        if all(new is old for new, old in zip(segments, problem.segments, strict=True)):
            continue
        as_given = _misfit(problem.form, problem.segments, limits) if as_given is None else as_given
        misfit = _misfit(problem.form, segments, limits)
        if misfit <= as_given and math.isfinite(misfit):
            likely.append((misfit, own, segments))
    rewired = []
    for _, own, segments in sorted(likely, key=lambda w: w[0])[:MOST_WIRINGS]:
        try:
            _, alone = fit_base(problem.form, segments, trials=ROUGH)
        except AutotuneError:
            continue
        begin = replace(present, theta=alone.theta, initial=alone.initial)
        rewired.append(EffectCandidate(own, begin, alone.cost, np.zeros(present.jacobian.shape[1])))
    return rewired


def _misfit(form: Form, segments: Sequence[Segment], limits: Limits) -> float:
    return initial_guess_of(form, segments).misfit(limits)


def merged(listed: Sequence[EffectCandidate], more: Sequence[EffectCandidate]) -> list[EffectCandidate]:
    """Return two lists merged: the most promising entry of each effect and place, the best first."""
    best: dict[tuple[str, str], EffectCandidate] = {}
    for candidate in sorted([*listed, *more], key=lambda c: c.promised):
        best.setdefault((candidate.effect.slug, candidate.effect.place), candidate)
    return list(best.values())


def _through(own: EffectInstance, segment: Segment) -> Segment:
    """Return a segment with its commands rewired by *own*; return the segment itself if nothing changes."""
    passage = segment.passage
    drive = Drive(passage.t_in, passage.commands, passage.start, passage.measured, passage.run)
    acting = EFFECTS[own.slug].drive(own, drive).channels
    if all(np.array_equal(acting[n], passage.commands[n]) for n in passage.commands):
        return segment
    commands = {n: acting[n] for n in passage.commands}
    table = np.column_stack([commands[n] for n in segment.input_names])
    return replace(segment, inputs=table)


SAMPLES_OF_A_PIECE = 30
"""Samples per piece: enough for initial states of its own, few enough for little error to accumulate."""

MOST_PIECES = 60
"""Maximum number of pieces of all segments together; each has initial states to fit."""

SHORT_LIST, KEPT = 8, 3
"""SHORT_LIST: number of candidates fitted roughly in pieces. KEPT: number of them fitted over whole runs."""

DETERMINED = 3.0
"""Distance from zero, in standard errors, above which the pieces determine a parameter."""


def segment_starts(
    problem: Problem, present: Fitted, slugs: Sequence[str], executor: Executor
) -> list[tuple[EffectCandidate, Fitted]]:
    """Return rough fits over whole runs, started at the likeliest causes of pieces, each with its candidate.

    present : the base fitted to whole runs.
    """
    pieces = _pieces(problem.segments)
    if len(pieces) <= len(problem.segments):
        return []
    try:
        short, base = fit_base(problem.form, pieces)
    except AutotuneError:
        return []
    choices = candidates(short.data_summary, (), [s for s in slugs if _moves_the_craft(s)])
    listed = screen(short, [base], [], choices, executor=executor)[:SHORT_LIST]
    fits = executor.map(partial(fitted_roughly, short), listed)
    rough = [(c, f) for c, f in zip(listed, fits, strict=True) if f is not None and f.cost < base.cost]
    rough = sorted(rough, key=lambda r: r[1].cost)[:KEPT]
    whole = executor.map(partial(_whole, problem, short, present), rough)
    return [(_candidate(present, f), f) for f in whole if f is not None]


def _whole(problem: Problem, short: Problem, present: Fitted, rough: tuple[EffectCandidate, Fitted]) -> Fitted | None:
    """Fit a rough fit of pieces to convergence, and return the rough fit over whole runs that starts there."""
    return _over_whole_runs(problem, fitted_to_the_end(short, *rough), present)


def _over_whole_runs(problem: Problem, fit: Fitted, present: Fitted) -> Fitted | None:
    """Return a rough fit of whole runs from the numbers of *fit*; return None if the motion diverges.

    Pieces may not determine some numbers, such as the drag of a motion that was not excited. The fit is then also
    started with the values of *present* for these.
    """
    start = problem.first_states(problem.segments)
    for theta in (fit.theta, _where_determined(fit, present)):
        first = problem.states(theta, fit.effects, start, fit.shift)
        if first is not None:
            return problem.fit(first.theta, first.effects, first.initial, trials=ROUGH, shift=first.shift)
    return None


def _where_determined(fit: Fitted, present: Fitted) -> Array:
    """Return the base parameters of *fit* that it determines, and those of *present* for the rest."""
    theta = present.theta.copy()
    std = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    for k, name in enumerate(fit.free):
        at = fit.form.parameters.index(name)
        if DETERMINED * std[k] < abs(fit.theta[at]):
            theta[at] = fit.theta[at]
    return theta


def _candidate(present: Fitted, fit: Fitted) -> EffectCandidate:
    (own,) = fit.effects
    begin = replace(present, theta=fit.theta, initial=fit.initial, shift=fit.shift)
    return EffectCandidate(own, begin, fit.cost, np.zeros(present.jacobian.shape[1]))


def _pieces(segments: Sequence[Segment]) -> list[Segment]:
    """Cut every segment into pieces of about equal length, in samples."""
    counts = [len(s.stamps) / SAMPLES_OF_A_PIECE for s in segments]
    share = min(1.0, MOST_PIECES / max(sum(counts), 1.0))
    return [piece for s, n in zip(segments, counts, strict=True) for piece in s.pieces(max(int(n * share), 1))]


def _moves_the_craft(slug: str) -> bool:
    """Return whether pieces can show an effect.

    Data errors and sensor effects need whole runs to show, and so do disturbances.
    """
    return EFFECTS[slug].family not in ("data errors", "sensor") and not EFFECTS[slug].is_disturbance
