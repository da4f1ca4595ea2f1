"""The strategies of a search, each ``SearchState -> SearchState | None``; None means that nothing was added.

:data:`SEARCH` lists the strategies for whole runs, and :func:`follow` applies them in order. If they find nothing, the
strategies of ``retries`` search again.

===========================  =========================================================================================
``add_causes``               add one cause after the other; compare each earlier one with its rivals again
``start_at_segments``        if the base diverged, start again with causes fitted in short pieces of the runs
``tie_break``                of causes that explain the runs equally well, report the most common
``drop_explained_moments``   drop causes at one time that a recorded command explains as well
``drop_insignificant``       drop causes whose intervals include no effect
===========================  =========================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gcs_autotune.clock import OutOfTime, check_effort
from gcs_autotune.diagnose.adequacy import (
    correlation_of,
    explains_all,
    leaves_nothing,
    tests_of,
    whiteness_of,
)
from gcs_autotune.diagnose.candidates import RUNNERS, best_of_each
from gcs_autotune.diagnose.heldout import parts_of
from gcs_autotune.diagnose.least_squares_scorer import LeastSquares
from gcs_autotune.diagnose.process_noise import above_the_command
from gcs_autotune.diagnose.score import (
    ALIKE,
    SIGNIFICANCE,
    CandidateScore,
    SearchStep,
    bic_penalty,
    is_form_of,
    is_needed,
    key_of,
    ordered,
)
from gcs_autotune.diagnose.search import add_one_by_one, judge
from gcs_autotune.diagnose.search_with_noise import needs_process_noise
from gcs_autotune.diagnose.starting_points import segment_starts
from gcs_autotune.diagnose.state import NOT_BEGUN, SearchState
from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, columns_of, effect_words, may_be_none, name_of
from gcs_autotune.identify.problems import Fitted, Problem
from gcs_autotune.sname import DOFS

__all__ = [
    "SEARCH",
    "Strategy",
    "blocked_cv",
    "drop_insignificant",
    "follow",
]

Strategy = Callable[[SearchState], SearchState | None]

MOST_CAUSES = 6
"""Maximum number of causes; an instrumented craft usually has three or four."""

DONE = 0.5
"""Whiteness p-value above which only disturbances are still tried."""

RESTARTS = 3
"""Maximum number of restarts of a step after it has led to a better fit of the model before it."""

CALM = 0.2
"""Ratio of drifting force to commanded force up to which a free simulation may still explain the runs."""

FOLLOWED, FARTHEST = 3, 3
"""FOLLOWED: number of candidates that are combined with a second one if none helps alone. FARTHEST: largest number of
causes per path.
"""

RIVALS = 9
"""Number of candidates fitted roughly when an earlier cause is compared with its rivals."""


def follow(state: SearchState, strategies: Sequence[Strategy]) -> SearchState:
    """Apply all *strategies* in order and return the final state.

    If the search is stopped, ``cut`` of the returned state describes where.
    """
    for strategy in strategies:
        try:
            check_effort(f"{NOT_BEGUN}{strategy.__name__.replace('_', ' ')}")
            state = strategy(state) or state
        except OutOfTime as over:
            state = state.stopped(over)
    return state


# -- cause after cause


def add_causes(state: SearchState, first: SearchStep[Fitted] | None = None) -> SearchState:
    """Return the state after adding one cause after the other, until no cause is accepted or the search is stopped.

    first : the next step, if it is already scored.
    """
    known = iter(() if first is None else (first,))
    return add_one_by_one(state, MOST_CAUSES, lambda now: _one_more(now, next(known, None)), backward_elimination)


def _one_more(state: SearchState, judged: SearchStep[Fitted] | None) -> SearchState:
    """Return the state after one more step, or after several steps if causes only help together.

    judged : the step, if it is already scored.
    """
    stage = f"cause {len(state.steps) + 1}"
    white = whiteness_of(tests_of(state.problem, state.fitted))
    if judged is None:
        some = [s for s in state.question.slugs if EFFECTS[s].is_disturbance] if state.steps and white > DONE else None
        state, step = state.step(stage, slugs=some)
    else:
        step = judged
    if step.accepted is None:
        state, step = blocked_cv(state, step) or (state, step)
    taken: tuple[SearchStep[Fitted], ...] = (step,)
    if step.accepted is None and white < SIGNIFICANCE:
        # With a drifting force every pair looks as good as the next, and there are many. Several causes without any
        # such force look like one, too, and only they leave nothing when all are known.
        state, adrift = needs_process_noise(state)
        try:
            state, ahead = _look_ahead(state, step, stage, adrift=adrift)
            taken = taken if ahead is None else ahead
        except OutOfTime as over:  # the search with process noise is kept: it takes long
            state = state.stopped(over)
    accepted = taken[-1].accepted
    if accepted is None:
        return replace(state, steps=(*state.steps, *taken))
    better = _without(state, accepted.fit)
    if better is not None:
        state = state.with_better(better)
        again = state.scorer(better).score(accepted.effect, accepted.fit)
        if again.lacks is None:
            accepted = again
            taken = (*taken[:-1], replace(taken[-1], accepted=again))
        elif state.restarts < RESTARTS:
            return _one_more(replace(state, restarts=state.restarts + 1), None)
    state = replace(state, steps=(*state.steps, *taken))
    return state.with_model(accepted.fit, accepted.unseen)


def _without(state: SearchState, fitted: Fitted) -> Fitted | None:
    """Return a better fit of the present model, started where a winner's fit ended; None if it is not better.

    A cause that only helps a fit to leave a local minimum must not get the credit for the better minimum.
    """
    present = state.fitted
    again = state.problem.fit(fitted.theta, present.effects, fitted.initial, shift=fitted.shift)
    return again if again is not None and again.cost < present.cost - ALIKE else None


def blocked_cv(state: SearchState, step: SearchStep[Fitted]) -> tuple[SearchState, SearchStep[Fitted]] | None:
    """Return the state after scoring a step again with blocks of every run held out, instead of whole runs.

    If each run has commands of one size only, no run predicts the next although one cause explains all. Return None if
    no candidate is accepted in this way either.
    """
    present = state.fitted
    if state.parts.kind != "runs" or leaves_nothing(state.problem, present):
        return None
    if not explains_all(state.problem, step):
        return None
    now = state.with_parts(parts_of(state.problem, in_blocks=True))
    paying = [j for j in step.judged if j.evidence > 0.0]
    scorer = now.scorer(present)
    again = ordered([scorer.score(j.effect, j.fit) for j in paying])
    winner = scorer.winner(again)
    return None if winner is None else (now, SearchStep(present, tuple(again), winner))


# -- causes that improve the prediction only together


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """Causes in the order added, and the step of each."""

    taken: tuple[CandidateScore[Fitted], ...]
    steps: tuple[SearchStep[Fitted], ...]

    def price(self, present: Fitted) -> float:
        """Return the cost of the path's last fit, including that of its additional parameters."""
        end = self.taken[-1].fit
        return end.cost + bic_penalty(end, present)


def _look_ahead(
    state: SearchState, step: SearchStep[Fitted], stage: str, *, adrift: bool
) -> tuple[SearchState, tuple[SearchStep[Fitted], ...] | None]:
    """Return steps whose causes help together; return None if no combination does.

    step : the step in which no cause helped. adrift : whether a drifting force may explain the residual as well. Only
        causes that leave nothing but noise are then accepted.

    If two things are wrong, correcting one may not improve the prediction, because the predicted position drifts in
    either case. The correction may not even make up for its parameter: quadratic drag and thrust curve nearly cancel.
    Such causes are followed only if the result must leave nothing. The likeliest causes are each combined with the best
    next one, by likelihood alone. If the best pair does not help either, a third cause is added.
    """
    paths: list[_Path] = []
    least = -ALIKE if adrift else 0.0
    likely = [j for j in step.judged if j.evidence > least and not state.scorer().follows_a_command(j.effect, j.fit)]
    for one in likely[:FOLLOWED]:
        state, path = _followed(state, _Path((one,), (step,)), stage)
        paths += [] if path is None else [path]
    path = min(paths, key=lambda p: p.price(state.fitted), default=None)
    while path is not None:
        length, end = len(path.taken), path.taken[-1]
        tried = math.comb(max(state.tried, length), length)
        scorer = state.scorer(tried=tried)
        whole = scorer.score(end.effect, end.fit)
        if scorer.winner([whole]) is not None and (not adrift or leaves_nothing(state.problem, whole.fit)):
            return state, _accepted(path, whole, scorer)
        state, path = _followed(state, path, stage) if length < FARTHEST else (state, None)
    return state, None


def _followed(state: SearchState, path: _Path, stage: str) -> tuple[SearchState, _Path | None]:
    """Return the path with the likeliest next cause; return None if no cause adds to it.

    Disturbances are excluded: a filter that learns from the residual predicts any ringing of a wrong model.
    """
    slugs = [s for s in state.question.slugs if not EFFECTS[s].is_disturbance]
    state, step = state.step(f"{stage} with one more cause", path.taken[-1].fit, slugs=slugs, quick=True)
    if not step.judged or step.judged[0].evidence <= 0.0:
        return state, None
    return state, _Path((*path.taken, step.judged[0]), (*path.steps, step))


def _accepted(path: _Path, whole: CandidateScore[Fitted], scorer: LeastSquares) -> tuple[SearchStep[Fitted], ...]:
    """Return the steps of a path with its causes accepted and the numbers of its final fit.

    In the last step, the evidence is that beside the causes before it, for the cause and its rivals alike. The rivals
    that the fitted runs do not distinguish from it are scored on held-out data too.
    """
    now = {(e.slug, e.place): e for e in whole.fit.effects}
    steps = []
    for taken, step in zip(path.taken[:-1], path.steps[:-1], strict=True):
        ended = replace(taken, effect=now[taken.effect.slug, taken.effect.place])
        steps.append(replace(step, judged=tuple(ended if j is taken else j for j in step.judged), accepted=ended))
    best, last = path.taken[-1], path.steps[-1]
    others = [
        replace(scorer.score(j.effect, j.fit), evidence=j.evidence) if best.evidence - j.evidence < ALIKE else j
        for j in last.judged
        if j is not best
    ]
    winner = replace(whole, evidence=best.evidence)
    return (*steps, replace(last, judged=(winner, *others), accepted=winner))


# -- earlier causes reconsidered


def backward_elimination(state: SearchState) -> SearchState:
    """Return the state after comparing every earlier cause with its rivals again, with the other causes present.

    A cause accepted early may have represented two others. The newest cause is compared again only if an earlier one
    has changed since.
    """
    state = _without_plainer_law(plain_constants(state) or state)
    newest, won = state.steps[-1].accepted, state.fitted
    last = None if newest is None else (newest.effect.slug, newest.effect.place)
    for key in sorted(((e.slug, e.place) for e in state.causes), key=lambda k: k == last):
        if key != last or state.fitted is not won:
            state = _recheck(state, *key)
    return state


def _without_plainer_law(state: SearchState) -> SearchState:
    """Return the state without the plainer laws of the newest cause, if they are not needed beside it.

    Beside a plainer law, the special one describes only what that law leaves of the same cause. It is therefore fitted
    again from its own start values and from those of the plainer law.
    """
    kept, accepted = state.fitted, state.steps[-1].accepted
    key = None if accepted is None else key_of(accepted.effect)
    newest = next((e for e in kept.effects if key_of(e) == key), None)
    plainer = [e for e in state.causes if newest is not None and is_form_of(newest, e)]
    if newest is None or not plainer:
        return state
    rest = tuple(e for e in kept.effects if e is not newest and e not in plainer)
    starts = [newest.with_values(s) for s in EFFECTS[newest.slug].starts(newest.place, state.problem.data_summary)]
    known = {n: v for e in plainer for n, v in e.values.items() if n in newest.values}
    tried = {tuple(own.values.items()): own for start in starts for own in (start.with_values(known), start)}
    fits = (
        state.problem.fit(kept.theta, (*rest, own), kept.initial, trials=30, shift=kept.shift)
        for own in (newest, *tried.values())
    )
    alone = min((f for f in fits if f is not None), key=lambda f: f.cost, default=None)
    if alone is None or is_needed((alone.cost - kept.cost) / correlation_of(kept), kept, alone, state.tried):
        return state
    return state.with_model(alone)


def _recheck(state: SearchState, slug: str, place: str) -> SearchState:
    """Remove a cause that is no longer needed, or replace it by a likelier one."""
    kept = state.fitted
    rest = tuple(e for e in kept.effects if (e.slug, e.place) != (slug, place))
    if len(rest) == len(kept.effects):
        return state
    without = state.problem.fit(kept.theta, rest, kept.initial, trials=12, shift=kept.shift)
    if without is None:
        return state
    likelihood = (without.cost - kept.cost) / correlation_of(kept)
    if not is_needed(likelihood, kept, without, state.tried):
        return state.with_model(without)
    slugs = [s for s in state.question.slugs if not EFFECTS[s].is_disturbance]
    state, again = state.step(
        f"check whether {effect_words(slug)} is still needed", without, slugs=slugs, quick=True, most=RIVALS
    )
    rivals = [j for j in again.judged if j.effect.slug != slug and not EFFECTS[j.effect.slug].happens_at]
    fits = [_likelier_fit(state.problem, kept, rest, j) for j in rivals]
    rival = min(fits, key=lambda f: f.cost + bic_penalty(f, kept), default=kept)
    likelihood = (kept.cost - rival.cost) / correlation_of(kept)
    if likelihood - bic_penalty(rival, kept) > ALIKE:
        return state.with_model(rival)
    return state


def _likelier_fit(
    problem: Problem, kept: Fitted, rest: tuple[EffectInstance, ...], rival: CandidateScore[Fitted]
) -> Fitted:
    """Return the fit of *rival*, or the one started at the values of *kept*, whichever is better.

    Without the cause in question the other values may have moved far. A rival fitted from there may stay there.
    """
    again = problem.fit(kept.theta, (*rest, rival.effect), kept.initial, trials=12, shift=kept.shift)
    return again if again is not None and again.cost < rival.fit.cost else rival.fit


CONSTANT = "input-bias"
"""Slug of the plainest of the causes that act like a constant force."""

HEADING_DEPENDENT = frozenset({"wind-moment", "tether-pull"})
"""Slugs of causes that are constant forces to runs of few headings."""


def plain_constants(state: SearchState) -> SearchState | None:
    """Replace all forces that depend on the heading by one constant, if the runs do not refute it.

    They are one family of laws with the constant. Two of them may cancel but for a constant.
    """
    dependent = [e for e in state.causes if e.slug in HEADING_DEPENDENT and CONSTANT in state.question.slugs]
    if not dependent:
        return None
    now, data, place = state.fitted, state.problem.data_summary, dependent[0].place
    others = tuple(e for e in now.effects if e not in dependent)
    if place not in EFFECTS[CONSTANT].places(data):
        return None
    if all((e.slug, e.place) != (CONSTANT, place) for e in others):
        others = (*others, EffectInstance(CONSTANT, place, dict(EFFECTS[CONSTANT].starts(place, data)[0])))
    fit = state.problem.fit(now.theta, others, now.initial, trials=12, shift=now.shift)
    if fit is None or (fit.cost - now.cost) / correlation_of(now) - bic_penalty(now, fit) > ALIKE:
        return None
    return state.with_model(fit)


def drop_explained_moments(state: SearchState) -> SearchState | None:
    """Return the state without a cause that happens at one time if, with all others present, a recorded command
    explains the runs as well.
    """
    effect = next((e for e in state.causes if state.scorer().follows_a_command(e, state.fitted)), None)
    rest = tuple(e for e in state.fitted.effects if e is not effect)
    fit = state.fitted
    without = None if effect is None else state.problem.fit(fit.theta, rest, fit.initial, shift=fit.shift)
    return None if without is None else state.with_model(without)


def drop_insignificant(state: SearchState) -> SearchState | None:
    """Return the state without the causes whose 95 % intervals include no effect.

    The fit without the cause starts at the present numbers and at those of the base. The cause may have replaced part
    of the base: for example, thrust that falls with turn rate replaces damping. The present numbers are then a bad
    start.
    """
    fit = state.fitted
    idle = next((e for e in state.causes if _may_be_none(fit, e)), None)
    if idle is None:
        return None
    rest = tuple(e for e in fit.effects if e is not idle)
    begins = ((fit.theta, fit.initial), (state.base.theta, state.base.initial))
    fits = (state.problem.fit(theta, rest, initial, shift=fit.shift) for theta, initial in begins)
    without = min((f for f in fits if f is not None), key=lambda f: f.cost, default=None)
    if without is None:
        return None
    fewer = state.with_model(without)
    return drop_insignificant(fewer) or fewer


def _may_be_none(fitted: Fitted, effect: EffectInstance) -> bool:
    return may_be_none(effect, fitted.errors_in(fitted.covariance(correlation_of(fitted)), effect))


# -- causes found in pieces where whole runs are lost


def start_at_segments(state: SearchState) -> SearchState | None:
    """Return a search started again with causes from pieces of the runs, if the base diverged and much is unexplained.

    Causes fitted in short pieces are expensive, and most diverged bases recover without them. The result is accepted if
    it leaves less unexplained.
    """
    lost = state.lost
    if lost is None or leaves_nothing(state.problem, state.fitted):
        return None
    state, adrift = needs_process_noise(state)
    search = None if state.noise_search is None else state.noise_search[1]
    rough = adrift and search is not None and above_the_command(search) > CALM
    if rough and search is not None and search.accepted and _is_all(search.dof, state.problem):
        return state
    try:
        state.question.say("in pieces", 0, 1)
        held = segment_starts(state.problem, lost.base, state.question.slugs, state.question.executor)
        ends = best_of_each([*lost.ends, *state.scorer().to_the_end(held)], lost.base)[:RUNNERS]
        if all(any(fit is old for _, old in lost.ends) for _, fit in ends):
            return state
        unseen = state.base_unseen if lost.base is state.base else state.unseen(lost.base)
        restarted = replace(state, steps=()).with_model(lost.base, unseen)
        other = add_causes(restarted, judge(restarted.scorer(lost.base, lost.tried), ends))
    except OutOfTime as over:  # the search with process noise is kept: it takes long
        return state.stopped(over)
    now, before = (s.fitted.cost + bic_penalty(s.fitted, lost.base) for s in (other, state))
    return other if now < before else replace(state, cut=other.cut)


def _is_all(dof: str, problem: Problem) -> bool:
    """Return whether only one motion was measured, so that its causes contain no information on coupling."""
    own = DOFS[dof]
    return set(problem.data_summary.signals) <= {own.velocity, own.position}


# -- equals


def tie_break(state: SearchState) -> SearchState:
    """Return the state in which more common causes replace those that explain the runs equally well, with the
    alternatives recorded.
    """
    for key in [(e.slug, e.place) for e in state.causes]:
        # As it is now: the fit of the one before it may have changed its numbers.
        effect = next(e for e in state.causes if (e.slug, e.place) == key)
        usual = _as_likely(state.problem, state.fitted, effect, EFFECTS[effect.slug].yields_to)
        if usual is not None:
            renamed = (*state.renamed, (name_of(usual[0]), name_of(effect)))
            state = replace(state, renamed=renamed).with_model(usual[1])
    for effect in state.causes:
        for slug, entry in EFFECTS.items():
            if effect.slug not in entry.yields_to:
                continue
            rival = _as_likely(state.problem, state.fitted, effect, (slug,))
            if rival is not None:
                state = replace(state, renamed=(*state.renamed, (name_of(effect), name_of(rival[0]))))
    return state


def _as_likely(
    problem: Problem, now: Fitted, effect: EffectInstance, slugs: Sequence[str]
) -> tuple[EffectInstance, Fitted] | None:
    """Return the first effect of *slugs* that explains the runs as well in place of *effect*, with its fit."""
    for slug in slugs:
        for other in _in_other_words(effect, slug, problem.data_summary):
            if any((e.slug, e.place) == (other.slug, other.place) for e in now.effects):
                continue
            effects = tuple(other if e is effect else e for e in now.effects)
            fit = problem.fit(now.theta, effects, now.initial, trials=12, shift=now.shift)
            if fit is not None and (fit.cost - now.cost) / correlation_of(now) < ALIKE:
                return other, fit
    return None


def _in_other_words(effect: EffectInstance, slug: str, data: DataSummary) -> list[EffectInstance]:
    """Return the effect *slug* at every place, as a replacement for *effect*; both must have a single number.

    It starts with the same number where its bounds allow that. At the place of *effect* it also starts with its own
    start values, because the same number may mean something else.
    """
    entry = EFFECTS[slug]
    if len(effect.values) != 1 or len(entry.parameters) != 1:
        return []
    name, value = entry.parameters[0].name, next(iter(effect.values.values()))
    replacements = []
    for place in entry.places(data):
        low, high = entry.bounds(place, data).get(name, (-math.inf, math.inf))
        starts = [{name: value}] if low <= value <= high else []
        if effect.place in (place, *columns_of(place)):
            starts += [dict(start) for start in entry.starts(place, data)]
        replacements += [EffectInstance(slug, place, start, dict(entry.constants(place, data))) for start in starts]
    return replacements


SEARCH: tuple[Strategy, ...] = (
    add_causes,
    start_at_segments,
    drop_explained_moments,
    tie_break,
    drop_insignificant,
)
"""Strategies that search for causes, in order."""
