"""The contents of a log as plain data: messages and rates, modes, parameters, damage, excitation of its runs.

This module also writes its runs to disk, as the CSV and metadata files that every command reads.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs_autotune.crosscheck import contradictions
from gcs_autotune.errors import AutotuneError, BadFile, UsageError
from gcs_autotune.logs.channels import servo_map_of
from gcs_autotune.logs.dataflash import SIGNALS as ON_BOARD
from gcs_autotune.logs.mavlink_decoder import SIGNALS as ON_THE_LINK
from gcs_autotune.logs.mavlink_decoder import TRUTH
from gcs_autotune.logs.sample_store import Note, Recording, SampleStore
from gcs_autotune.logs.segmentation import Cut
from gcs_autotune.mavlink import save_params
from gcs_autotune.trial import Trial, save_trial

__all__ = ["fresh_folder", "survey", "write_runs"]


def survey(log: Recording, cut: Cut) -> dict[str, Any]:
    """Return the contents of a log as plain data, as ``logs list`` shows them.

    ``boots`` has a row per boot with its ``duration`` [s], and with ``modes`` and ``armed`` as (time since the boot's
    start [s], new state). ``messages`` is kind -> count and rate [1/s]. ``runs`` and ``left_out`` are the results of
    :func:`cut_runs`.
    """
    counted = sorted(log.census.seen.items(), key=lambda item: -item[1][0])
    return {
        "schema": 1,
        "source": log.meta.get("source", ""),
        "format": log.form,
        "counts": {k: v for k, v in log.meta.items() if k != "source"},
        "boots": [_boot(store) for store in log.stores],
        "messages": {
            kind: {
                "count": int(row[0]),
                "rate": round(log.census.rate(kind), 3),
                "read": kind in ON_BOARD or kind in ON_THE_LINK,
            }
            for kind, row in counted
        },
        "truth": sorted(TRUTH & set(log.census.seen)),
        "runs": [_run(run) for run in cut.runs],
        "left_out": [{"name": left.run.name, "why": left.why} for left in cut.left_out],
        "notes": [list(note) for note in _notes(log, cut)],
    }


def _boot(store: SampleStore) -> dict[str, Any]:
    start, end = store.span
    name = store.firmware.mode_name if store.firmware else (lambda number: f"MODE {number}")
    return {
        "vehicle": store.vehicle,
        "clock": store.clock,
        "duration": end - start,
        "modes": [[_since(t, start), name(number)] for t, number in store.modes],
        "armed": [[_since(t, start), on] for t, on in store.arming],
        "parameters": len(store.parameters),
        "servo_map": _servo_map(store),
        "late_samples": store.late,
        "absurd_samples": store.absurd,
        "dated_by_arrival": sorted(store.dated_by_arrival),
    }


def _since(t: float, start: float) -> float:
    return max(t - start, 0.0) if math.isfinite(t) else 0.0


def _servo_map(store: SampleStore) -> str:
    try:
        servos = servo_map_of(store)[0]
    except AutotuneError as error:
        return f"unknown: {error}"
    return ", ".join(servos.names) + " from outputs " + ", ".join(str(o.channel) for o in servos.outputs)


def _run(run: Trial) -> dict[str, Any]:
    return {
        "name": run.name,
        "stretch": run.meta.get("stretch"),
        "duration": run.duration,
        "channels": list(run.channels),
        "input_from": run.meta.get("input_from", ""),
        "sources": run.meta.get("sources", {}),
        "filters": run.meta.get("filters", {}),
        "excitation": run.meta.get("excitation", []),
    }


def _notes(log: Recording, cut: Cut) -> list[Note]:
    runs = [*cut.runs, *(left.run for left in cut.left_out)]
    every: list[Note] = [("contradiction", c.cause, c.cure) for run in cut.runs for c in contradictions(run)]
    every += [*log.notes, *(note for run in runs for note in run.meta.get("notes", ()))]
    return list(dict.fromkeys(every))


def fresh_folder(folder: Path) -> Path:
    """Create *folder*, which must not contain runs.

    Raises
    ------
    UsageError
        The folder contains CSV files, which would be mixed with the new runs.
    BadFile
        The folder cannot be created.
    """
    if folder.is_dir() and any(folder.glob("*.csv")):
        raise UsageError(f"{folder} already contains runs. Use another folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadFile(f"{folder} cannot be created: {error.strerror}. Use another folder with --out") from error
    return folder


def write_runs(
    folder: Path, label: str, runs: Sequence[Trial], log: Recording, report: Mapping[str, Any]
) -> list[Path]:
    """Write *runs* (``LABEL-03-MANUAL.csv``, with marks and metadata as ``.json``) and return their paths.

    It also writes the survey (*report*) as ``LABEL.log.json`` and the vehicle's parameters, if the log contains any, as
    ``LABEL.param``.

    Raises
    ------
    BadFile
        The disk is full, or the folder cannot be written.
    """
    stem = _plain(label)
    paths = []
    try:
        for run in runs:
            path = folder / f"{stem}-{int(run.meta['stretch']):02d}-{_plain(str(run.meta['mode']))}.csv"
            save_trial(run, path)
            paths.append(path)
        (folder / f"{stem}.log.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{folder} cannot be written: {error.strerror}. Check the disk") from error
    for store in log.stores[-1:]:
        if store.parameters:
            save_params(
                folder / f"{stem}.param", store.parameters, comment=f"{store.vehicle}, from {log.meta['source']}"
            )
    return paths


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.]+", "-", text).strip("-.") or "log"
