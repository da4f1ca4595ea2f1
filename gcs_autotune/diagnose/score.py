"""The score of a candidate, on the runs fitted and on data left out, and which candidate wins a step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.diagnose.heldout import HeldOut, rms_of
from gcs_autotune.diagnose.result import Lack
from gcs_autotune.effects import EFFECTS, INPUT, DataSummary, EffectInstance, columns_of
from gcs_autotune.identify import Fitted, NoisyFit

__all__ = [
    "ALIKE",
    "HALF",
    "LUCK",
    "MATERIAL",
    "WORTH",
    "CandidateScore",
    "FitT",
    "SearchStep",
    "alike_of",
    "bic_penalty",
    "error_ratio",
    "further",
    "is_form_of",
    "is_material",
    "is_needed",
    "key_of",
    "lack_by_error",
    "lack_by_parts",
    "lasts",
    "may_be_none",
    "needed_of",
    "ordered",
    "plainest",
    "winner_of",
]

Array = NDArray[np.float64]

FitT = TypeVar("FitT", bound=Fitted | NoisyFit)


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


WORTH = 3.0
"""Log-likelihood gained on data left out (odds of twenty to one) that a cause must have."""

AMPLE = 10.0
"""Chosen: log-likelihood gained on data left out that needs no interval where each of three parts contributes to it."""

FAR_MORE = 3.0
"""Chosen: so many times what is needed, gained on data left out, makes up for too little on the runs fitted. With once
as much, asymmetric thrust was reported of a clean craft (weather, seed 75 case 11: 5.6 of 6.4, 12.5 left out)."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateScore(Generic[FitT]):
    """A candidate fitted, and what supports it, by either scorer. ``lacks``: why it may not be accepted, if so.

    On the runs fitted: ``gained``, the log-likelihood over the model before it (correlated samples counted once), and
    ``needed``, what its ``numbers`` gain by chance, all candidates tried counted. On data left out: ``gain``, the share
    by which the error falls, and ``p``, the chance that this is luck. ``evidence``: twice a log-likelihood; by least
    squares that of the runs fitted less the cost of the numbers, with process noise that of data left out.

    By least squares ``unseen`` is what it leaves of data left out. With process noise ``parts`` (k,) are the
    log-likelihoods gained on each part, ``interval`` 90 % of their sum, ``ahead`` its error some seconds ahead over
    that of the model before it (1: not calculated), ``unsound`` in words why no model of the craft stands with it.
    """

    effect: EffectInstance
    fit: FitT
    gained: float
    needed: float
    numbers: int
    evidence: float
    gain: float = 0.0
    p: float = 1.0
    lacks: Lack | None = None
    unseen: HeldOut | None = None
    parts: Array = field(default_factory=lambda: np.zeros(0))
    interval: tuple[float, float] = (math.nan, math.nan)
    ahead: float = 1.0
    unsound: str = ""

    @property
    def held_out_gain(self) -> float:
        """Log-likelihood gained on all data left out."""
        return float(self.parts.sum())

    @property
    def is_ample(self) -> bool:
        """Whether each of three parts and more left out contributes to ten nats, and none all but three of them.

        That is sure whatever its scatter over blocks: no single gust brings it.
        """
        even = len(self.parts) > 2 and bool(np.all(self.parts > 0.0))
        return even and self.held_out_gain > AMPLE and self.held_out_gain - float(self.parts.max()) > WORTH

    @property
    def holds(self) -> bool:
        """Whether the data left out gains surely, and every part of it.

        Of three parts and more one may lose, where the others gain well more. What is ample is sure.
        """
        if self.interval[0] < 0.0 and not self.is_ample:
            return False
        losing = int(np.sum(self.parts <= 0.0))
        if losing == 0:
            return self.held_out_gain > WORTH
        most = float(self.parts.max())
        return losing == 1 and len(self.parts) > 2 and min(self.held_out_gain - most, 0.5 * self.held_out_gain) > WORTH


@dataclass(frozen=True, slots=True, eq=False)
class SearchStep(Generic[FitT]):
    """One step of a search: every candidate scored, best first; ``accepted`` the winner, None when there was none.

    ``present``: the model they were added to, fitted better where the step found out how. ``alike``: with process
    noise, names that these runs do not distinguish from the winner, its own first.
    """

    present: FitT
    judged: tuple[CandidateScore[FitT], ...]
    accepted: CandidateScore[FitT] | None
    alike: tuple[str, ...] = ()


def key_of(effect: EffectInstance) -> tuple[str, str]:
    """Return what identifies an effect in a model: its slug and place."""
    return effect.slug, effect.place


def needed_of(more: int, tried: int) -> float:
    """Return the log-likelihood that so many numbers more gain by chance in the best of all *tried*."""
    return 0.5 * chi_square.threshold(SIGNIFICANCE / max(tried, 1), max(more, 1))


def lasts(effect: EffectInstance, data: DataSummary) -> float:
    """Return the shortest time [s] among an effect's numbers, a rate told as the time to the largest command."""
    times = [math.inf]
    for q in EFFECTS[effect.slug].parameters:
        value = abs(effect.values.get(q.name, math.inf))
        if q.unit == "s":
            times.append(value)
        elif q.unit == f"{INPUT}/s":
            largest = max((data.amplitude.get(n, math.inf) for n in columns_of(effect.place)), default=math.inf)
            times.append(largest / max(value, 1e-300))
    return min(times)


def lack_by_error(one: CandidateScore[Fitted], *, brief: bool = False) -> Lack | None:
    """Return what a candidate lacks to be accepted, by its error on data left out; None for nothing.

    brief : see :data:`.Lack`.
    """
    if one.evidence <= 0.0 or not one.gained > one.needed:
        return "weak"
    if brief:
        return "brief"
    if not is_material(one):
        return "no-gain"
    return None if one.p < LUCK else "not-sure"


def lack_by_parts(one: CandidateScore[NoisyFit], *, brief: bool = False, uncertain: bool = False) -> Lack | None:
    """Return what a candidate lacks to be accepted, by the log-likelihood gained on each part left out; None for
    nothing.

    It must gain what is needed on the runs fitted, or far more of it on those left out, where the plain model itself
    may be lost. brief, uncertain : see :data:`.Lack`.
    """
    if uncertain:
        return "uncertain"
    if brief:
        return "brief"
    if one.holds and (one.gained > one.needed or one.held_out_gain > FAR_MORE * one.needed):
        return None
    if one.gained <= one.needed:
        return "weak"
    return "not-sure" if one.interval[0] < 0.0 else "not-on-each"


def bic_penalty(fitted: Fitted, present: Fitted) -> float:
    """Return what the additional parameters cost (Schwarz); one more for the effect itself."""
    return further(fitted, present) * math.log(fitted.samples)


def winner_of(scores: Sequence[CandidateScore[Fitted]]) -> CandidateScore[Fitted] | None:
    """Return the likeliest candidate that lacks nothing; a disturbance only when no cause predicts more than it."""
    paying = [j for j in scores if j.lacks is None]
    if not paying:
        return None
    paying = [j for j in paying if not _outdone(j, paying)]
    best = paying[0]
    if EFFECTS[best.effect.slug].is_disturbance:
        better = [j for j in paying if not EFFECTS[j.effect.slug].is_disturbance and j.gain > best.gain]
        best = better[0] if better else best
    return plainest(best, paying)


def plainest(winner: CandidateScore[FitT], paying: Sequence[CandidateScore[FitT]]) -> CandidateScore[FitT]:
    """Return *winner*, or the same cause by a plainer law where that is supported as well."""
    found = (j for j in paying if is_form_of(winner.effect, j.effect) and j.evidence > HALF * winner.evidence)
    return next(found, winner)


def is_form_of(other: EffectInstance, plainer: EffectInstance) -> bool:
    """Whether *other* is the cause *plainer* by a law that holds less often."""
    return plainer.slug in EFFECTS[other.slug].form_of and plainer.place == other.place


def _outdone(one: CandidateScore[Fitted], paying: Sequence[CandidateScore[Fitted]]) -> bool:
    """Whether *one* is a slip of the pen, and another cause leaves less: a slip that happened accounts for all."""
    if EFFECTS[one.effect.slug].family != "data errors":
        return False
    return any(other.gain > one.gain and other.fit.cost < one.fit.cost for other in paying)


def is_material(one: CandidateScore[Fitted]) -> bool:
    """Whether a gain on unseen data is worth a name: all signals count, but one may show it while the others do not."""
    return one.gain > 0.0 and -len(one.fit.levels) * math.log1p(-min(one.gain, 0.999)) > MATERIAL


def is_needed(likelihood: float, fitted: Fitted, present: Fitted, tried: int) -> bool:
    """Whether so much of twice the log-likelihood is more than so many numbers gain by chance, all tries counted."""
    return 0.5 * likelihood > needed_of(further(fitted, present), tried)


def further(fitted: Fitted, present: Fitted) -> int:
    """Return how many numbers *fitted* has more than *present*, those learnt from what was left over included."""
    return fitted.parameters - present.parameters + _learnt(fitted) - _learnt(present)


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


def alike_of(scores: Sequence[CandidateScore[FitT]]) -> list[CandidateScore[FitT]]:
    """Return those whose evidence cannot be distinguished from the best, the more usual cause first."""
    ranked = sorted(scores, key=lambda j: -j.evidence)
    alike = [j for j in ranked if ranked[0].evidence - j.evidence < ALIKE]
    slugs = {j.effect.slug for j in alike}
    return sorted(alike, key=lambda j: len(slugs & set(EFFECTS[j.effect.slug].yields_to)))


def ordered(scores: Sequence[CandidateScore[FitT]]) -> list[CandidateScore[FitT]]:
    """Return candidates by evidence; of those not distinguished from the best, the more usual cause first."""
    alike = alike_of(scores)
    rest = sorted(scores, key=lambda j: -j.evidence)[len(alike) :]
    return [*alike, *rest]


def error_ratio(before: HeldOut, after: HeldOut) -> float:
    """Return the geometric mean over signals of the ratio of held-out errors."""
    old, new = rms_of(before.rests), rms_of(after.rests)
    logs = [math.log(max(new[n], 1e-300) / max(old[n], 1e-300)) for n in old if n in new and old[n] > 0.0]
    return math.exp(float(np.mean(logs))) if logs else 1.0


def _learnt(fitted: Fitted) -> int:
    """Return how many numbers were learnt from what was left over."""
    return sum(len(e.values) for e in fitted.effects if EFFECTS[e.slug].is_disturbance)
