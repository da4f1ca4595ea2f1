"""Commands that reach the wrong place, signals the wrong way round: the base model itself has to be found anew.

With such a slip the base fits nothing, so that nothing can be learnt from small changes about it: each way of wiring
that suits short pieces of the runs is tried by fitting the base to runs wired that way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose.attempts import ROUGH
from gcs_autotune.diagnose.screen import Candidate
from gcs_autotune.diagnose.unspoilt import unspoilt
from gcs_autotune.effects import EFFECTS, Drive, EffectInstance
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.base_model import base_limits, fit_base
from gcs_autotune.identify.coupled.objective import Limits
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form

__all__ = ["lost", "merged", "rewired"]

LOST = 0.3
"""Error of some signal, in shares of its motion, at which wiring is suspected."""

TRIED = 5
"""Wirings the base is fitted under, at most."""


def lost(present: Fitted, spread: Mapping[str, float]) -> bool:
    """Whether a model misses some signal altogether."""
    return any(level > LOST * spread[name] for name, level in present.levels.items())


def rewired(problem: Problem, present: Fitted, choices: Sequence[Sequence[EffectInstance]]) -> list[Candidate]:
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
        segments = [unspoilt([] if "@" in own.place else [own], _through(own, s)) for s in problem.segments]
        if all(new is old for new, old in zip(segments, problem.segments, strict=True)):
            continue
        as_given = _misfit(problem.form, problem.segments, limits) if as_given is None else as_given
        misfit = _misfit(problem.form, segments, limits)
        if misfit <= as_given and math.isfinite(misfit):
            likely.append((misfit, own, segments))
    found = []
    for _, own, segments in sorted(likely, key=lambda w: w[0])[:TRIED]:
        try:
            _, alone = fit_base(problem.form, segments, trials=ROUGH)
        except AutotuneError:
            continue
        begin = replace(present, theta=alone.theta, initial=alone.initial)
        found.append(Candidate(own, begin, alone.cost, np.zeros(present.jacobian.shape[1])))
    return found


def _misfit(form: Form, segments: Sequence[Segment], limits: Limits) -> float:
    return ground_of(form, segments).misfit(limits)


def merged(listed: Sequence[Candidate], more: Sequence[Candidate]) -> list[Candidate]:
    """Return both lists, the best promise of each effect and place, the best first."""
    best: dict[tuple[str, str], Candidate] = {}
    for candidate in sorted([*listed, *more], key=lambda c: c.promised):
        best.setdefault((candidate.own.slug, candidate.own.place), candidate)
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
