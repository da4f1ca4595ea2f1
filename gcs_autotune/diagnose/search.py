"""One step of a search for causes, whichever scorer fits and judges the candidates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from gcs_autotune.diagnose.score import CandidateScore, FitT, SearchStep
from gcs_autotune.effects import EffectInstance

__all__ = ["Scorer", "fits_of", "judge"]

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


def fits_of(scorer: Scorer[AttemptT, FitT], choices: Sequence[Sequence[EffectInstance]]) -> list[AttemptT]:
    """Return the best of the candidates, fitted to the end. choices : for each candidate the values to begin from."""
    return scorer.to_the_end(scorer.rough(choices)[: scorer.runners])


def judge(scorer: Scorer[AttemptT, FitT], ends: Sequence[AttemptT]) -> SearchStep[FitT]:
    """Return the step that candidates fitted to the end make: their scores, and which of them is accepted."""
    scorer = scorer.rebased(ends)
    scores = scorer.scores(ends)
    winner = scorer.winner(scores)
    return SearchStep(scorer.present, tuple(scores), winner, () if winner is None else scorer.alike(scores, winner))
