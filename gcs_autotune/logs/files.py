"""Find recorded runs on disk: files of every type in the table of ``formats``, and directories."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from msgspec import Struct

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.logs.formats import LOG_SUFFIXES, format_of
from gcs_autotune.logs.renaming import renamed
from gcs_autotune.logs.sample_store import Recording
from gcs_autotune.logs.segmentation import runs_of
from gcs_autotune.sname import DOFS, INPUTS, Dof
from gcs_autotune.trial import Purpose, Trial, load_trial
from gcs_autotune.untrusted_text import visible
from gcs_autotune_files import Refused, conform, read

__all__ = ["TRIALS_FOLDER", "load_runs", "record"]


TRIALS_FOLDER = "trials"
"""Name of the folder of a run directory that contains the recorded manoeuvres."""

LEAD_IN = "-with-lead-in"
"""Suffix of the file name for a recording that starts before its manoeuvre."""

LONG_ENOUGH: Collection[Purpose] = ("identification", "proof")
"""Values of :attr:`Trial.purpose` for trials that are long enough to identify from if no complete experiment was
flown."""

LEAST_SAMPLES = 30
"""Smallest number of motion samples of a usable run: three seconds at 10 Hz. Project choice."""


def record(path: Path, system: int | None = None, parameters: Mapping[str, float] | None = None) -> Recording | None:
    """Return the log at *path* as read, its type being recognised by its content or, if damaged, by its suffix. Return
    None for a table of columns.

    parameters : parameters of the vehicle, used if missing in the log.

    Raises
    ------
    BadFile
        The file is missing, unreadable, or of an unsupported type. The message states the type and how to convert it.
        UsageError: no vehicle of that *system*.
    """
    if not path.exists():
        raise BadFile(f"{path} does not exist")
    form = format_of(path)
    if form is None or form.record is None:
        return None
    log = form.record(path, system)
    for store in log.stores:
        store.parameters = {**(parameters or {}), **store.parameters}
    return log


def load_runs(
    path: Path | str,
    *,
    pick: Collection[int] = (),
    system: int | None = None,
    columns: Mapping[str, str] | None = None,
    parameters: Mapping[str, float] | None = None,
    by_speed: bool = False,
) -> list[Trial]:
    """Return the runs at *path*, in order of file name or of time.

    * a CSV file: that trial;
    * a telemetry log (``.tlog``), an onboard log (``.bin``, ``.log``), a PX4 ULog: one trial per segment armed in one
      mode; its type is recognised by its content;
    * a MATLAB file or a ROS bag: that run;
    * a run directory: those of its ``trials/*.csv`` that were flown for identification, with their inputs during the
      lead-in. If none of these is complete: the incomplete ones and the steps of a proof, with a doubt. If no metadata
      file contains a manoeuvre (files from another source): every CSV in that folder;
    * any other directory: its ``*.csv``, by the same rules, or its logs if it contains no CSV.

    Parameters
    ----------
    pick : numbers of the log's segments to return (``dive#3`` is 3); empty: all.
    system : system id of the vehicle, for a log with several.
    columns : name in the file -> ``channel[unit]``, see :func:`parse_columns`.
    parameters : parameters of the vehicle, used if missing in the log.
    by_speed : take the measured speeds of the shafts in a log as inputs, not the commands.

    Raises
    ------
    BadFile
        There is nothing at *path*, nothing readable, or nothing flown for identification; also as for ``load_trial``.
    NotInformative
        The log contains no segment that is armed, driven and moves.
    UsageError
        A *pick*, *system* or name in *columns* does not exist.
    """
    place = Path(path)
    form = format_of(place) if place.exists() else None
    if form is None and place.is_dir():
        return _of_directory(place, pick, system, columns, parameters, by_speed)
    if not place.exists():
        raise BadFile(f"{place} does not exist. Give a file or a run directory")
    log = None if form is not None and form.runs is not None else record(place, system, parameters)
    if log is None and by_speed:
        raise UsageError(f"--input speed: {place} is not a log with ESC messages. Give the .tlog or .bin of the run")
    if form is not None and form.runs is not None:
        return form.runs(place, columns or {})
    if log is None:
        return [load_trial(place, columns)]
    for store in log.stores:
        store.by_speed = by_speed
    runs = runs_of(log)
    if columns:
        runs = [renamed(run, columns) for run in runs]
    return _picked(place, runs, pick)


def _picked(place: Path, runs: list[Trial], pick: Collection[int]) -> list[Trial]:
    found = [r for r in runs if not pick or r.meta["stretch"] in pick]
    missing = set(pick) - {r.meta["stretch"] for r in found}
    if missing:
        there = "; ".join(r.name for r in runs)
        numbers = ", ".join(map(str, sorted(missing)))
        raise UsageError(f"{place} contains no segment {numbers}. It contains: {there}")
    return found


def _with_history(trial: Trial, file: Path) -> Trial:
    """Return *trial* with its inputs during the lead-in, recorded in a separate file.

    The initial state of an actuator with lag, backlash or delay depends on the commands before the manoeuvre.
    """
    whole = file.with_name(f"{file.stem}{LEAD_IN}.csv")
    if not whole.is_file():
        return trial
    before = load_trial(whole)
    channels = {n: before[n] if n in INPUTS and n in before else c for n, c in trial.channels.items()}
    return replace(trial, channels=channels)


def _of_directory(
    place: Path,
    pick: Collection[int],
    system: int | None,
    columns: Mapping[str, str] | None,
    parameters: Mapping[str, float] | None,
    by_speed: bool,
) -> list[Trial]:
    folder = place / TRIALS_FOLDER if (place / TRIALS_FOLDER).is_dir() else place
    files = sorted(folder.glob("*.csv"))
    if not files:
        logs = sorted(f for f in folder.iterdir() if f.suffix.lower() in LOG_SUFFIXES)
        if not logs:
            raise BadFile(
                f"{folder} is a folder without a recorded run (*.csv, {', '.join(f'*{s}' for s in LOG_SUFFIXES)}): "
                f"give a file or a run directory{_holds(folder)}"
            )
        return [
            run
            for log in logs
            for run in load_runs(
                log, pick=pick, system=system, columns=columns, parameters=parameters, by_speed=by_speed
            )
        ]
    if by_speed:
        raise UsageError(f"--input speed: {place} contains tables of runs. Give the .tlog or .bin of the run")
    if any(format_of(file) for file in files):
        return [
            run
            for file in files
            for run in load_runs(
                file, pick=pick, system=system, columns=columns, parameters=parameters, by_speed=by_speed
            )
        ]
    trials = [load_trial(file, columns) for file in files]
    if not any("manoeuvre" in t.meta for t in trials):
        return trials
    flown = [_with_history(t, file) for t, file in zip(trials, files, strict=True) if t.purpose]
    whole = [t for t in flown if t.purpose == "identification" and t.ending != "aborted"]
    known = _fitted_to(place)
    if known and known <= {t.name for t in flown}:
        whole = list({t.name: t for t in flown if t.name in known}.values())  # of one flown again the last
    runs = whole or list(_makeshift(flown))
    if not runs:
        kinds = ", ".join(sorted({str(t.meta.get("manoeuvre", "unnamed")) for t in flown}))
        raise BadFile(
            f"{folder} contains no run in which an actuator is driven long enough for identification, only: {kinds}. "
            "Give one of its CSV files to try anyway"
        )
    return runs


def _holds(folder: Path) -> str:
    """Return a sentence on what *folder* contains: its runs, as the directory of ``tune all`` does, or its files."""
    runs = sorted(f for f in folder.iterdir() if any((f / TRIALS_FOLDER).glob("*.csv")))
    if runs:
        return f". It contains these runs: {', '.join(visible(str(run)) for run in runs)}"
    names = sorted(visible(f.name) for f in folder.iterdir())
    return f". It contains {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}" if names else ". It is empty"


class _FitData(Struct):
    """The part of ``fit.json`` that is read: the names of the fitted runs."""

    used: list[str]


def _fitted_to(place: Path) -> set[str]:
    """Return the names of the runs to which the model of their directory was fitted; empty if unknown."""
    try:
        return set(conform(read(place / "fit.json"), _FitData).used)
    except Refused:
        return set()


def _makeshift(flown: Sequence[Trial]) -> Iterator[Trial]:
    """Yield usable parts of a run without a complete experiment, with a doubt: incomplete trials and steps.

    The short pulses of a check are used only if there is nothing else.
    """
    driven = [t for t in flown if _is_driven(t)]
    longer = [t for t in driven if t.purpose in LONG_ENOUGH]
    for run in longer or [t for t in driven if t.purpose == "check"]:
        why = "is incomplete" if run.ending == "aborted" else f"was flown as a {run.purpose}, not for identification"
        doubt = (
            f"makeshift-run-{run.name}",
            f"'{run.name}' {why}; its directory has no complete experiment",
            "fly the whole experiment, then identify again",
        )
        dof = _flown_dof(run)
        yield replace(run, meta={**run.meta, "dof": dof and dof.name, "notes": [*run.meta.get("notes", ()), doubt]})


def _flown_dof(trial: Trial) -> Dof | None:
    """Return the degree of freedom that a manoeuvre excites, from its metadata file."""
    name, signal = trial.meta.get("dof"), trial.meta.get("signal")
    return next((d for d in DOFS.values() if d.name == name or signal in (d.position, d.velocity)), None)


def _is_driven(trial: Trial) -> bool:
    """Return whether the actuator of the degree of freedom was driven, and the resulting motion was measured."""
    dof = _flown_dof(trial)
    if dof is None or dof.force not in trial or not (dof.position in trial or dof.velocity in trial):
        return False
    motion = trial[dof.position if dof.position in trial else dof.velocity]
    return len(motion) >= LEAST_SAMPLES and float(np.ptp(trial[dof.force].values)) > 0.0
