"""From a base model to one with the effects asked for: one after the other, each from every start and place."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.effects import EffectInstance
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.extended.wish import Wish
from gcs_autotune.identify.problem import Fitted, Problem

__all__ = ["with_effects"]

FIRST_TRIALS = 12
"""Steps of a start's first descent; the best is then fitted to the end."""

LAST_TRIALS = 60


def with_effects(problem: Problem, fitted: Fitted, wishes: Sequence[Wish]) -> Fitted:
    """Return *fitted* with every effect of *wishes* added and all parameters fitted together.

    With two or more of them each is given a second chance from all its starts once the others are there, because
    the first to come may have taken what belongs to the later ones.

    Raises
    ------
    UsageError
        An effect these runs cannot show. NotInformative: the motion runs away with it from every start.
    """
    for wish in wishes:
        fitted = _best(problem, fitted, fitted.effects, wish)
    if len(wishes) > 1:
        for wish in wishes:
            others = tuple(e for e in fitted.effects if not _meant(e, wish))
            again = _best(problem, fitted, others, wish)
            fitted = again if again.cost < fitted.cost else fitted
    return fitted


def _best(problem: Problem, fitted: Fitted, others: Sequence[EffectInstance], wish: Wish) -> Fitted:
    best: Fitted | None = None
    taken = {(e.slug, e.place) for e in others}
    for own in wish.candidates(problem.scene):
        if (own.slug, own.place) in taken:
            continue
        found = problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FIRST_TRIALS, shift=fitted.shift)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    final = None
    if best is not None:
        final = problem.fit(best.theta, best.effects, best.initial, trials=LAST_TRIALS, shift=best.shift)
    if final is None:
        raise NotInformative(f"no model with '{wish.slug}' can be simulated on these runs: leave it out")
    return final


def _meant(own: EffectInstance, wish: Wish) -> bool:
    return own.slug == wish.slug and wish.place in (None, own.place)
