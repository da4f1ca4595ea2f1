"""The search for causes: one after the other, each reconsidered once the next is known.

Candidates are screened, the promising ones fitted, the fits compared by likelihood less what their parameters cost,
and the winner must pay on data left out. A cause accepted early may have been a stand-in for two: when another is
found, every earlier one has to hold its place against its rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.ahead import look_ahead
from gcs_autotune.diagnose.attempts import RUNNERS, Attempt, best_of_each, fitted_roughly, fitted_to_the_end
from gcs_autotune.diagnose.bases import without_one_signal
from gcs_autotune.diagnose.begin_in_pieces import LostBase, begin_in_pieces
from gcs_autotune.diagnose.by_blocks import judged_by_blocks
from gcs_autotune.diagnose.heldout import HeldOut, Parts, held_out, p_value, parts_of
from gcs_autotune.diagnose.judging import (
    ALIKE,
    SIGNIFICANCE,
    Found,
    Judged,
    error_ratio,
    ordered,
    price_of,
    winner_of,
)
from gcs_autotune.diagnose.rewiring import lost, merged, rewired
from gcs_autotune.diagnose.screen import Candidate, candidates, screen
from gcs_autotune.diagnose.second_thoughts import drop_swallowed, reconsider
from gcs_autotune.diagnose.usual import name_as_usual
from gcs_autotune.diagnose.whiteness import correlation_of, tests_of, whiteness_of
from gcs_autotune.diagnose.workers import in_parallel
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.segment import Segment

__all__ = ["Search", "begin_search"]

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MOST_CAUSES = 6
"""Causes looked for, at most: a craft over telemetry has three or four of its own."""

SHORT_LIST = 18
"""Candidates fitted roughly."""

RESTARTS = 3
"""Better fits of the same model that a winner may lead to, at most."""

DONE = 0.5
"""Whiteness at which the search is over."""

ASTRAY = 0.05
"""Whiteness below which bookkeeping errors are also looked for from fits that leave out one signal."""


@dataclass(eq=False)
class Search:
    """A search under way: the problem, the folds, the present model.

    ``base``: what causes are added to and their gains counted over; of a ``given`` model the same with its numbers
    fitted, for what these gain is no cause's merit.
    """

    problem: Problem
    fitted: Fitted
    parts: Parts
    slugs: Sequence[str]
    given: Fitted | None = None
    progress: Progress | None = None
    jobs: int = 1
    tried: int = 0
    steps: list[Found] = field(default_factory=list)
    renamed: list[tuple[str, str]] = field(default_factory=list)
    lost: LostBase | None = None
    restarts: int = 0
    _alone: Sequence[Fitted] | None = None
    _former: Fitted | None = None
    """The base that a better one took the place of: the better may be none of the craft's, so causes begin at both."""

    def __post_init__(self) -> None:
        self.base = self.fitted
        self.base_unseen = self.present_unseen = self.unseen(self.base)
        self.given_unseen = None if self.given is None else self.unseen(self.given, refit=False)

    # -- the whole

    def run(self) -> None:
        """Look for causes until none pays, then call each by its most usual name."""
        self.until_none_pays()
        begin_in_pieces(self)
        name_as_usual(self)
        drop_swallowed(self)

    def until_none_pays(self, first: Found | None = None) -> None:
        """Take one step after the other; *first*: the next one, judged already."""
        while len(self.steps) < MOST_CAUSES and self._one_more(first):
            first = None
            if len(self.steps) > 1:
                reconsider(self)

    def _one_more(self, judged: Found | None) -> bool:
        """Take one more step (or two, where only two causes together pay); whether anything was found."""
        stage = f"cause {len(self.steps) + 1}"
        white = whiteness_of(tests_of(self.problem, self.fitted))
        slugs = [s for s in self.slugs if EFFECTS[s].is_disturbance] if self.steps and white > DONE else None
        found = self.step(stage, slugs=slugs) if judged is None else judged
        if found.accepted is None:
            found = judged_by_blocks(self, found) or found
        taken: tuple[Found, ...] = (found,)
        if found.accepted is None and white < SIGNIFICANCE:
            taken = look_ahead(self, found, stage) or taken
        accepted = taken[-1].accepted
        if accepted is None:
            self.steps.extend(taken)
            return False
        better = self._without(accepted.fitted)
        if better is not None:
            self._begin_at(better)
            again = self.judged(accepted.own, accepted.fitted, better, self.tried)
            if winner_of([again], self.tried, better) is not None:
                accepted = again
                taken = (*taken[:-1], replace(taken[-1], accepted=again))
            elif self.restarts < RESTARTS:
                self.restarts += 1
                return self._one_more(None)
        self.steps.extend(taken)
        self.take(accepted)
        return True

    def _without(self, fitted: Fitted) -> Fitted | None:
        """Return the present model fitted from where a winner ended, if that is better: the gain was not the winner's.

        A cause that gives a fit the way out of a valley must not be credited with what it found outside.
        """
        present = self.fitted
        again = self.problem.fit(fitted.theta, present.effects, fitted.initial, shift=fitted.shift)
        return again if again is not None and again.cost < present.cost - ALIKE else None

    def _begin_at(self, better: Fitted) -> None:
        """Make a better fit of the present model the present model."""
        if self.fitted is self.base:
            self.base, self.base_unseen, self._former = better, self.unseen(better), self.base
        self.fitted, self.present_unseen = better, self.unseen(better)

    def take(self, judged: Judged) -> None:
        """Make a judged fit the present model."""
        self.fitted = judged.fitted
        self.present_unseen = judged.unseen or self.unseen(judged.fitted)

    # -- one step

    def step(
        self,
        stage: str,
        against: Fitted | None = None,
        *,
        slugs: Sequence[str] | None = None,
        quick: bool = False,
        most: int = SHORT_LIST,
    ) -> Found:
        """Judge every candidate on top of *against* (the present model when None); *quick*: by likelihood alone.

        slugs : of candidates, all of the search's when None. most : fitted roughly.
        """
        present = self.fitted if against is None else against
        astray = not present.effects and whiteness_of(tests_of(self.problem, present)) < ASTRAY
        others = self._others() if astray else []
        present = self.fitted if against is None else against
        grounds = [present] if self._former is None or present.effects else [present, self._former]
        choices = candidates(self.problem, present.effects, self.slugs if slugs is None else slugs)
        choices = [c for c in choices if not _contradicts(present.effects, c[0])]
        self.tried = max(self.tried, len(choices))
        self.say(stage + ": screening", 0, len(choices))
        listed = screen(
            self.problem, grounds, others, choices, lambda i, n: self.say(stage + ": screening", i, n), self.jobs
        )
        is_lost = astray and lost(present, self.problem.scene.spread)
        if is_lost and self.given is None:
            listed = merged(listed, rewired(self.problem, present, choices))
        rough: list[Attempt] = []
        fresh, passed_over = listed[:most], listed[most:]
        while fresh:
            rough = best_of_each([*rough, *self._rough(fresh, present, stage)], present)
            better = bool(rough) and rough[0][1].cost < present.cost
            fresh = _taken_for(rough[0][0].own, passed_over) if better else []
            passed_over = [c for c in passed_over if all(c is not f for f in fresh)]
        ends = self.ends_of(rough[:RUNNERS])
        if is_lost and not quick and self.lost is None:
            self.lost = LostBase(present, tuple(ends), len(choices))
        return self.judged_all(ends, present, len(choices), quick)

    def judged_all(self, ends: Sequence[Attempt], present: Fitted, tried: int, quick: bool = False) -> Found:
        """Judge fits made on top of *present*, of so many *tried*."""
        best = min((fit for _, fit in ends), key=lambda f: f.cost + price_of(f, present), default=present)
        raised = correlation_of(best)

        def judged_one(i: int) -> Judged:
            return self.judged(ends[i][0].own, ends[i][1], present, tried, raised, quick=quick)

        judged = ordered(in_parallel(judged_one, len(ends), 1 if quick else self.jobs))
        return Found(tuple(judged), None if quick else winner_of(judged, tried, present))

    def ends_of(self, rough: Sequence[Attempt]) -> list[Attempt]:
        """Fit to the end what was fitted roughly."""
        fits = in_parallel(lambda i: fitted_to_the_end(self.problem, *rough[i]), len(rough), self.jobs)
        return [(candidate, fit) for (candidate, _), fit in zip(rough, fits, strict=True)]

    def _rough(self, listed: Sequence[Candidate], present: Fitted, stage: str) -> list[Attempt]:
        self.say(stage + ": fitting", 0, len(listed))
        fits = in_parallel(
            lambda i: fitted_roughly(self.problem, listed[i]),
            len(listed),
            self.jobs,
            lambda i, n: self.say(stage + ": fitting", i, n),
        )
        return [(c, fit) for c, fit in zip(listed, fits, strict=True) if fit is not None]

    def judged(
        self,
        own: EffectInstance,
        fitted: Fitted,
        present: Fitted,
        tried: int,
        common: float | None = None,
        *,
        quick: bool = False,
    ) -> Judged:
        """Judge a fit: against its rivals with the *common* number of samples that make one independent one."""
        raised = correlation_of(fitted)
        likelihood = (present.cost - fitted.cost) / raised
        evidence = (present.cost - fitted.cost) / (common or raised) - price_of(fitted, present)
        now = next(e for e in fitted.effects if (e.slug, e.place) == (own.slug, own.place))
        if evidence <= 0.0 or quick:
            return Judged(now, fitted, evidence, likelihood, 0.0, 1.0, None)
        unseen = self.unseen(fitted)
        before = self.present_unseen
        gain, p = 0.0, 1.0
        if unseen.complete and before.rests:
            gain = 1.0 - error_ratio(before, unseen)
            p = p_value(before, unseen, fitted.levels, raised, present.parameters, tried)
        return Judged(now, fitted, evidence, likelihood, gain, p, unseen)

    # -- helpers

    def unseen(self, fitted: Fitted, *, refit: bool = True, problem: Problem | None = None) -> HeldOut:
        """Predict what is left out; *problem*: with other numbers free."""
        return held_out(self.problem if problem is None else problem, self.parts, fitted, refit=refit)

    def _others(self) -> Sequence[Fitted]:
        """Return other places for bookkeeping fits to begin; a better base found on the way becomes the base."""
        if self._alone is None:
            self._alone = ()
            if self.given is None:
                bases = without_one_signal(self.problem, self.base)
                self._alone = bases.alone
                if bases.best is not self.base:
                    self._former, self.base, self.fitted = self.base, bases.best, bases.best
                    self.base_unseen = self.present_unseen = self.unseen(bases.best)
        return self._alone

    def say(self, stage: str, done: int, total: int) -> None:
        """Report progress: a stage, how much of it is done, how much there is."""
        if self.progress is not None:
            self.progress(stage, done, total)


def begin_search(
    problem: Problem,
    fitted: Fitted,
    unseen: Sequence[Segment],
    slugs: Sequence[str],
    *,
    given: Fitted | None = None,
    progress: Progress | None = None,
    jobs: int = 1,
) -> Search:
    """Return a search ready to run.

    unseen : segments of runs kept apart; without any, parts of the problem's are left out in turn.
    """
    parts = parts_of(problem, unseen)
    return Search(problem, fitted, parts, slugs, given=given, progress=progress, jobs=jobs)


def _taken_for(own: EffectInstance, passed_over: Sequence[Candidate]) -> list[Candidate]:
    """Return those of *passed_over* that *own* is easily mistaken for, at its place: a screening may misjudge them."""
    return [c for c in passed_over if c.own.slug in EFFECTS[own.slug].mistaken_for and c.own.place == own.place]


def _contradicts(present: Sequence[EffectInstance], own: EffectInstance) -> bool:
    """Whether an effect is already there in other words: the same slug at a place that overlaps."""
    return any(e.slug == own.slug and set(e.place.split("+")) & set(own.place.split("+")) for e in present)
