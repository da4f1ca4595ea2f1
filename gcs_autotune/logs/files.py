"""Finding the runs to identify from on disk: one table of readers, by suffix."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.logs.dataflash import record_dataflash
from gcs_autotune.logs.mavlink_csv import is_mavlogdump, is_mission_planner, record_mavlogdump, record_mission_planner
from gcs_autotune.logs.qgc_csv import is_qgc, record_qgc
from gcs_autotune.logs.recording import LogReader, Recording
from gcs_autotune.logs.renaming import renamed
from gcs_autotune.logs.stretches import runs_of
from gcs_autotune.logs.tlog import record_tlog
from gcs_autotune.trial import Trial, load_trial

__all__ = ["READERS", "TRIALS_FOLDER", "load_runs", "record"]

TRIALS_FOLDER = "trials"
"""Where a run directory keeps its recorded manoeuvres."""

LEAD_IN = "-with-lead-in"
"""What a recording that begins earlier adds to the file name of its manoeuvre."""

INPUTS = frozenset("XYZKMN") | {"delta"}
"""Channels that drive a craft."""

IDENTIFYING = "relay"
"""The manoeuvre (``meta["manoeuvre"]`` in a trial's side file) a run directory is identified from."""

READERS: Mapping[str, LogReader] = {
    ".tlog": record_tlog,
    ".bin": record_dataflash,
    ".log": record_dataflash,
}
"""Suffix -> reader of (path, system id); anything else is read as CSV. A format is one file and one line here."""

CSV_READERS: tuple[tuple[Callable[[str], bool], LogReader], ...] = (
    (is_mission_planner, record_mission_planner),
    (is_mavlogdump, record_mavlogdump),
    (is_qgc, record_qgc),
)
"""Whether the first lines of a text file are of a ground station's making -> reader; else it is a table of runs."""
HEAD = 1 << 16
"""Characters of a text file that are looked at."""


def record(path: Path, system: int | None = None, parameters: Mapping[str, float] | None = None) -> Recording | None:
    """Read *path* as the log its suffix (or, of a CSV file, its first lines) says it is; None when it is no log.

    parameters : of the vehicle, for what the log itself does not tell.

    Raises
    ------
    BadFile
        Not there, unreadable, or not what its name says. UsageError: no vehicle of that *system*.
    """
    if not path.is_file():
        raise BadFile(f"{path}: no such file")
    reader = READERS.get(path.suffix.lower()) or _csv_reader(path)
    if reader is None:
        return None
    log = reader(path, system)
    for tape in log.tapes:
        tape.parameters = {**(parameters or {}), **tape.parameters}
    return log


def _csv_reader(path: Path) -> LogReader | None:
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            head = stream.read(HEAD)
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror or error}") from error
    return next((reader for fits, reader in CSV_READERS if fits(head)), None)


def load_runs(
    path: Path | str,
    *,
    pick: Collection[int] = (),
    system: int | None = None,
    columns: Mapping[str, str] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> list[Trial]:
    """Return the runs at *path*, in order of file name or of time.

    * a CSV file: that trial;
    * a telemetry log (``.tlog``) or a log on board (``.bin``, ``.log``): one trial per stretch armed in one mode;
    * a run directory: those of its ``trials/*.csv`` whose side file says ``"manoeuvre": "relay"``, with what their
      inputs were during the lead-in (recorded beside them); when no side
      file names any manoeuvre at all (files from elsewhere), every CSV there;
    * any other directory: its ``*.csv``, by the same rule, or its logs when it has no CSV.

    Parameters
    ----------
    pick : numbers of the stretches of a log to return (``dive#3`` is 3); all when empty.
    system : system id of the vehicle meant, for a log that heard several.
    columns : name in the file -> ``channel[unit]``, see :func:`parse_columns`.
    parameters : of the vehicle, for what a log itself does not tell.

    Raises
    ------
    BadFile
        Nothing at *path*, nothing readable in it, or none of a relay; and what ``load_trial`` raises.
    NotInformative
        A log without a stretch that is armed, driven and moves.
    UsageError
        A *pick*, *system* or *columns* that is not there.
    """
    place = Path(path)
    if place.is_dir():
        return _of_directory(place, pick, system, columns, parameters)
    if not place.is_file():
        raise BadFile(f"{place}: no such file or run directory")
    log = record(place, system, parameters)
    if log is None:
        return [load_trial(place, columns)]
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
        raise UsageError(f"{place} has no stretch {numbers} to identify from; it has: {there}")
    return found


def _with_history(trial: Trial, file: Path) -> Trial:
    """Return *trial* with what its inputs were during its lead-in, recorded beside it.

    An actuator that lags, plays or delays begins a manoeuvre where the commands before it have left it.
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
) -> list[Trial]:
    folder = place / TRIALS_FOLDER if (place / TRIALS_FOLDER).is_dir() else place
    files = sorted(folder.glob("*.csv"))
    if not files:
        logs = sorted(f for f in folder.iterdir() if f.suffix.lower() in READERS and f.suffix.lower() != ".log")
        if not logs:
            raise BadFile(f"{folder} holds no recorded run (*.csv, *.tlog, *.bin); give a file or a run directory")
        return [
            run
            for log in logs
            for run in load_runs(log, pick=pick, system=system, columns=columns, parameters=parameters)
        ]
    if any(_csv_reader(file) for file in files):
        return [
            run
            for file in files
            for run in load_runs(file, pick=pick, system=system, columns=columns, parameters=parameters)
        ]
    trials = [load_trial(file, columns) for file in files]
    if not any("manoeuvre" in t.meta for t in trials):
        return trials
    flown = zip(trials, files, strict=True)
    relays = [_with_history(t, file) for t, file in flown if t.meta.get("manoeuvre") == IDENTIFYING]
    if not relays:
        kinds = ", ".join(sorted({str(t.meta.get("manoeuvre", "unnamed")) for t in trials}))
        raise BadFile(f"{folder} holds no relay experiment, only: {kinds}; name the CSV file to identify from it")
    return relays
