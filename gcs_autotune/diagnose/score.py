"""Score candidates on the fitted runs and on held-out data, and choose the winner of a step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.diagnose.heldout import HeldOut, rms_of
from gcs_autotune.diagnose.result import Lack
from gcs_autotune.effects import EFFECTS, INPUT, DataSummary, EffectInstance, columns_of
from gcs_autotune.identify.kalman import NoisyFit
from gcs_autotune.identify.problems import Fitted

__all__ = [
    "ALIKE",
    "FAR_MORE",
    "HALF",
    "LUCK",
    "MATERIAL",
    "MIN_HELD_OUT_GAIN",
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
    "needed_of",
    "ordered",
    "plainest",
    "winner_of",
]

Array = NDArray[np.float64]

FitT = TypeVar("FitT", bound=Fitted | NoisyFit)


SIGNIFICANCE = 0.005
"""Probability of reporting any cause although the base model explains the data."""

MATERIAL = 0.02
"""Relative reduction of the held-out error of one signal that a cause must reach to be reported."""

LUCK = 0.05
"""Largest accepted probability that a held-out gain is luck, counting all candidates tried."""

HALF = 0.5
"""Fraction of a cause's gain in log-likelihood from which a simpler law of the same cause is reported in its place. On
real water the gains of two laws differ by tens of nats, and its sign changes between runs.
"""

ALIKE = 6.0
"""Difference of twice the log-likelihood, less the cost of parameters, below which two causes are not distinguished.

It corresponds to odds of twenty to one.
"""


MIN_HELD_OUT_GAIN = 3.0
"""Held-out log-likelihood that a cause must gain: odds of twenty to one."""

AMPLE = 10.0
"""Held-out log-likelihood gain from which its interval is not considered, if each of three parts contributes."""

FAR_MORE = 3.0
"""Multiple of the required gain that the held-out gain must reach if the gain on the fitted runs is too small.

With a multiple of 1, asymmetric thrust was reported of a fault-free craft (process noise, seed 75 case 11). It gained
5.6 of the required 6.4 on the fitted runs, and 12.5 on held-out data.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateScore(Generic[FitT]):
    """A fitted candidate with its gains on fitted and on held-out data, from either scorer.

    ``lacks``: why it must not be accepted. On the fitted runs, ``gained`` is the log-likelihood over the model before
    it; correlated samples count once. ``needed`` is what its ``numbers`` gain by chance, counting all candidates tried.
    On held-out data, ``gain`` is the relative reduction of the error, and ``p`` the probability that it is luck.

    ``evidence`` is twice a log-likelihood ratio: by least squares that of the fitted runs, less the cost of the
    numbers; with process noise that of held-out data.

    By least squares, ``unseen`` are the held-out residuals. With process noise, ``parts`` (k,) are the log-likelihoods
    gained on each fold, and ``interval`` is the 90 % interval of their sum. ``ahead`` is the error some seconds ahead,
    relative to the model before it (1: not calculated). ``unsound`` states in words why the fit is not a model of the
    craft.
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
        """Whether the log-likelihood rises on all of three or more held-out folds: by over ten in total, by over three
        without the largest.

        Such a gain is accepted whatever its scatter over blocks, because a single gust cannot cause it.
        """
        even = len(self.parts) > 2 and bool(np.all(self.parts > 0.0))
        return even and self.held_out_gain > AMPLE and self.held_out_gain - float(self.parts.max()) > MIN_HELD_OUT_GAIN

    @property
    def holds(self) -> bool:
        """Whether the held-out gain is significant, and positive on every fold. With three or more folds, one may be
        negative if the others gain clearly more. An ample gain counts as significant.
        """
        if self.interval[0] < 0.0 and not self.is_ample:
            return False
        losing = int(np.sum(self.parts <= 0.0))
        if losing == 0:
            return self.held_out_gain > MIN_HELD_OUT_GAIN
        most = float(self.parts.max())
        return (
            losing == 1
            and len(self.parts) > 2
            and min(self.held_out_gain - most, 0.5 * self.held_out_gain) > MIN_HELD_OUT_GAIN
        )


@dataclass(frozen=True, slots=True, eq=False)
class SearchStep(Generic[FitT]):
    """One step of a search: all scored candidates, the best first. ``accepted``: the winner, or None.

    ``present``: the model to which they were added, or a better fit of it from this step. ``alike``: with process
    noise, the causes that these runs do not distinguish from the winner, starting with the winner.
    """

    present: FitT
    judged: tuple[CandidateScore[FitT], ...]
    accepted: CandidateScore[FitT] | None
    alike: tuple[str, ...] = ()


def key_of(effect: EffectInstance) -> tuple[str, str]:
    """Return the key of an effect in a model: its slug and place."""
    return effect.slug, effect.place


def needed_of(more: int, tried: int) -> float:
    """Return the log-likelihood that *more* additional numbers gain by chance in the best of *tried* candidates."""
    return 0.5 * chi_square.threshold(SIGNIFICANCE / max(tried, 1), max(more, 1))


def lasts(effect: EffectInstance, data: DataSummary) -> float:
    """Return the shortest time [s] among an effect's numbers.

    A rate limit is converted to the time to the largest command.
    """
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
    """Return why a candidate must not be accepted, judged by its held-out error; None if it may be accepted. brief :
    whether the effect is too fast for these runs, see :data:`.Lack`.
    """
    if one.evidence <= 0.0 or not one.gained > one.needed:
        return "weak"
    if brief:
        return "brief"
    if not is_material(one):
        return "no-gain"
    return None if one.p < LUCK else "not-sure"


def lack_by_parts(one: CandidateScore[NoisyFit], *, brief: bool = False, uncertain: bool = False) -> Lack | None:
    """Return why a candidate must not be accepted, judged by its gain on each held-out fold; None if it may be
    accepted. It must gain what is needed on the fitted runs. A far larger held-out gain also suffices, because the
    plain model itself may have diverged.

    brief, uncertain : see :data:`.Lack`.
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
    """Return the cost of the additional parameters (Schwarz's criterion)."""
    return further(fitted, present) * math.log(fitted.samples)


def winner_of(scores: Sequence[CandidateScore[Fitted]]) -> CandidateScore[Fitted] | None:
    """Return the likeliest candidate that may be accepted.

    A disturbance is returned only if no cause predicts better.
    """
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
    """Return *winner*, or a simpler law of the same cause if the runs support it as well."""
    forms = (j for j in paying if is_form_of(winner.effect, j.effect) and j.evidence > HALF * winner.evidence)
    return next(forms, winner)


def is_form_of(other: EffectInstance, plainer: EffectInstance) -> bool:
    """Return whether *other* is the same cause as *plainer*, with a more special law."""
    return plainer.slug in EFFECTS[other.slug].form_of and plainer.place == other.place


def _outdone(one: CandidateScore[Fitted], paying: Sequence[CandidateScore[Fitted]]) -> bool:
    """Return whether *one* is a data error, and another candidate predicts and fits better.

    A real data error would be the best explanation.
    """
    if EFFECTS[one.effect.slug].family != "data errors":
        return False
    return any(other.gain > one.gain and other.fit.cost < one.fit.cost for other in paying)


def is_material(one: CandidateScore[Fitted]) -> bool:
    """Return whether a held-out gain is large enough to report.

    All signals are considered together, but a gain in one is enough.
    """
    return one.gain > 0.0 and -len(one.fit.levels) * math.log1p(-min(one.gain, 0.999)) > MATERIAL


def is_needed(likelihood: float, fitted: Fitted, present: Fitted, tried: int) -> bool:
    """Return whether twice a log-likelihood exceeds what the additional numbers gain by chance, in the best of
    *tried*."""
    return 0.5 * likelihood > needed_of(further(fitted, present), tried)


def further(fitted: Fitted, present: Fitted) -> int:
    """Return the number of parameters that *fitted* has in addition to those of *present*, including those estimated
    from the residuals.
    """
    return fitted.parameters - present.parameters + _learnt(fitted) - _learnt(present)


def alike_of(scores: Sequence[CandidateScore[FitT]]) -> list[CandidateScore[FitT]]:
    """Return the candidates whose log-likelihood does not distinguish them from the best.

    The more common cause comes first.
    """
    ranked = sorted(scores, key=lambda j: -j.evidence)
    alike = [j for j in ranked if ranked[0].evidence - j.evidence < ALIKE]
    slugs = {j.effect.slug for j in alike}
    return sorted(alike, key=lambda j: len(slugs & set(EFFECTS[j.effect.slug].yields_to)))


def ordered(scores: Sequence[CandidateScore[FitT]]) -> list[CandidateScore[FitT]]:
    """Return candidates by gain in log-likelihood. Those not distinguished from the best are ordered by how common the
    cause is.
    """
    alike = alike_of(scores)
    rest = sorted(scores, key=lambda j: -j.evidence)[len(alike) :]
    return [*alike, *rest]


def error_ratio(before: HeldOut, after: HeldOut) -> float:
    """Return the ratio of held-out errors with and without a candidate, as the geometric mean over signals."""
    old, new = rms_of(before.rests), rms_of(after.rests)
    logs = [math.log(max(new[n], 1e-300) / max(old[n], 1e-300)) for n in old if n in new and old[n] > 0.0]
    return math.exp(float(np.mean(logs))) if logs else 1.0


def _learnt(fitted: Fitted) -> int:
    """Return the number of parameters that disturbances estimated from the residuals."""
    return sum(len(e.values) for e in fitted.effects if EFFECTS[e.slug].is_disturbance)
