"""The state of a search for causes: what was asked, the model so far, and what was judged on the way to it.

A state never changes. Strategies (:mod:`.strategies`) make the next one from it, so that going back is keeping the old
one. Here is what they all do with one: predict what is left out, judge a fit, and take one step: candidates are
screened, the promising ones fitted, and the fits compared by likelihood less what their parameters cost; the winner
must pay on data left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

from gcs_autotune.clock import OutOfTime, check_effort
from gcs_autotune.diagnose.adequacy import correlation_of, tests_of, whiteness_of
from gcs_autotune.diagnose.candidates import (
    RUNNERS,
    Attempt,
    EffectCandidate,
    best_of_each,
    candidates,
    fitted_roughly,
    fitted_to_the_end,
    screen,
)
from gcs_autotune.diagnose.heldout import HeldOut, Parts, held_out, p_value, parts_of
from gcs_autotune.diagnose.process_noise import WeatherSearch
from gcs_autotune.diagnose.result import ErrorReduction, Number, Numbers
from gcs_autotune.diagnose.score import (
    ALIKE,
    CandidateScore,
    SearchStep,
    bic_penalty,
    error_ratio,
    further,
    lack_by_error,
    needed_of,
    ordered,
    winner_of,
)
from gcs_autotune.diagnose.starting_points import lost, merged, permuted_channels, without_one_signal
from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel
from gcs_autotune.executor import Executor, SerialExecutor
from gcs_autotune.identify import Doubt, Fitted, Problem, Segment, WanderingFit, fit_base, given_base
from gcs_autotune.models import Form

__all__ = [
    "NOT_BEGUN",
    "Key",
    "LostBase",
    "ModelInQuestion",
    "Progress",
    "Question",
    "SearchState",
    "begin",
    "begin_with",
    "mistaken_for",
]

Progress = Callable[[str, int, int], None]

Key = tuple[str, str, str]
"""A number of an effect: its slug, its place, its name. Of the base: two empty words and the derivative."""

NOT_BEGUN = "not begun: "
"""Begins the words for a part of the search that was not begun when it was stopped."""

SHORT_LIST = 18
"""Candidates fitted roughly."""

FOLLOWING = 12
"""Chosen: trials of a fit in which an effect follows a command."""

ASTRAY = 0.05
"""Whiteness below which errors of the data are also looked for from fits that leave out one signal."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelInQuestion:
    """The model in question, and how its owner knows it.

    ``names``: number -> (name in the owner's file, sign by which it differs from ours); ``std``: standard error of a
    number, by the name in the file, where the file states one. ``theirs``: how the plain model fits the simulator that
    this model stands for; None for a model that was given itself. ``records``: what is wrong in the simulator's file
    itself (clock, signs, units), and was set right before.
    """

    model: ExtendedModel
    names: Mapping[Key, tuple[str, float]] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    theirs: tuple[Problem, Fitted] | None = None
    records: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What is asked: runs to explain, runs kept apart, the model in question, effects to try.

    ``whole``: the runs a model found in pieces must hold for. ``horizon`` [s]: pieces asked for by whoever asks; None
    leaves that to the search. ``progress``: called with a stage, how much of it is done, and how much there is;
    ``executor``: does what can be done at the same time.
    ``weather``: whether a force that wanders may be blamed. ``one_flight``: the runs complete each other (a step and a
    relay of one tune), so that none of them predicts the other: blocks of all are left out in turn.
    """

    form: Form
    segments: Sequence[Segment]
    slugs: Sequence[str]
    unseen: Sequence[Segment] = ()
    whole: Sequence[Segment] = ()
    given: ModelInQuestion | None = None
    horizon: float | None = None
    progress: Progress | None = None
    executor: Executor = field(default_factory=SerialExecutor)
    weather: bool = True
    one_flight: bool = False

    def say(self, stage: str, done: int, total: int) -> None:
        """Report progress.

        Raises
        ------
        OutOfTime
            The work or the time given is used up.
        """
        if self.progress is not None:
            self.progress(stage, done, total)
        check_effort(f"{stage}, {done} of {total} done")


@dataclass(frozen=True, slots=True, eq=False)
class LostBase:
    """A base that misses some signal altogether, and the fits begun there, of so many candidates tried."""

    base: Fitted
    ends: Sequence[Attempt]
    tried: int


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """Where a search stands.

    ``fitted``: the present model. ``base``: what causes are added to and their gains counted over; of a ``given`` model
    the same with its numbers fitted, for what these gain is no cause's merit. ``parts``: what is left out in turn, and
    ``..._unseen`` what each model leaves of it. ``former``: the base that a better one took the place of: the better
    may be none of the craft's, so causes begin at both. ``alone``: the base fitted to all signals but one, once asked
    for. ``renamed``: pairs of slugs, the one named and one that explains the runs as well. ``pieces`` [s]: how long the
    pieces were in which causes were found, where the search chose them itself. ``weather``: what a search under
    process noise ended with, where it took the floor. ``beneath``: that search, once asked for, and the
    problem it was asked about. ``refused``: causes of that search that were taken back in the end;
    ``own_gains``: what each of those that stand gains on data left out, by slug and place. ``cut``: at what the search
    was stopped, and what was not begun, in words.
    """

    question: Question
    problem: Problem
    fitted: Fitted
    base: Fitted
    parts: Parts
    base_unseen: HeldOut
    present_unseen: HeldOut
    given: Fitted | None = None
    given_unseen: HeldOut | None = None
    steps: tuple[SearchStep[Fitted], ...] = ()
    renamed: tuple[tuple[str, str], ...] = ()
    tried: int = 0
    restarts: int = 0
    lost: LostBase | None = None
    alone: tuple[Fitted, ...] | None = None
    former: Fitted | None = None
    doubts: tuple[Doubt, ...] = ()
    pieces: float | None = None
    numbers: Numbers | None = None
    weather: WeatherSearch | None = None
    beneath: tuple[Problem, WeatherSearch | None] | None = None
    refused: tuple[CandidateScore[WanderingFit], ...] = ()
    own_gains: Mapping[tuple[str, str], ErrorReduction] = field(default_factory=dict)
    cut: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[EffectInstance, ...]:
        """The effects found: those the base does not have."""
        had = {(e.slug, e.place) for e in self.base.effects}
        return tuple(e for e in self.fitted.effects if (e.slug, e.place) not in had)

    # -- models

    def unseen(self, fitted: Fitted, *, refit: bool = True, problem: Problem | None = None) -> HeldOut:
        """Predict what is left out; *problem*: with other numbers free."""
        return held_out(self.problem if problem is None else problem, self.parts, fitted, refit=refit)

    def with_model(self, fitted: Fitted, unseen: HeldOut | None = None) -> SearchState:
        """Return the state with another present model; *unseen*: what it leaves of data left out, if known."""
        return replace(self, fitted=fitted, present_unseen=unseen or self.unseen(fitted))

    def with_better(self, better: Fitted) -> SearchState:
        """Return the state with a better fit of the present model; of the base, where that is the present model."""
        unseen = self.unseen(better)
        if self.fitted is self.base:
            return replace(self, base=better, base_unseen=unseen, former=self.base).with_model(better, unseen)
        return self.with_model(better, unseen)

    def with_parts(self, parts: Parts) -> SearchState:
        """Return the state with other data left out."""
        now = replace(self, parts=parts)
        base = now.unseen(self.base)
        given = None if self.given is None else now.unseen(self.given, refit=False)
        return replace(now, base_unseen=base, given_unseen=given).with_model(
            self.fitted, base if self.fitted is self.base else None
        )

    # -- one step

    def step(
        self,
        stage: str,
        against: Fitted | None = None,
        *,
        slugs: Sequence[str] | None = None,
        quick: bool = False,
        most: int = SHORT_LIST,
    ) -> tuple[SearchState, SearchStep[Fitted]]:
        """Judge every candidate on top of *against* (the present model when None); *quick*: by likelihood alone.

        The state returned has the same model, or a better base found on the way. slugs : of candidates, all of the
        question's when None. most : fitted roughly.
        """
        question, present = self.question, self.fitted if against is None else against
        astray = not present.effects and whiteness_of(tests_of(self.problem, present)) < ASTRAY
        now = self._with_others() if astray else self
        present = now.fitted if against is None else against
        begun = [present] if now.former is None or present.effects else [present, now.former]
        choices = candidates(now.problem, present.effects, question.slugs if slugs is None else slugs)
        choices = [c for c in choices if not _contradicts(present.effects, c[0])]
        now = replace(now, tried=max(now.tried, len(choices)))

        def screened(done: int, total: int) -> None:
            question.say(stage + ": screening", done, total)

        screened(0, len(choices))
        others = (now.alone or ()) if astray else ()
        listed = screen(now.problem, begun, others, choices, screened, question.executor)
        is_lost = astray and lost(present, now.problem.data_summary.spread)
        if is_lost and now.given is None:
            listed = merged(listed, permuted_channels(now.problem, present, choices))
        rough: list[Attempt] = []
        fresh, passed_over = listed[:most], listed[most:]
        while fresh:
            rough = best_of_each([*rough, *now._rough(fresh, stage)], present)
            better = bool(rough) and rough[0][1].cost < present.cost
            fresh = mistaken_for(rough[0][0].effect, passed_over) if better else []
            passed_over = [c for c in passed_over if all(c is not f for f in fresh)]
        ends = now.ends_of(rough[:RUNNERS], stage)
        if is_lost and not quick and now.lost is None:
            now = replace(now, lost=LostBase(present, tuple(ends), len(choices)))
        return now, now.judged_all(ends, present, len(choices), quick, stage)

    def judged_all(
        self, ends: Sequence[Attempt], present: Fitted, tried: int, quick: bool = False, stage: str = "causes"
    ) -> SearchStep[Fitted]:
        """Judge fits made on top of *present*, of so many *tried*."""
        best = min((fit for _, fit in ends), key=lambda f: f.cost + bic_penalty(f, present), default=present)
        raised = correlation_of(best)

        silent = replace(self, question=replace(self.question, progress=None))
        judged_one = partial(_judged_by, silent, present, tried, raised, quick)

        def told(done: int, total: int) -> None:
            self.question.say(stage + ": runs left out", done, total)

        executor = SerialExecutor() if quick else self.question.executor
        judged = ordered(list(executor.map(judged_one, [(c.effect, fit) for c, fit in ends], told)))
        return SearchStep(tuple(judged), None if quick else self.pick(judged))

    def pick(self, judged: Sequence[CandidateScore[Fitted]]) -> CandidateScore[Fitted] | None:
        """Return the winner; none that happens at a moment which a recorded command explains as well."""
        left = list(judged)
        while (winner := winner_of(left)) is not None and self.follows_a_command(winner.effect, winner.fit):
            left.remove(winner)
        return winner

    def follows_a_command(self, effect: EffectInstance, fitted: Fitted) -> bool:
        """Whether the runs are explained as well when *effect* of *fitted* follows a recorded command, at no moment."""
        others = tuple(e for e in fitted.effects if (e.slug, e.place) != (effect.slug, effect.place))
        for own in EFFECTS[effect.slug].followers(effect, self.problem.data_summary):
            if any((e.slug, e.place) == (own.slug, own.place) for e in others):
                continue
            fit = self.problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FOLLOWING, shift=fitted.shift)
            if fit is not None and fit.cost + bic_penalty(fit, fitted) < fitted.cost + ALIKE:
                return True
        return False

    def judged(
        self,
        effect: EffectInstance,
        fitted: Fitted,
        present: Fitted,
        tried: int,
        common: float | None = None,
        *,
        quick: bool = False,
    ) -> CandidateScore[Fitted]:
        """Judge a fit: against its rivals with the *common* number of samples that make one independent one."""
        raised = correlation_of(fitted)
        lower = present.cost - fitted.cost
        now = next(e for e in fitted.effects if (e.slug, e.place) == (effect.slug, effect.place))
        found = CandidateScore(
            now,
            fitted,
            gained=0.5 * lower / raised,
            needed=needed_of(further(fitted, present), tried),
            numbers=fitted.parameters - present.parameters,
            evidence=lower / (common or raised) - bic_penalty(fitted, present),
        )
        if found.evidence > 0.0 and not quick:
            unseen, before = self.unseen(fitted), self.present_unseen
            found = replace(found, unseen=unseen)
            if unseen.complete and before.rests:
                gain = 1.0 - error_ratio(before, unseen)
                p = p_value(before, unseen, fitted.levels, raised, present.parameters, tried)
                found = replace(found, gain=gain, p=p)
        return replace(found, lacks=lack_by_error(found))

    def ends_of(self, rough: Sequence[Attempt], stage: str = "causes") -> list[Attempt]:
        """Fit to the end what was fitted roughly."""

        def told(done: int, total: int) -> None:
            self.question.say(stage + ": fitting to the end", done, total)

        fits = self.question.executor.map(partial(_fitted_to_the_end, self.problem), rough, told)
        return [(candidate, fit) for (candidate, _), fit in zip(rough, fits, strict=True)]

    def _rough(self, listed: Sequence[EffectCandidate], stage: str) -> list[Attempt]:
        def told(done: int, total: int) -> None:
            self.question.say(stage + ": fitting", done, total)

        told(0, len(listed))
        fits = self.question.executor.map(partial(fitted_roughly, self.problem), listed, told)
        return [(c, fit) for c, fit in zip(listed, fits, strict=True) if fit is not None]

    def _with_others(self) -> SearchState:
        """Return the state with other places for errors of the data to begin; a better base on the way is the base."""
        if self.alone is not None:
            return self
        if self.given is not None:
            return replace(self, alone=())
        bases = without_one_signal(self.problem, self.base)
        now = replace(self, alone=bases.alone)
        if bases.best is self.base:
            return now
        unseen = self.unseen(bases.best)
        return replace(
            now,
            former=self.base,
            base=bases.best,
            fitted=bases.best,
            base_unseen=unseen,
            present_unseen=unseen,
        )


def begin(question: Question) -> SearchState:
    """Return the state of a search that has only fitted its base."""
    with suppress(OutOfTime):  # some base there must be
        question.say("plain model", 0, 1)
    if question.given is None:
        problem, fitted = fit_base(question.form, question.segments)
        return begin_with(question, problem, fitted)
    model = question.given.model
    problem, as_it_is, fitted = given_base(model.base, model.effects, question.segments)
    return begin_with(question, problem, fitted, given=as_it_is)


def begin_with(question: Question, problem: Problem, fitted: Fitted, *, given: Fitted | None = None) -> SearchState:
    """Return the state of a search that begins at *fitted*; *given*: the model in question as it is."""
    parts = parts_of(problem, question.unseen, in_blocks=question.one_flight)
    unseen, given_unseen = HeldOut((), False), None
    cut: tuple[str, ...] = ()
    try:
        question.say("plain model: runs left out", 0, 1)
        unseen = held_out(problem, parts, fitted, refit=True)
        given_unseen = None if given is None else held_out(problem, parts, given, refit=False)
    except OutOfTime as over:
        cut = (str(over),)
    return SearchState(question, problem, fitted, fitted, parts, unseen, unseen, given, given_unseen, cut=cut)


def mistaken_for(effect: EffectInstance, passed_over: Sequence[EffectCandidate]) -> list[EffectCandidate]:
    """Return those of *passed_over* that *effect* is easily mistaken for, there: a screening may misjudge them."""
    rivals = EFFECTS[effect.slug].mistaken_for
    return [c for c in passed_over if c.effect.slug in rivals and c.effect.place == effect.place]


def _contradicts(present: Sequence[EffectInstance], effect: EffectInstance) -> bool:
    """Whether an effect is already there in other words: the same slug at a place that overlaps."""
    return any(e.slug == effect.slug and set(e.place.split("+")) & set(effect.place.split("+")) for e in present)


def _judged_by(
    state: SearchState,
    present: Fitted,
    tried: int,
    common: float,
    quick: bool,
    end: tuple[EffectInstance, Fitted],
) -> CandidateScore[Fitted]:
    effect, fitted = end
    return state.judged(effect, fitted, present, tried, common, quick=quick)


def _fitted_to_the_end(problem: Problem, attempt: Attempt) -> Fitted:
    return fitted_to_the_end(problem, *attempt)
