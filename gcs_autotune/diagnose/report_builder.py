"""Build the report of a finished search.

It contains the verdict, numbers with errors, gains, causes that the runs do not distinguish, and the next manoeuvre.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import Budget
from gcs_autotune.diagnose.adequacy import WHITE, correlation_of, nonparametric_rivals
from gcs_autotune.diagnose.evidence import hints_of
from gcs_autotune.diagnose.heldout import gains_of
from gcs_autotune.diagnose.missing_force import missing_of, next_of, words_of
from gcs_autotune.diagnose.residual_analysis import portraits_of, signature_of
from gcs_autotune.diagnose.result import Cause, Diagnosis, Ranked, Signature, Verdict
from gcs_autotune.diagnose.run_to_run import doubt_of_days
from gcs_autotune.diagnose.score import ALIKE, key_of
from gcs_autotune.diagnose.search import Search
from gcs_autotune.diagnose.state import NOT_BEGUN, SearchState
from gcs_autotune.effects import EFFECTS, VELOCITY_PRODUCT, EffectInstance, effect_at, effect_words
from gcs_autotune.identify import Doubt, reversed_input
from gcs_autotune.identify.problems import Fitted
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
"""Three conditions -> verdict of a diagnosis. The conditions are: the supplied model has wrong numbers; a cause was
accepted; the residual is white and no generic law is likelier.
"""


ONE_SIDED = 1.645
"""Quantile of the normal distribution for a one-sided 95 % limit, in standard errors."""

SEEN_TO_SETTLE = 3.0
"""Minimum time constant of a rate, in samples, for the inertia to be observable."""

CERTAIN = 0.05
"""Relative standard error below which also a time constant of less than :data:`SEEN_TO_SETTLE` samples, but more than
one, is observable. Project choice.
"""

LIKE_SAMPLES = 10.0
"""Time in samples below which the time constants of a drifting force and of the craft may be confused."""


def build_report(
    state: SearchState,
    doubts: Sequence[Doubt],
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    *,
    sure: bool = True,
) -> Diagnosis:
    """Return the report of a finished search.

    sure : whether its causes hold over whole runs.

    Raises
    ------
    OutOfTime
        A :class:`.Budget` around the call is used up.
    """
    state = _without_useless(state)
    problem, final, numbers = state.problem, state.fitted, state.numbers
    base = state.base if state.given is None else state.given
    left = signature_of(problem, final)[0]
    gave_away = signature_of(problem, base)[0]
    with_noise = state.with_noise
    order = [effect for effect in _found_order(state) if effect in final.effects]
    missing = None if with_noise is None else missing_of(with_noise)
    # With process noise a free run drifts off, and laws fitted to it show only that. Curves show the missing force.
    rivals = nonparametric_rivals(problem, final) if with_noise is None else ()
    left = replace(left, findings=(*left.findings, *rivals))
    if with_noise is not None:
        left = replace(left, findings=(*words_of(with_noise, missing), *left.findings))
    white = left.whiteness_p > WHITE and not rivals
    wrong = numbers is not None and bool(numbers.wrong)
    verdict = VERDICTS[wrong, bool(order), white and sure]
    search: Search = state if with_noise is None else with_noise
    gains, shares, alike = search.gains(order), search.shares(order), search.alike(order)
    own_gains = search.gains_of_each(order, gains)
    return Diagnosis(
        verdict=verdict,
        causes=tuple(
            Cause(
                effect,
                search.values(effect),
                EFFECTS[effect.slug].meaning,
                shares.get(key_of(effect), math.nan),
                EFFECTS[effect.slug].curve(effect, problem.data_summary),
                None if EFFECTS[effect.slug].is_disturbance else own_gains.get(key_of(effect)),
            )
            for effect in order
        ),
        ranking=_ranked(search),
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
        tried=search.tried,
        seconds=math.nan,
        doubts=(
            *doubts,
            *state.doubts,
            *_other_places(state, order),
            *_reversed(state),
            *_weightless(state),
            *(() if white and with_noise is None else _by_interval(state)),  # of a plain model, no longer in use then
            *(() if missing is None else doubt_of_days(missing.dof, missing.unit, missing.days)),
        ),
        numbers=numbers,
        missing=missing,
        hints=hints_of(search, order, problem.segments),
    )


def _without_useless(state: SearchState) -> SearchState:
    """Return the state without causes if all of them together reduce no held-out error.

    Each cause reduced the error when it was accepted. Later changes of the model, or of the held-out data, may have
    removed that gain.
    """
    if state.with_noise is not None or not state.causes:
        return state
    if any(EFFECTS[e.slug].is_disturbance for e in state.causes):
        return state
    gains = gains_of(state.base_unseen, state.present_unseen, state.parts.words)
    if not gains or any(g.ratio < 1.0 for g in gains):
        return state
    names = ", ".join(map(effect_at, state.causes))
    doubt = Doubt(
        "no-gain",
        f"{names} fits these runs but does not reduce the error on held-out data. It is therefore not reported as a "
        "cause",
        "repeat the manoeuvre, fly a different one too, and diagnose all runs together",
    )
    return replace(
        state, fitted=state.base, present_unseen=state.base_unseen, renamed=(), doubts=(*state.doubts, doubt)
    )


def _reversed(state: SearchState) -> list[Doubt]:
    """Return a doubt if commands act opposite to their names, for example with exchanged thruster labels."""
    final, with_noise = state.fitted, state.with_noise
    form, model = final.model.base.form, final.model.base
    values = {n: model[n] for n in form.parameters}
    spread = np.sqrt(np.maximum(np.diag(final.covariance(correlation_of(final))), 0.0))
    std = dict(zip(final.free, spread[: len(final.free)].tolist(), strict=True))
    if with_noise is not None:
        # A free run in rough water determines the gain poorly. The filter's gain has its own error.
        gain = f"k_{DOFS[with_noise.dof].force}"
        if gain in std:
            values[gain], std[gain] = with_noise.fit.gain, math.sqrt(max(with_noise.fit.covariance[0, 0], 0.0))
    doubt = reversed_input(form, values, std)
    return [] if doubt is None else [doubt]


def _weightless(state: SearchState) -> list[Doubt]:
    """Return a doubt for each degree of freedom that responds to its commands faster than the record can show."""
    model, interval = state.fitted.model.base, state.problem.data_summary.interval
    doubts = []
    for i, dof in enumerate(model.form.dofs):
        d = DOFS[dof]
        damping = f"{d.force}_{d.velocity}"
        if damping not in model.form.parameters or not model[damping]:
            continue
        settles = abs(float(model.inertia[i, i]) / model[damping])
        if settles < SEEN_TO_SETTLE * interval:
            error = _relative_error(state.fitted, f"{damping}dot", damping)
            if settles > interval and error < CERTAIN:
                continue
            below = settles * math.exp(min(ONE_SIDED * error, 700.0))
            if below > SEEN_TO_SETTLE * interval:
                continue  # found so by chance: the runs allow an inertia that they would have shown
            bound = f"below {below:.2g} s (95 %)" if math.isfinite(below) else f"about {settles:.2g} s"
            memory = (
                0.0 if state.with_noise is None or state.with_noise.dof != dof else state.with_noise.fit.noise.memory
            )
            # Time constant a and correlation time b of the force give the same motion as b and a.
            swapped = (
                f" (or {memory:.2g} s, the correlation time of the disturbance; these runs do not distinguish the two)"
            )
            doubts.append(
                Doubt(
                    "no-inertia",
                    f"these runs show no inertia in {dof}. The time constant is "
                    f"{bound}{swapped * (below < memory < LIKE_SAMPLES * interval)}. That is less than three "
                    "samples, so the value is not reliable",
                    "use only the gain and delay from these runs. For a real craft, record faster. A simulator may "
                    "have no inertia in this motion",
                )
            )
    return doubts


def _by_interval(state: SearchState) -> list[Doubt]:
    """Return a doubt if the result changes with the sampling interval of the thinned runs."""
    search = None if state.noise_search is None else state.noise_search[1]
    if search is None or not search.interval:
        return []
    return [
        Doubt(
            "sampling-interval",
            search.interval,
            "use these numbers only for motion slower than that interval. They do not cover faster dynamics "
            "(thruster lag, the autopilot's filter). To cover those, record thrust or propeller speed",
        )
    ]


def _relative_error(fitted: Fitted, *names: str) -> float:
    """Return the relative standard error of the ratio of two base parameters; a fixed parameter has no error."""
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
    """Return the report of a stopped search: what was tried, what remains to be tried, and no cause.

    No cause is reported, because a complete search may still reject it. A rival, a drifting force, or the test on whole
    runs may come later.

    effort : the work used.
    """
    problem, base = state.problem, state.base if state.given is None else state.given
    search = None if state.noise_search is None else state.noise_search[1]
    ranking = (*_ranked(state), *(() if search is None else _ranked(search)))
    model = replace(base.model, amplitude=problem.data_summary.full, units=problem.data_summary.inputs)
    unknown = Signature(("not analysed, because the search was stopped",), math.nan)
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
    """Return a doubt that states where a search was stopped, what was tried and what is left."""
    later = [s.removeprefix(NOT_BEGUN) for s in dict.fromkeys(state.cut) if s.startswith(NOT_BEGUN)]
    tried = list(dict.fromkeys(r.cause for r in ranking))
    at = "" if effort.stopped.startswith(NOT_BEGUN) else f" during: {effort.stopped}"
    parts = [f"stopped{at}", f"completed: {', '.join(tried) or 'nothing'}"]
    parts += [f"{NOT_BEGUN}{', '.join(later)}"] if later else []
    what = "work" if effort.by_work else "time"
    return Doubt(
        f"out-of-{what}",
        f"the search reached its {what} limit, so no cause is reported ({'; '.join(parts)})",
        "continue with --resume DIR, the folder that this search wrote. Or diagnose fewer runs or fewer effects "
        "(--effects)",
    )


def _found_order(state: SearchState) -> list[EffectInstance]:
    """Return the effects of the final model in the order found.

    An effect that replaced an earlier one takes its position.
    """
    search: Search = state if state.with_noise is None else state.with_noise
    order: list[tuple[str, str]] = []
    for step in search.steps:
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


def _ranked(search: Search) -> tuple[Ranked, ...]:
    """Return every candidate scored in a search."""
    return tuple(
        Ranked(
            one.effect.slug,
            one.effect.place,
            one.gain,
            one.p,
            one.evidence,
            search.values(one.effect, one.fit),
            k + 1,
            tuple(one.parts.tolist()),
            one.interval,
        )
        for k, step in enumerate(search.steps)
        for one in step.judged
    )


def _other_places(state: SearchState, order: Sequence[EffectInstance]) -> list[Doubt]:
    """Return a doubt for each cause of *order* that explains the runs equally well at another place.

    Example: a heading in degrees, or a turn rate divided by 57.3. The runs show only that the two columns disagree.
    """
    doubts = []
    for step in state.steps:
        won = step.accepted
        if won is None or not any((e.slug, e.place) == (won.effect.slug, won.effect.place) for e in order):
            continue
        same = [j for j in step.judged if j.effect.slug == won.effect.slug and j.effect.place != won.effect.place]
        alike = [j.effect for j in same if abs(j.fit.cost - won.fit.cost) < ALIKE]
        if alike:
            doubts.append(_elsewhere(won.effect, alike))
    return doubts


def _elsewhere(effect: EffectInstance, alike: Sequence[EffectInstance]) -> Doubt:
    here, others = f"{effect.place}{_digits(effect)}", " or ".join(f"{e.place}{_digits(e)}" for e in alike)
    return Doubt(
        "another-place",
        f"{effect_words(effect.slug)} on {here} explains these runs as well as on {others}",
        f"check the columns: {EFFECTS[effect.slug].separated_by}",
    )


def _digits(effect: EffectInstance) -> str:
    return "".join(f", {name} {value:.4g}" for name, value in effect.values.items())


def _next(order: Sequence[EffectInstance], alike: Sequence[Sequence[str]], verdict: Verdict) -> str:
    """Return the next manoeuvre to fly."""
    if alike:
        return EFFECTS[alike[0][0] if alike[0][0] in EFFECTS else VELOCITY_PRODUCT].separated_by
    if verdict in ("unexplained", "partly-explained"):
        return (
            "fly the same manoeuvre twice, the second time on the opposite heading, then a minute without commands. "
            "What repeats comes from the craft. What turns with the heading comes from wind, current or the compass. "
            "The rest is disturbance"
        )
    if order:
        return EFFECTS[order[0].slug].separated_by
    return "these runs show no need for another. A run with larger commands would test the model harder"
