"""From a finished search to what is told of it: verdict, numbers with their errors, gains, ties, what to fly next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import Budget
from gcs_autotune.diagnose.adequacy import WHITE, correlation_of, nonparametric_rivals
from gcs_autotune.diagnose.attested import Attested
from gcs_autotune.diagnose.day_to_day import doubt_of_days
from gcs_autotune.diagnose.evidence import hints_of, own_gain, surest
from gcs_autotune.diagnose.heldout import gains_of, rms_of
from gcs_autotune.diagnose.missing_force import next_of, words_of
from gcs_autotune.diagnose.residual_analysis import portraits_of, signature_of
from gcs_autotune.diagnose.result import Cause, Diagnosis, ErrorReduction, Ranked, Signature, Value, Verdict
from gcs_autotune.diagnose.score import ALIKE, HALF, LUCK, Judged, is_form_of
from gcs_autotune.diagnose.state import NOT_BEGUN, SearchState
from gcs_autotune.diagnose.weathered import (
    gains_under,
    missing_under,
    numbers_under,
    order_under,
    ranking_under,
    shares_under,
    values_under,
)
from gcs_autotune.effects import EFFECTS, VELOCITY_PRODUCT, EffectInstance, EffectResidual, name_of, twins_of
from gcs_autotune.identify import Doubt, Fitted, Problem, reversed_input
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["build_report", "unfinished_report"]

Array = NDArray[np.float64]

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


ONE_SIDED = 1.645
"""Standard errors above which one in twenty lies."""

SEEN_TO_SETTLE = 3.0
"""Samples a rate must take to follow a step by two thirds, for the inertia to be seen at all."""

LIKE_SAMPLES = 10.0
"""Chosen: samples within which a force that wanders may be taken for the craft's own pace, and that for its."""


def build_report(
    state: SearchState,
    doubts: Sequence[Doubt],
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    *,
    sure: bool = True,
) -> Diagnosis:
    """Return what there is to tell of a search that has ended; *sure*: its causes hold over whole runs.

    Raises
    ------
    OutOfTime
        Within an :class:`.Budget` that is used up.
    """
    state = _without_useless(state)
    problem, final, numbers = state.problem, state.fitted, state.numbers
    base = state.base if state.given is None else state.given
    left = signature_of(problem, final)[0]
    gave_away = signature_of(problem, base)[0]
    weather = state.weather
    order = [effect for effect in _found_order(state) if effect in final.effects]
    missing = None if weather is None else missing_under(weather, state)
    # Beneath weather a free run is lost, and laws fitted to it tell of that; the missing force is told by its curves.
    rivals = nonparametric_rivals(problem, final) if weather is None else ()
    left = replace(left, findings=(*left.findings, *rivals))
    if weather is not None:
        left = replace(left, findings=(*words_of(weather, missing), *left.findings))
    white = left.whiteness_p > WHITE and not rivals
    wrong = numbers is not None and bool(numbers.wrong)
    verdict = VERDICTS[wrong, bool(order), white and sure]
    values = _values(problem, final) if weather is None else values_under(weather, state)
    words = state.parts.words + ("" if state.pieces is None else f"; in pieces of {state.pieces:.3g} s")
    if weather is None:
        gains = gains_of(state.base_unseen, state.present_unseen, words) if order else ()
        alike = _alike(state, order)
        shares = {(e.slug, e.place): _share(state, e) for e in order}
        own_gains = _own_gains(state, order, gains)
    else:
        # Of a single cause what it gains is known.
        gains = tuple(state.own_gains.values()) if len(order) == 1 else gains_under(weather) if order else ()
        alike = weather.alike
        shares = shares_under(weather)
        own_gains = dict(state.own_gains)
    return Diagnosis(
        verdict=verdict,
        causes=tuple(
            Cause(
                effect,
                values[effect.slug, effect.place],
                EFFECTS[effect.slug].meaning,
                shares.get((effect.slug, effect.place), math.nan),
                EFFECTS[effect.slug].curve(effect, problem.data_summary),
                None if EFFECTS[effect.slug].is_disturbance else own_gains.get((effect.slug, effect.place)),
            )
            for effect in order
        ),
        ranking=_ranking(state) if weather is None else ranking_under(weather, state),
        indistinguishable=alike,
        gain=min(gains, key=lambda g: g.ratio, default=None),
        gains=gains,
        base_model=replace(base.model, amplitude=problem.data_summary.full, units=problem.data_summary.inputs),
        extended_model=replace(final.model, amplitude=problem.data_summary.full, units=problem.data_summary.inputs),
        next_manoeuvre=(None if order and alike else next_of(missing)) or _next(order, alike, verdict),
        left=left,
        gave_away=gave_away,
        before=portraits_of(problem, base),
        after=portraits_of(problem, final) if order or wrong else (),
        used=tuple(r.name for r in runs),
        held_out=tuple(r.name for r in unseen),
        noise=dict(final.levels),
        tried=state.tried if weather is None else weather.tried,
        seconds=math.nan,
        doubts=(
            *doubts,
            *state.doubts,
            *_other_places(state, order),
            *_reversed(state),
            *_weightless(state),
            *_by_interval(state),
            *(() if missing is None else doubt_of_days(missing.dof, missing.unit, missing.days)),
        ),
        numbers=numbers,
        missing=missing,
        hints=hints_of(state, order, lambda one: _values_of(state, one)),
    )


def _values_of(state: SearchState, one: Attested | Judged) -> Mapping[str, Value]:
    """Return the numbers of a candidate with their standard errors, in the base model's units."""
    if isinstance(one, Attested):
        assert state.weather is not None
        return numbers_under(one, state.weather, state)
    return _values(state.problem, one.fitted)[one.effect.slug, one.effect.place]


def _without_useless(state: SearchState) -> SearchState:
    """Return the state without causes, where all of them together lower no error on data left out.

    Each paid when it came; second thoughts, or other data left out since, may have taken that away.
    """
    if state.weather is not None or not state.causes:
        return state
    if any(EFFECTS[e.slug].is_disturbance for e in state.causes):
        return state
    gains = gains_of(state.base_unseen, state.present_unseen, state.parts.words)
    if not gains or any(g.ratio < 1.0 for g in gains):
        return state
    names = ", ".join(f"{e.slug} of {e.place}" for e in state.causes)
    doubt = Doubt(
        "no-gain",
        f"{names} fits the runs given and lowers no error on data left out, so it is not identified as a cause",
        "fly the same manoeuvre again, and another one, and diagnose all runs together",
    )
    return replace(
        state, fitted=state.base, present_unseen=state.base_unseen, renamed=(), doubts=(*state.doubts, doubt)
    )


def _own_gains(
    state: SearchState, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
) -> dict[tuple[str, str], ErrorReduction]:
    """Return what each cause gained on data left out when it was found, of a single one what it gains now."""
    if len(order) == 1:
        whole = surest(gains)
        return {} if whole is None else {(order[0].slug, order[0].place): whole}
    found, before = {}, state.base_unseen
    for step in state.steps:
        if step.accepted is None or step.accepted.unseen is None:
            continue
        own = own_gain(before, step.accepted.unseen, state.parts.words)
        before = step.accepted.unseen
        if own is not None:
            found[step.accepted.effect.slug, step.accepted.effect.place] = own
    return found


def _reversed(state: SearchState) -> list[Doubt]:
    """Return a doubt where commands act opposite to their names: thruster labels exchanged, say."""
    final, weather = state.fitted, state.weather
    form, model = final.model.base.form, final.model.base
    values = {n: model[n] for n in form.parameters}
    spread = np.sqrt(np.maximum(np.diag(final.covariance(correlation_of(final))), 0.0))
    std = dict(zip(final.free, spread[: len(final.free)].tolist(), strict=True))
    if weather is not None:
        # A free run of rough water knows the gain badly; the filter's has its own error.
        gain = f"k_{DOFS[weather.dof].force}"
        if gain in std:
            values[gain], std[gain] = float(weather.fit.theta[0]), math.sqrt(max(weather.fit.covariance[0, 0], 0.0))
    doubt = reversed_input(form, values, std)
    return [] if doubt is None else [doubt]


def _weightless(state: SearchState) -> list[Doubt]:
    """Return a doubt for every degree of freedom that follows its commands faster than the record could show."""
    model, interval = state.fitted.model.base, state.problem.data_summary.interval
    found = []
    for i, dof in enumerate(model.form.dofs):
        d = DOFS[dof]
        damping = f"{d.force}_{d.velocity}"
        if damping not in model.form.parameters or not model[damping]:
            continue
        settles = abs(float(model.inertia[i, i]) / model[damping])
        if settles < SEEN_TO_SETTLE * interval:
            below = settles * math.exp(min(ONE_SIDED * _relative_error(state.fitted, f"{damping}dot", damping), 700.0))
            if below > SEEN_TO_SETTLE * interval:
                continue  # found so by chance: the runs allow an inertia that they would have shown
            bound = f"below {below:.2g} s (95 %)" if math.isfinite(below) else f"about {settles:.2g} s"
            memory = 0.0 if state.weather is None or state.weather.dof != dof else state.weather.fit.water.memory
            # A craft of time constant a under a force remembered for b wanders just as one of b under a force of a.
            swapped = f" (or {memory:.2g} s, as long as what else drives it is remembered: the two may change places)"
            found.append(
                Doubt(
                    "no-inertia",
                    f"these runs show no inertia in {dof}: the time constant is {bound}"
                    f"{swapped * (below < memory < LIKE_SAMPLES * interval)}, and was found within three "
                    "samples, whatever number the model has for it",
                    "take gain and delay alone from these runs; a simulator may well have no inertia there, of a craft "
                    "record faster",
                )
            )
    return found


def _by_interval(state: SearchState) -> list[Doubt]:
    """Return a doubt where the answer changes with the interval between the samples judged."""
    search = None if state.beneath is None else state.beneath[1]
    if search is None or not search.interval:
        return []
    return [
        Doubt(
            "sampling-interval",
            search.interval,
            "take the numbers for those of motion slower than that interval; what acts faster (thrusters that need "
            "time, the autopilot's filter) is in no model here: record thrust or propeller speed",
        )
    ]


def _relative_error(fitted: Fitted, *names: str) -> float:
    """Return the standard error of the ratio of two numbers of the base over that ratio, of one where one is fitted."""
    covariance = fitted.covariance(correlation_of(fitted))
    at = [
        (fitted.free.index(n), sign / fitted.model.base[n])
        for n, sign in zip(names, (1.0, -1.0), strict=True)
        if n in fitted.free
    ]
    return math.sqrt(max(sum(a * b * float(covariance[i, k]) for i, a in at for k, b in at), 0.0))


def unfinished_report(
    state: SearchState, doubts: Sequence[Doubt], runs: Sequence[Trial], unseen: Sequence[Trial], effort: Budget
) -> Diagnosis:
    """Return what there is to tell of a search that was stopped: what was tried and what is left, and no name.

    A whole search may refuse any cause that an unfinished one holds likely: by a rival tried later, by a force that
    wanders, on whole runs. effort : what it used up.
    """
    problem, base = state.problem, state.base if state.given is None else state.given
    search = None if state.beneath is None else state.beneath[1]
    ranking = (*_ranking(state), *(() if search is None else ranking_under(search, state)))
    model = replace(base.model, amplitude=problem.data_summary.full, units=problem.data_summary.inputs)
    unknown = Signature(("not looked at: the search was stopped",), math.nan)
    return Diagnosis(
        verdict="unfinished",
        causes=(),
        ranking=ranking,
        indistinguishable=(),
        gain=None,
        gains=(),
        base_model=model,
        extended_model=model,
        next_manoeuvre="",
        left=unknown,
        gave_away=unknown,
        before=portraits_of(problem, base),
        after=(),
        used=tuple(r.name for r in runs),
        held_out=tuple(r.name for r in unseen),
        noise=dict(base.levels),
        tried=state.tried,
        seconds=math.nan,
        doubts=(*doubts, _stopped(state, ranking, effort)),
    )


def _stopped(state: SearchState, ranking: Sequence[Ranked], effort: Budget) -> Doubt:
    """Return the doubt that says at what a search was stopped, what was tried and what is left."""
    later = [s.removeprefix(NOT_BEGUN) for s in dict.fromkeys(state.cut) if s.startswith(NOT_BEGUN)]
    tried = list(dict.fromkeys(r.cause for r in ranking))
    at = "" if effort.stopped.startswith(NOT_BEGUN) else f" at: {effort.stopped}"
    parts = [f"stopped{at}", f"tried to the end: {', '.join(tried) or 'nothing'}"]
    parts += [f"{NOT_BEGUN}{', '.join(later)}"] if later else []
    what = "work" if effort.by_work else "time"
    return Doubt(
        f"out-of-{what}",
        f"the search used up the {what} it was given and names nothing; {'; '.join(parts)}",
        "go on with --resume DIR, DIR the folder this search wrote; or look at fewer runs, or at the effects in "
        "question (--effects)",
    )


def _found_order(state: SearchState) -> list[EffectInstance]:
    """Return the effects of the final model in the order found; second thoughts take the place of what they replace."""
    if state.weather is not None:
        return order_under(state.weather, state)
    order: list[tuple[str, str]] = []
    for step in state.steps:
        if step.accepted is not None:
            key = (step.accepted.effect.slug, step.accepted.effect.place)
            order = [*(k for k in order if k != key), key]
    now = {(e.slug, e.place): e for e in state.fitted.effects}
    kept = [now[key] for key in order if key in now]
    given = {(e.slug, e.place) for e in state.base.effects}
    late = [e for key, e in now.items() if key not in order and key not in given]
    missing = [i for i, key in enumerate(order) if key not in now]
    for e in late:
        kept.insert(missing[0] if missing else len(kept), e)
    return kept


def _values(problem: Problem, fitted: Fitted) -> dict[tuple[str, str], dict[str, Value]]:
    covariance = fitted.covariance(correlation_of(fitted))
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    first = len(fitted.free)
    column = {key: first + k for k, key in enumerate(fitted.free_effects)}
    found = {}
    left = [
        EffectResidual(problem.segments[r.segment].run, r.signal, r.t, r.measured - r.predicted, r.measured, own_level)
        for r in fitted.rests
        for own_level in (fitted.levels[r.signal],)
    ]
    for i, own in enumerate(fitted.effects):
        entry = EFFECTS[own.slug]
        learnt = entry.uncertainty(own, left) if entry.is_disturbance else {}
        found[own.slug, own.place] = {
            n: Value(
                v,
                entry.unit_of(n, own.place, problem.data_summary),
                float(std[column[i, n]]) if (i, n) in column else learnt.get(n, 0.0 if n in entry.fixed else math.nan),
            )
            for n, v in own.values.items()
        }
    return found


def _ranking(state: SearchState) -> tuple[Ranked, ...]:
    found = []
    for k, step in enumerate(state.steps):
        for judged in step.judged:
            numbers = _values(state.problem, judged.fitted)[judged.effect.slug, judged.effect.place]
            found.append(
                Ranked(judged.effect.slug, judged.effect.place, judged.gain, judged.p, judged.evidence, numbers, k + 1)
            )
    return tuple(found)


def _alike(state: SearchState, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
    groups = []
    for step in state.steps:
        if step.accepted is None or step.accepted.effect.slug not in {e.slug for e in order}:
            continue
        best = step.accepted
        same = [name_of(best.effect), *twins_of(best.effect, state.problem.data_summary)]
        same += [name_of(j.effect) for j in step.judged if _is_alike(state, j, best)]
        names = tuple(dict.fromkeys(same))
        if len(names) > 1:
            groups.append(names)
    for usual, other in state.renamed:
        known = next((k for k, names in enumerate(groups) if usual in names or other in names), None)
        if known is None:
            groups.append((usual, other))
        else:
            groups[known] = tuple(dict.fromkeys((usual, *groups[known], other)))
    return tuple(groups)


def _is_alike(state: SearchState, other: Judged, best: Judged) -> bool:
    """Whether these runs cannot tell *other* from *best*.

    It pays on unseen data too, and its evidence is as good, or would be but for the first moments of what is late; or
    it is as likely and only pays for numbers that the runs say nothing about.
    """
    if other is best or other.gain <= 0.0 or other.p >= LUCK:
        return False
    if is_form_of(other.effect, best.effect):
        return other.evidence > HALF * best.evidence
    if best.evidence - other.evidence < ALIKE or delay_equivalence(
        best, other, state.problem.data_summary.time_constant
    ):
        return True
    return best.likelihood - other.likelihood < ALIKE and _is_vague(state, other)


def _is_vague(state: SearchState, judged: Judged) -> bool:
    """Whether some number of a candidate is less certain than its whole range."""
    entry, data_summary = EFFECTS[judged.effect.slug], state.problem.data_summary
    bounds = entry.bounds(judged.effect.place, data_summary)
    numbers = _values(state.problem, judged.fitted)[judged.effect.slug, judged.effect.place]
    spans = {n: bounds[n][1] - bounds[n][0] for n in numbers if n in bounds}
    return any(numbers[n].std > span for n, span in spans.items())


def _other_places(state: SearchState, order: Sequence[EffectInstance]) -> list[Doubt]:
    """Return a doubt for every cause of *order* that would explain the runs as well at another place.

    A heading in degrees or a turn rate divided by 57.3: between two columns, runs tell only that they disagree.
    """
    found = []
    for step in state.steps:
        won = step.accepted
        if won is None or not any((e.slug, e.place) == (won.effect.slug, won.effect.place) for e in order):
            continue
        same = [j for j in step.judged if j.effect.slug == won.effect.slug and j.effect.place != won.effect.place]
        alike = [j.effect for j in same if abs(j.fitted.cost - won.fitted.cost) < ALIKE]
        if alike:
            found.append(_elsewhere(won.effect, alike))
    return found


def _elsewhere(effect: EffectInstance, alike: Sequence[EffectInstance]) -> Doubt:
    here, others = f"{effect.place}{_digits(effect)}", " or ".join(f"{e.place}{_digits(e)}" for e in alike)
    return Doubt(
        "another-place",
        f"{effect.slug} of {here} explains these runs no better than {effect.slug} of {others}",
        f"look at the columns: {EFFECTS[effect.slug].separated_by}",
    )


def _digits(effect: EffectInstance) -> str:
    return "".join(f", {name} {value:.4g}" for name, value in effect.values.items())


def _share(state: SearchState, own: EffectInstance) -> float:
    """Return the share of the mean square error above the noise, over all signals, that this step removed."""
    for k, step in enumerate(state.steps):
        if step.accepted is None or (step.accepted.effect.slug, step.accepted.effect.place) != (own.slug, own.place):
            continue
        earlier = [s.accepted for s in state.steps[:k] if s.accepted is not None and s.accepted.unseen is not None]
        before = earlier[-1].unseen if earlier and earlier[-1].unseen is not None else state.base_unseen
        after = step.accepted.unseen
        if after is None:
            return math.nan
        base, old, new = (rms_of(h.rests) for h in (state.base_unseen, before, after))
        shares = []
        for n, level in state.fitted.levels.items():
            above = base.get(n, 0.0) ** 2 - level**2
            if above > 0.05 * level**2 and n in old and n in new:
                shares.append((old[n] ** 2 - new[n] ** 2) / above)
        return float(np.clip(max(shares, default=math.nan), 0.0, 1.0)) if shares else math.nan
    return math.nan


def _next(order: Sequence[EffectInstance], alike: Sequence[Sequence[str]], verdict: Verdict) -> str:
    """Return the manoeuvre worth flying next."""
    if alike:
        return EFFECTS[alike[0][0] if alike[0][0] in EFFECTS else VELOCITY_PRODUCT].separated_by
    if verdict in ("unexplained", "partly-explained"):
        return (
            "the same manoeuvre twice, once on the opposite heading, then a minute without any command: what repeats "
            "is the craft, what turns with the heading is wind, current or compass, what does neither is disturbance"
        )
    if order:
        return EFFECTS[order[0].slug].separated_by
    return "nothing more is needed for this model; a run with larger commands would try it harder"


LATE: Mapping[str, str] = {"input-delay": "delay", "measurement-delay": "delay", "time-offset": "offset"}
"""Slug -> by how much things are late [s]."""


def delay_equivalence(one: Judged, other: Judged, slowest: float) -> bool:
    """Whether both are about something late, and fit alike once each run has gone on for that long and a time constant
    *pace* [s] of the craft, in which it forgets where it began.
    """
    if one.effect.slug not in LATE or other.effect.slug not in LATE:
        return False
    late = slowest + max(abs(j.effect[LATE[j.effect.slug]]) for j in (one, other))
    left = [_left_after(j.fitted, late, one.fitted.levels) for j in (one, other)]
    return abs(left[0] - left[1]) < ALIKE


def _left_after(fitted: Fitted, late: float, levels: Mapping[str, float]) -> float:
    """Return the sum of squares, over *levels*, of what is left from *late* [s] after the start of each run on."""
    total = 0.0
    for rest in fitted.rests:
        known = np.isfinite(rest.judged) & (rest.t > rest.t[0] + late)
        total += float(np.sum(rest.judged[known] ** 2)) / levels[rest.signal] ** 2
    return total
