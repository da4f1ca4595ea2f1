"""Where a search may begin besides at the model fitted to all, of which nothing is learnt where it is lost.

**Without one signal.** A signal spoilt by an error of the data (a wrong sign, a wrong unit) spoils the fit of all.

**Channels permuted.** Commands that reach the wrong place, signals the wrong way round: the base fits nothing, so
each way of wiring that suits short pieces of the runs is tried by fitting the base to runs wired that way.

**Segments.** What an effect does adds up. A base without drag, or of a rudder that stalls, leaves the craft's heading
within seconds and never returns; what is left over says nothing of the cause any more. Over pieces of a few seconds
that begin where the craft was the same base is nearly right and the cause stands out. Its numbers there are where
whole runs are fitted from; whether it pays, whole runs decide, so nothing is taken on trust.
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
from gcs_autotune.identify import (
    Fitted,
    Limits,
    Problem,
    Segment,
    base_limits,
    fit_base,
    initial_guess_of,
    without_signal,
)
from gcs_autotune.models import Form

__all__ = ["Bases", "lost", "merged", "permuted_channels", "segment_starts", "without_one_signal"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Bases:
    """The base fitted to all signals but one, judged by all, one for each signal; and the best fitted to all."""

    alone: tuple[Fitted, ...]
    best: Fitted


def without_one_signal(problem: Problem, base: Fitted) -> Bases:
    """Fit the base to all signals but one, for each that can be missed.

    Where one of these leads to a better base for all signals, that is the best; else *base* itself.
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
"""Error of some signal, in shares of its motion, at which wiring is suspected."""

MOST_WIRINGS = 5
"""Wirings the base is fitted under, at most."""


def lost(present: Fitted, spread: Mapping[str, float]) -> bool:
    """Whether a model misses some signal altogether.

    Of a track what counts is how it bends: that a craft which sails away is far off in the end any model knows.
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
    """Return the likeliest slips in the wiring of commands, or of signals of all runs, with the base found anew under
    each.

    A wiring that suits short pieces of the runs worse than the one given is none: there no base gets lost.
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
    found = []
    for _, own, segments in sorted(likely, key=lambda w: w[0])[:MOST_WIRINGS]:
        try:
            _, alone = fit_base(problem.form, segments, trials=ROUGH)
        except AutotuneError:
            continue
        begin = replace(present, theta=alone.theta, initial=alone.initial)
        found.append(EffectCandidate(own, begin, alone.cost, np.zeros(present.jacobian.shape[1])))
    return found


def _misfit(form: Form, segments: Sequence[Segment], limits: Limits) -> float:
    return initial_guess_of(form, segments).misfit(limits)


def merged(listed: Sequence[EffectCandidate], more: Sequence[EffectCandidate]) -> list[EffectCandidate]:
    """Return both lists, the best promise of each effect and place, the best first."""
    best: dict[tuple[str, str], EffectCandidate] = {}
    for candidate in sorted([*listed, *more], key=lambda c: c.promised):
        best.setdefault((candidate.effect.slug, candidate.effect.place), candidate)
    return list(best.values())


def _through(own: EffectInstance, segment: Segment) -> Segment:
    """Return a segment with its commands as *own* wires them; itself when nothing changes."""
    passage = segment.passage
    drive = Drive(passage.t_in, passage.commands, passage.start, passage.measured, passage.run)
    acting = EFFECTS[own.slug].drive(own, drive).channels
    if all(np.array_equal(acting[n], passage.commands[n]) for n in passage.commands):
        return segment
    commands = {n: acting[n] for n in passage.commands}
    table = np.column_stack([commands[n] for n in segment.input_names])
    return replace(segment, inputs=table)


SAMPLES_OF_A_PIECE = 30
"""Chosen: stamps of a piece: enough for its own initial states, few enough that little adds up."""

MOST_PIECES = 60
"""Of all segments together: each has initial states to fit."""

SHORT_LIST, KEPT = 8, 3
"""Candidates fitted roughly in pieces, and of these to the end and over whole runs."""

TOLD = 3.0
"""A parameter this many standard errors from zero counts as determined by the pieces."""


def segment_starts(
    problem: Problem, present: Fitted, slugs: Sequence[str], executor: Executor
) -> list[tuple[EffectCandidate, Fitted]]:
    """Return rough fits over whole runs begun at the likeliest causes of pieces, each with its candidate.

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
    """Return a rough fit of pieces fitted to its end there, and carried over to whole runs."""
    return _over_whole_runs(problem, fitted_to_the_end(short, *rough), present)


def _over_whole_runs(problem: Problem, fit: Fitted, present: Fitted) -> Fitted | None:
    """Return a rough fit of whole runs from the numbers of *fit*; None when the motion runs away with them.

    What pieces do not tell (the drag of a motion nobody excited) may be wild there: it is tried as in *present* too.
    """
    start = problem.first_states(problem.segments)
    for theta in (fit.theta, _where_told(fit, present)):
        first = problem.states(theta, fit.effects, start, fit.shift)
        if first is not None:
            return problem.fit(first.theta, first.effects, first.initial, trials=ROUGH, shift=first.shift)
    return None


def _where_told(fit: Fitted, present: Fitted) -> Array:
    """Return the base's numbers of *fit* where it tells them, those of *present* elsewhere."""
    theta = present.theta.copy()
    std = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    for k, name in enumerate(fit.free):
        at = fit.form.parameters.index(name)
        if TOLD * std[k] < abs(fit.theta[at]):
            theta[at] = fit.theta[at]
    return theta


def _candidate(present: Fitted, fit: Fitted) -> EffectCandidate:
    (own,) = fit.effects
    begin = replace(present, theta=fit.theta, initial=fit.initial, shift=fit.shift)
    return EffectCandidate(own, begin, fit.cost, np.zeros(present.jacobian.shape[1]))


def _pieces(segments: Sequence[Segment]) -> list[Segment]:
    """Cut every segment into pieces of about as many samples."""
    counts = [len(s.stamps) / SAMPLES_OF_A_PIECE for s in segments]
    share = min(1.0, MOST_PIECES / max(sum(counts), 1.0))
    return [piece for s, n in zip(segments, counts, strict=True) for piece in s.pieces(max(int(n * share), 1))]


def _moves_the_craft(slug: str) -> bool:
    """Whether an effect can be seen in pieces: bookkeeping and sensors show over whole runs, waves need them."""
    return EFFECTS[slug].family not in ("data errors", "sensor") and not EFFECTS[slug].is_disturbance
