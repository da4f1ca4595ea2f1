"""One step of a search for causes, whichever scorer fits and judges the candidates."""

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
    """Fits candidates added to the model ``present``, and scores the fits on the runs and on data left out.

    There are two: :class:`.LeastSquares`, and :class:`.WithProcessNoise` with a force that drifts in the model.
    """

    @property
    def present(self) -> FitT:
        """The model that candidates are added to."""

    @property
    def runners(self) -> int:
        """How many candidates are fitted to the end."""

    def rough(self, choices: Sequence[Sequence[EffectInstance]]) -> list[AttemptT]:
        """Fit candidates roughly, each from several values; the best first."""

    def to_the_end(self, rough: Sequence[AttemptT]) -> list[AttemptT]:
        """Fit to the end what was fitted roughly."""

    def rebased(self, ends: Sequence[AttemptT]) -> Scorer[AttemptT, FitT]:
        """Return the same with the better fit of the present model that the best of *ends* leads to, if any."""

    def scores(self, ends: Sequence[AttemptT]) -> list[CandidateScore[FitT]]:
        """Return the scores of candidates fitted to the end, the best first."""

    def winner(self, scores: Sequence[CandidateScore[FitT]]) -> CandidateScore[FitT] | None:
        """Return the candidate that is accepted; None for none."""

    def alike(self, scores: Sequence[CandidateScore[FitT]], winner: CandidateScore[FitT]) -> tuple[str, ...]:
        """Return the names that these runs do not distinguish from *winner*, its own first."""


Cause = tuple[str, str]
"""Slug and place of an effect."""


class Search(Protocol):
    """A search, and what it came to in the base model's units, whichever scorer it uses.

    ``words``: what was left out in turn. ``order``: the causes that are reported, in the order found.
    """

    @property
    def steps(self) -> Sequence[SearchStep[Any]]:
        """All steps, those without a winner included."""

    def stopped(self, over: OutOfTime) -> Self:
        """Return the search as it is, stopped."""

    @property
    def tried(self) -> int:
        """How many candidates were tried in one step."""

    @property
    def words(self) -> str:
        """What was left out in turn."""

    @property
    def names(self) -> Collection[str]:
        """Names that no hint has: of causes, and of what these runs do not distinguish from them."""

    @property
    def refused(self) -> Sequence[CandidateScore[Any]]:
        """Causes that were accepted, and taken back in the end."""

    def values(self, effect: EffectInstance, fit: Any = None) -> Mapping[str, Value]:
        """Return the numbers of an effect in *fit*, the model with all causes when None."""

    def shares(self, order: Sequence[EffectInstance]) -> Mapping[Cause, float]:
        """Return the share of what the base model leaves that each cause removed."""

    def gains(self, order: Sequence[EffectInstance]) -> tuple[ErrorReduction, ...]:
        """Return the error on data left out, before and after all causes."""

    def gains_of_each(
        self, order: Sequence[EffectInstance], gains: Sequence[ErrorReduction]
    ) -> Mapping[Cause, ErrorReduction]:
        """Return what each cause gains on data left out; *gains*: of all together."""

    def alike(self, order: Sequence[EffectInstance]) -> tuple[tuple[str, ...], ...]:
        """Return groups of names that these runs do not distinguish."""


SearchT = TypeVar("SearchT", bound=Search)


def add_one_by_one(
    state: SearchT,
    most: int,
    one_more: Callable[[SearchT], SearchT],
    reconsidered: Callable[[SearchT], SearchT],
) -> SearchT:
    """Take one step after the other, *most* in all, until none has a winner, or the search is stopped.

    reconsidered : called after each winner: every earlier cause defends its place beside it.
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
    """Return the best of the candidates, fitted to the end. choices : for each candidate the values to begin from."""
    return scorer.to_the_end(scorer.rough(choices)[: scorer.runners])


def judge(scorer: Scorer[AttemptT, FitT], ends: Sequence[AttemptT]) -> SearchStep[FitT]:
    """Return the step that candidates fitted to the end make: their scores, and which of them is accepted."""
    scorer = scorer.rebased(ends)
    scores = scorer.scores(ends)
    winner = scorer.winner(scores)
    return SearchStep(scorer.present, tuple(scores), winner, () if winner is None else scorer.alike(scores, winner))
