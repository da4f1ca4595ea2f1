"""Runs as they are handed in, made fit for preparation: split where the clock restarts, checked for wrong units.

What is found is written into the run's ``meta["notes"]`` (slug, cause, cure), as log readers do; :func:`.notes.told`
gives it back as doubts when the run is prepared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile, DataError, MissingChannel
from gcs_autotune.identify.cleaning import JUMP_SAMPLES, jumps_back
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.unit_check import check_units
from gcs_autotune.trial import Channel, Trial

__all__ = ["clock_jump", "left_out", "parts_of", "prepared_runs", "take_in"]

Record = TypeVar("Record")


def take_in(runs: Sequence[Trial]) -> tuple[Trial, ...]:
    """Return *runs* with those split in two (or more) whose clock jumps back, each checked for wrong units.

    Raises
    ------
    BadFile
        Two columns of a run contradict each other by the factor of a wrong unit.
    """
    return tuple(_noted(part, check_units(part)) for run in runs for part in parts_of(run))


def prepared_runs(
    runs: Sequence[Trial], prepare: Callable[[Trial], tuple[Record, ...]]
) -> tuple[tuple[Trial, ...], list[Record], tuple[Doubt, ...]]:
    """Prepare every run; one that cannot be used is left out, with a doubt that names it, as long as another can.

    Raises
    ------
    DataError
        No run can be used: what the first one raised.
    """
    used: list[Trial] = []
    records: list[Record] = []
    failures: list[tuple[str, DataError]] = []
    for run in runs:
        try:
            records += prepare(run)
            used.append(run)
        except MissingChannel:
            raise
        except DataError as error:
            failures.append((run.name, error))
    if not used:
        raise failures[0][1]
    return tuple(used), records, tuple(left_out(name, error) for name, error in failures)


def left_out(name: str, error: Exception) -> Doubt:
    """Say that the run called *name* was left out, and why."""
    return Doubt("run-left-out", f"run '{name}' was left out: {error}", "mend or drop that run, the others were used")


def _noted(trial: Trial, doubts: Sequence[Doubt]) -> Trial:
    if not doubts:
        return trial
    notes = [*trial.meta.get("notes", ()), *((d.slug, d.cause, d.cure) for d in doubts)]
    return replace(trial, meta={**trial.meta, "notes": notes})


def parts_of(trial: Trial) -> list[Trial]:
    """Cut *trial* where its clock jumps back; whole when it never does.

    Raises
    ------
    BadFile
        Not every channel jumps equally often.
    """
    cuts = {name: jumps_back(c.t) for name, c in trial.channels.items() if len(c) >= JUMP_SAMPLES}
    counts = {len(c) for c in cuts.values()}
    if not cuts or counts == {0}:
        return [trial]
    if len(counts) > 1:
        where = next(f"{float(trial[n].t[c[0] - 1]):.3f} s (channel {n})" for n, c in cuts.items() if len(c))
        raise BadFile(
            f"the clock of run '{trial.name}' jumps back after t = {where}, but not on every channel alike: "
            "cut the file there and identify the parts as two runs"
        )
    pieces = [_piece(trial, cuts, k) for k in range(counts.pop() + 1)]
    doubt = clock_jump(trial.name, len(pieces) - 1)
    return [_noted(piece, [doubt]) for piece in pieces]


def clock_jump(name: str, times: int) -> Doubt:
    """Say that the clock of the run called *name* jumped back so many *times*."""
    return Doubt(
        "clock-jump",
        f"the clock of run '{name}' jumps back {times} time(s)",
        "the parts were taken as runs of their own; check the logger, and that it is one craft",
    )


def _piece(trial: Trial, cuts: dict[str, NDArray[np.intp]], k: int) -> Trial:
    channels = {n: _part(trial[n], cut, k) for n, cut in cuts.items()}
    start = min(float(c.t[0]) for c in channels.values() if len(c))
    for name, channel in channels.items():
        if k and len(channel) and channel.t[0] > start and trial[name].values.size:
            before = float(trial[name].values[cuts[name][k - 1] - 1])
            held = name in ("X", "Y", "Z", "K", "M", "N", "delta")
            if held:
                t, values = np.r_[start, channel.t], np.r_[before, channel.values]
                channels[name] = replace(channel, t=t, values=values)
    return replace(trial, name=f"{trial.name} (part {k + 1})", channels=channels, marks=())


def _part(channel: Channel, cut: NDArray[np.intp], k: int) -> Channel:
    borders = [0, *(int(i) for i in cut), len(channel)]
    inside = slice(borders[k], borders[k + 1])
    return replace(channel, t=channel.t[inside], values=channel.values[inside])
