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
    """Fit candidates added to the model ``present``, and score them on the fitted runs and on held-out data.

    There are two scorers: :class:`.LeastSquares`, and :class:`.WithProcessNoise` with a drifting force in the model.
    """

    @property
    def present(self) -> FitT:
        """The model that candidates are added to."""

    @property
    def runners(self) -> int:
        """Number of candidates that are fitted until they converge."""

    def rough(self, choices: Sequence[Sequence[EffectInstance]]) -> list[AttemptT]:
        """Fit candidates roughly, each from several start values; return the best first."""

    def to_the_end(self, rough: Sequence[AttemptT]) -> list[AttemptT]:
        """Fit the roughly fitted candidates until they converge."""

    def rebased(self, ends: Sequence[AttemptT]) -> Scorer[AttemptT, FitT]:
        """Return this scorer on a better fit of the present model, if the best of *ends* leads to one."""

    def scores(self, ends: Sequence[AttemptT]) -> list[CandidateScore[FitT]]:
        """Return the scores of the converged candidates, the best first."""

    def winner(self, scores: Sequence[CandidateScore[FitT]]) -> CandidateScore[FitT] | None:
        """Return the candidate that is accepted; None for none."""

    def alike(self, scores: Sequence[CandidateScore[FitT]], winner: CandidateScore[FitT]) -> tuple[str, ...]:
        """Return the causes that these runs do not distinguish from *winner*, starting with *winner* itself."""


Cause = tuple[str, str]
"""Slug and place of an effect."""


class Search(Protocol):
    """A search and its result in the base model's units, for either scorer.

    ``words``: what was left out in turn. ``order``: the reported causes, in the order found.
    """

    @property
    def steps(self) -> Sequence[SearchStep[Any]]:
        """All steps, including those without a winner."""

    def stopped(self, over: OutOfTime) -> Self:
        """Return the search in its present state, marked as stopped."""

    @property
    def tried(self) -> int:
        """Number of candidates tried in one step."""

    @property
    def words(self) -> str:
        """What was left out in turn."""

    @property
    def names(self) -> Collection[str]:
        """Causes that are not reported as hints: the accepted ones, and those that these runs do not distinguish from
        them."""

    @property
    def refused(self) -> Sequence[CandidateScore[Any]]:
        """Causes that were accepted first and rejected at the end."""

    def values(self, effect: EffectInstance, fit: Any = None) -> Mapping[str, Value]:
        """Return the numbers of an effect in *fit*, the model with all causes when None."""

    def shares(self, order: Sequence[EffectInstance]) -> Mapping[Cause, float]:
        """Return the fraction of the base model's error that each cause removed."""

    def gains(self, order: Sequence[EffectInstance]) -> tuple[ErrorReduction, ...]:
        """Return the held-out error before and after all causes."""

    def gains_of_each(
        self, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
    ) -> Mapping[Cause, ErrorReduction]:
        """Return the held-out gain of each cause; *gains*: of all together."""

    def alike(self, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
        """Return groups of causes that these runs do not distinguish."""


SearchT = TypeVar("SearchT", bound=Search)


def add_one_by_one(
    state: SearchT,
    most: int,
    one_more: Callable[[SearchT], SearchT],
    reconsidered: Callable[[SearchT], SearchT],
) -> SearchT:
    """Take up to *most* steps, until none has a winner or the search is stopped.

    reconsidered : called after each winner, to compare every earlier cause with its rivals again.
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
    """Return the best candidates after convergence. choices : for each candidate the start values."""
    return scorer.to_the_end(scorer.rough(choices)[: scorer.runners])


def judge(scorer: Scorer[AttemptT, FitT], ends: Sequence[AttemptT]) -> SearchStep[FitT]:
    """Return the step made of converged candidates: their scores and the accepted one."""
    scorer = scorer.rebased(ends)
    scores = scorer.scores(ends)
    winner = scorer.winner(scores)
    return SearchStep(scorer.present, tuple(scores), winner, () if winner is None else scorer.alike(scores, winner))
