"""Fit and score candidates by least squares: simulations are compared with the fitted runs and with held-out runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.diagnose.adequacy import correlation_of
from gcs_autotune.diagnose.candidates import (
    RUNNERS,
    Attempt,
    EffectCandidate,
    best_of_each,
    fitted_roughly,
    fitted_to_the_end,
    screen,
)
from gcs_autotune.diagnose.heldout import HeldOut, Parts, held_out, p_value
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.result import Value
from gcs_autotune.diagnose.score import (
    ALIKE,
    HALF,
    LUCK,
    CandidateScore,
    bic_penalty,
    error_ratio,
    further,
    is_form_of,
    key_of,
    lack_by_error,
    lasts,
    needed_of,
    ordered,
    winner_of,
)
from gcs_autotune.diagnose.starting_points import merged, permuted_channels
from gcs_autotune.effects import EFFECTS, EffectInstance, EffectResidual
from gcs_autotune.executor import SerialExecutor
from gcs_autotune.identify.problems import Fitted, Problem

__all__ = ["SHORT_LIST", "LeastSquares", "delay_equivalence", "is_alike", "mistaken_for", "values_of"]

BRIEF = 0.4
"""Time constant of an effect, in samples of the record, below which it may be an artefact of how commands are held.

An autopilot that writes its outputs 50 times a second and logs them 10 times shows a lag of 0.02 s. The limit is below
one half, because stamps that are half a sample early are a delay of exactly that.
"""

SHORT_LIST = 18
"""Number of candidates that are fitted roughly after the screening."""

FOLLOWING = 12
"""Maximum number of iterations of a fit in which an effect is driven by a recorded command."""


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """Scorer that adds candidates to the model ``present`` and fits them by least squares.

    ``tried``: total number of candidates. ``unseen``: held-out residuals, on the held-out folds ``parts``, of the model
    that gains are relative to. ``quick``: score by the likelihood of the fitted runs only. ``begun``: fits from which
    candidates start. ``others``: further starting fits, used for errors of the data only. ``exchanges``: whether
    exchanged channels are tried.
    ``most``: number of candidates fitted roughly.
    """

    question: Question
    problem: Problem
    parts: Parts
    present: Fitted
    unseen: HeldOut
    tried: int
    stage: str = "causes"
    quick: bool = False
    begun: Sequence[Fitted] = ()
    others: Sequence[Fitted] = ()
    exchanges: bool = False
    most: int = SHORT_LIST

    @property
    def runners(self) -> int:
        """Number of candidates that are fitted to convergence."""
        return RUNNERS

    def rough(self, choices: Sequence[Sequence[EffectInstance]]) -> list[Attempt]:
        """Return the candidates after a rough fit, the best first."""
        question, stage, present = self.question, self.stage, self.present

        def screened(done: int, total: int) -> None:
            question.say(stage + ": screening", done, total)

        screened(0, len(choices))
        listed = screen(self.problem, self.begun, self.others, choices, screened, question.executor)
        if self.exchanges:
            listed = merged(listed, permuted_channels(self.problem, present, choices))
        rough: list[Attempt] = []
        fresh, passed_over = listed[: self.most], listed[self.most :]
        while fresh:
            rough = best_of_each([*rough, *self._rough(fresh)], present)
            better = bool(rough) and rough[0][1].cost < present.cost
            fresh = mistaken_for(rough[0][0].effect, passed_over) if better else []
            passed_over = [c for c in passed_over if all(c is not f for f in fresh)]
        return rough

    def _rough(self, listed: Sequence[EffectCandidate]) -> list[Attempt]:
        def report(done: int, total: int) -> None:
            self.question.say(self.stage + ": fitting", done, total)

        report(0, len(listed))
        fits = self.question.executor.map(partial(fitted_roughly, self.problem), listed, report)
        return [(c, fit) for c, fit in zip(listed, fits, strict=True) if fit is not None]

    def to_the_end(self, rough: Sequence[Attempt]) -> list[Attempt]:
        """Return the roughly fitted candidates, fitted to convergence."""

        def report(done: int, total: int) -> None:
            self.question.say(self.stage + ": final fits", done, total)

        fits = self.question.executor.map(partial(_fitted_to_the_end, self.problem), rough, report)
        return [(candidate, fit) for (candidate, _), fit in zip(rough, fits, strict=True)]

    def rebased(self, ends: Sequence[Attempt]) -> LeastSquares:
        """Return this scorer unchanged, because it searches for a better base only after a candidate is accepted."""
        return self

    def scores(self, ends: Sequence[Attempt]) -> list[CandidateScore[Fitted]]:
        """Return the scores of the converged candidates, the best first.

        For all scores, correlated samples are counted as for the best candidate.
        """
        best = min((fit for _, fit in ends), key=lambda f: f.cost + bic_penalty(f, self.present), default=self.present)
        silent = replace(self, question=replace(self.question, progress=None))

        def report(done: int, total: int) -> None:
            self.question.say(self.stage + ": held-out runs", done, total)

        executor = SerialExecutor() if self.quick else self.question.executor
        score = partial(_score_of, silent, correlation_of(best))
        return ordered(list(executor.map(score, [(c.effect, fit) for c, fit in ends], report)))

    def score(self, effect: EffectInstance, fit: Fitted, common: float | None = None) -> CandidateScore[Fitted]:
        """Return the score of a fit.

        common : number of correlated samples that count as one independent sample, equal for all rivals.
        """
        present, raised = self.present, correlation_of(fit)
        lower = present.cost - fit.cost
        score = CandidateScore(
            fit.own(effect),
            fit,
            gained=0.5 * lower / raised,
            needed=needed_of(further(fit, present), self.tried),
            numbers=fit.parameters - present.parameters,
            evidence=lower / (common or raised) - bic_penalty(fit, present),
        )
        if score.evidence > 0.0 and not self.quick:
            unseen = held_out(self.problem, self.parts, fit, refit=True)
            score = replace(score, unseen=unseen)
            if unseen.complete and self.unseen.rests:
                gain = 1.0 - error_ratio(self.unseen, unseen)
                p = p_value(self.unseen, unseen, fit.levels, raised, present.parameters, self.tried)
                score = replace(score, gain=gain, p=p)
        brief = lasts(score.effect, self.problem.data_summary) < BRIEF * self.problem.data_summary.interval
        return replace(score, lacks=lack_by_error(score, brief=brief))

    def winner(self, scores: Sequence[CandidateScore[Fitted]]) -> CandidateScore[Fitted] | None:
        """Return the best candidate that may be accepted; return None if there is none.

        An effect that happens at one time is passed over if a recorded command explains the runs as well.
        """
        left = [] if self.quick else list(scores)
        while (winner := winner_of(left)) is not None and self.follows_a_command(winner.effect, winner.fit):
            left.remove(winner)
        return winner

    def alike(self, scores: Sequence[CandidateScore[Fitted]], winner: CandidateScore[Fitted]) -> tuple[str, ...]:
        """Return an empty tuple: the alternatives depend on causes found later, so the report calculates them."""
        return ()

    def follows_a_command(self, effect: EffectInstance, fitted: Fitted) -> bool:
        """Return whether *effect* explains the runs equally well when a recorded command drives it."""
        others = fitted.without(effect)
        for own in EFFECTS[effect.slug].followers(effect, self.problem.data_summary):
            if any((e.slug, e.place) == (own.slug, own.place) for e in others):
                continue
            fit = self.problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FOLLOWING, shift=fitted.shift)
            if fit is not None and fit.cost + bic_penalty(fit, fitted) < fitted.cost + ALIKE:
                return True
        return False


def mistaken_for(effect: EffectInstance, passed_over: Sequence[EffectCandidate]) -> list[EffectCandidate]:
    """Return the candidates of *passed_over* that are easily mistaken for *effect* at its place.

    The screening may have underestimated them.
    """
    rivals = EFFECTS[effect.slug].mistaken_for
    return [c for c in passed_over if c.effect.slug in rivals and c.effect.place == effect.place]


def _score_of(scorer: LeastSquares, common: float, end: tuple[EffectInstance, Fitted]) -> CandidateScore[Fitted]:
    return scorer.score(*end, common)


def _fitted_to_the_end(problem: Problem, attempt: Attempt) -> Fitted:
    return fitted_to_the_end(problem, *attempt)


def values_of(problem: Problem, fitted: Fitted) -> dict[tuple[str, str], dict[str, Value]]:
    """Return the numbers of all effects of a fit with their standard errors."""
    covariance = fitted.covariance(correlation_of(fitted))
    values = {}
    left = [
        EffectResidual(problem.segments[r.segment].run, r.signal, r.t, r.measured - r.predicted, r.measured, own_level)
        for r in fitted.rests
        for own_level in (fitted.levels[r.signal],)
    ]
    for own in fitted.effects:
        errors, entry = fitted.errors_in(covariance, own), EFFECTS[own.slug]
        learnt = entry.uncertainty(own, left) if entry.is_disturbance else {}
        values[own.slug, own.place] = {
            n: Value(
                v,
                entry.unit_of(n, own.place, problem.data_summary),
                errors.get(n, learnt.get(n, 0.0 if n in entry.fixed else math.nan)),
            )
            for n, v in own.values.items()
        }
    return values


def is_alike(problem: Problem, other: CandidateScore[Fitted], best: CandidateScore[Fitted]) -> bool:
    """Return whether these runs do not distinguish *other* from *best*.

    *other* must help on held-out data, and its gain in log-likelihood must be equally good. If both effects cause a
    delay, a difference at the start of the runs is ignored. The cost of numbers that the runs contain no information on
    is ignored too.
    """
    if other is best or other.gain <= 0.0 or other.p >= LUCK:
        return False
    if is_form_of(other.effect, best.effect):
        return other.evidence > HALF * best.evidence
    if best.evidence - other.evidence < ALIKE or delay_equivalence(best, other, problem.data_summary.time_constant):
        return True
    return 2.0 * (best.gained - other.gained) < ALIKE and _is_vague(problem, other)


def _is_vague(problem: Problem, judged: CandidateScore[Fitted]) -> bool:
    """Return whether the standard error of some number exceeds the number's whole range."""
    entry, data_summary = EFFECTS[judged.effect.slug], problem.data_summary
    bounds = entry.bounds(judged.effect.place, data_summary)
    numbers = values_of(problem, judged.fit)[key_of(judged.effect)]
    spans = {n: bounds[n][1] - bounds[n][0] for n in numbers if n in bounds}
    return any(numbers[n].std > span for n, span in spans.items())


LATE: Mapping[str, str] = {"input-delay": "delay", "measurement-delay": "delay", "time-offset": "offset"}
"""Slug of an effect -> name of the number that is its delay [s]."""


def delay_equivalence(one: CandidateScore[Fitted], other: CandidateScore[Fitted], slowest: float) -> bool:
    """Return whether both effects cause a delay and fit equally well after the start of each run.

    The start lasts for the delay plus the craft's time constant *slowest* [s]. After that, the initial state no longer
    matters.
    """
    if one.effect.slug not in LATE or other.effect.slug not in LATE:
        return False
    late = slowest + max(abs(j.effect[LATE[j.effect.slug]]) for j in (one, other))
    left = [_left_after(j.fit, late, one.fit.levels) for j in (one, other)]
    return abs(left[0] - left[1]) < ALIKE


def _left_after(fitted: Fitted, late: float, levels: Mapping[str, float]) -> float:
    """Return the sum of squares of the residuals, relative to *levels*, without the start of each run.

    late [s] : length of the start.
    """
    total = 0.0
    for rest in fitted.rests:
        known = np.isfinite(rest.judged) & (rest.t > rest.t[0] + late)
        total += float(np.sum(rest.judged[known] ** 2)) / levels[rest.signal] ** 2
    return total
