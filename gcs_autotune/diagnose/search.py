"""One step of a search for causes, for either scorer."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Protocol, Self, TypeVar

from gcs_autotune.clock import OutOfTime
from gcs_autotune.diagnose.result import ErrorReduction, Value
from gcs_autotune.diagnose.score import CandidateScore, FitT, SearchStep
from gcs_autotune.effects import EffectInstance

__all__ = ["Scorer", "Search", "add_one_by_one", "fits_of", "judge"]

AttemptT = TypeVar("AttemptT")


class Scorer(Protocol[AttemptT, FitT]):
    """Interface of a scorer: fit candidates added to the model ``present``, then score them.

    Scores use the fitted runs and held-out data. There are two scorers: :class:`.LeastSquares`, and
    :class:`.WithProcessNoise` with a drifting force in the model.
    """

    @property
    def present(self) -> FitT:
        """The model to which candidates are added."""

    @property
    def runners(self) -> int:
        """Number of candidates that are fitted to convergence."""

    def rough(self, choices: Sequence[Sequence[EffectInstance]]) -> list[AttemptT]:
        """Return the candidates after a rough fit from several start values each, the best first."""

    def to_the_end(self, rough: Sequence[AttemptT]) -> list[AttemptT]:
        """Return the roughly fitted candidates, fitted to convergence."""

    def rebased(self, ends: Sequence[AttemptT]) -> Scorer[AttemptT, FitT]:
        """Return this scorer with a better fit of the present model, if a refit from the best of *ends* gives one."""

    def scores(self, ends: Sequence[AttemptT]) -> list[CandidateScore[FitT]]:
        """Return the scores of the converged candidates, the best first."""

    def winner(self, scores: Sequence[CandidateScore[FitT]]) -> CandidateScore[FitT] | None:
        """Return the accepted candidate; None if there is none."""

    def alike(self, scores: Sequence[CandidateScore[FitT]], winner: CandidateScore[FitT]) -> tuple[str, ...]:
        """Return the causes that these runs do not distinguish from *winner*, starting with *winner* itself."""


Cause = tuple[str, str]
"""Slug and place of an effect."""


class Search(Protocol):
    """Interface of a search and its result in the base model's units, for either scorer.

    ``words``: what was left out in turn. ``order``: the reported causes, in the order found.
    """

    @property
    def steps(self) -> Sequence[SearchStep[Any]]:
        """All steps of the search, including those without a winner."""

    def stopped(self, over: OutOfTime) -> Self:
        """Return the search so far, marked as stopped by the limit that *over* reports."""

    @property
    def tried(self) -> int:
        """Number of candidates tried in one step."""

    @property
    def words(self) -> str:
        """Description of what was left out in turn."""

    @property
    def names(self) -> Collection[str]:
        """Causes that are not reported as hints: accepted causes, and causes that these runs do not distinguish from
        them."""

    @property
    def refused(self) -> Sequence[CandidateScore[Any]]:
        """Causes that were accepted first and rejected at the end."""

    def values(self, effect: EffectInstance, fit: Any = None) -> Mapping[str, Value]:
        """Return the numbers of an effect in *fit*; None: in the model with all causes."""

    def shares(self, order: Sequence[EffectInstance]) -> Mapping[Cause, float]:
        """Return, for each cause, the fraction of the base model's error that it removed (:func:`.shares_of`)."""

    def gains(self, order: Sequence[EffectInstance]) -> tuple[ErrorReduction, ...]:
        """Return the held-out error of every signal without causes and with all causes."""

    def gains_of_each(
        self, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
    ) -> Mapping[Cause, ErrorReduction]:
        """Return the reduction of the held-out error by each cause.

        gains : gains of all causes together.
        """

    def alike(self, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
        """Return groups of causes that these runs do not distinguish from each other."""


SearchT = TypeVar("SearchT", bound=Search)


def add_one_by_one(
    state: SearchT,
    most: int,
    one_more: Callable[[SearchT], SearchT],
    reconsidered: Callable[[SearchT], SearchT],
) -> SearchT:
    """Return a search continued by up to *most* steps, until a step accepts no cause or the search is stopped.

    reconsidered : called after each accepted cause, to compare the earlier causes with their rivals again.
    """
    try:
        while len(state.steps) < most:
            state = one_more(state)
            if state.steps[-1].accepted is None:
                break
            state = reconsidered(state)
    except OutOfTime as over:
        state = state.stopped(over)
    return state


def fits_of(scorer: Scorer[AttemptT, FitT], choices: Sequence[Sequence[EffectInstance]]) -> list[AttemptT]:
    """Return the best candidates, fitted to convergence.

    choices : start values of each candidate.
    """
    return scorer.to_the_end(scorer.rough(choices)[: scorer.runners])


def judge(scorer: Scorer[AttemptT, FitT], ends: Sequence[AttemptT]) -> SearchStep[FitT]:
    """Return the step with the scores of converged candidates, and its accepted candidate."""
    scorer = scorer.rebased(ends)
    scores = scorer.scores(ends)
    winner = scorer.winner(scores)
    return SearchStep(scorer.present, tuple(scores), winner, () if winner is None else scorer.alike(scores, winner))
