"""One candidate fitted: roughly, to be compared with others, and to the end."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.diagnose.screen import Candidate
from gcs_autotune.effects import BOOK
from gcs_autotune.effects.effect import Applied
from gcs_autotune.identify.extended.fitting import Fitted, Problem

__all__ = ["fitted_roughly", "fitted_to_the_end"]

ROUGH = 8
"""Trials of a rough fit."""


def fitted_roughly(problem: Problem, candidate: Candidate) -> Fitted | None:
    """Return a rough fit, begun at the model adapted to first order; at the model as it is when that leads nowhere,
    and at other values of the effect when that is still no better than without it. None: the motion runs away.
    """
    begin, fit = candidate.begin, problem.fit
    theta, effects, initial = problem.moved(begin, candidate.adapted)
    found = fit(theta, (*effects, candidate.own), initial, trials=ROUGH, shift=begin.shift)
    if found is None or found.cost > begin.cost:
        for own in (candidate.own, *candidate.also):
            again = fit(begin.theta, (*begin.effects, own), begin.initial, trials=ROUGH, shift=begin.shift)
            found = again if found is None or (again is not None and again.cost < found.cost) else found
            if found is not None and found.cost <= begin.cost:
                break
    return found


def fitted_to_the_end(problem: Problem, candidate: Candidate, rough: Fitted) -> Fitted:
    """Return the fit; an effect that acts on commands is tried at other values too, as its cost has many valleys."""
    best = rough
    if BOOK[candidate.own.slug].overrides("drive") and candidate.own.values:
        for own in candidate.also:
            effects = _replaced(rough.effects, own)
            other = problem.fit(rough.theta, effects, rough.initial, trials=ROUGH, shift=rough.shift)
            best = other if other is not None and other.cost < best.cost else best
    fit = problem.fit(best.theta, best.effects, best.initial, trials=30, learn=False, shift=best.shift)
    best = fit if fit is not None and fit.cost <= best.cost else best
    if any(BOOK[e.slug].overrides("normal") for e in best.effects):
        again = problem.fit(best.theta, best.effects, best.initial, trials=1, shift=best.shift)
        best = again if again is not None and again.cost < best.cost else best
    return best


def _replaced(effects: Sequence[Applied], own: Applied) -> tuple[Applied, ...]:
    """Return *effects* with the one of the same slug and place replaced."""
    return tuple(own if (e.slug, e.place) == (own.slug, own.place) else e for e in effects)
