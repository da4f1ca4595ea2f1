"""From a base model to one with the effects asked for: one after the other, each from every start and place."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.effects import EffectInstance
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.problem import Fitted, Problem

__all__ = ["with_effects"]

FIRST_TRIALS = 12
"""Steps of a start's first descent; the best is then fitted to the end."""

LAST_TRIALS = 60


def with_effects(problem: Problem, fitted: Fitted, specs: Sequence[EffectSpec]) -> Fitted:
    """Return *fitted* with every effect of *specs* added and all parameters fitted together.

    With two or more of them each is given a second chance from all its starts once the others are there, because
    the first to come may have taken what belongs to the later ones.

    Raises
    ------
    UsageError
        An effect these runs cannot show. NotInformative: the motion runs away with it from every start.
    """
    for spec in specs:
        fitted = _best(problem, fitted, fitted.effects, spec)
    if len(specs) > 1:
        for spec in specs:
            others = tuple(e for e in fitted.effects if not _meant(e, spec))
            again = _best(problem, fitted, others, spec)
            fitted = again if again.cost < fitted.cost else fitted
    return fitted


def _best(problem: Problem, fitted: Fitted, others: Sequence[EffectInstance], spec: EffectSpec) -> Fitted:
    best: Fitted | None = None
    taken = {(e.slug, e.place) for e in others}
    for own in spec.candidates(problem.data_summary):
        if (own.slug, own.place) in taken:
            continue
        found = problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FIRST_TRIALS, shift=fitted.shift)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    final = None
    if best is not None:
        final = problem.fit(best.theta, best.effects, best.initial, trials=LAST_TRIALS, shift=best.shift)
    if final is None:
        raise NotInformative(f"no model with '{spec.slug}' can be simulated on these runs: leave it out")
    return final


def _meant(own: EffectInstance, spec: EffectSpec) -> bool:
    return own.slug == spec.slug and spec.place in (None, own.place)
