"""Decide whether the runs support a cause, and list hints, which are causes with too little support. The support is
measured by the gain in log-likelihood. A cause needs more than noise could produce in any of the tried candidates. It
also needs a gain on every held-out fold, and a smaller held-out prediction error. A candidate is a hint if it gains
three to ten nats, or more without meeting the other conditions. In addition, noise must produce such a gain in at most
one search of twenty. Hints within three nats of each other form one group, because the runs do not distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from gcs_autotune import chi_square
from gcs_autotune.diagnose.process_noise import CONSTANT
from gcs_autotune.diagnose.result import Hint, Lack
from gcs_autotune.diagnose.score import CandidateScore, key_of
from gcs_autotune.diagnose.search import Search
from gcs_autotune.effects import EFFECTS, EffectInstance, may_be_none, name_of
from gcs_autotune.identify.signals import Segment

__all__ = [
    "ENOUGH",
    "FAINT",
    "WeakCandidate",
    "chance_of",
    "equivalent_gain",
    "hints_of",
    "weak_among",
]

FAINT, ENOUGH = 3.0, 10.0
"""Log-likelihood gain of an effect with one parameter that makes a hint (FAINT), and that supports a cause (ENOUGH).

The gain of an effect with several parameters is converted, see :func:`equivalent_gain`. A cause must also improve the
prediction of held-out data. The gains correspond to odds of twenty to one (FAINT), and of twenty thousand to one
(ENOUGH).
"""

RARE = 0.05
"""Largest probability that noise produces the gain of a hint.

Of 31 rough-water cases in which three nats alone made a hint, the first hint was right in 17. With this limit and the
rule for external effects it was right in 13 of 17 (seeds 1 to 20 and 100 to 149). In 16 of these the right cause is in
the group of the first hint.
"""

ALIKE = 3.0
"""Difference of log-likelihood within which two hints are not distinguished: odds of twenty to one."""

MOST_HINTS = 3


def chance_of(gained: float, numbers: int, tried: int) -> float:
    """Return the probability that noise alone gives the best of *tried* candidates this gain.

    numbers : number of parameters of the candidate.
    """
    one = chi_square.exceeded_by_chance(2.0 * max(gained, 0.0), max(numbers, 1))
    return float(-math.expm1(max(tried, 1) * math.log1p(-min(one, 1.0 - 1e-12))))


def equivalent_gain(gained: float, numbers: int) -> float:
    """Return the log-likelihood gain that with one parameter is as improbable by chance as the gain *gained* with
    *numbers* parameters.
    """
    p = chi_square.exceeded_by_chance(2.0 * max(gained, 0.0), max(numbers, 1))
    return 0.5 * chi_square.threshold(p, 1) if p > 0.0 else gained


@dataclass(frozen=True, slots=True, eq=False)
class WeakCandidate:
    """A candidate that is a hint.

    ``size``: its log-likelihood gain, converted to one parameter. ``chance``: probability that noise alone produces
    this gain.
    ``lacks``: the condition of a cause that it does not meet. ``alike``: names of the other candidates within
    :data:`ALIKE`, whether hints or not.
    """

    one: CandidateScore[Any]
    size: float
    chance: float
    lacks: Lack
    alike: tuple[str, ...] = ()


def hints_of(search: Search, causes: Sequence[EffectInstance], segments: Sequence[Segment]) -> tuple[Hint, ...]:
    """Return the hints of a finished search over *segments*, the likeliest first.

    causes : the identified causes.
    """
    known = {key_of(e) for e in causes}
    hints = (_hint(search, w, segments) for w in weak_among(search) if key_of(w.one.effect) not in known)
    return tuple(islice((hint for hint in hints if not _may_be_none(hint)), MOST_HINTS))


def _may_be_none(hint: Hint) -> bool:
    """Return whether the 95 % intervals of the estimate of *hint* include the case of no effect."""
    std = {name: value.std for name, value in hint.parameters.items()}
    values = {name: value.value for name, value in hint.parameters.items()}
    return may_be_none(EffectInstance(hint.cause, hint.place, values), std)


def weak_among(search: Search) -> list[WeakCandidate]:
    """Return the hints among the candidates of the last step and the causes rejected at the end.

    Candidates whose 95 % interval includes no effect are left out. Rejected causes come first, because they passed the
    test on the held-out folds.
    """
    last = search.steps[-1].judged if search.steps and search.steps[-1].accepted is None else ()
    beside = [a for a in last if name_of(a.effect) not in search.names]
    weak = []
    for one in {key_of(a.effect): a for a in (*beside, *search.refused)}.values():
        if one.gain > 0.0 and one.lacks is not None and one.lacks != "uncertain":
            chance = chance_of(one.gained, one.numbers, search.tried)
            weak.append(WeakCandidate(one, equivalent_gain(one.gained, one.numbers), chance, one.lacks))
    ranked = _ranked(weak)
    held = [w for w in ranked if any(w.one is a for a in search.refused)]
    return [*held, *(w for w in ranked if w not in held)]


def _ranked(candidates: Sequence[WeakCandidate]) -> list[WeakCandidate]:
    """Return the candidates with enough evidence, the strongest first; of equals, the more common cause first."""
    slugs = {w.one.effect.slug for w in candidates}
    enough = []
    for own in (w for w in candidates if w.size >= _least(w.one.effect) and w.chance <= RARE):
        near = [w for w in candidates if w is not own and abs(w.size - own.size) < ALIKE]
        names = (name_of(w.one.effect) for w in sorted(near, key=lambda w: -w.size))
        enough.append(replace(own, alike=tuple(n for n in dict.fromkeys(names) if n != name_of(own.one.effect))))
    return sorted(enough, key=lambda w: (-w.size, len(slugs & set(EFFECTS[w.one.effect.slug].yields_to))))


def _least(effect: EffectInstance) -> float:
    """Return the least evidence that makes an effect a hint.

    External effects that depend on heading, position or time resemble a drifting force. They need more evidence.
    """
    outside = EFFECTS[effect.slug].family == "environment" and effect.slug not in CONSTANT
    return ENOUGH if outside else FAINT


def _hint(search: Search, own: WeakCandidate, segments: Sequence[Segment]) -> Hint:
    seconds = sum(float(s.stamps[-1]) - s.start for s in segments)
    runs = max(1, len({s.run for s in segments}))
    effect = own.one.effect
    return Hint(
        effect.slug,
        effect.place,
        EFFECTS[effect.slug].meaning,
        search.values(effect, own.one.fit),
        own.one.gained,
        tuple(own.one.parts.tolist()),
        search.words,
        own.chance,
        own.lacks,
        own.alike,
        seconds,
        # Evidence grows with the length of the runs; where there is enough of it, another run has to confirm it.
        seconds * (ENOUGH / own.size if own.size < ENOUGH else 1.0 + 1.0 / runs),
        EFFECTS[effect.slug].separated_by,
    )
