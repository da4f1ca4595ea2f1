"""A tape cut into runs: one per stretch armed in one mode, those that nothing drives or moves left out."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs_autotune.errors import NotInformative
from gcs_autotune.logs.channels import motion_channels
from gcs_autotune.logs.excitation import excitation_of, little_told
from gcs_autotune.logs.filters import filters_of
from gcs_autotune.logs.outputs import drive_channels
from gcs_autotune.logs.recording import Recording
from gcs_autotune.logs.tape import Note, Tape
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["Cut", "LeftOut", "cut_runs", "runs_of"]

SHORTEST = 5.0
"""Chosen [s]: a shorter stretch is no manoeuvre."""
SILENCE = 3.0
"""Chosen [s]: when nothing at all was heard for longer, what follows is another run."""
FEWEST = 20
"""Fewest samples of any motion channel."""
NO_INPUT = ("motion-only", "no-inputs")
"""Notes that say why a log has no input."""
FORCES = ("X", "Y", "Z", "K", "M", "N")


@dataclass(frozen=True, slots=True)
class _Stretch:
    """From ``start`` to ``end`` [s] the craft was armed in ``mode``."""

    start: float
    end: float
    mode: str


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A stretch from which nothing can be identified, and why."""

    run: Trial
    why: str

    def __str__(self) -> str:
        return f"{self.run.name}: {self.why}"


@dataclass(frozen=True, slots=True)
class Cut:
    """What became of a log: the ``runs``, and the stretches left out."""

    runs: list[Trial]
    left_out: list[LeftOut]


def runs_of(log: Recording) -> list[Trial]:
    """Return the runs in a log, numbered through in order of time, e.g. ``dive#3 MANUAL 120-185 s``.

    Raises
    ------
    NotInformative
        No stretch is driven and moves; the message says what was there.
    """
    cut = cut_runs(log)
    if not cut.runs:
        raise NotInformative(_nothing(log.tapes, cut.left_out))
    return cut.runs


def cut_runs(log: Recording) -> Cut:
    """Cut a log at boots, silences, and every change of mode or arming."""
    runs: list[Trial] = []
    dropped: list[LeftOut] = []
    number = 0
    for tape in log.tapes:
        motion, sources = motion_channels(tape)
        drive, origin, doubts = drive_channels(tape)
        zero = tape.span[0]
        for stretch in _stretches(tape):
            number += 1
            name = f"{tape.name}#{number} {stretch.mode} {stretch.start - zero:.0f}-{stretch.end - zero:.0f} s"
            channels = {n: _between(c, stretch.start, stretch.end) for n, c in {**motion, **drive}.items()}
            run = Trial(
                name,
                {n: c for n, c in channels.items() if len(c)},
                _marks(tape, stretch),
                "imported",
                meta={
                    **log.meta,
                    "format": log.form,
                    "vehicle": tape.vehicle,
                    "firmware": tape.firmware.name if tape.firmware else "unknown",
                    "mode": stretch.mode,
                    "stretch": number,
                    "clock": tape.clock,
                    "late_samples": tape.late,
                    "absurd_samples": tape.absurd,
                    "dated_by_arrival": sorted(tape.dated_by_arrival),
                    "input_from": origin,
                    "sources": sources,
                    "filters": filters_of(tape.parameters, sources),
                    **({"outputs_dated": "midway"} if origin == "servo outputs" else {}),
                    "notes": [*log.notes, *tape.notes, *doubts],
                },
            )
            why = _useless(run, stretch, [*log.notes, *doubts])
            if why:
                dropped.append(LeftOut(run, why))
            else:
                runs.append(_looked_at(run))
    words = [str(left) for left in dropped]
    return Cut([_with_dropped(run, words) for run in runs], dropped)


def _between(channel: Channel, start: float, end: float) -> Channel:
    """Return the samples with ``start <= t <= end`` without copying them."""
    first, last = np.searchsorted(channel.t, start, side="left"), np.searchsorted(channel.t, end, side="right")
    return Channel(channel.name, channel.unit, channel.t[first:last], channel.values[first:last])


def _looked_at(run: Trial) -> Trial:
    """Return a run with a first look at what it may tell, and a doubt when that is little."""
    looks = excitation_of(run)
    doubt = little_told(looks)
    notes = [*run.meta["notes"], *([doubt] if doubt else [])]
    return replace(run, meta={**run.meta, "excitation": [e.to_dict() for e in looks], "notes": notes})


def _with_dropped(run: Trial, dropped: list[str]) -> Trial:
    return replace(run, meta={**run.meta, "stretches_left_out": dropped})


def _stretches(tape: Tape) -> list[_Stretch]:
    """Cut at every change of mode or arming and around silences; without any word of arming it counts as armed."""
    start, end = tape.span
    silent = tape.silences(SILENCE)
    armed = tape.arming or [(start, True)]
    modes = tape.modes or [(start, -1)]
    cuts = sorted({min(max(t, start), end) for t, _ in (*armed, *modes)} | {end} | {t for gap in silent for t in gap})
    found: list[_Stretch] = []
    for a, b in itertools.pairwise(cuts):
        is_armed = _at(armed, a)
        if not is_armed or b <= a or (a, b) in silent:
            continue
        number = _at(modes, a)
        mode = "armed" if number is None or number < 0 else _mode_name(tape, number)
        if found and found[-1].end == a and found[-1].mode == mode:
            found[-1] = _Stretch(found[-1].start, b, mode)
        else:
            found.append(_Stretch(a, b, mode))
    return found


def _at(changes: list[tuple[float, Any]], t: float) -> Any:
    """Return what was last said at or before *t*, None before the first word."""
    before = [value for moment, value in changes if moment <= t]
    return before[-1] if before else None


def _mode_name(tape: Tape, number: int) -> str:
    return tape.firmware.mode_name(number) if tape.firmware else f"MODE {number}"


def _marks(tape: Tape, stretch: _Stretch) -> tuple[Mark, ...]:
    marks = [Mark(t, "mode", {"mode": _mode_name(tape, n)}) for t, n in tape.modes]
    marks += [Mark(t, "armed" if on else "disarmed") for t, on in tape.arming]
    marks += [Mark(t, "text", {"text": text}) for t, text in tape.texts]
    return tuple(sorted((m for m in marks if stretch.start <= m.t <= stretch.end), key=lambda m: m.t))


def _useless(run: Trial, stretch: _Stretch, doubts: list[Note]) -> str:
    """Return why nothing can be learnt from a run, empty when something may."""
    if stretch.end - stretch.start < SHORTEST:
        return f"shorter than {SHORTEST:g} s"
    forces = [run[n] for n in FORCES if n in run]
    if not forces:
        return next((cause for slug, cause, _ in doubts if slug in NO_INPUT), "no input was recorded")
    if not any(_varies(c) for c in forces):
        return "nothing was driven"
    if not any(_varies(c) and len(c) >= FEWEST for n, c in run.channels.items() if n in _MOTION):
        return "nothing moves"
    return ""


_MOTION = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "U")


def _varies(channel: Channel) -> bool:
    return len(channel) > 1 and bool(np.ptp(channel.values) > 0.0)


def _nothing(tapes: list[Tape], dropped: list[LeftOut]) -> str:
    name = tapes[0].name if tapes else "the log"
    if not tapes or all(t.span == (0.0, 0.0) for t in tapes):
        return f"{name} holds no motion of a vehicle: was an autopilot connected while it was recorded?"
    long = sum(t.span[1] - t.span[0] for t in tapes)
    if not dropped:
        return (
            f"{name} holds {long:.0f} s of {tapes[0].vehicle}, but it was never armed: nothing was driven, so nothing "
            "can be learnt; record a relay, a zig-zag or steps"
        )
    return (
        f"{name} holds no stretch to identify from ({'; '.join(map(str, dropped[:6]))}): record a relay or steps, with "
        "servo outputs and parameters in the log"
    )
