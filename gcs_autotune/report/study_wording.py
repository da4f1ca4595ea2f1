"""The sentences about an identification."""

from __future__ import annotations

from gcs_autotune.identify import AxisFit, Fit
from gcs_autotune.models.coupled import FORMS
from gcs_autotune.report.numbers import format_error, format_percent
from gcs_autotune.report.study import Outcome, Study
from gcs_autotune.report.wording import Headline, Tone, explains, model_sentences, model_words
from gcs_autotune.sname import SIGNALS

__all__ = ["answer_sentences", "structure_title", "unseen_remarks", "verdict_headline"]


def structure_title(fit: Fit) -> str:
    """Return the heading of the model's table."""
    if isinstance(fit, AxisFit):
        return f"Model of {fit.dof}: {model_words(fit)} ({fit.structure})"
    known = FORMS.get(fit.structure)
    return f"Model '{fit.structure}'" + (f": {known.title}" if known is not None else "")


def answer_sentences(study: Study) -> tuple[str, ...]:
    """Return what the fit means, how well it fits, and where it comes from."""
    fit = study.fit
    said = list(model_sentences(fit)) if isinstance(fit, AxisFit) else [_fits(fit)]
    said.append(f"Method: {fit.method}, from {', '.join(fit.used)}.")
    return tuple(said)


def _fits(fit: Fit) -> str:
    said = f"The model, simulated from the inputs alone, {explains(fit.fit_percent)} the motion it was fitted to."
    left = {n: r for n, r in fit.remainder.items() if n in SIGNALS}
    if not left:
        return said
    rows = ", ".join(f"{n} {format_error(r.rms, SIGNALS[n][0], 2)}" for n, r in left.items())
    coloured = {n: r for n, r in left.items() if r.unexplained > 0.0}
    if not coloured:
        return f"{said} Left of it (rms): {rows}, which change from sample to sample, as measurement noise does."
    rest = ", ".join(f"{n} {format_error(r.unexplained, SIGNALS[n][0], 2)}" for n, r in coloured.items())
    return f"{said} Left of it (rms): {rows}; of that correlated, so unexplained and no noise: {rest}."


def unseen_remarks(answer: Outcome) -> tuple[str, ...]:
    """Return what is to be said below the table of what was predicted."""
    poor = answer.unseen is not None and any(s.fit_percent < 0.0 for s in answer.unseen.statistics)
    return ("A fit below 0 %: the prediction errs by more than the signal varies.",) if poor else ()


def verdict_headline(study: Study) -> Headline:
    """Return the one sentence everybody reads first, its tone, and what follows from it."""
    fit, unseen = study.fit, study.answer.unseen
    percent = fit.fit_percent if unseen is None else unseen.fit_percent
    where = "the motion it was fitted to" if unseen is None else "motion it has not seen"
    said = f"The model {explains(percent)} {where}"
    if unseen is not None:
        said += f" ({format_percent(fit.fit_percent)} of what it was fitted to)" if fit.fit_percent > 0.0 else ""
    said += "."
    grave = [d for d in fit.doubts if d.slug in ("poor-fit", "cannot-tell", "not-converged", "run-apart")]
    if percent < 40.0 or grave:
        return Headline(said + " Read what to doubt before you use it.", "bad", answer_sentences(study))
    tone: Tone = "good" if percent >= 70.0 and not fit.doubts else "neutral"
    return Headline(said, tone, answer_sentences(study))
