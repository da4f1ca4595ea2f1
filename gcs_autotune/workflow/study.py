"""An identification from end to end: runs in, fits by one or all methods, checks on unseen data, what to fly next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.identify import METHODS, AxisFit, Fit, fit
from gcs_autotune.identify.door import form_of
from gcs_autotune.identify.validate import Validation, join, validate
from gcs_autotune.models.coupled import Form
from gcs_autotune.report.study import Outcome, RunRow, Study
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.findings import (
    Proposed,
    Weighed,
    cannot_tell,
    chosen_form,
    drags_weighed,
    forms_weighed,
    next_manoeuvres,
    response_pictures,
)

__all__ = ["StudySettings", "study"]

HELD_BACK = 0.3
"""Share of a single run held back for the check on unseen data: its end."""

MOST_FOLDS = 8
"""Runs left out in turn; with more of them they are left out in groups."""

ALL = "all"


@dataclass(frozen=True, slots=True)
class StudySettings:
    """What ``identify`` was asked for; the names as in :func:`gcs_autotune.identify.fit`.

    ``check`` on data left out; ``choose``: drop the terms of a coupled form these runs do not justify; ``plan_next``:
    propose manoeuvres of so many seconds.
    """

    dof: str | None = None
    structure: str | Path | Form | None = None
    method: str = "output-error"
    delay: Literal["auto"] | float = "auto"
    use: tuple[str, ...] | None = None
    loss: Literal["linear", "soft_l1"] = "linear"
    options: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    check: bool = True
    choose: bool = False
    plan_next: float | None = None


def study(runs: Sequence[Trial], unseen: Sequence[Trial], settings: StudySettings, when: str) -> Study:
    """Identify from *runs*, check on *unseen* ones; without any, on parts of *runs* left out in turn.

    Raises
    ------
    AutotuneError
        What the method asked for raised; with ``method="all"`` only when every method refused.
    """
    forms = Weighed()
    if settings.choose:
        choice = chosen_form(runs, form_of(settings.structure, settings.dof), settings)
        forms, settings = forms_weighed(choice), replace(settings, structure=choice.chosen.form, known={})
    methods = _methods(settings)
    outcomes = [_outcome(name, runs, unseen, settings, lenient=len(methods) > 1) for name in methods]
    fitted = [o.fit for o in outcomes if o.fit is not None]
    if not fitted:
        raise UsageError(f"no method could identify these runs; output-error says: {outcomes[0].refusal}")
    outcomes.sort(key=lambda o: o.fit is None)
    answer = outcomes[0]
    assert answer.fit is not None
    drags = Weighed()
    if settings.check and isinstance(answer.fit, AxisFit) and settings.structure is None:
        drags = drags_weighed(answer.fit, runs)
    flown = Proposed() if settings.plan_next is None else next_manoeuvres(answer.fit, runs, settings.plan_next)
    return Study(
        title=f"Identification of {answer.fit.dof}: {', '.join(dict.fromkeys(t.name for t in runs))}",
        when=when,
        runs=(*(_row(t, "identification") for t in runs), *(_row(t, "check only") for t in unseen)),
        outcomes=tuple(outcomes),
        how_unseen=_how(runs, unseen) if answer.unseen is not None else "",
        choice=drags.rows or forms.rows,
        choice_verdict=drags.verdict or forms.verdict,
        cannot_tell=cannot_tell(answer.fit, runs),
        proposals=flown.rows,
        proposal_verdict=flown.verdict,
        figures=(*response_pictures(fitted), *flown.pictures),
    )


def structure_of(settings: StudySettings) -> str | Path | Form | None:
    """Return the structure asked for, with the constants that are known."""
    if not settings.known:
        return settings.structure
    form = form_of(settings.structure, settings.dof)
    if form is None:
        raise UsageError(
            "constants (--known) belong to a coupled model: give --dof horizontal, 6dof or a form's TOML file"
        )
    return form.fixing(settings.known)


def _methods(settings: StudySettings) -> list[str]:
    """Return the method asked for, or all that fit this kind of model."""
    if settings.method != ALL:
        return [settings.method]
    coupled = form_of(settings.structure, settings.dof) is not None
    return [m.name for m in METHODS.values() if (m.coupled if coupled else m.axis) is not None]


def _outcome(
    method: str, runs: Sequence[Trial], unseen: Sequence[Trial], settings: StudySettings, *, lenient: bool
) -> Outcome:
    begun = time.perf_counter()

    def identify(trials: Sequence[Trial]) -> Fit:
        options = {k: v for k, v in settings.options.items() if not lenient or k in dict(METHODS[method].options)}
        return fit(
            trials,
            structure_of(settings),
            method,
            dof=settings.dof,
            delay=settings.delay,
            use=settings.use,
            loss=settings.loss,
            **options,
        )

    try:
        found = identify(runs)
    except AutotuneError as error:
        if not lenient:
            raise
        return Outcome(method, None, time.perf_counter() - begun, refusal=str(error))
    seconds = time.perf_counter() - begun
    check = _check(found, identify, runs, unseen) if settings.check else None
    return Outcome(method, found, seconds, check)


def _check(
    found: Fit, identify: Callable[[Sequence[Trial]], Fit], runs: Sequence[Trial], unseen: Sequence[Trial]
) -> Validation | None:
    """Return how the model predicts what it has not seen, None when there is nothing to check on."""
    try:
        if unseen:
            return found.validate(unseen)
        return _left_out(identify, runs)
    except AutotuneError:
        return None


def _left_out(identify: Callable[[Sequence[Trial]], Fit], runs: Sequence[Trial]) -> Validation:
    if len(runs) == 1:
        run = runs[0]
        cut = run.end - HELD_BACK * run.duration
        return validate(identify([run.between(run.start, cut)]).model, run.between(cut, run.end))
    folds = min(len(runs), MOST_FOLDS)
    parts = []
    for k in range(folds):
        rest = [r for i, r in enumerate(runs) if i % folds != k]
        parts.append(validate(identify(rest).model, [r for i, r in enumerate(runs) if i % folds == k]))
    return join(parts)


def _how(runs: Sequence[Trial], unseen: Sequence[Trial]) -> str:
    if unseen:
        return f"Predicted from the inputs alone, only the initial state fitted: {', '.join(t.name for t in unseen)}."
    if len(runs) == 1:
        share = round(100 * HELD_BACK)
        return (
            f"One run only: identified once more without its last {share} %, which that model then predicts "
            "(the answer above uses the whole run)."
        )
    return (
        "Each run predicted by a model identified from the others (the answer above uses all of them). "
        "Only the initial state is fitted to the run predicted."
    )


def _row(trial: Trial, role: str) -> RunRow:
    samples = max((len(c) for c in trial.channels.values()), default=0)
    return RunRow(trial.name, str(trial.meta.get("source", "")), trial.duration, samples, tuple(trial.channels), role)
