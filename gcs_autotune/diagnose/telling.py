"""From a finished search to what is told of it: verdict, numbers with their errors, gains, ties, what to fly next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.heldout import gains_of, rms_of
from gcs_autotune.diagnose.judging import ALIKE, LUCK, Judged
from gcs_autotune.diagnose.lateness import differ_only_at_first
from gcs_autotune.diagnose.nameless import outdone_by
from gcs_autotune.diagnose.result import Cause, Diagnosis, Gain, Numbers, Ranked, Value, Verdict
from gcs_autotune.diagnose.search import Search
from gcs_autotune.diagnose.signature import portraits_of, signature_of
from gcs_autotune.diagnose.usual import other_places
from gcs_autotune.diagnose.whiteness import correlation_of
from gcs_autotune.effects import EFFECTS, EffectInstance, Leftover
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Trial

__all__ = ["WHITE", "told_of"]

Array = NDArray[np.float64]

WHITE = 0.005
"""Chance of calling a complete model incomplete."""

VERDICTS: Mapping[tuple[bool, bool, bool], Verdict] = {
    (False, True, True): "effect-found",
    (False, True, False): "partly-explained",
    (False, False, False): "unexplained",
    (False, False, True): "no-effect",
    (True, True, True): "wrong-numbers-and-effect",
    (True, True, False): "partly-explained",
    (True, False, False): "partly-explained",
    (True, False, True): "wrong-numbers",
}
"""(Numbers of the given model are wrong, some cause was accepted, what is left is white and no law without a name does
better) -> verdict."""


def told_of(
    search: Search,
    words: str,
    doubts: Sequence[Doubt],
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    seconds: float,
    *,
    numbers: Numbers | None = None,
    sure: bool = True,
) -> Diagnosis:
    """Tell of a search that has ended; *words* say what was held out, *numbers* how those of a given model compare,
    *sure* that its causes hold over whole runs.
    """
    problem, final = search.problem, search.fitted
    base = search.base if search.given is None else search.given
    gave_away, _ = signature_of(problem, base)
    left, _ = signature_of(problem, final)
    order = [own for own in _found_order(search) if own in final.effects]
    outdone = outdone_by(problem, final)
    left = replace(left, findings=(*left.findings, *outdone))
    white = left.whiteness_p > WHITE and not outdone
    wrong = numbers is not None and bool(numbers.wrong)
    verdict = VERDICTS[wrong, bool(order), white and sure]
    values = _numbers(problem, final)
    gains = gains_of(search.base_unseen, search.present_unseen, words) if order else ()
    alike = _alike(search, order)
    return Diagnosis(
        verdict=verdict,
        causes=tuple(
            Cause(
                own,
                values[own.slug, own.place],
                EFFECTS[own.slug].meaning,
                _share(search, own),
                EFFECTS[own.slug].curve(own, problem.scene),
            )
            for own in order
        ),
        ranking=_ranking(search),
        indistinguishable=alike,
        gain=_headline(gains),
        gains=gains,
        base_model=replace(base.model, amplitude=problem.scene.full, units=problem.scene.inputs),
        extended_model=replace(final.model, amplitude=problem.scene.full, units=problem.scene.inputs),
        next_manoeuvre=_next(order, alike, verdict),
        left=left,
        gave_away=gave_away,
        before=portraits_of(problem, base),
        after=portraits_of(problem, final) if order or wrong else (),
        used=tuple(r.name for r in runs),
        held_out=tuple(r.name for r in unseen),
        noise=dict(final.levels),
        tried=search.tried,
        seconds=seconds,
        doubts=(*doubts, *other_places(search, order)),
        numbers=numbers,
    )


def _found_order(search: Search) -> list[EffectInstance]:
    """Return the effects of the final model in the order found; second thoughts take the place of what they replace."""
    order: list[tuple[str, str]] = []
    for step in search.steps:
        if step.accepted is not None:
            key = (step.accepted.own.slug, step.accepted.own.place)
            order = [*(k for k in order if k != key), key]
    now = {(e.slug, e.place): e for e in search.fitted.effects}
    kept = [now[key] for key in order if key in now]
    given = {(e.slug, e.place) for e in search.base.effects}
    late = [e for key, e in now.items() if key not in order and key not in given]
    missing = [i for i, key in enumerate(order) if key not in now]
    for e in late:
        kept.insert(missing[0] if missing else len(kept), e)
    return kept


def _numbers(problem: Problem, fitted: Fitted) -> dict[tuple[str, str], dict[str, Value]]:
    covariance = fitted.covariance(correlation_of(fitted))
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    first = len(fitted.free)
    column = {key: first + k for k, key in enumerate(fitted.free_effects)}
    found = {}
    left = [
        Leftover(problem.segments[r.segment].run, r.signal, r.t, r.measured - r.predicted, r.measured, own_level)
        for r in fitted.rests
        for own_level in (fitted.levels[r.signal],)
    ]
    for i, own in enumerate(fitted.effects):
        entry = EFFECTS[own.slug]
        learnt = entry.uncertainty(own, left) if entry.is_disturbance else {}
        found[own.slug, own.place] = {
            n: Value(
                v,
                entry.unit_of(n, own.place, problem.scene),
                float(std[column[i, n]]) if (i, n) in column else learnt.get(n, 0.0 if n in entry.fixed else math.nan),
            )
            for n, v in own.values.items()
        }
    return found


def _ranking(search: Search) -> tuple[Ranked, ...]:
    found = []
    for k, step in enumerate(search.steps):
        for judged in step.judged:
            numbers = _numbers(search.problem, judged.fitted)[judged.own.slug, judged.own.place]
            found.append(
                Ranked(judged.own.slug, judged.own.place, judged.gain, judged.p, judged.evidence, numbers, k + 1)
            )
    return tuple(found)


def _alike(search: Search, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
    groups = []
    for step in search.steps:
        if step.accepted is None or step.accepted.own.slug not in {e.slug for e in order}:
            continue
        best = step.accepted
        same = [best.own.slug, *(j.own.slug for j in step.judged if _is_alike(search, j, best))]
        names = tuple(dict.fromkeys(same))
        if len(names) > 1:
            groups.append(names)
    for usual, other in search.renamed:
        known = next((k for k, names in enumerate(groups) if usual in names or other in names), None)
        if known is None:
            groups.append((usual, other))
        else:
            groups[known] = tuple(dict.fromkeys((usual, *groups[known], other)))
    return tuple(groups)


def _is_alike(search: Search, other: Judged, best: Judged) -> bool:
    """Whether these runs cannot tell *other* from *best*.

    It pays on unseen data too, and its evidence is as good, or would be but for the first moments of what is late; or
    it is as likely and only pays for numbers that the runs say nothing about.
    """
    if other is best or other.gain <= 0.0 or other.p >= LUCK:
        return False
    if best.evidence - other.evidence < ALIKE or differ_only_at_first(best, other, search.problem.scene.pace):
        return True
    return best.likelihood - other.likelihood < ALIKE and _is_vague(search, other)


def _is_vague(search: Search, judged: Judged) -> bool:
    """Whether some number of a candidate is less certain than its whole range."""
    entry, scene = EFFECTS[judged.own.slug], search.problem.scene
    bounds = entry.bounds(judged.own.place, scene)
    numbers = _numbers(search.problem, judged.fitted)[judged.own.slug, judged.own.place]
    spans = {n: bounds[n][1] - bounds[n][0] for n in numbers if n in bounds}
    return any(numbers[n].std > span for n, span in spans.items())


def _headline(gains: Sequence[Gain]) -> Gain | None:
    """Return the gain of the signal that gains most."""
    return min(gains, key=lambda g: g.ratio, default=None)


def _share(search: Search, own: EffectInstance) -> float:
    """Return the share of the mean square error above the noise, over all signals, that this step removed."""
    for k, step in enumerate(search.steps):
        if step.accepted is None or (step.accepted.own.slug, step.accepted.own.place) != (own.slug, own.place):
            continue
        earlier = [s.accepted for s in search.steps[:k] if s.accepted is not None and s.accepted.unseen is not None]
        before = earlier[-1].unseen if earlier and earlier[-1].unseen is not None else search.base_unseen
        after = step.accepted.unseen
        if after is None:
            return math.nan
        base, old, new = (rms_of(h.rests) for h in (search.base_unseen, before, after))
        shares = []
        for n, level in search.fitted.levels.items():
            above = base.get(n, 0.0) ** 2 - level**2
            if above > 0.05 * level**2 and n in old and n in new:
                shares.append((old[n] ** 2 - new[n] ** 2) / above)
        return float(np.clip(max(shares, default=math.nan), 0.0, 1.0)) if shares else math.nan
    return math.nan


def _next(order: Sequence[EffectInstance], alike: Sequence[Sequence[str]], verdict: Verdict) -> str:
    """Return the manoeuvre worth flying next."""
    if alike:
        return EFFECTS[alike[0][0]].separated_by
    if verdict in ("unexplained", "partly-explained"):
        return (
            "the same manoeuvre twice, once on the opposite heading, then a minute without any command: what repeats "
            "is the craft, what turns with the heading is wind, current or compass, what does neither is disturbance"
        )
    if order:
        return EFFECTS[order[0].slug].separated_by
    return "nothing more is needed for this model; a run with larger commands would try it harder"
