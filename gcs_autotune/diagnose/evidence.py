"""What supports a cause: its own gain on data left out, and hints, which are causes supported too weakly to be named.

Evidence is the log-likelihood gained. A cause needs enough of it that noise alone would not give it in any of the
candidates tried, a gain on every part left out, and a smaller error of prediction there. A candidate that has between
three and ten nats, or more and not the rest, is a hint where noise gives some candidate as much in one search of twenty
at most. Hints within three nats of each other are one group, for these runs do not distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gcs_autotune import chi_square
from gcs_autotune.diagnose.process_noise import CONSTANT
from gcs_autotune.diagnose.result import Hint, Lack
from gcs_autotune.diagnose.score import CandidateScore, key_of
from gcs_autotune.diagnose.search import Search
from gcs_autotune.effects import EFFECTS, EffectInstance, name_of
from gcs_autotune.identify import Segment

__all__ = [
    "ENOUGH",
    "FAINT",
    "WeakCandidate",
    "chance_of",
    "hints_of",
    "weak_among",
    "worth",
]

FAINT, ENOUGH = 3.0, 10.0
"""Log-likelihood gained by one number from which on a candidate is a hint, and from which on it is named where it also
holds on data left out. Chosen: odds of twenty to one, and of twenty thousand to one."""

RARE = 0.05
"""Chosen: chance that noise gives some candidate as much, above which none is a hint. Of 31 rough-water cases where any
candidate with three nats was one, the first was right in 17; with this, and the rule for what acts from outside, 13 of
17 (seeds 1 to 20 and 100 to 149), and in 16 the right one is in its group."""

ALIKE = 3.0
"""Chosen: log-likelihood within which two hints are not distinguished, odds of twenty to one."""

MOST_HINTS = 3


def chance_of(gained: float, numbers: int, tried: int) -> float:
    """Return the chance that noise makes the best of *tried* candidates of *numbers* gain as much log-likelihood."""
    one = chi_square.exceeded_by_chance(2.0 * max(gained, 0.0), max(numbers, 1))
    return float(-math.expm1(max(tried, 1) * math.log1p(-min(one, 1.0 - 1e-12))))


def worth(gained: float, numbers: int) -> float:
    """Return the log-likelihood that one number would gain as rarely by chance as *numbers* gain *gained*."""
    p = chi_square.exceeded_by_chance(2.0 * max(gained, 0.0), max(numbers, 1))
    return 0.5 * chi_square.threshold(p, 1) if p > 0.0 else gained


@dataclass(frozen=True, slots=True, eq=False)
class WeakCandidate:
    """A candidate that is a hint: ``size`` of its evidence, in nats of one number, its ``chance``, what it lacks.

    ``alike``: slugs of the others within :data:`ALIKE`, hints themselves or not.
    """

    one: CandidateScore[Any]
    size: float
    chance: float
    lacks: Lack
    alike: tuple[str, ...] = ()


def hints_of(search: Search, causes: Sequence[EffectInstance], segments: Sequence[Segment]) -> tuple[Hint, ...]:
    """Return the hints of a finished search over *segments*, the likeliest first; *causes*: those identified."""
    known = {key_of(e) for e in causes}
    weak = [w for w in weak_among(search) if key_of(w.one.effect) not in known][:MOST_HINTS]
    return tuple(_hint(search, w, segments) for w in weak)


def weak_among(search: Search) -> list[WeakCandidate]:
    """Return the candidates of a search's last step that are hints, and causes refused in the end.

    Left out are those of which the 95 % interval contains no effect. What was refused comes first: it held on the parts
    left out.
    """
    last = search.steps[-1].judged if search.steps and search.steps[-1].accepted is None else ()
    beside = [a for a in last if name_of(a.effect) not in search.names]
    found = []
    for one in {key_of(a.effect): a for a in (*beside, *search.refused)}.values():
        if one.gain > 0.0 and one.lacks is not None and one.lacks != "uncertain":
            chance = chance_of(one.gained, one.numbers, search.tried)
            found.append(WeakCandidate(one, worth(one.gained, one.numbers), chance, one.lacks))
    ranked = _ranked(found)
    held = [w for w in ranked if any(w.one is a for a in search.refused)]
    return [*held, *(w for w in ranked if w not in held)]


def _ranked(found: Sequence[WeakCandidate]) -> list[WeakCandidate]:
    """Return those of enough evidence, the strongest first, of equals the more usual cause."""
    slugs = {w.one.effect.slug for w in found}
    enough = []
    for own in (w for w in found if w.size >= _least(w.one.effect) and w.chance <= RARE):
        near = [w for w in found if w is not own and abs(w.size - own.size) < ALIKE]
        names = (w.one.effect.slug for w in sorted(near, key=lambda w: -w.size))
        enough.append(replace(own, alike=tuple(n for n in dict.fromkeys(names) if n != own.one.effect.slug)))
    return sorted(enough, key=lambda w: (-w.size, len(slugs & set(EFFECTS[w.one.effect.slug].yields_to))))


def _least(effect: EffectInstance) -> float:
    """Return the evidence from which on an effect is a hint.

    What goes with the heading, the place or the time from outside is much like a drifting force, so it takes more.
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
