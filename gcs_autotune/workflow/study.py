"""A complete identification: runs, fits by one or all methods, validation, and recommended manoeuvres."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.identify import (
    METHODS,
    AxisFit,
    Fit,
    Model,
    ModelFile,
    Structure,
    Validation,
    fit,
    form_of,
    is_of_one_axis,
    model_file_of,
    moved_too,
    validate,
)
from gcs_autotune.identify.thrust import fit_surge, with_doubt_of_kind, with_thrust_curve
from gcs_autotune.models import Form
from gcs_autotune.registry import lookup
from gcs_autotune.report import MethodOutcome, RunRow, Study
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.settings import StudySettings
from gcs_autotune.workflow.study_sections import (
    Intervals,
    Proposed,
    Weighed,
    chosen_form,
    compared,
    drags_weighed,
    forms_weighed,
    next_manoeuvres,
    not_distinguished,
    profiled,
    response_plots,
)

__all__ = ["study", "study_of"]

HELD_BACK = 0.3
"""Fraction of a single run, at its end, that is held out for validation."""

MOST_FOLDS = 8
"""Largest number of runs that are held out one at a time. More runs are held out in groups."""

ALL = "all"

DRAGS: Mapping[str, Structure] = {str(n): n for n in get_args(Structure)}


Stage = Callable[[str, int, int], None]
"""Callback that receives the present step, the number of pieces done, and their total."""


def _unheard(stage: str, done: int, total: int) -> None:
    """Ignore progress: the default callback."""


def study(
    runs: Sequence[Trial], unseen: Sequence[Trial], settings: StudySettings, when: str, stage: Stage = _unheard
) -> Study:
    """Identify from *runs* and validate on the *unseen* runs; without these, on sections of *runs* held out in turn.

    stage : receives the progress before each piece of work.

    Raises
    ------
    AutotuneError
        The requested method failed; with ``method="all"``, every method failed.
    """
    forms = Weighed()
    if not settings.effects and settings.begin is None:
        settings = replace(settings, structure=form_of(settings.structure, settings.dof, runs) or settings.structure)
    if settings.choose:
        stage("choosing terms", 0, 1)
        choice = chosen_form(runs, form_of(settings.structure, settings.dof), settings)
        forms, settings = forms_weighed(choice), replace(settings, structure=choice.chosen.form, known={})
    methods = _methods(settings)
    pieces = _Pieces(stage, len(methods) * (1 + (_checks(runs, unseen) if settings.check else 0)))
    outcomes = [_outcome(name, runs, unseen, settings, pieces, lenient=len(methods) > 1) for name in methods]
    fitted = [o.fit for o in outcomes if o.fit is not None]
    if not fitted:
        raise UsageError(f"no method could identify these runs. The method output-error reports: {outcomes[0].refusal}")
    outcomes.sort(key=lambda o: o.fit is None)
    if settings.dof is None:
        outcomes[0] = _naming_what_moved_too(outcomes[0], runs)
    answer = outcomes[0]
    assert answer.fit is not None
    drags = Weighed()
    plain = answer.fit.whole_model is answer.fit.model
    if settings.check and is_of_one_axis(answer.fit) and settings.structure is None and plain:
        stage("comparing damping structures", 0, 1)
        drags = drags_weighed(answer.fit, runs)
    if settings.plan_next is not None:
        stage("planning the next manoeuvre", 0, 1)
    stated = Intervals()
    if settings.profile:
        stage("profiling the likelihood", 0, 1)
        stated = profiled(answer.fit, runs, settings.profile)
    beside = None if settings.compare is None else _other_model(settings, runs, stage)
    flown = Proposed() if settings.plan_next is None else next_manoeuvres(answer.fit, runs, settings.plan_next)
    return Study(
        title=f"Identification of {answer.fit.dof}: {', '.join(dict.fromkeys(t.name for t in runs))}",
        when=when,
        runs=(*(_row(t, "identification") for t in runs), *(_row(t, "check only") for t in unseen)),
        outcomes=tuple(outcomes),
        how_unseen=_how(runs, unseen, answer) if settings.check else "",
        choice=drags.rows or forms.rows,
        choice_verdict=drags.verdict or forms.verdict,
        not_distinguished=not_distinguished(answer.fit, runs),
        intervals=stated.sentences,
        compared_with="" if beside is None else beside.name,
        comparisons=() if beside is None else compared(answer.fit, beside, runs),
        proposals=flown.rows,
        proposal_verdict=flown.verdict,
        figures=(*response_plots(fitted), *stated.pictures, *flown.pictures),
        trials=(*runs, *unseen),
    )


def _naming_what_moved_too(answer: MethodOutcome, runs: Sequence[Trial]) -> MethodOutcome:
    """Return *answer* with a doubt for each degree of freedom that moved but is not in its model."""
    if not is_of_one_axis(answer.fit):
        return answer
    doubts = (*answer.fit.doubts, *moved_too(runs, (answer.fit.dof,)))
    return replace(answer, fit=replace(answer.fit, doubts=doubts))


def study_of(fit: AxisFit, runs: Sequence[Trial], title: str, when: str) -> Study:
    """Return an existing fit as a study of its *runs*, without validation."""
    return Study(
        title=title,
        when=when,
        runs=tuple(_row(t, "identification") for t in runs),
        outcomes=(MethodOutcome(fit.method, fit, 0.0),),
        not_distinguished=not_distinguished(fit, runs),
        trials=tuple(runs),
    )


def _other_model(settings: StudySettings, runs: Sequence[Trial], stage: Stage) -> ModelFile:
    """Return the model to compare with. If a method was requested, its model is fitted to the same runs."""
    if isinstance(settings.compare, ModelFile):
        return settings.compare
    method = str(settings.compare)
    lookup(METHODS, method, "identification method")
    stage(f"fitting {method} for comparison", 0, 1)
    other = fit(runs, structure_of(settings), method, dof=settings.dof, delay=settings.delay, use=settings.use)
    return model_file_of(other)


class _Pieces:
    """Counts the pieces of work of a study, for the progress report."""

    def __init__(self, stage: Stage, total: int) -> None:
        self._stage = stage
        self._total = total
        self._begun = 0

    def begin(self, what: str) -> None:
        """Report that the next piece of work begins."""
        self._stage(what, self._begun, self._total)
        self._begun += 1

    def skip(self, count: int) -> None:
        """Count *pieces* of work as done, because they are not needed."""
        self._begun += count


def _checks(runs: Sequence[Trial], unseen: Sequence[Trial]) -> int:
    """Return the number of validations on held-out data."""
    return len(unseen) or min(len(runs), MOST_FOLDS)


def structure_of(settings: StudySettings) -> str | Path | Form | None:
    """Return the structure with the requested name, with the constants known from the settings."""
    if not settings.known:
        return settings.structure
    if settings.begin is not None:
        raise UsageError("the --start model already contains the known constants. Omit --known")
    form = form_of(settings.structure, settings.dof)
    if form is None:
        raise UsageError(
            "--known applies only to coupled models. Add --dof horizontal, --dof 6dof or --structure FILE.toml"
        )
    return form.knowing(settings.known)


def _methods(settings: StudySettings) -> list[str]:
    """Return the requested method, or all methods for this kind of model."""
    if settings.method != ALL:
        return [settings.method]
    if settings.effects or settings.begin is not None:
        raise UsageError("effects and start values work only with the method output-error. Omit --method all")
    coupled = form_of(settings.structure, settings.dof) is not None
    return [m.name for m in METHODS.values() if (m.coupled if coupled else m.axis) is not None]


def _outcome(
    method: str,
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    settings: StudySettings,
    pieces: _Pieces,
    *,
    lenient: bool,
) -> MethodOutcome:
    begun = time.perf_counter()

    def identify(trials: Sequence[Trial]) -> Fit[Model]:
        options = {k: v for k, v in settings.options.items() if not lenient or k in dict(METHODS[method].options)}
        if method == "output-error" and _shows_a_thrust_curve(trials, settings):
            return fit_surge(trials, structure=_drag(settings), delay=settings.delay)
        found = fit(
            trials,
            structure_of(settings),
            method,
            dof=settings.dof,
            delay=settings.delay,
            use=settings.use,
            loss=settings.loss,
            effects=settings.effects,
            start=settings.begin,
            **options,
        )
        open_choice = method == "output-error" and settings.structure is None and _leaves_the_model_open(settings)
        return with_thrust_curve(found, trials) if open_choice and is_of_one_axis(found) else found

    checks = _checks(runs, unseen) if settings.check else 0
    pieces.begin(f"{method}: fitting")
    try:
        found = identify(runs)
    except AutotuneError as error:
        if not lenient:
            raise
        pieces.skip(checks)
        return MethodOutcome(method, None, time.perf_counter() - begun, refusal=str(error))
    if settings.effects or settings.begin is not None:
        found = with_doubt_of_kind(found, runs)
    seconds = time.perf_counter() - begun
    if not settings.check:
        return MethodOutcome(method, found, seconds)
    checked, objections = _check(found, identify, runs, unseen, lambda: pieces.begin(f"{method}: checking"))
    return MethodOutcome(method, found, seconds, checked, objections="; ".join(dict.fromkeys(objections)))


def _shows_a_thrust_curve(trials: Sequence[Trial], settings: StudySettings) -> bool:
    """Return whether the runs were flown to identify thrust over throttle, and no other structure is requested."""
    flown = all(t.meta.get("thrust_curve") is True for t in trials)
    drag = settings.structure is None or (isinstance(settings.structure, str) and settings.structure in DRAGS)
    return flown and drag and _leaves_the_model_open(settings) and settings.dof in (None, "surge")


def _leaves_the_model_open(settings: StudySettings) -> bool:
    """Return whether the settings neither determine the actuator or the start, nor restrict the fit."""
    given = settings.effects or settings.begin or settings.known or settings.use or settings.options
    return not given and settings.loss == "linear"


def _drag(settings: StudySettings) -> Structure | None:
    return DRAGS.get(str(settings.structure))


def _check(
    found: Fit[Model],
    identify: Callable[[Sequence[Trial]], Fit[Model]],
    runs: Sequence[Trial],
    unseen: Sequence[Trial],
    begin: Callable[[], None],
) -> tuple[Validation | None, list[str]]:
    """Return the validation on held-out data if there was any, what could not be validated, and why."""
    parts: list[Validation] = []
    objections: list[str] = []
    for model, held in _folds(found, identify, runs, unseen):
        begin()
        try:
            parts.append(validate(model(), held))
        except AutotuneError as error:
            objections.append(str(error))
    return (Validation.joined(parts) if parts else None), objections


def _folds(
    found: Fit[Model], identify: Callable[[Sequence[Trial]], Fit[Model]], runs: Sequence[Trial], unseen: Sequence[Trial]
) -> Iterator[tuple[Callable[[], Any], Sequence[Trial]]]:
    """Yield pairs of a fit function and the runs that its model has to predict."""
    if unseen:
        for run in unseen:
            yield (lambda: found.whole_model), [run]
        return
    if len(runs) == 1:
        run = runs[0]
        cut = run.end - HELD_BACK * run.duration
        held_back = run.between(cut, run.end)
        whole = found.whole_model
        if isinstance(whole, ExtendedModel):
            held_back = _with_what_went_before(held_back, run, whole)
        yield (lambda: identify([run.between(run.start, cut)]).whole_model), [held_back]
        return
    folds = min(len(runs), MOST_FOLDS)
    for k in range(folds):
        rest = [r for i, r in enumerate(runs) if i % folds != k]
        held = [r for i, r in enumerate(runs) if i % folds == k]
        yield partial(_model_of, identify, rest), held


def _with_what_went_before(rest: Trial, run: Trial, model: ExtendedModel) -> Trial:
    """Return *rest* with the commands of the whole run, because backlash, lag and drift continue across the cut."""
    commands = {n: run[n] for n in model.base.form.inputs if n in run}
    return replace(rest, channels={**rest.channels, **commands})


def _model_of(identify: Callable[[Sequence[Trial]], Fit[Model]], runs: Sequence[Trial]) -> Any:
    return identify(runs).whole_model


def _how(runs: Sequence[Trial], unseen: Sequence[Trial], answer: MethodOutcome) -> str:
    """Return which data the validation used, and what could not be validated."""
    if answer.unseen is None and answer.objections and len(runs) == 1 and not unseen:
        share = round(100.0 * (1.0 - HELD_BACK))
        why = f"A second model would need the first {share} % of the run alone, but there {answer.objections}"
        return f"No held-out check was possible. {why.rstrip('.')}."
    said = _checked_on(runs, unseen) if answer.unseen is not None else "No held-out check was possible."
    return said + (f" Not checked: {answer.objections.rstrip('.')}." if answer.objections else "")


def _checked_on(runs: Sequence[Trial], unseen: Sequence[Trial]) -> str:
    if unseen:
        return (
            f"Runs predicted from the inputs alone: {', '.join(t.name for t in unseen)}. Only their initial state is "
            "fitted."
        )
    if len(runs) == 1:
        share = round(100 * HELD_BACK)
        return (
            f"Single run: a second model is identified without its last {share} % and predicts that part. "
            "The model above uses the whole run."
        )
    return (
        "Each run is predicted by a model identified from the others. Only the initial state is fitted to the "
        "predicted run. The model above uses all runs."
    )


def _row(trial: Trial, role: str) -> RunRow:
    samples = max((len(c) for c in trial.channels.values()), default=0)
    return RunRow(trial.name, str(trial.meta.get("source", "")), trial.duration, samples, tuple(trial.channels), role)
