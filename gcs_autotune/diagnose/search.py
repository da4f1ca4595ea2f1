"""The search for causes: one after the other, each reconsidered once the next is known.

Candidates are screened, the promising ones fitted, the fits compared by likelihood less what their parameters cost,
and the winner must pay on data left out. A cause accepted early may have been a stand-in for two: when another is
found, every earlier one has to hold its place against its rivals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from gcs_autotune.diagnose.heldout import Fold, HeldOut, folds_of, held_out, p_value, rms_of
from gcs_autotune.diagnose.pairs import pair_ahead
from gcs_autotune.diagnose.rewiring import lost, merged, rewired
from gcs_autotune.diagnose.screen import Candidate, candidates, screen
from gcs_autotune.diagnose.whiteness import correlation_of, tests_of, whiteness_of
from gcs_autotune.effects import BOOK
from gcs_autotune.effects.effect import Applied
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.extended.base import fit_base
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.extended.stretches import Stretch, only

__all__ = ["ALIKE", "CHANCE", "Found", "Judged", "Search", "begin_search"]

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MOST_CAUSES = 6
"""Causes looked for, at most: a craft over telemetry has three or four of its own."""

SHORT_LIST, RUNNERS = 14, 5
"""Candidates fitted roughly, and of these to the end."""

ROUGH = 8
"""Trials of a rough fit."""

SIGNIFICANCE = 0.005
"""Chance of any false finding on data the base model explains."""

MATERIAL = 0.02
"""Share by which a cause must lower the held-out error to be worth a name."""

CHANCE = 0.05
"""Chance that a cause which is named pays on unseen data by luck alone."""

ASTRAY = 0.05
"""Whiteness below which bookkeeping errors are also looked for from fits to one signal alone."""

ALIKE = 6.0
"""Difference of twice the log-likelihood (less the cost of parameters) within which two causes cannot be told apart:
odds of twenty to one."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A candidate fitted: evidence against the model before it, error on unseen data, and its chance to be luck."""

    own: Applied
    fitted: Fitted
    evidence: float
    likelihood: float
    gain: float
    p: float
    unseen: HeldOut | None


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """One step of the search: everything judged, best first; ``accepted`` the winner, None when none paid."""

    judged: tuple[Judged, ...]
    accepted: Judged | None


@dataclass(eq=False)
class Search:
    """A search under way: the problem, the folds, the present model."""

    problem: Problem
    fitted: Fitted
    folds: Sequence[Fold]
    fold_states: Sequence[tuple[Array, ...]]
    test_states: Sequence[tuple[Array, ...]]
    slugs: Sequence[str]
    given: Fitted | None = None
    progress: Progress | None = None
    tried: int = 0
    steps: list[Found] = field(default_factory=list)
    _alone: list[Fitted] | None = None

    def __post_init__(self) -> None:
        self.base = self.fitted if self.given is None else self.given
        self.base_unseen = self.unseen(self.base, refit=self.given is None)
        self.present_unseen = self.base_unseen if self.given is None else self.unseen(self.fitted)

    # -- the whole

    def run(self) -> None:
        """Look for causes until none pays."""
        while len(self.steps) < MOST_CAUSES:
            stage = f"cause {len(self.steps) + 1}"
            found = self.step(stage)
            steps: Sequence[Found] = (found,)
            if found.accepted is None:
                steps = pair_ahead(self, found, stage, least=MATERIAL, chance=CHANCE) or steps
            self.steps += steps
            last = steps[-1].accepted
            if last is None:
                return
            self._take(last)
            if len(self.steps) > 1:
                self._reconsider()
            if whiteness_of(tests_of(self.problem, self.fitted)) > 0.5:
                return

    def _take(self, judged: Judged) -> None:
        self.fitted = judged.fitted
        self.present_unseen = judged.unseen or self.unseen(judged.fitted)

    # -- one step

    def step(self, stage: str, against: Fitted | None = None, slugs: Sequence[str] | None = None) -> Found:
        """Judge every candidate on top of *against* (the present model when None)."""
        present = self.fitted if against is None else against
        choices = candidates(self.problem, present.effects, slugs or self.slugs)
        choices = [c for c in choices if not _contradicts(present.effects, c[0])]
        self.tried = max(self.tried, len(choices))
        self._say(stage + ": screening", 0, len(choices))
        astray = not present.effects and whiteness_of(tests_of(self.problem, present)) < ASTRAY
        fits = [present, *(self._others() if astray else ())]
        listed = screen(self.problem, fits, choices, lambda i, n: self._say(stage + ": screening", i, n))
        if astray and self.given is None and lost(present, self.problem.scene.spread):
            listed = merged(listed, rewired(self.problem, present, choices))
        rough = self._rough(listed[:SHORT_LIST], present, stage)
        rough.sort(key=lambda f: f[1].cost + self.price(f[1], present))
        fitted = [self._finished(own, f) for own, f in rough[:RUNNERS]]
        judged = [self._judged(own, f, present, len(choices)) for own, f in fitted]
        judged = _ordered(judged)
        return Found(tuple(judged), self._winner(judged, len(choices), present))

    def _rough(self, listed: Sequence[Candidate], present: Fitted, stage: str) -> list[tuple[Applied, Fitted]]:
        found = []
        for i, candidate in enumerate(listed):
            self._say(stage + ": fitting", i, len(listed))
            fit = self._begun(candidate)
            if fit is not None:
                found.append((candidate.own, fit))
        self._say(stage + ": fitting", len(listed), len(listed))
        return found

    def _begun(self, candidate: Candidate) -> Fitted | None:
        """Fit roughly, from the model adapted to first order; from the model as it is when that leads nowhere."""
        begin, fit = candidate.begin, self.problem.fit
        theta, effects, initial = self.problem.moved(begin, candidate.adapted)
        found = fit(theta, (*effects, candidate.own), initial, trials=ROUGH, shift=begin.shift)
        if found is None or found.cost > begin.cost:
            own = (*begin.effects, candidate.own)
            again = fit(begin.theta, own, begin.initial, trials=ROUGH, shift=begin.shift)
            found = again if found is None or (again is not None and again.cost < found.cost) else found
        return found

    def _finished(self, own: Applied, rough: Fitted) -> tuple[Applied, Fitted]:
        again = self.problem.fit(rough.theta, rough.effects, rough.initial, trials=30, learn=False, shift=rough.shift)
        return own, (again if again is not None and again.cost <= rough.cost else rough)

    def price(self, fitted: Fitted, present: Fitted) -> float:
        """Return what the additional parameters cost (Schwarz); one more for the effect itself."""
        return (fitted.parameters - present.parameters + _learnt(fitted) - _learnt(present)) * math.log(fitted.samples)

    def _judged(self, own: Applied, fitted: Fitted, present: Fitted, tried: int) -> Judged:
        raised = correlation_of(fitted)
        likelihood = (present.cost - fitted.cost) / raised
        evidence = likelihood - self.price(fitted, present)
        now = next(e for e in fitted.effects if (e.slug, e.place) == (own.slug, own.place))
        if evidence <= 0.0:
            return Judged(now, fitted, evidence, likelihood, 0.0, 1.0, None)
        unseen = self.unseen(fitted)
        before = self.present_unseen
        gain, p = 0.0, 1.0
        if unseen.complete and before.rests:
            gain = 1.0 - _ratio(before, unseen)
            p = p_value(before, unseen, fitted.levels, raised, present.parameters, tried)
        return Judged(now, fitted, evidence, likelihood, gain, p, unseen)

    def _winner(self, judged: Sequence[Judged], tried: int, present: Fitted) -> Judged | None:
        paying = []
        for one in judged:
            more = max(1, one.fitted.parameters - present.parameters + _learnt(one.fitted) - _learnt(present))
            needed = float(chi2.isf(SIGNIFICANCE / max(tried, 1), more))
            if one.likelihood > needed and one.evidence > 0.0 and one.gain > MATERIAL and one.p < CHANCE:
                paying.append(one)
        return next((one for one in paying if not _outdone(one, paying)), None)

    # -- second thoughts

    def _reconsider(self) -> None:
        """Let every earlier cause defend its place against its rivals, the others given."""
        for own in self.fitted.effects[:]:
            if own not in self.fitted.effects:
                continue
            rest = tuple(e for e in self.fitted.effects if e is not own)
            now = self.fitted
            without = self.problem.fit(now.theta, rest, now.initial, trials=12, shift=now.shift)
            if without is None:
                continue
            kept, seen = self.fitted, self.present_unseen
            self.fitted, self.present_unseen = without, self.unseen(without)
            again = self.step(f"second thoughts on {own.slug}", without)
            best = again.judged[0] if again.judged else None
            if again.accepted is None and again.judged:
                continue  # it no longer pays: leave it out
            better = best is not None and best.fitted.cost + self.price(best.fitted, kept) < kept.cost - 1e-6
            if better and best is not None and again.accepted is best and best.own.slug != own.slug:
                self._take(best)
            else:
                self.fitted, self.present_unseen = kept, seen

    # -- helpers

    def unseen(self, fitted: Fitted, *, refit: bool = True) -> HeldOut:
        """Predict what the folds leave out."""
        return held_out(self.problem, self.folds, self.fold_states, fitted, refit=refit, test_states=self.test_states)

    def _others(self) -> list[Fitted]:
        """Return other places for bookkeeping fits to begin: the base fitted to one signal alone."""
        if self._alone is None:
            self._alone = []
            names = list(self.problem.scene.signals)
            for name in names if len(names) > 1 and self.given is None else ():
                try:
                    _, alone = fit_base(self.problem.form, only(self.problem.stretches, name))
                except AutotuneError:
                    continue
                again = self.problem.states(alone.theta, (), self.base.initial)
                full = None
                if again is not None:
                    full = self.problem.fit(again.theta, (), again.initial, trials=0, shift=again.shift)
                if full is not None:
                    self._alone.append(full)
        return self._alone

    def _say(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)


def begin_search(
    problem: Problem,
    fitted: Fitted,
    unseen: Sequence[Stretch],
    slugs: Sequence[str],
    *,
    given: Fitted | None = None,
    progress: Progress | None = None,
) -> tuple[Search, str]:
    """Return a search ready to run, and in words what its errors are measured on.

    unseen : stretches of runs kept apart; without any, parts of the problem's are left out in turn.
    """
    folds, pool, words = folds_of(problem.stretches, unseen)
    states = problem.first_states([*pool, *unseen])
    at = {id(s): i for i, s in enumerate([*pool, *unseen])}
    starts = [tuple(states[i] for i in fold.train_at) for fold in folds]
    tests = [tuple(states[at[id(s)]] for s in fold.test) for fold in folds]
    return Search(problem, fitted, folds, starts, tests, slugs, given=given, progress=progress), words


def _ratio(before: HeldOut, after: HeldOut) -> float:
    """Return the geometric mean over signals of the ratio of held-out errors."""
    old, new = rms_of(before.rests), rms_of(after.rests)
    logs = [math.log(max(new[n], 1e-300) / max(old[n], 1e-300)) for n in old if n in new and old[n] > 0.0]
    return math.exp(float(np.mean(logs))) if logs else 1.0


def _ordered(judged: Sequence[Judged]) -> list[Judged]:
    """Return candidates by evidence; of those that cannot be told from the best, the more usual cause first."""
    ranked = sorted(judged, key=lambda j: -j.evidence)
    alike = [j for j in ranked if ranked[0].evidence - j.evidence < ALIKE]
    slugs = {j.own.slug for j in alike}
    alike.sort(key=lambda j: len(slugs & set(BOOK[j.own.slug].yields_to)))
    return [*alike, *ranked[len(alike) :]]


def _outdone(one: Judged, paying: Sequence[Judged]) -> bool:
    """Whether *one* is a slip of the pen, and another cause leaves less: a slip that happened accounts for all."""
    if BOOK[one.own.slug].family != "bookkeeping":
        return False
    return any(other.gain > one.gain and other.fitted.cost < one.fitted.cost for other in paying)


def _learnt(fitted: Fitted) -> int:
    """Return how many numbers were learnt from what was left over."""
    return sum(len(e.values) for e in fitted.effects if BOOK[e.slug].overrides("learn"))


def _contradicts(present: Sequence[Applied], own: Applied) -> bool:
    """Whether an effect is already there in other words: the same slug at a place that overlaps."""
    return any(e.slug == own.slug and set(e.place.split("+")) & set(own.place.split("+")) for e in present)
