"""Causes by their most usual name: where two explain the runs equally well, the one met more often is named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gcs_autotune.diagnose.judging import ALIKE
from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.result import Doubt

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["name_as_usual", "other_places"]


def name_as_usual(search: Search) -> None:
    """Replace every cause by the more usual one that explains the runs as well; note which others would too."""
    given = {(e.slug, e.place) for e in search.base.effects}
    for own in [e for e in search.fitted.effects if (e.slug, e.place) not in given]:
        usual = _as_likely(search.problem, search.fitted, own, EFFECTS[own.slug].yields_to)
        if usual is not None:
            search.fitted, search.present_unseen = usual[1], search.unseen(usual[1])
            search.renamed.append((usual[0].slug, own.slug))
    for own in [e for e in search.fitted.effects if (e.slug, e.place) not in given]:
        for slug, entry in EFFECTS.items():
            if own.slug in entry.yields_to and _as_likely(search.problem, search.fitted, own, (slug,)) is not None:
                search.renamed.append((own.slug, slug))


def other_places(search: Search, order: Sequence[EffectInstance]) -> list[Doubt]:
    """Return a doubt for every cause of *order* that would explain the runs as well at another place.

    A heading in degrees or a turn rate divided by 57.3: between two columns, runs tell only that they disagree.
    """
    found = []
    for step in search.steps:
        own = None if step.accepted is None else step.accepted
        if own is None or not any((e.slug, e.place) == (own.own.slug, own.own.place) for e in order):
            continue
        same = [j for j in step.judged if j.own.slug == own.own.slug and j.own.place != own.own.place]
        alike = [j.own for j in same if abs(j.fitted.cost - own.fitted.cost) < ALIKE]
        if alike:
            found.append(_elsewhere(own.own, alike))
    return found


def _elsewhere(own: EffectInstance, alike: Sequence[EffectInstance]) -> Doubt:
    others = " or ".join(f"{e.place}{_numbers(e)}" for e in alike)
    return Doubt(
        "another-place",
        f"{own.slug} of {own.place}{_numbers(own)} explains these runs no better than {own.slug} of {others}",
        f"look at the columns: {EFFECTS[own.slug].separated_by}",
    )


def _numbers(own: EffectInstance) -> str:
    return "".join(f", {name} {value:.4g}" for name, value in own.values.items())


def _as_likely(
    problem: Problem, now: Fitted, own: EffectInstance, slugs: Sequence[str]
) -> tuple[EffectInstance, Fitted] | None:
    """Return the first of *slugs* (with the fit) that explains the runs as well in the place of *own*."""
    for slug in slugs:
        for other in _in_other_words(own, slug, problem.scene):
            if any((e.slug, e.place) == (other.slug, other.place) for e in now.effects):
                continue
            effects = tuple(other if e is own else e for e in now.effects)
            fit = problem.fit(now.theta, effects, now.initial, trials=12, shift=now.shift)
            if fit is not None and fit.cost < now.cost + ALIKE:
                return other, fit
    return None


def _in_other_words(own: EffectInstance, slug: str, scene: DataSummary) -> list[EffectInstance]:
    """Return the effect called *slug* at every place, its one number that of *own*; none when they have more."""
    entry = EFFECTS[slug]
    if len(own.values) != 1 or len(entry.parameters) != 1:
        return []
    name, value = entry.parameters[0].name, next(iter(own.values.values()))
    found = []
    for place in entry.places(scene):
        low, high = entry.bounds(place, scene).get(name, (-math.inf, math.inf))
        if low <= value <= high:
            found.append(EffectInstance(slug, place, {name: value}, dict(entry.constants(place, scene))))
    return found
