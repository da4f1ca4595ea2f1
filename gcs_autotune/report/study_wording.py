"""The sentences about an identification."""

from __future__ import annotations

from gcs_autotune.identify import AxisFit, Fit
from gcs_autotune.models.coupled import FORMS
from gcs_autotune.report.numbers import format_percent, format_quantity
from gcs_autotune.report.study import Study
from gcs_autotune.report.wording import Headline, Tone, model_sentences, structure_words
from gcs_autotune.sname import SIGNALS

__all__ = ["answer_sentences", "structure_title", "verdict_headline"]


def structure_title(fit: Fit) -> str:
    """Return the heading of the model's table."""
    if isinstance(fit, AxisFit):
        return f"Model of {fit.dof}: {structure_words(fit.structure)} ({fit.structure})"
    known = FORMS.get(fit.structure)
    return f"Model '{fit.structure}'" + (f": {known.title}" if known is not None else "")


def answer_sentences(study: Study) -> tuple[str, ...]:
    """Return what the fit means, how well it fits, and where it comes from."""
    fit = study.fit
    said = list(model_sentences(fit)) if isinstance(fit, AxisFit) else [_fits(fit)]
    said.append(f"Method: {fit.method}, from {', '.join(fit.used)}.")
    return tuple(said)


def _fits(fit: Fit) -> str:
    noise = ", ".join(f"{n} {format_quantity(s, SIGNALS[n][0], 2)}" for n, s in fit.noise.items() if n in SIGNALS)
    said = f"The model, simulated from the inputs alone, explains {format_percent(fit.fit_percent)} of the motion."
    return said + (f" Noise found: {noise}." if noise else "")


def verdict_headline(study: Study) -> Headline:
    """Return the one sentence everybody reads first, its tone, and what follows from it."""
    fit, unseen = study.fit, study.answer.unseen
    percent = fit.fit_percent if unseen is None else unseen.fit_percent
    where = "of the motion" if unseen is None else "of motion it has not seen"
    said = f"The model explains {format_percent(percent)} {where}."
    grave = [d for d in fit.doubts if d.slug in ("poor-fit", "cannot-tell", "not-converged", "run-apart")]
    if percent < 40.0 or grave:
        return Headline(said + " Read what to doubt before you use it.", "bad", answer_sentences(study))
    tone: Tone = "good" if percent >= 70.0 and not fit.doubts else "neutral"
    return Headline(said, tone, answer_sentences(study))
