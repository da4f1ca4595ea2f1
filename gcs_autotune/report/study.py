"""What there is to tell about an identification: one or several fits of the same runs, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gcs_autotune.identify import Fit
from gcs_autotune.identify.validate import Validation
from gcs_autotune.trial import Trial

__all__ = ["Outcome", "RunRow", "Study", "study_to_dict"]


@dataclass(frozen=True, slots=True)
class RunRow:
    """One run of the study: what it holds and what it was used for."""

    name: str
    source: str
    duration: float
    samples: int
    signals: tuple[str, ...]
    role: str


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What one method made of the runs: a fit and how it predicts what it has not seen, or why it refused."""

    method: str
    fit: Fit | None
    seconds: float
    unseen: Validation | None = None
    refusal: str = ""
    objections: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """An identification ready to be told.

    ``outcomes``: one per method, the first fitted one is the answer. ``how_unseen`` says which data the check used.
    ``choice``: rows of the structure decision, in the columns of ``study_tables.choice_table``.
    ``trials``: the runs themselves, for the pictures of inputs and track.
    ``cannot_tell``, ``intervals``, ``proposals``: sentences; ``figures``: extra pictures as (caption,
    matplotlib figure).
    """

    title: str
    when: str
    runs: tuple[RunRow, ...]
    outcomes: tuple[Outcome, ...]
    how_unseen: str = ""
    choice: tuple[tuple[str, ...], ...] = ()
    choice_verdict: str = ""
    cannot_tell: tuple[str, ...] = ()
    intervals: tuple[str, ...] = ()
    proposals: tuple[tuple[str, ...], ...] = ()
    proposal_verdict: str = ""
    figures: tuple[tuple[str, Any], ...] = ()
    trials: tuple[Trial, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def answer(self) -> Outcome:
        """The outcome the page is about."""
        return next(o for o in self.outcomes if o.fit is not None)

    @property
    def fit(self) -> Fit:
        """The fit the page is about."""
        fit = self.answer.fit
        assert fit is not None
        return fit


def study_to_dict(study: Study) -> dict[str, Any]:
    """Return the JSON form: the answer's fit, and under ``methods`` what the others made of it."""
    answer = study.answer
    data = study.fit.to_dict()
    if answer.unseen is not None:
        data["validation"] = {"how": study.how_unseen, **answer.unseen.to_dict()}
    if study.choice:
        data["structure_choice"] = {"verdict": study.choice_verdict, "rows": [list(row) for row in study.choice]}
    if study.cannot_tell:
        data["cannot_tell"] = list(study.cannot_tell)
    if study.intervals:
        data["intervals"] = list(study.intervals)
    if study.proposals:
        data["plan_next"] = {"verdict": study.proposal_verdict, "rows": [list(row) for row in study.proposals]}
    if len(study.outcomes) > 1:
        data["methods"] = {o.method: _outcome(o) for o in study.outcomes}
    return data


def _outcome(outcome: Outcome) -> dict[str, Any]:
    if outcome.fit is None:
        return {"refused": outcome.refusal}
    data = outcome.fit.to_dict()
    kept = {k: data[k] for k in ("structure", "parameters", "fit_percent", "doubts", "model")}
    unseen = None if outcome.unseen is None else outcome.unseen.fit_percent
    return {**kept, "seconds": outcome.seconds, "unseen_fit_percent": unseen}
