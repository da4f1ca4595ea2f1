"""Results of a flight: its runs, the figures and models computed from them, and the report page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs_autotune.errors import AutotuneError, NotInformative
from gcs_autotune.identify import Fit, Model, Validation, fit_axis, moved_besides, save_model, validate
from gcs_autotune.identify.thrust import with_doubt_of_thrust, with_thrust_curve
from gcs_autotune.manoeuvres import Preview, limited_orders
from gcs_autotune.report import (
    Document,
    FlightModel,
    FlightStory,
    TrialSummary,
    flight_document,
    preview_document,
    save_page,
    to_html,
)
from gcs_autotune.seatrials import MANOEUVRES as SHIP_MANOEUVRES
from gcs_autotune.seatrials import Sheet, ship_figures
from gcs_autotune.thrusters import write_pulls
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.authority import authority
from gcs_autotune.workflow.flight_plan import FlightPlan, FlightRun, FlySettings
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.self_planned import TrialStep
from gcs_autotune.workflow.settings import CommonSettings

__all__ = ["FlightResult", "read_flight", "write_previews"]


@dataclass(frozen=True, slots=True, eq=False)
class FlightResult:
    """The result of a flight.

    ``runs``: the runs with their records.
    ``sheets``: manoeuvring figures of the runs.
    ``models``: one model per degree of freedom.
    ``remarks``: results that the records do not determine.
    ``document``: the report, written to ``page``.
    ``steps``: steps of a self-planned trial, whose model has the required form.
    """

    runs: Sequence[FlightRun]
    page: Path
    document: Document
    sheets: Sequence[Sheet] = ()
    models: Sequence[FlightModel] = ()
    remarks: Sequence[str] = ()
    steps: Sequence[TrialStep] = ()

    @property
    def preview(self) -> Preview:
        """The preview of the first run."""
        return self.runs[0].preview

    @property
    def trial(self) -> Trial | None:
        """The record of the first run."""
        return self.runs[0].trial

    @property
    def fit(self) -> Fit[Model] | None:
        """The fit of the first model identified from the flight."""
        return self.models[0].fit if self.models else None


def write_previews(runs: Sequence[FlightRun], plan: FlightPlan, directory: Path, when: str) -> FlightResult:
    """Write the predicted tracks to ``preview.html`` in *directory*."""
    directory.mkdir(parents=True, exist_ok=True)
    page = directory / "preview.html"
    told = [(run.name, run.preview.trial, run.preview.summary(), run.rejection or run.caution) for run in runs]
    cycles = {
        run.name: (run.preview.motion, cycle)
        for run in runs
        if run.preview.motion is not None and (cycle := run.preview.cycle()) is not None
    }
    document = preview_document(f"Preview of {plan.title}", when, told, cycles)
    page.write_text(to_html(document), encoding="utf-8")
    return FlightResult(runs, page, document)


def read_flight(
    plan: FlightPlan,
    common: CommonSettings,
    record: RunDirectory,
    runs: Sequence[FlightRun],
    when: str,
    steps: Sequence[TrialStep] = (),
) -> FlightResult:
    """Return the figures and models computed from the records of *runs*. A figure or model that they do not determine
    becomes a remark.

    A model is fitted per degree of freedom and validated on the runs held out. The plan selects the held-out runs; by
    default it is the last of several runs. A self-planned trial (*steps*) already has its model. Each of its runs was
    predicted by the model identified before it.
    """
    remarks: list[str] = []
    sheets: list[Sheet] = []
    flown = [(run.settings, run.trial) for run in runs if run.trial is not None]
    for settings, trial in flown:
        of = f"{settings.name}: " if len(flown) > 1 else ""
        remarks += [of + text for text in _limited(trial)]
        if settings.kind.tied:
            table = record.path / f"{settings.name}.csv"
            write_pulls(trial, settings.force or "N", table)
            remarks.append(
                f"{of}write the pull of each level [N] into the column force of {table}, then run "
                f"`gcs-autotune thrusters {table}`. Or give all pulls as an option: `... thrusters {table} --forces "
                "0,1.2,4.8,...`"
            )
        try:
            sheets += ship_figures(trial) if settings.kind.name in SHIP_MANOEUVRES else ()
        except AutotuneError as error:
            remarks.append(f"{of}no figures: {error}")
    models = [FlightModel(steps[-1].outlook.fit)] if steps else []
    for dof, (used, held) in ({} if steps else _by_dof(flown)).items():
        try:
            models.append(_identified(dof, used, held, common))
            remarks += _left_out(dof, flown, record.path)
        except NotInformative as error:
            remarks.append(f"no model of {dof}: {error}" if len(flown) > 1 else f"no model: {error}")
    for model in models:
        stem = "" if len(models) == 1 else f"-{model.fit.dof}"
        record.save_json(f"fit{stem}.json", model.fit.to_dict())
        save_model(model.fit, record.path / f"model{stem}.json")
    if sheets:
        record.save_json("figures.json", {"schema": 1, "sheets": [sheet.to_dict() for sheet in sheets]})
    tracks = [(settings.name, trial) for settings, trial in flown]
    predicted = runs[0].preview.trial if len(runs) == 1 else None
    asked = plan.title if plan.until is None else f"A trial for {plan.until.title}"
    title = f"{asked}: {common.connection.uri.partition('?')[0]}"
    told = FlightStory(
        title,
        when,
        tracks,
        predicted,
        sheets,
        models,
        remarks,
        story_of(steps),
        str(common.directory or ""),
        bool(models) and _has_authority(record.path),
    )
    document = flight_document(told)
    page = save_page(record.path, document)
    return FlightResult(runs, page, document, sheets, models, remarks, steps)


def _has_authority(directory: Path) -> bool:
    """Return whether the models in *directory* determine any figure of `authority`."""
    try:
        return bool(authority([directory]).figures)
    except AutotuneError:
        return False


def story_of(steps: Sequence[TrialStep]) -> Sequence[TrialSummary]:
    """Return the steps of a self-planned trial as rows for the report page."""
    return [
        TrialSummary(s.run, s.why, s.seconds, s.precision.told(s.outlook.relative), s.outlook.predicted, s.ended)
        for s in steps
    ]


def _by_dof(flown: Sequence[tuple[FlySettings, Trial]]) -> Mapping[str, tuple[list[Trial], list[Trial]]]:
    """Return the runs to fit and those held out, for each degree of freedom that the runs excite."""
    found: dict[str, tuple[list[Trial], list[Trial]]] = {}
    for settings, trial in flown:
        dof = str(trial.meta.get("dof", ""))
        if settings.kind.identifies and dof:
            found.setdefault(dof, ([], []))[settings.held_out].append(trial)
    for dof, (used, held) in found.items():
        if not used:
            found[dof] = (held, [])
        elif not held and len(used) > 1:
            found[dof] = (used[:-1], used[-1:])
    return found


def _identified(dof: str, used: Sequence[Trial], held: Sequence[Trial], common: CommonSettings) -> FlightModel:
    fit = fit_axis(
        list(used), dof=dof, structure=common.structure, delay="auto" if common.delay is None else common.delay
    )
    if common.structure is None:
        fit = with_thrust_curve(fit, used)
    fit = with_doubt_of_thrust(fit, used, common.directory)
    unseen: Validation | None = validate(fit.whole_model, held) if held else None
    return FlightModel(fit, tuple(t.name for t in held), unseen)


def _left_out(dof: str, flown: Sequence[tuple[FlySettings, Trial]], directory: Path) -> list[str]:
    """Return a remark on motions other than *dof* in the runs, which a model of one degree of freedom omits."""
    swung = [trial for settings, trial in flown if settings.kind.identifies and trial.meta.get("dof") == dof]
    moved = moved_besides(swung, {dof})
    if not moved:
        return []
    names = dict.fromkeys(name for runs in moved.values() for name in runs)
    asked = "horizontal" if "sway" in moved else next(iter(moved))
    return [
        f"{', '.join(names)} also moved {' and '.join(sorted(moved))}, which the model of {dof} omits. "
        f"`gcs-autotune identify {shlex.quote(str(directory))} --dof {asked}` fits "
        f"{'them together' if asked == 'horizontal' else 'it'}"
    ]


def _limited(trial: Trial) -> list[str]:
    """Return a remark if an actuator delivered clearly less than commanded, because it was at a limit."""
    thrusts = "X" in trial and bool(np.any(trial["X"].values > 0.0))
    return [
        f"{force} was limited: {asked:.0%} commanded, {came:.0%} at the output"
        f"{' (a lower --throttle leaves the thrusters more range to steer)' * (force == 'N' and thrusts)}. "
        "Figures and model use the actual output"
        for force, (asked, came) in limited_orders(trial).items()
    ][:1]
