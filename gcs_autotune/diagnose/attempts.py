"""One candidate fitted: roughly, to be compared with others, and to the end."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.diagnose.judging import price_of
from gcs_autotune.diagnose.screen import Candidate
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify.extended.fitting import Fitted, Problem

__all__ = ["ROUGH", "RUNNERS", "Attempt", "best_of_each", "fitted_roughly", "fitted_to_the_end"]

Attempt = tuple[Candidate, Fitted]

ROUGH = 8
"""Trials of a rough fit."""

RUNNERS = 5
"""Candidates of a step fitted to the end."""

MOMENTS, FEW = 6, 3
"""Chosen: moments tried on either side of the one found, and trials of each."""


def best_of_each(attempts: Sequence[Attempt], present: Fitted) -> list[Attempt]:
    """Return the best fit of each effect and place, the best first."""
    best: dict[tuple[str, str], Attempt] = {}
    for candidate, fit in sorted(attempts, key=lambda f: f[1].cost + price_of(f[1], present)):
        best.setdefault((candidate.own.slug, candidate.own.place), (candidate, fit))
    return list(best.values())


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
    """Return the fit. Where the cost has many valleys, other values are tried too: of effects that act on commands,
    and moments about the one found.
    """
    best = rough
    if "commands" in EFFECTS[candidate.own.slug].acts_on and candidate.own.values:
        for own in candidate.also:
            effects = _replaced(rough.effects, own)
            other = problem.fit(rough.theta, effects, rough.initial, trials=ROUGH, shift=rough.shift)
            best = other if other is not None and other.cost < best.cost else best
    best = _settled(problem, best)
    for name in EFFECTS[candidate.own.slug].happens_at:
        best = _at_another_moment(problem, candidate.own, name, best)
    if any(EFFECTS[e.slug].is_rounding for e in best.effects):
        again = problem.fit(best.theta, best.effects, best.initial, trials=1, shift=best.shift)
        best = again if again is not None and again.cost < best.cost else best
    return best


def _settled(problem: Problem, best: Fitted) -> Fitted:
    fit = problem.fit(best.theta, best.effects, best.initial, trials=30, learn=False, shift=best.shift)
    return fit if fit is not None and fit.cost <= best.cost else best


def _at_another_moment(problem: Problem, own: EffectInstance, name: str, best: Fitted) -> Fitted:
    """Return the best fit with the moment *name* of an effect some of the craft's time constants earlier or later."""
    now = next(e for e in best.effects if (e.slug, e.place) == (own.slug, own.place))
    others = []
    for k in range(1, MOMENTS + 1):
        for moment in (now[name] - k * problem.scene.pace, now[name] + k * problem.scene.pace):
            effects = _replaced(best.effects, now.with_values({name: moment}))
            fit = problem.fit(best.theta, effects, best.initial, trials=FEW, learn=False, shift=best.shift)
            others += [] if fit is None else [fit]
    other = min(others, key=lambda f: f.cost, default=best)
    return _settled(problem, other) if other.cost < best.cost else best


def _replaced(effects: Sequence[EffectInstance], own: EffectInstance) -> tuple[EffectInstance, ...]:
    """Return *effects* with the one of the same slug and place replaced."""
    return tuple(own if (e.slug, e.place) == (own.slug, own.place) else e for e in effects)
