"""What supports a cause: its own gain on data left out, and hints, which are causes supported too weakly to be named.

Evidence is the log-likelihood gained. A cause needs enough of it that noise alone would not give it in any of the
candidates tried, a gain on every part left out, and a smaller error of prediction there. A candidate that has between
three and ten nats, or more and not the rest, is a hint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune import chi_square
from gcs_autotune.diagnose.heldout import HeldOut, gains_of
from gcs_autotune.diagnose.result import ErrorReduction, Hint, Lack, Value
from gcs_autotune.diagnose.score import CandidateScore, SearchStep, key_of
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EFFECTS, EffectInstance, name_of
from gcs_autotune.identify import Fitted, WanderingFit

__all__ = [
    "ENOUGH",
    "FAINT",
    "Score",
    "Steps",
    "WeakCandidate",
    "chance_of",
    "hints_of",
    "own_gain",
    "surest",
    "weak_among",
    "worth",
]

FAINT, ENOUGH = 3.0, 10.0
"""Log-likelihood gained by one number from which on a candidate is a hint, and from which on it is named where it also
holds on data left out. Chosen: odds of twenty to one, and of twenty thousand to one."""

ALIKE = 3.0
"""Chosen: log-likelihood within which two hints are not distinguished, odds of twenty to one."""

MOST_HINTS = 3

Score = CandidateScore[Fitted] | CandidateScore[WanderingFit]
Steps = Sequence[SearchStep[Fitted] | SearchStep[WanderingFit]]


def own_gain(before: HeldOut, after: HeldOut | None, words: str) -> ErrorReduction | None:
    """Return the gain on data left out of one cause, for the signal that surely gains most; None where unknown."""
    if after is None or len(before.rests) != len(after.rests):
        return None
    return surest(gains_of(before, after, words))


def surest(gains: Sequence[ErrorReduction]) -> ErrorReduction | None:
    """Return the gain with the smallest upper end of its interval."""
    return min(gains, key=lambda g: g.ratio if math.isnan(g.ci95[1]) else g.ci95[1], default=None)


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
    """A candidate that is a hint: ``size`` of its evidence, in nats of one number, its ``chance``, what it lacks."""

    one: Score
    size: float
    chance: float
    lacks: Lack


def hints_of(
    state: SearchState, causes: Sequence[EffectInstance], values_of: Callable[[Score], Mapping[str, Value]]
) -> tuple[Hint, ...]:
    """Return the hints of a finished search, the likeliest first; *causes*: those that are identified."""
    search = state.weather
    if search is None:
        weak = weak_among(state.steps, state.tried)
    else:
        weak = weak_among(search.steps, search.tried, search.names, state.refused)
    known = {key_of(e) for e in causes}
    best = [w for w in weak if key_of(w.one.effect) not in known][:MOST_HINTS]
    return tuple(_hint(state, w, best, values_of(w.one)) for w in best)


def weak_among(
    steps: Steps, tried: int, told: Collection[str] = (), refused: Sequence[Score] = ()
) -> list[WeakCandidate]:
    """Return the candidates of the last of *steps* that are hints, none of the names *told*, and causes *refused*.

    Of so many *tried*. Left out are those of which the 95 % interval contains no effect. What was refused comes first:
    it held on the parts left out.
    """
    last: Sequence[Score] = steps[-1].judged if steps else ()
    beside = [a for a in last if name_of(a.effect) not in told]
    found = []
    for one in {key_of(a.effect): a for a in (*beside, *refused)}.values():
        if one.gain > 0.0 and one.lacks is not None and one.lacks != "uncertain":
            chance = chance_of(one.gained, one.numbers, tried)
            found.append(WeakCandidate(one, worth(one.gained, one.numbers), chance, one.lacks))
    held = [w for w in _ranked(found) if any(w.one is a for a in refused)]
    return [*held, *(w for w in _ranked(found) if w not in held)]


def _ranked(found: Sequence[WeakCandidate]) -> list[WeakCandidate]:
    """Return those of enough evidence, the strongest first, of equals the more usual cause."""
    slugs = {w.one.effect.slug for w in found}
    enough = [w for w in found if w.size >= FAINT]
    return sorted(enough, key=lambda w: (-w.size, len(slugs & set(EFFECTS[w.one.effect.slug].yields_to))))


def _hint(state: SearchState, own: WeakCandidate, best: Sequence[WeakCandidate], values: Mapping[str, Value]) -> Hint:
    seconds = sum(float(s.stamps[-1]) - s.start for s in state.problem.segments)
    runs = max(1, len({s.run for s in state.problem.segments}))
    alike = (w.one.effect.slug for w in best if w is not own and abs(w.size - own.size) < ALIKE)
    effect = own.one.effect
    return Hint(
        effect.slug,
        effect.place,
        EFFECTS[effect.slug].meaning,
        values,
        own.one.gained,
        tuple(own.one.parts.tolist()),
        state.parts.words if state.weather is None else state.weather.parts,
        own.chance,
        own.lacks,
        tuple(dict.fromkeys(alike)),
        seconds,
        # Evidence grows with the length of the runs; where there is enough of it, another run has to confirm it.
        seconds * (ENOUGH / own.size if own.size < ENOUGH else 1.0 + 1.0 / runs),
        EFFECTS[effect.slug].separated_by,
    )
