"""``authority``: what a craft can do, from its model files and run directories. Nothing is flown or written to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs_autotune.design import Authority, CraftModels, FlownModel, authority_of
from gcs_autotune.documents import model_file
from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.identify import load_model
from gcs_autotune.logs import load_runs, record
from gcs_autotune.mavlink import load_params
from gcs_autotune.trial import Trial

__all__ = ["authority"]

TELEMETRY = "telemetry.tlog"
PARAMETERS = ("parameters_before.json", "parameters_after.json")
"""Files of a tune with parameters; the later one counts."""
DRIVEN = "XN"
"""Inputs whose flown range is read from runs."""


def authority(
    inputs: Sequence[Path],
    *,
    parameters: Mapping[str, float] | None = None,
    full_scale: Mapping[str, float] | None = None,
    throttle: float | None = None,
) -> Authority:
    """Return what the craft of these model files and run directories can do.

    parameters : of the vehicle; those in the run directories are used too. full_scale : input -> its value at full
        output, for models whose inputs are forces or angles. throttle : the working throttle [fraction].

    Raises
    ------
    BadFile
        A file contains no model.
    UsageError
        The models do not belong together, or an input's value at full output is unknown.
    """
    settings: dict[str, float] = {}
    firmwares: set[str] = set()
    boards: dict[str, str] = {}
    models = []
    for path in inputs:
        runs: Sequence[Trial] = ()
        file = path
        if path.is_dir():
            file = model_file(path)
            settings |= _settings(path)
            runs = readable_runs(path)
            firmwares |= {str(run.meta.get("firmware", "")) for run in runs} - {""}
            boards |= {uid: str(path) for run in runs if (uid := _board(run))}
        models.append(_flown(path, file, runs, full_scale or {}))
    surge, yaw = _roles(models)
    result = authority_of(
        CraftModels(
            surge,
            yaw,
            {**settings, **(parameters or {})},
            math.nan if throttle is None else throttle,
            rover=not firmwares or "ArduRover" in firmwares,
        )
    )
    if len(boards) < 2:
        return result
    runs_of = ", ".join(dict.fromkeys(boards.values()))
    same = (
        f"The runs {runs_of} are of one craft, although their autopilot boards differ. If not, the results are wrong."
    )
    return replace(result, assumed=(same, *result.assumed))


def _board(run: Trial) -> str:
    """Return the unique id of the autopilot that flew *run*; empty if unknown."""
    vehicle = run.meta.get("vehicle")
    return str(vehicle.get("uid", "")) if isinstance(vehicle, Mapping) else ""


def _flown(path: Path, file: Path, runs: Sequence[Trial], full_scale: Mapping[str, float]) -> FlownModel:
    found = load_model(file)
    model = replace(found.model, units=dict(found.inputs) or found.model.units)
    full = {}
    for channel, pairs in model.base.form.inputs.items():
        unit = found.inputs.get(channel, "1" if model.base.form.normalised else "")
        given = full_scale.get(channel) or next((full_scale[f] for f, _ in pairs if f in full_scale), None)
        if unit != "1" and given is None:
            what = f"in {unit}" if unit else "of unknown unit"
            raise UsageError(
                f"the input {channel} of {path} is {what}. Give its value at full output with --full-scale, or "
                "identify from runs with normalised output"
            )
        full[channel] = 1.0 if unit == "1" else float(given or 1.0)
    speeds = [float(np.mean(run["u"].values)) for run in runs if "u" in run]
    flown = {
        name: (min(float(c.values.min()) for c in channels), max(float(c.values.max()) for c in channels))
        for name in DRIVEN
        if (channels := [run[name] for run in runs if name in run and run[name].unit == "1" and len(run[name])])
    }
    speed = float(np.mean(speeds)) if speeds else math.nan
    return FlownModel(str(path), model, found.names, found.covariance, full, speed, flown)


def _roles(models: Sequence[FlownModel]) -> tuple[FlownModel | None, tuple[FlownModel, ...]]:
    """Return the model of surge and those of yaw, one per speed: that of the largest output."""
    surges, yaws = ([m for m in models if m.has(dof)] for dof in ("surge", "yaw"))
    if not (surges or yaws):
        raise UsageError("none of these models has surge or yaw. Give those of a heading and of a speed run")
    both = [m for m in surges if m in yaws]
    if len(surges) > 1 or (both and len(models) > 1):
        names = ", ".join(m.name for m in (surges if len(surges) > 1 else models))
        raise UsageError(f"several models of surge: {names}. Give one of them")
    if len(yaws) > 1 and not all(math.isfinite(m.speed) for m in yaws):
        unknown = ", ".join(m.name for m in yaws if not math.isfinite(m.speed))
        raise UsageError(f"the speed of {unknown} is unknown. Give its run directory, or one yaw model only")
    kept: list[FlownModel] = []
    for model in sorted(yaws, key=lambda m: m.speed):
        if kept and model.speed < (1.0 + SAME_SPEED) * kept[-1].speed:
            kept[-1] = max(kept[-1], model, key=lambda m: m.largest("N"))
        else:
            kept.append(model)
    return (surges[0] if surges else None), tuple(kept)


SAME_SPEED = 0.15
"""Relative difference of two speeds below which two yaw models are of the same speed."""


def readable_runs(path: Path) -> Sequence[Trial]:
    """Return the runs that were fitted; none if they cannot be read, since the model alone is usable."""
    try:
        return load_runs(path)
    except AutotuneError:
        return ()


def _settings(path: Path) -> dict[str, float]:
    """Return the vehicle's parameters that a run directory contains."""
    found: dict[str, float] = {}
    if (path / TELEMETRY).is_file():
        log = record(path / TELEMETRY)
        for store in log.stores if log is not None else ():
            found |= store.parameters
    for file in (path / name for name in PARAMETERS):
        if file.is_file():
            found |= load_params(file)
    return found
