"""Optional parts of a study: undetermined parameters, choice of structure, recommended manoeuvres, Bode plot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.experiments import (
    DofComparison,
    FormChoice,
    compare_models,
    eliminate,
    identifiability,
    plan_next,
    profile,
    weigh_drags,
)
from gcs_autotune.identify import (
    METHODS,
    AxisFit,
    Fit,
    Model,
    ModelFile,
    is_of_one_axis,
    model_file_of,
    scaled_form,
)
from gcs_autotune.identify.frequency import FrequencyResponse
from gcs_autotune.models import Form, Nomoto1
from gcs_autotune.report import correlation_plot, format_error, frequency_plot, plan_plot, profile_plot
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.settings import StudySettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


__all__ = [
    "Intervals",
    "Proposed",
    "Weighed",
    "chosen_form",
    "compared",
    "drags_weighed",
    "forms_weighed",
    "next_manoeuvres",
    "not_distinguished",
    "profiled",
    "response_plots",
]

SHOWN = 6
"""Number of ranked manoeuvres shown. Project choice."""

WELL_KNOWN = 0.02
"""Relative standard error below which a parameter needs no further run. A control design tolerates larger errors.
Project choice.
"""

ENOUGH = "These runs determine every parameter of this model to 2 % or better. More runs are not necessary"

Rows = tuple[tuple[str, ...], ...]
Plot: TypeAlias = tuple[str, Callable[[], "Figure"]]
"""A caption and the function that plots the figure."""


@dataclass(frozen=True, slots=True)
class Weighed:
    """A comparison of structures: rows of ``study_tables.choice_table`` and the verdict."""

    rows: Rows = ()
    verdict: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Intervals:
    """Intervals of parameters: a sentence for each, and plots with captions."""

    sentences: tuple[str, ...] = ()
    pictures: tuple[Plot, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Proposed:
    """Recommended manoeuvres: rows of ``study_tables.proposal_table``, the verdict, plots with captions."""

    rows: Rows = ()
    verdict: str = ""
    pictures: tuple[Plot, ...] = ()


def not_distinguished(fit: Fit[Model], runs: Sequence[Trial]) -> tuple[str, ...]:
    """Return a sentence for each parameter that the runs of the fit do not determine."""
    try:
        doubts = identifiability(fit, runs).doubts
    except AutotuneError:
        return ()
    return tuple(f"{d.cause}: {d.cure}." for d in doubts)


def compared(fit: Fit[Model], other: ModelFile, runs: Sequence[Trial]) -> tuple[DofComparison, ...]:
    """Return, axis by axis, how the responses of the model of *fit* and of *other* to the inputs of *runs* compare.

    Raises
    ------
    UsageError
        The models have no common axis that the runs excite, or their forces have different units.
    """
    own = model_file_of(fit)
    return compare_models(own.model, other.model, (own.inputs, other.inputs), runs)


def profiled(fit: Fit[Model], runs: Sequence[Trial], names: Sequence[str]) -> Intervals:
    """Return the profile-likelihood intervals of the parameters *names*, and the correlation of the estimates.

    Raises
    ------
    UnknownName
        A name is not that of a fitted parameter.
    """
    found = [profile(fit, runs, name) for name in names]
    pictures = (
        (
            "Deviance (-2 log-likelihood) over each parameter. The line marks the end of the 95 % interval.",
            partial(profile_plot, found),
        ),
        (
            "Correlation of the estimates. Dark squares are strongly correlated pairs.",
            partial(correlation_plot, identifiability(fit, runs)),
        ),
    )
    return Intervals(tuple(f"{f.words}." for f in found), pictures)


def drags_weighed(fit: AxisFit, runs: Sequence[Trial]) -> Weighed:
    """Return the drag structures compared by their errors on held-out data, and the verdict."""
    try:
        choice = weigh_drags(fit, runs)
    except AutotuneError:
        return Weighed()
    least = min((r.bic for r in choice.table if math.isfinite(r.bic)), default=math.nan)
    rows = tuple(
        (
            r.structure,
            _people(r.left_out, choice.signal),
            "" if math.isnan(r.bic) else f"{r.bic - least + 0.0:.1f}",
            "chosen" if r.structure == choice.chosen else "",
        )
        for r in choice.table
    )
    return Weighed(rows, ". ".join(reason[0].upper() + reason[1:] for reason in choice.reasons) + ".")


def _people(value: float, signal: str) -> str:
    if not math.isfinite(value):
        return "not every part"
    return format_error(value, SIGNALS[signal].unit)


def chosen_form(runs: Sequence[Trial], form: Form | None, settings: StudySettings) -> FormChoice:
    """Return the form without the terms that *runs* do not justify.

    Raises
    ------
    UsageError
        No coupled form was requested.
    """
    if form is None:
        raise UsageError("--choose applies to a coupled model. Use --dof horizontal, 6dof or a form's TOML file")
    form = form.knowing(settings.known).driven_by({name for run in runs for name in run.channels})
    form, _ = scaled_form(form, runs)
    method = settings.method if settings.method in METHODS else "output-error"
    delay = None if settings.delay == "auto" else float(settings.delay)
    return eliminate(runs, form, method, delay=delay, **settings.options)


def forms_weighed(choice: FormChoice) -> Weighed:
    """Return the forms compared by their errors on held-out data, and the reason for the choice."""
    least = min((r.bic for r in choice.table if math.isfinite(r.bic)), default=math.nan)
    rows = tuple(
        (
            r.form.name,
            f"{100.0 * r.left_out:.1f} %" if math.isfinite(r.left_out) else "not every part",
            f"{r.bic - least + 0.0:.1f}" if math.isfinite(r.bic) else "",
            "chosen" if r is choice.chosen else ", ".join(r.complaints),
        )
        for r in choice.table
    )
    return Weighed(rows, "; ".join(choice.reasons) + ("." if choice.reasons else ""))


def next_manoeuvres(fit: Fit[Model], runs: Sequence[Trial], seconds: float) -> Proposed:
    """Return the recommended manoeuvres, the verdict, and a plot of the improvement by the best manoeuvre."""
    proposal = plan_next(fit, runs, seconds=seconds)
    rows = []
    for plan in proposal.plans[:SHOWN]:
        reach = plan.reach
        factors = sorted(proposal.factors(plan).items(), key=lambda item: -item[1])[:3]
        buys = ", ".join(f"{n} {_times(f)}" for n, f in factors)
        takes = f"{reach.room:.0f} m, {math.degrees(reach.turned):.0f}\u00b0 of turning"
        rows.append((plan.candidate.title, f"{seconds:.0f} s", buys, takes + "".join(f"; {x}!" for x in plan.flags)))
    known = float(np.max(proposal.now.relative, initial=0.0)) < WELL_KNOWN
    verdict = ". ".join((*([ENOUGH] if known else []), *proposal.words)) + "."
    if not rows:
        return Proposed((), verdict)
    caption = "Expected standard errors, now and with the best manoeuvre added."
    return Proposed(tuple(rows), verdict, ((caption, partial(plan_plot, proposal)),))


def _times(factor: float) -> str:
    return "becomes identifiable" if math.isinf(factor) else f"std / {factor:.1f}"


def response_plots(fits: Sequence[Fit[Model]]) -> tuple[Plot, ...]:
    """Return the Bode plot if one of the fits measured a frequency response."""
    found = next((f for f in fits if is_of_one_axis(f) and f.method == "frequency"), None)
    if found is None:
        return ()
    response = FrequencyResponse.from_dict(found.extra["response"])
    caption = "Frequency response from input to rate, with coherence. The line is the first-order Nomoto model."
    nomoto = {"Nomoto 1": Nomoto1.from_single_dof(found.model)}
    return ((caption, partial(frequency_plot, response, nomoto)),)
