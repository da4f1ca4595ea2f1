"""What supports a cause: its own gain on data left out, and hints, which are causes supported too weakly to be named.

Evidence is the log-likelihood gained. A cause needs enough of it that noise alone would not give it in any of the
candidates tried, a gain on every part left out, and a smaller error of prediction there. A candidate that has between
three and ten nats, or more and not the rest, is a hint where noise gives some candidate as much in one search of twenty
at most. Hints within three nats of each other are one group, for these runs do not distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gcs_autotune import chi_square
from gcs_autotune.diagnose.attested import Attested
from gcs_autotune.diagnose.heldout import HeldOut, gains_of
from gcs_autotune.diagnose.process_noise import CONSTANT, WeatherSearch
from gcs_autotune.diagnose.result import ErrorReduction, Hint, Lack, Value
from gcs_autotune.diagnose.sampling_interval import stands
from gcs_autotune.diagnose.score import LUCK, Judged, is_material, is_needed
from gcs_autotune.diagnose.state import SearchState
from gcs_autotune.effects import EFFECTS, EffectInstance, name_of

__all__ = ["ENOUGH", "FAINT", "WeakCandidate", "chance_of", "hints_of", "own_gain", "surest", "weak_under", "worth"]

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

Candidate = Attested | Judged


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
    """A candidate that is a hint: ``size`` of its evidence, in nats of one number, and the rest of what a hint has.

    ``alike``: slugs of the others within :data:`ALIKE`, hints themselves or not.
    """

    one: Candidate
    size: float
    gained: float
    unseen: tuple[float, ...]
    chance: float
    lacks: Lack
    alike: tuple[str, ...] = ()


def hints_of(
    state: SearchState, causes: Sequence[EffectInstance], values_of: Callable[[Candidate], Mapping[str, Value]]
) -> tuple[Hint, ...]:
    """Return the hints of a finished search, the likeliest first; *causes*: those that are identified."""
    weak = _weak(state) if state.weather is None else weak_under(state.weather, state.refused)
    known = {(e.slug, e.place) for e in causes}
    best = [w for w in weak if _key(w.one) not in known][:MOST_HINTS]
    return tuple(_hint(state, w, values_of(w.one)) for w in best)


def weak_under(search: WeatherSearch, refused: Sequence[tuple[Attested, Lack]] = ()) -> list[WeakCandidate]:
    """Return the candidates of the last step under process noise that are hints, and names that were *refused*.

    Left out are those of which the 95 % interval contains no effect. What was refused comes first: it held on the parts
    left out.
    """
    last_step = max((a.step for a in search.judged), default=0)
    told = {name for group in search.alike for name in group} | {name_of(a.effect) for a in search.named}
    beside = [(a, _lack(search, a)) for a in search.judged if a.step == last_step and name_of(a.effect) not in told]
    own = {(a.effect.slug, a.effect.place): (a, why) for a, why in (*beside, *refused) if not a.uncertain}
    found = []
    for one, lacks in own.values():
        if one.foretold > 0.0:
            here = [i for i, e in enumerate(one.fit.effects) if (e.slug, e.place) == _key(one)]
            numbers = sum(i in here for i, _ in one.fit.free_effects)
            chance = chance_of(one.gain, numbers, search.tried)
            unseen = tuple(one.unseen.tolist())
            found.append(WeakCandidate(one, worth(one.gain, numbers), one.gain, unseen, chance, lacks))
    ranked = _ranked(found)
    held = [w for w in ranked if any(w.one is a for a, _ in refused)]
    return [*held, *(w for w in ranked if w not in held)]


def _weak(state: SearchState) -> list[WeakCandidate]:
    """Return the candidates of the last step, where nothing was accepted, that are hints."""
    last = state.steps[-1] if state.steps else None
    found = []
    for one in () if last is None or last.accepted is not None else last.judged:
        if one.unseen is not None and one.gain > 0.0:
            numbers, gained = one.fitted.parameters - state.fitted.parameters, 0.5 * one.likelihood
            chance = chance_of(gained, numbers, state.tried)
            found.append(WeakCandidate(one, worth(gained, numbers), gained, (), chance, _lack_of(state, one)))
    return _ranked(found)


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


def _key(one: Candidate) -> tuple[str, str]:
    return one.effect.slug, one.effect.place


def _hint(state: SearchState, own: WeakCandidate, values: Mapping[str, Value]) -> Hint:
    seconds = sum(float(s.stamps[-1]) - s.start for s in state.problem.segments)
    runs = max(1, len({s.run for s in state.problem.segments}))
    effect = own.one.effect
    return Hint(
        effect.slug,
        effect.place,
        EFFECTS[effect.slug].meaning,
        values,
        own.gained,
        own.unseen,
        state.parts.words if state.weather is None else state.weather.parts,
        own.chance,
        own.lacks,
        own.alike,
        seconds,
        # Evidence grows with the length of the runs; where there is enough of it, another run has to confirm it.
        seconds * (ENOUGH / own.size if own.size < ENOUGH else 1.0 + 1.0 / runs),
        EFFECTS[effect.slug].separated_by,
    )


def _lack(search: WeatherSearch, one: Attested) -> Lack:
    if one.brief:
        return "brief"
    if one.unsound:
        return "no-gain" if stands(search.problem, one.fit) else "no-model"
    if one.gain <= one.needed:
        return "weak"
    return "not-sure" if one.interval[0] < 0.0 else "not-on-each"


def _lack_of(state: SearchState, one: Judged) -> Lack:
    if not is_needed(one.likelihood, one.fitted, state.fitted, state.tried):
        return "weak"
    if not is_material(one):
        return "no-gain"
    return "not-sure" if one.p >= LUCK else "weak"
