"""Gains from a file instead of designed ones, either from a dry run or any others. The proof is the same."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from gcs_autotune.axes import AXES
from gcs_autotune.design import Change
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.identify import load_model
from gcs_autotune.link import same_float32
from gcs_autotune.logs import TRIALS_FOLDER
from gcs_autotune.manoeuvres import StepSettings
from gcs_autotune.mavlink import load_params
from gcs_autotune.trial import Trial, load_trial
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.record import PROPOSED
from gcs_autotune.workflow.settings import SuppliedGains

__all__ = ["changes_of", "load_gains", "step_of"]


def load_gains(path: Path, axis: str) -> SuppliedGains:
    """Read the gains for the proof of *axis* from a parameter file, or from a run directory with a proposal.

    Raises
    ------
    BadFile
        Unreadable, or a directory without a proposal.
    UsageError
        The run flew the step of another axis. Or the axis is a speed or a turn rate and no run with its step exists;
            such a step is flown about the measured steady value.
    """
    file = path / PROPOSED if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise BadFile(f"{path} contains no {PROPOSED}. Use a run that proposed gains without writing them")
    values, flown = load_params(file), _proof_in(file.parent / TRIALS_FOLDER)
    stepped = AXES[axis].stepped
    if flown is not None and flown.meta.get("signal") != stepped:
        raise UsageError(
            f"the run of {file} steps {flown.meta.get('signal')}, but a tune of {axis} steps {stepped}. Use the "
            "axis flown in that run"
        )
    if flown is None and AXES[axis].controls_velocity:
        raise UsageError(
            f"{file} is not in a run directory with a {axis} step. That step is needed to test the gains. "
            "Use the directory of a dry run (`tune ... --dry-run`)"
        )
    if flown is None:
        return SuppliedGains(file, values, None)
    fit = file.with_name("fit.json")
    noise = load_model(fit).noise if fit.is_file() else {}
    return SuppliedGains(file, values, _settings_of(flown), noise)


def _proof_in(folder: Path) -> Trial | None:
    """Return the first step flown in a run; None if there is none."""
    runs = (load_trial(file) for file in sorted(folder.glob("*.csv")))
    return next((run for run in runs if run.purpose == "proof"), None)


def _settings_of(flown: Trial) -> StepSettings:
    known: dict[str, Any] = {f.name: flown.meta[f.name] for f in fields(StepSettings) if f.name in flown.meta}
    try:
        numbers = {n: float(v) for n, v in known.items() if n != "signal"}
        return StepSettings(signal=str(known["signal"]), **numbers)
    except (KeyError, TypeError, ValueError) as error:
        raise BadFile(f"the meta file of '{flown.name}' does not contain the step: {error}") from error


def step_of(given: SuppliedGains, asked: StepSettings) -> StepSettings:
    """Return the step flown by the run of *given*, or the *asked* one if it flew none."""
    return asked if given.step is None else replace(given.step, speed=asked.speed)


def changes_of(context: TuneContext, given: SuppliedGains) -> tuple[Change, ...]:
    """Return the changes that *given* would make on the vehicle; nothing is written.

    Raises
    ------
    UsageError
        A parameter is not a gain of this axis, or a value is outside its documented range.
    """
    names = context.axis.names
    gains = {names.own(g.parameter): g for g in context.axis.gains}
    changes = []
    for own, new in given.values.items():
        gain = gains.get(own)
        if gain is None:
            raise UsageError(
                f"{given.file} sets {own}, which is not a gain of the {context.axis.name} loop of this vehicle. Its "
                f"gains are {', '.join(gains)}"
            )
        low, high = sorted(names.own_value(gain.parameter, limit) for limit in (gain.low, gain.high))
        if not low <= new <= high and not context.settings.beyond_ranges:
            raise UsageError(
                f"{given.file} sets {own} to {new:g}, outside its documented range {low:g} to {high:g}. Use "
                "--beyond-ranges to allow it"
            )
        old = names.own_value(gain.parameter, context.present[gain.parameter])
        if not same_float32(old, new):
            changes.append(Change(own, old, new, low, high, f"{gain.meaning}: from {given.file}"))
    return tuple(changes)
