"""What is in a log, as plain data: messages and rates, modes, parameters, damage, and what its runs may tell."""

from __future__ import annotations

import math
from typing import Any

from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import read_servo_map
from gcs_autotune.logs.dataflash_signals import SIGNALS as ON_BOARD
from gcs_autotune.logs.mavlink_signals import SIGNALS as ON_THE_LINK
from gcs_autotune.logs.mavlink_signals import TRUTH
from gcs_autotune.logs.recording import Recording
from gcs_autotune.logs.stretches import Cut
from gcs_autotune.logs.tape import Note, RecordedParameters, Tape
from gcs_autotune.trial import Trial

__all__ = ["survey"]


def survey(log: Recording, cut: Cut) -> dict[str, Any]:
    """Return what ``logs list`` shows.

    ``boots`` has a row per boot with its ``duration`` [s], ``modes`` and ``armed`` as (time since its start [s],
    what); ``messages`` is kind -> count and rate [1/s]; ``runs`` and ``left_out`` are what :func:`cut_runs` found.
    """
    counted = sorted(log.census.seen.items(), key=lambda item: -item[1][0])
    return {
        "schema": 1,
        "source": log.meta.get("source", ""),
        "format": log.form,
        "counts": {k: v for k, v in log.meta.items() if k != "source"},
        "boots": [_boot(tape) for tape in log.tapes],
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


def _boot(tape: Tape) -> dict[str, Any]:
    start, end = tape.span
    name = tape.firmware.mode_name if tape.firmware else (lambda number: f"MODE {number}")
    return {
        "vehicle": tape.vehicle,
        "clock": tape.clock,
        "duration": end - start,
        "modes": [[_since(t, start), name(number)] for t, number in tape.modes],
        "armed": [[_since(t, start), on] for t, on in tape.arming],
        "parameters": len(tape.parameters),
        "servo_map": _servo_map(tape),
        "late_samples": tape.late,
        "absurd_samples": tape.absurd,
        "dated_by_arrival": sorted(tape.dated_by_arrival),
    }


def _since(t: float, start: float) -> float:
    return max(t - start, 0.0) if math.isfinite(t) else 0.0


def _servo_map(tape: Tape) -> str:
    if tape.firmware is None:
        return "unknown: the log does not tell what autopilot it is of"
    try:
        servos = read_servo_map(RecordedParameters(tape.parameters), tape.firmware, skid=True)
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
    every: list[Note] = [*log.notes, *(note for run in runs for note in run.meta.get("notes", ()))]
    return list(dict.fromkeys(every))
