"""State of a search for causes: the question, the model so far, and intermediate results.

A state is immutable. Strategies (:mod:`.strategies`) create the next state from it, so an earlier state remains
available. This module contains their common operations: predict held-out data, and take one step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.adequacy import tests_of, whiteness_of
from gcs_autotune.diagnose.candidates import Attempt, candidates
from gcs_autotune.diagnose.heldout import HeldOut, Parts, gains_of, held_out, own_gain, parts_of, rms_of, surest
from gcs_autotune.diagnose.least_squares_scorer import SHORT_LIST, LeastSquares, is_alike, values_of
from gcs_autotune.diagnose.process_noise import NoiseSearch
from gcs_autotune.diagnose.question import Question
from gcs_autotune.diagnose.result import ErrorReduction, Numbers, Value
from gcs_autotune.diagnose.score import CandidateScore, SearchStep, key_of
from gcs_autotune.diagnose.search import fits_of, judge
from gcs_autotune.diagnose.shares import shares_of
from gcs_autotune.diagnose.starting_points import lost, without_one_signal
from gcs_autotune.effects import EffectInstance, name_of, twins_of
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.problems import Fitted, Problem, fit_base, given_base

__all__ = ["NOT_BEGUN", "LostBase", "SearchState", "begin", "begin_with"]

NOT_BEGUN = "not begun: "
"""Start of the description of a part of the search that had not begun when the search was stopped."""

ASTRAY = 0.05
"""Whiteness p-value below which data errors are also tried from fits without one signal."""


@dataclass(frozen=True, slots=True, eq=False)
class LostBase:
    """A base that misses some signal completely, or that no candidate helps although its residuals are not white.

    With the candidates fitted from it, and the number of candidates tried.
    """

    base: Fitted
    ends: Sequence[Attempt]
    tried: int


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """State of a search.

    ``fitted``: the present model. ``base``: the model that causes are added to; gains are relative to it. For a
    supplied (``given``) model the base has fitted numbers, because the gain of fitting them does not come from a cause.
    ``parts``: what is left out in turn. ``..._unseen``: held-out residuals of each model. ``former``: the base that a
    better one replaced. The better one may be wrong, so candidates are tried from both.

    ``alone``: fits of the base without each of the signals, once needed. ``renamed``: pairs of names
    (:func:`.name_of`), of the reported cause and of one that fits as well. ``pieces`` [s]: length of the pieces in
    which causes were found, if the search chose it. ``with_noise``: result of a search with process noise, if it
    replaced the other. ``noise_search``: that search and its problem, once needed. ``models``: for each present model
    so far, its causes and the held-out residuals of the base and of the model. ``cut``: where the search was stopped,
    and what was not begun, in words.
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
    with_noise: NoiseSearch | None = None
    noise_search: tuple[Problem, NoiseSearch | None] | None = None
    models: tuple[tuple[tuple[EffectInstance, ...], HeldOut, HeldOut], ...] = ()
    cut: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[EffectInstance, ...]:
        """Identified effects: those that the base does not contain."""
        had = {(e.slug, e.place) for e in self.base.effects}
        return tuple(e for e in self.fitted.effects if (e.slug, e.place) not in had)

    def stopped(self, over: OutOfTime) -> SearchState:
        """Return the state, marked as stopped by the limit that *over* reports."""
        return replace(self, cut=(*self.cut, str(over)))

    # -- models

    def unseen(self, fitted: Fitted, *, refit: bool = True, problem: Problem | None = None) -> HeldOut:
        """Return the residuals of predictions of the held-out data by a model.

        problem : definition of the fit, if other numbers are free.
        """
        return held_out(self.problem if problem is None else problem, self.parts, fitted, refit=refit)

    def with_model(self, fitted: Fitted, unseen: HeldOut | None = None) -> SearchState:
        """Return the state with another present model.

        unseen : its held-out residuals, if known.
        """
        now = replace(self, fitted=fitted, present_unseen=unseen or self.unseen(fitted))
        return replace(now, models=(*now.models, (now.causes, now.base_unseen, now.present_unseen)))

    def with_better(self, better: Fitted) -> SearchState:
        """Return the state with a better fit of the present model; if the base is the present model, it is replaced
        too."""
        unseen = self.unseen(better)
        if self.fitted is self.base:
            return replace(self, base=better, base_unseen=unseen, former=self.base).with_model(better, unseen)
        return self.with_model(better, unseen)

    def with_parts(self, parts: Parts) -> SearchState:
        """Return the state with *parts* as the folds held out."""
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
        """Return the state and the step after scoring every candidate added to *against*; None: the present model.

        The returned state has the same model, or a better base found in the process.

        quick : score by likelihood alone. slugs : slugs of the candidates; None: all. most : number of candidates
        fitted roughly.
        """
        question, present = self.question, self.fitted if against is None else against
        astray = not present.effects and whiteness_of(tests_of(self.problem, present)) < ASTRAY
        now = self._with_others() if astray else self
        present = now.fitted if against is None else against
        begun = [present] if now.former is None or present.effects else [present, now.former]
        choices = candidates(now.problem.data_summary, present.effects, question.slugs if slugs is None else slugs)
        choices = [c for c in choices if not _contradicts(present.effects, c[0])]
        now = replace(now, tried=max(now.tried, len(choices)))
        is_lost = astray and lost(present, now.problem.data_summary.spread)
        scorer = replace(
            now.scorer(present, len(choices), stage=stage, quick=quick),
            begun=begun,
            others=(now.alone or ()) if astray else (),
            exchanges=is_lost and now.given is None,
            most=most,
        )
        ends = fits_of(scorer, choices)
        judged = judge(scorer, ends)
        if astray and (is_lost or judged.accepted is None) and not quick and now.lost is None:
            now = replace(now, lost=LostBase(present, tuple(ends), len(choices)))
        return now, judged

    def scorer(
        self, present: Fitted | None = None, tried: int | None = None, *, stage: str = "causes", quick: bool = False
    ) -> LeastSquares:
        """Return the scorer for candidates added to *present*; None: the present model.

        tried : total number of candidates.
        """
        return LeastSquares(
            self.question,
            self.problem,
            self.parts,
            self.fitted if present is None else present,
            self.present_unseen,
            self.tried if tried is None else tried,
            stage,
            quick,
        )

    def _with_others(self) -> SearchState:
        """Return the state with fits of the base without each of the signals, as further starts for data errors.

        If one of them leads to a better base, that base replaces the present one.
        """
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

    # -- for the report

    @property
    def words(self) -> str:
        """Description of what was left out in turn."""
        return self.parts.words

    @property
    def names(self) -> frozenset[str]:
        """Causes that are not reported as hints: none, because hints come from a last step without a winner."""
        return frozenset()

    @property
    def refused(self) -> tuple[CandidateScore[Fitted], ...]:
        """Causes accepted first and rejected at the end: none, because this search reports no hints from them."""
        return ()

    def values(self, effect: EffectInstance, fit: Fitted | None = None) -> Mapping[str, Value]:
        """Return the numbers of an effect in *fit* with their standard errors; None: in the present model."""
        return values_of(self.problem, self.fitted if fit is None else fit)[key_of(effect)]

    def gains(self, order: Sequence[EffectInstance]) -> tuple[ErrorReduction, ...]:
        """Return the held-out error of every signal, before and after all causes."""
        words = self.words + ("" if self.pieces is None else f", in pieces of {self.pieces:.3g} s")
        return gains_of(self.base_unseen, self.present_unseen, words) if order else ()

    def gains_of_each(
        self, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
    ) -> Mapping[tuple[str, str], ErrorReduction]:
        """Return the held-out error reduction of each cause when it was accepted; for a single cause, its
        present one.
        """
        if len(order) == 1:
            whole = surest(gains)
            return {} if whole is None else {key_of(order[0]): whole}
        own_gains, before = {}, self.base_unseen
        for won in (s.accepted for s in self.steps if s.accepted is not None):
            if won.unseen is not None:
                own = own_gain(before, won.unseen, self.words)
                before = won.unseen
                if own is not None:
                    own_gains[key_of(won.effect)] = own
        return own_gains

    def shares(self, order: Sequence[EffectInstance]) -> Mapping[tuple[str, str], float]:
        """Return for each cause the fraction that it removed of the mean square error above noise.

        They add up to the fraction that all causes removed (:func:`.shares_of`), in the signal in which it is largest.
        Causes added together count as added in the *order* in which they are reported.
        """
        now = (self.causes, self.base_unseen, self.present_unseen)
        total = _explained(self.base_unseen, self.present_unseen, self.fitted.levels)
        signal = max(total, key=lambda n: total[n], default="")
        models = [
            ([key_of(e) for e in causes], _explained(base, unseen, self.fitted.levels).get(signal, math.nan))
            for causes, base, unseen in (*self.models, now)
        ]
        place = _places([keys for keys, _ in models], [key_of(e) for e in order])
        return shares_of((sorted(keys, key=lambda key: place.get(key, len(order))), e) for keys, e in models)

    def alike(self, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
        """Return groups of causes that the runs do not distinguish."""
        groups = []
        for step in self.steps:
            best = step.accepted
            if best is None or best.effect.slug not in {e.slug for e in order}:
                continue
            same = [name_of(best.effect), *twins_of(best.effect, self.problem.data_summary)]
            same += [name_of(j.effect) for j in step.judged if is_alike(self.problem, j, best)]
            names = tuple(dict.fromkeys(same))
            if len(names) > 1:
                groups.append(names)
        for usual, other in self.renamed:
            known = next((k for k, names in enumerate(groups) if usual in names or other in names), None)
            if known is None:
                groups.append((usual, other))
            else:
                groups[known] = tuple(dict.fromkeys((usual, *groups[known], other)))
        return tuple(groups)


def begin(question: Question) -> SearchState:
    """Return the state of a search that has only a fitted base."""
    with suppress(OutOfTime):  # some base there must be
        question.say("plain model", 0, 1)
    if question.given is None:
        problem, fitted = fit_base(question.form, question.segments)
        return begin_with(question, problem, fitted)
    model = question.given.model
    problem, as_it_is, fitted = given_base(model.base, model.effects, question.segments)
    return begin_with(question, problem, fitted, given=as_it_is)


def begin_with(question: Question, problem: Problem, fitted: Fitted, *, given: Fitted | None = None) -> SearchState:
    """Return the state of a search that begins at *fitted*.

    given : the model in question, unchanged.
    """
    parts = parts_of(problem, question.unseen, in_blocks=question.one_flight)
    unseen, given_unseen = HeldOut((), False), None
    cut: tuple[str, ...] = ()
    try:
        question.say("plain model: prediction of the held-out runs", 0, 1)
        unseen = held_out(problem, parts, fitted, refit=True)
        given_unseen = None if given is None else held_out(problem, parts, given, refit=False)
    except OutOfTime as over:
        cut = (str(over),)
    return SearchState(question, problem, fitted, fitted, parts, unseen, unseen, given, given_unseen, cut=cut)


def _explained(base: HeldOut, unseen: HeldOut, levels: Mapping[str, float]) -> dict[str, float]:
    """Return signal -> fraction of the base's mean square error above noise (*levels*) that a model removed."""
    old, new = rms_of(base.rests), rms_of(unseen.rests)
    above = {n: old.get(n, 0.0) ** 2 - level**2 for n, level in levels.items()}
    removed = {n: (old[n] ** 2 - new[n] ** 2) / above[n] for n in new if above.get(n, 0.0) > 0.05 * levels[n] ** 2}
    return {n: fraction for n, fraction in removed.items() if math.isfinite(fraction)}


def _contradicts(present: Sequence[EffectInstance], effect: EffectInstance) -> bool:
    """Return whether an effect of the same slug is already present at an overlapping place."""
    return any(e.slug == effect.slug and set(e.place.split("+")) & set(effect.place.split("+")) for e in present)


def _places(
    models: Sequence[Sequence[tuple[str, str]]], order: Sequence[tuple[str, str]]
) -> dict[tuple[str, str], int]:
    """Return the position of each cause in *order*. A cause that was replaced has that of its replacement."""
    place = {key: i for i, key in enumerate(order)}
    for before, after in reversed(list(itertools.pairwise(models))):
        lost, new = [k for k in before if k not in after], [k for k in after if k not in before]
        if len(lost) == len(new) == 1 and new[0] in place:
            place.setdefault(lost[0], place[new[0]])
    return place
