"""Scoring candidates: evidence against the model before, gain on unseen data, and who wins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_autotune import chi_square
from gcs_autotune.diagnose.heldout import HeldOut, rms_of
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify import Fitted

__all__ = [
    "ALIKE",
    "HALF",
    "LUCK",
    "MATERIAL",
    "SIGNIFICANCE",
    "Judged",
    "SearchStep",
    "bic_penalty",
    "error_ratio",
    "is_form_of",
    "is_material",
    "is_needed",
    "may_be_none",
    "ordered",
    "winner_of",
]


SIGNIFICANCE = 0.005
"""Chance of any false finding on data the base model explains."""

MATERIAL = 0.02
"""Share by which a cause must lower the held-out error of one signal to be worth a name."""

LUCK = 0.05
"""Chance that a gain on unseen data is luck, all that was tried counted, above which it is not believed."""

HALF = 0.5
"""Chosen: share of a cause's evidence that the same cause by a plainer law must have to be named in its place: which
law it is, real water tells by tens of nats either way, and another day the other way round."""

ALIKE = 6.0
"""Difference of twice the log-likelihood (less the cost of parameters) within which two causes cannot be told apart:
odds of twenty to one."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A candidate fitted: evidence against the model before it, error on unseen data, and its chance to be luck."""

    effect: EffectInstance
    fitted: Fitted
    evidence: float
    likelihood: float
    gain: float
    p: float
    unseen: HeldOut | None


@dataclass(frozen=True, slots=True, eq=False)
class SearchStep:
    """One step of the search: everything judged, best first; ``accepted`` the winner, None when none paid."""

    judged: tuple[Judged, ...]
    accepted: Judged | None


def bic_penalty(fitted: Fitted, present: Fitted) -> float:
    """Return what the additional parameters cost (Schwarz); one more for the effect itself."""
    return (fitted.parameters - present.parameters + _learnt(fitted) - _learnt(present)) * math.log(fitted.samples)


def winner_of(judged: Sequence[Judged], tried: int, present: Fitted) -> Judged | None:
    """Return the likeliest candidate that pays; a disturbance only when no cause foretells more than it does."""
    paying = [
        j
        for j in judged
        if j.evidence > 0.0 and is_needed(j.likelihood, j.fitted, present, tried)
        if is_material(j) and j.p < LUCK
    ]
    if not paying:
        return None
    paying = [j for j in paying if not _outdone(j, paying)]
    best = paying[0]
    if EFFECTS[best.effect.slug].is_disturbance:
        foretold = [j for j in paying if not EFFECTS[j.effect.slug].is_disturbance and j.gain > best.gain]
        best = foretold[0] if foretold else best
    return next((j for j in paying if is_form_of(best.effect, j.effect) and j.evidence > HALF * best.evidence), best)


def is_form_of(other: EffectInstance, plainer: EffectInstance) -> bool:
    """Whether *other* is the cause *plainer* by a law that holds less often."""
    return plainer.slug in EFFECTS[other.slug].form_of and plainer.place == other.place


def _outdone(one: Judged, paying: Sequence[Judged]) -> bool:
    """Whether *one* is a slip of the pen, and another cause leaves less: a slip that happened accounts for all."""
    if EFFECTS[one.effect.slug].family != "data errors":
        return False
    return any(other.gain > one.gain and other.fitted.cost < one.fitted.cost for other in paying)


def is_material(judged: Judged) -> bool:
    """Whether a gain on unseen data is worth a name: all signals count, but one may show it while the others do not."""
    return judged.gain > 0.0 and -len(judged.fitted.levels) * math.log1p(-min(judged.gain, 0.999)) > MATERIAL


def is_needed(likelihood: float, fitted: Fitted, present: Fitted, tried: int) -> bool:
    """Whether so much of twice the log-likelihood is more than so many numbers gain by chance, all tries counted."""
    more = max(1, fitted.parameters - present.parameters + _learnt(fitted) - _learnt(present))
    return likelihood > chi_square.threshold(SIGNIFICANCE / max(tried, 1), more)


HALF_WIDTH = 1.96
"""Standard errors to either end of a 95 % interval."""


def may_be_none(effect: EffectInstance, std: Mapping[str, float]) -> bool:
    """Whether an effect's numbers, by their 95 % intervals, may all be such that nothing happens.

    std : standard errors of those that were fitted; one that is not finite says that the number may be anything.
    """
    entry = EFFECTS[effect.slug]
    growing = set(entry.grows_with) & set(effect.values)
    if not growing or set(std) & growing != growing:
        return False
    return not any(abs(effect[n] - entry.neutral.get(n, 0.0)) > HALF_WIDTH * std[n] for n in growing)


def ordered(judged: Sequence[Judged]) -> list[Judged]:
    """Return candidates by evidence; of those that cannot be told from the best, the more usual cause first."""
    ranked = sorted(judged, key=lambda j: -j.evidence)
    alike = [j for j in ranked if ranked[0].evidence - j.evidence < ALIKE]
    slugs = {j.effect.slug for j in alike}
    alike.sort(key=lambda j: len(slugs & set(EFFECTS[j.effect.slug].yields_to)))
    return [*alike, *ranked[len(alike) :]]


def error_ratio(before: HeldOut, after: HeldOut) -> float:
    """Return the geometric mean over signals of the ratio of held-out errors."""
    old, new = rms_of(before.rests), rms_of(after.rests)
    logs = [math.log(max(new[n], 1e-300) / max(old[n], 1e-300)) for n in old if n in new and old[n] > 0.0]
    return math.exp(float(np.mean(logs))) if logs else 1.0


def _learnt(fitted: Fitted) -> int:
    """Return how many numbers were learnt from what was left over."""
    return sum(len(e.values) for e in fitted.effects if EFFECTS[e.slug].is_disturbance)
