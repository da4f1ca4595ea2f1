"""The record of an identification: one or several fits of the same runs, and sentences about them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.experiments import DofComparison
from gcs_autotune.identify import Fit, Model, Validation, is_of_one_axis
from gcs_autotune.models import FORMS, CoupledModel
from gcs_autotune.report.toolkit.axis_fit import (
    explained_sentence,
    model_sentences,
    model_words,
    noise_words,
    with_effects,
)
from gcs_autotune.report.toolkit.document import Verdict
from gcs_autotune.report.toolkit.wording import (
    format_error,
    format_number,
    format_percent,
    format_quantity,
)
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "MethodOutcome",
    "RunRow",
    "Study",
    "answer_sentences",
    "comparison_sentences",
    "structure_title",
    "unseen_remarks",
    "verdict_of",
]


@dataclass(frozen=True, slots=True)
class RunRow:
    """One run of an identification: its contents and its use."""

    name: str
    source: str
    duration: float
    samples: int
    signals: tuple[str, ...]
    role: str


@dataclass(frozen=True, slots=True, eq=False)
class MethodOutcome:
    """The result of one identification method: a fit with its prediction of held-out data, or the reason why it
    failed.
    """

    method: str
    fit: Fit[Model] | None
    seconds: float
    unseen: Validation | None = None
    refusal: str = ""
    objections: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """The complete record of an identification.

    ``outcomes``: one per method; the first with a fit is selected.
    ``how_unseen``: what data the held-out check used.
    ``choice``: rows of the comparison of structures, in the columns of ``study_tables.choice_table``.
    ``trials``: the runs, for the figures of inputs and track.
    ``comparisons``: comparison with the model ``compared_with``, axis by axis.
    ``not_distinguished``, ``intervals``, ``proposals``: sentences.
    ``figures``: extra figures as (caption, function that draws it).
    """

    title: str
    when: str
    runs: tuple[RunRow, ...]
    outcomes: tuple[MethodOutcome, ...]
    how_unseen: str = ""
    choice: tuple[tuple[str, ...], ...] = ()
    choice_verdict: str = ""
    not_distinguished: tuple[str, ...] = ()
    intervals: tuple[str, ...] = ()
    compared_with: str = ""
    comparisons: tuple[DofComparison, ...] = ()
    proposals: tuple[tuple[str, ...], ...] = ()
    proposal_verdict: str = ""
    figures: tuple[tuple[str, Callable[[], Figure]], ...] = ()
    trials: tuple[Trial, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def answer(self) -> MethodOutcome:
        """The outcome of the selected method: the first one with a fit."""
        return next(o for o in self.outcomes if o.fit is not None)

    @property
    def fit(self) -> Fit[Model]:
        """The fit of the selected outcome."""
        fit = self.answer.fit
        assert fit is not None
        return fit


def comparison_sentences(study: Study) -> tuple[str, ...]:
    """Return two sentences per degree of freedom that compare steady state and rise time of both models."""
    return tuple(s for c in study.comparisons for s in _compared(c, study.compared_with))


def _compared(c: DofComparison, other: str) -> tuple[str, str]:
    unit = f"{DOFS[c.dof].position_unit}/s"
    largest, smallest = (format_quantity(x, c.input_unit) for x in (c.largest, c.smallest))
    settles = [format_quantity(v, unit) for v in c.steady]
    said = f"{c.dof}, at the largest input ({largest}): steady speed {settles[0]}; {other}: {settles[1]}. "
    said += f"The difference is {format_quantity(c.steady_apart, unit)}"
    if c.quantum > 0.0:
        step = format_quantity(c.quantum, unit)
        said += f", {'within' if c.same_steady else 'more than'} the sensor resolution of {step}"
        said += ". The drag of both models is taken as equal" if c.same_steady else ""
    rise = [format_number(t) for t in c.rise]
    soon = f"{c.dof}, at the smallest input ({smallest}): rise time to {100.0 * c.share:.0f} % {rise[0]} s; "
    soon += f"{other}: {rise[1]} s. The difference is {format_number(c.rise_apart)} s "
    soon += f"({format_number(c.samples, 2)} samples)"
    return f"{said}.", f"{soon}."


def structure_title(fit: Fit[Model]) -> str:
    """Return the heading of the table with the fitted model."""
    if is_of_one_axis(fit):
        return f"Model of {fit.dof}: {model_words(fit)}"
    model = fit.model
    assert isinstance(model, CoupledModel | ExtendedModel)  # of one axis: the case above
    form = model.base.form if isinstance(model, ExtendedModel) else model.form
    name = f" '{form.name}'" if form.name in FORMS else ""
    return f"Model{name}: {form.title}{with_effects(fit.effects)}"


def answer_sentences(fit: Fit[Model]) -> tuple[str, ...]:
    """Return sentences on the selected fit: its meaning, its residual and its origin."""
    about = model_sentences(fit) if is_of_one_axis(fit) else _residual_sentences(fit)
    return (*about, f"Method: {fit.method}, from {', '.join(fit.used)}.")


def _residual_sentences(fit: Fit[Model]) -> tuple[str, ...]:
    """Return the residual of a coupled model, signal by signal."""
    residuals = {n: r for n, r in fit.remainder.items() if n in SIGNALS}
    if not residuals:
        return ()
    rows = ", ".join(f"{n} {format_error(r.rms, SIGNALS[n][0], 2)}" for n, r in residuals.items())
    coloured = {n: r for n, r in residuals.items() if r.unexplained > 0.0}
    if not coloured:
        return (f"Residual (rms): {rows}. It is {noise_words(*residuals.values())}.",)
    rest = ", ".join(f"{n} {format_error(r.unexplained, SIGNALS[n][0], 2)}" for n, r in coloured.items())
    return (f"Residual (rms): {rows}. Correlated, unexplained part: {rest}.",)


def unseen_remarks(answer: MethodOutcome) -> tuple[str, ...]:
    """Return the remarks to print below the table of held-out predictions."""
    poor = answer.unseen is not None and any(s.fit_percent < 0.0 for s in answer.unseen.statistics)
    return (
        ("A fit below 0 % means that the prediction error is larger than the variation of the signal.",) if poor else ()
    )


def verdict_of(fit: Fit[Model], unseen: Validation | None = None) -> Verdict:
    """Return the verdict of an identification: how well the fit predicts held-out data, or else explains the motion,
    and its kind.
    """
    percent = fit.fit_percent if unseen is None else unseen.fit_percent
    said = explained_sentence(fit.fit_percent)
    if unseen is not None:
        identified = (
            f" ({format_percent(fit.fit_percent)} of the motion used for the fit)" if fit.fit_percent > 0.0 else ""
        )
        said = explained_sentence(percent, "held-out motion", identified)
    worst = next((d for d in fit.doubts if d.grade == "distrust" and d.slug != "poor-fit"), None)
    if worst is not None:
        said = f"Do not trust this model: {worst.cause.split('. ')[0].rstrip('.')}. {said}"
    if worst is not None or percent < 40.0 or any(d.slug in ("poor-fit", "cannot-tell") for d in fit.doubts):
        return Verdict(f"{said} Read the doubts before you use the model.", "bad", answer_sentences(fit))
    return Verdict(said, "good" if percent >= 70.0 and not fit.doubts else "neutral", answer_sentences(fit))
