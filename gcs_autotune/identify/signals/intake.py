"""Check runs when they are read: split them where the clock restarts, and look for wrong units.

Results are added to the run's ``meta["notes"]`` (slug, cause, cure), as log readers do. They become doubts when the run
is prepared. :mod:`gcs_autotune.crosscheck` finds columns that contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.crosscheck import contradictions
from gcs_autotune.errors import BadFile, DataError, MissingChannel
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.signals.cleaning import JUMP_SAMPLES, jumps_back
from gcs_autotune.rounding import counted
from gcs_autotune.sname import DOFS, OVERFULL
from gcs_autotune.trial import Channel, Trial

__all__ = [
    "CONTRADICTION",
    "check_axes",
    "check_units",
    "clock_jump",
    "contradictions_of",
    "left_out",
    "parts_of",
    "prepared_runs",
    "take_in",
]

Record = TypeVar("Record")


def take_in(runs: Sequence[Trial], use: Sequence[str] | None = None) -> tuple[Trial, ...]:
    """Return *runs*, checked for contradictions. A run whose clock jumps back is split into several runs.

    use : names of the signals that are fitted. A pair of columns is not compared if one of its signals is not used.

    Raises
    ------
    BadFile
        Two columns of a run differ by the factor of a wrong unit.
    """
    parts = [part for run in runs for part in parts_of(run)]
    return tuple(p if COMPARED in p.meta else _noted(p, check_units(p, use)) for p in parts)


def prepared_runs(
    runs: Sequence[Trial], prepare: Callable[[Trial], tuple[Record, ...]]
) -> tuple[tuple[Trial, ...], list[Record], tuple[Doubt, ...]]:
    """Return the usable runs, their records from *prepare*, and a doubt for each run that cannot be used.

    Raises
    ------
    DataError
        No run can be used. The exception of the first run is raised.
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
    """Return a doubt that the run called *name* was left out, with the reason."""
    return Doubt(
        "run-left-out", f"run '{name}' was left out: {error}", "the other runs were used. Repair or omit that run"
    )


COMPARED = "compared"
"""Key in the metadata of a run that marks its columns as compared already."""


def _noted(trial: Trial, doubts: Sequence[Doubt]) -> Trial:
    notes = [*trial.meta.get("notes", ()), *((d.slug, d.cause, d.cure) for d in doubts)]
    return replace(trial, meta={**trial.meta, "notes": notes, COMPARED: True})


def parts_of(trial: Trial) -> list[Trial]:
    """Return the parts of *trial* between backward jumps of its clock.

    Without a jump this is the whole run.

    Raises
    ------
    BadFile
        The channels differ in their number of jumps.
    """
    cuts = {name: jumps_back(c.t) for name, c in trial.channels.items() if len(c) >= JUMP_SAMPLES}
    counts = {len(c) for c in cuts.values()}
    if not cuts or counts == {0}:
        return [trial]
    if len(counts) > 1:
        where = next(f"{float(trial[n].t[c[0] - 1]):.3f} s (channel {n})" for n, c in cuts.items() if len(c))
        raise BadFile(
            f"the clock of run '{trial.name}' jumps back after t = {where}, but not equally on every channel. Cut "
            "the file there and identify the two parts as separate runs"
        )
    pieces = [_piece(trial, cuts, k) for k in range(counts.pop() + 1)]
    doubt = clock_jump(trial.name, len(pieces) - 1)
    note = (doubt.slug, doubt.cause, doubt.cure)
    return [replace(p, meta={**p.meta, "notes": [*p.meta.get("notes", ()), note]}) for p in pieces]


def clock_jump(name: str, times: int) -> Doubt:
    """Return a doubt that the clock of the run called *name* jumped back, and how many *times*."""
    return Doubt(
        "clock-jump",
        f"the clock of run '{name}' jumps back {counted(times, 'time')}",
        "the parts were used as separate runs. Check the logger, and that all parts are of one craft",
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


Array = NDArray[np.float64]

DEG = 180.0 / math.pi
GROSS = 5.0
"""Factor between two columns above which a wrong unit is certain. Project choice.

A smaller factor may have another cause (current, slip) and only raises a doubt.
"""
WINDOW = 1.0
"""Time [s] over which columns are compared.

Project choice. It is twice the interval over which the rate of a heading is calculated.
"""
STRETCHES, ALONG_TRACK = 20, 0.25
"""Settings of the test that detects ``u`` and ``v`` along north and east instead of body axes. Project choice.

- ``STRETCHES``: number of stretches of the track that are compared.
- ``ALONG_TRACK``: largest squared residual with ``u`` and ``v`` taken along north and east. It is relative to the
  squared residual with body axes, and to the squared length of the track.
"""
TURNED = 0.3
"""Smallest turn [rad] required for the test of north and east speeds. Project choice.

On a straight course, speeds along north and east look like speeds in body axes.
"""
TURN = 3.5
"""Turn rate [rad/s] of a heading above which its values are probably in degrees. Project choice."""


def check_units(trial: Trial, use: Sequence[str] | None = None) -> list[Doubt]:
    """Return doubts about the units of *trial*, and about columns that contradict each other.

    use : as for :func:`take_in`.

    Raises
    ------
    BadFile
        Two columns differ by a factor that only a wrong unit explains.
    """
    alone = _heading_alone(trial, trial["psi"]) if "psi" in trial else []
    try:
        doubts = contradictions_of(trial, use)
    except BadFile as error:
        if not alone or not str(error).startswith("psi ") or "degrees" in str(error):
            raise
        # so fast that unwrapping lost count of the turns: the factor means nothing
        raise BadFile(f"{alone[0].cause}: {alone[0].cure}") from error
    check_axes(trial)
    return doubts + alone + _inputs_alone(trial)


def contradictions_of(trial: Trial, use: Sequence[str] | None = None) -> list[Doubt]:
    """Return a doubt for each pair of columns of *trial* that contradict each other.

    Exceptions are those of :func:`check_units`.
    """
    pairs = contradictions(trial, use)
    for c in pairs:
        size = max(abs(c.value), 1.0 / abs(c.value)) if math.isfinite(c.value) and c.value else 0.0
        if c.unit and size > GROSS:
            raise BadFile(f"{c.cause}. Correct the unit in the header, or omit the wrong column (--use)")
    return [Doubt(CONTRADICTION, c.cause, c.cure) for c in pairs]


CONTRADICTION = "contradiction"
"""Slug of the doubt about columns that contradict each other."""


def check_axes(trial: Trial) -> None:
    """Raise BadFile if ``u`` and ``v`` are speeds north and east instead of ahead and to starboard.

    Such speeds agree with the rates of ``x`` and ``y``, but not after rotation by the heading.

    Raises
    ------
    BadFile
        The message lists the two columns.
    """
    if any(name not in trial for name in ("x", "y", "psi", "u", "v")):
        return
    (t, x), (ty, y), (tu, u), (tv, v), (tp, psi) = (_known(trial[n]) for n in ("x", "y", "u", "v", "psi"))
    if min(len(t), len(ty), len(tu), len(tv), len(tp)) < 20:
        return
    ends = np.linspace(max(t[0], tu[0], tp[0]), min(t[-1], tu[-1], tp[-1]), STRETCHES + 1)
    if not ends[-1] > ends[0]:
        return
    moved = np.diff([np.interp(ends, t, x), np.interp(ends, ty, y)], axis=1)
    v, heading = np.interp(tu, tv, v), np.interp(tu, tp, np.unwrap(psi))
    if np.ptp(heading) < TURNED:
        return
    turned = (u * np.cos(heading) - v * np.sin(heading), u * np.sin(heading) + v * np.cos(heading))
    by_craft, by_track = (
        sum(float(np.sum((moved[i] - np.diff(np.interp(ends, tu, _integral(tu, speed[i])))) ** 2)) for i in (0, 1))
        for speed in (turned, (u, v))
    )
    if by_track < ALONG_TRACK * by_craft and by_track < ALONG_TRACK * float(np.sum(moved**2)):
        raise BadFile(
            f"u and v of run '{trial.name}' are the rates of x and y, not the speeds ahead and to starboard. Rotate "
            "them by psi (u = dx cos psi + dy sin psi, v = dy cos psi - dx sin psi), or omit them"
        )


def _inputs_alone(trial: Trial) -> list[Doubt]:
    """Return doubts about inputs that are too large for their unit.

    A rudder angle is below half a turn, and a normalised output does not exceed 1 by much.
    """
    doubts: list[Doubt] = []
    for name in ("delta", *(dof.force for dof in DOFS.values())):
        if name not in trial or len(trial[name]) == 0:
            continue
        size = float(np.max(np.abs(trial[name].values), initial=0.0, where=np.isfinite(trial[name].values)))
        if trial[name].unit == "rad" and size > 1.1 * math.pi:
            raise BadFile(
                f"{name} of run '{trial.name}' reaches {size:.3g} rad, more than half a turn of the rudder. If the "
                f"numbers are degrees, write {name}[deg] in the header (or --columns OLD={name}[deg])"
            )
        if trial[name].unit == "1" and size > OVERFULL:
            cause = (
                f"{name} of run '{trial.name}' reaches {size:.3g} without a unit. Without a unit, 1 means full output"
            )
            doubts.append(
                Doubt(
                    "unit",
                    cause,
                    f"write {name}[count] or its unit in the header, or divide by the value at full output",
                )
            )
    return doubts


def _integral(t: Array, v: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])


def _known(channel: Channel) -> tuple[Array, Array]:
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    t, first = np.unique(channel.t[good], return_index=True)
    return t, channel.values[good][first]


def _heading_alone(trial: Trial, psi: Channel) -> list[Doubt]:
    """Return doubts about the unit of a heading, from the size of its wraps and from its turn rate."""
    t, x = _known(psi)
    if len(t) < 20:
        return []
    steps = np.abs(np.diff(x))
    usual = float(np.median(steps))
    wraps = steps[steps > max(0.5 * float(np.ptp(x)), 20.0 * usual)]
    for height, stated, really in ((360.0, "radians", "degrees"), (2.0 * math.pi / DEG, "degrees", "radians")):
        if len(wraps) and np.all(np.abs(wraps / height - 1.0) < 0.05) and np.ptp(x) <= 1.01 * height:
            raise BadFile(
                f"psi of run '{trial.name}' wraps round at {float(np.median(wraps)):.4g} rad. Its header states "
                f"{stated}, but the numbers are {really}. Correct the unit in the header"
            )
    is_smooth = float(np.median(np.abs(np.diff(x, n=2)))) < 0.5 * usual
    if is_smooth and float(np.mean(steps > math.pi)) > 0.1:
        cause = (
            f"psi of run '{trial.name}' changes smoothly, but by more than half a turn from sample to sample. "
            "Its header states radians"
        )
        return [Doubt("unit", cause, "check whether the numbers are degrees, and correct the unit in the header")]
    lag = max(1, round(0.5 * WINDOW / max(float(np.median(np.diff(t))), 1e-6)))
    turned = np.concatenate([[0.0], np.cumsum(np.angle(np.exp(1j * np.diff(x))))])
    if len(t) <= lag + 20:
        return []
    rate = float(np.median(np.abs(turned[lag:] - turned[:-lag]) / (t[lag:] - t[:-lag])))
    if rate <= TURN:
        return []
    cause = (
        f"psi of run '{trial.name}' turns faster than {TURN:g} rad/s half of the time ({rate:.1f} rad/s). Its "
        "header states radians"
    )
    return [Doubt("unit", cause, "check whether the numbers are degrees, and correct the unit in the header")]
