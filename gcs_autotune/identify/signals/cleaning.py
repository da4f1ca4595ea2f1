"""Clean one channel: invalid numbers, repeated or reversed stamps, wrapped angles, clipping, gaps in an input.

A clipped signal stays at its extreme value for several samples, and changes fast just before and after. A craft at
rest, or a coarse sensor, also repeats an extreme value, but changes slowly before and after. Samples at the limit of
the range are left out, because they are only a bound on the true value, and so are those of a stuck sensor. No other
samples are removed, so that no gap appears while the input acts.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.rounding import counted
from gcs_autotune.sensor import TURN, quantum, stuck
from gcs_autotune.trial import Channel, Trial

__all__ = [
    "JUMP_SAMPLES",
    "clean",
    "clipped",
    "continuous",
    "holes_of",
    "jumps_back",
    "noted",
    "outside",
    "unstuck",
    "unwrap",
    "within_range",
]

Array = NDArray[np.float64]


JUMP_SAMPLES = 3
"""Number of consecutive samples older than an earlier one that count as a jump of the clock. Project choice.

Fewer such samples count as late.
"""

LATE = 0.05
"""Largest fraction of late samples that may be left out. With more, the clock is not reliable. Project choice."""

FULL_TURN = {"rad": 2.0 * np.pi, "deg": 360.0}
"""Unit of an angle -> full turn in this unit. Jumps of this size are removed from headings."""

OVERTAKEN = 5.0
"""Largest lateness of a late sample that is kept [median time steps]. Project choice."""

DWELL = 3
"""Smallest number of identical extreme samples in a row that counts as clipping. Project choice."""

SPEED = 0.3
"""Smallest change next to identical extreme samples that counts as fast, relative to the signal's usual change per
sample. Project choice.
"""

QUANTA = 3.0
"""Smallest change next to identical extreme samples that counts as fast, in steps of the sensor's resolution.

Project choice.
"""

LEAD = 5
"""Number of steps before and after a stuck stretch of which the mean must be fast. Project choice."""

EQUAL = 1e-9
"""Difference of two numbers, relative to the range of the signal, below which they count as equal."""

STEADY = 0.9
"""Fraction of the time steps that must be near the usual one for an input to count as regularly recorded.

Project choice.
"""

GAP_SECONDS, GAP_STEPS = 0.25, 10.0
"""Limits of an interval without samples, in seconds and in median time steps. Project choice.

An interval that exceeds both is a gap. The oscillation of a small ROV has half-periods of 0.7 s: a gap of 0.5 s may
hide a pulse of its input, and then a model fitted across the gap is wrong by a multiple.
"""


def noted(trial: Trial) -> list[Doubt]:
    """Return the doubts about a run that were stored in its ``meta["notes"]``."""
    return [Doubt(*(str(part) for part in note)) for note in trial.meta.get("notes", ()) if len(note) == 3]


def jumps_back(t: Array) -> NDArray[np.intp]:
    """Return the indices of the samples in *t* at which the clock jumps to an earlier time."""
    known = np.flatnonzero(np.isfinite(t))
    stamps = t[known]
    jumps = []
    for i in np.flatnonzero(np.diff(stamps) < 0.0) + 1:
        after = stamps[i : i + JUMP_SAMPLES]
        if len(after) == JUMP_SAMPLES and np.all(after < stamps[i - 1]) and np.all(np.diff(after) >= 0.0):
            jumps.append(known[i])
    return np.array(jumps, dtype=np.intp)


def clean(channel: Channel, run: str, notes: list[Doubt]) -> Channel:
    """Return *channel* without invalid numbers and repeated stamps, and with late samples sorted in.

    Doubts go to *notes*.

    Of samples with the same stamp, the first is kept.

    Raises
    ------
    BadFile
        The clock jumps back.
    """
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    t, values = channel.t[good], channel.values[good]
    late = np.concatenate([[False], t[1:] < np.maximum.accumulate(t)[:-1]]) if len(t) else np.zeros(0, dtype=bool)
    jumps = jumps_back(t)
    if len(jumps) or late.sum() > max(1.0, LATE * len(t)):
        where = float(t[(jumps[0] if len(jumps) else int(np.argmax(late))) - 1])
        raise BadFile(
            f"the clock of run '{run}' jumps back after t = {where:.3f} s (channel {channel.name}). Cut the file "
            "there and identify the two parts as separate runs"
        )
    t, values = _in_order(t, values, late)
    first = np.concatenate([[True], np.diff(t) > 0.0]) if len(t) else np.zeros(0, dtype=bool)
    lost, repeated = int((~good).sum()), int((~first).sum())
    if lost:
        notes.append(
            Doubt(
                "missing-samples",
                f"{counted(lost, 'sample')} of {channel.name} in run '{run}' "
                f"{'are not numbers' if lost > 1 else 'is not a number'}",
                "these samples were left out. Check the sensor and the logger",
            )
        )
    if late.any():
        notes.append(
            Doubt(
                "late-samples",
                f"{counted(int(late.sum()), 'sample')} of {channel.name} in run '{run}' with an earlier time stamp "
                "than the sample before",
                "the samples were sorted, or left out if far too old. Log with the vehicle's own time stamps",
            )
        )
    if repeated > 0.02 * len(t):
        _note_repeats(repeated, channel.name, run, notes)
    return replace(channel, t=t[first], values=values[first])


def _note_repeats(count: int, name: str, run: str, notes: list[Doubt]) -> None:
    """Add a doubt about repeated stamps, one for all columns of *run* with the same repeats."""
    start, end = f"{count} stamps of ", f" in run '{run}' are repeated"
    for i, note in enumerate(notes):
        if note.slug == "repeated-stamps" and note.cause.startswith(start) and note.cause.endswith(end):
            others = note.cause.removeprefix(start).removesuffix(end).split(", ")
            if name not in others:
                notes[i] = replace(note, cause=f"{start}{', '.join([*others, name])}{end}")
            return
    cure = "only the first sample of each stamp was kept. Log with the vehicle's own time stamps, with enough digits"
    notes.append(Doubt("repeated-stamps", f"{start}{name}{end}", cure))


def _in_order(t: Array, values: Array, late: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the samples sorted by stamp, without those later than :data:`OVERTAKEN` allows."""
    if not late.any():
        return t, values
    behind = np.maximum.accumulate(t) - t
    keep = behind <= OVERTAKEN * float(np.median(np.diff(t[~late])))
    order = np.argsort(t[keep], kind="stable")
    return t[keep][order], values[keep][order]


def unwrap(t: Array, angle: Array, rate: Channel | None) -> Array:
    """Return *angle* [rad] without jumps of a full turn.

    Over a gap the angle continues at the measured *rate* or, without one, at the last rate.
    """
    step = np.diff(angle)
    turns = np.round(step / (2.0 * np.pi))
    dt = np.diff(t)
    holes = np.flatnonzero(dt > 3.0 * np.median(dt)) if len(dt) else np.empty(0, dtype=int)
    for i in holes:
        turns[i] = np.round((step[i] - _turn_expected(t, angle, rate, int(i))) / (2.0 * np.pi))
    return np.concatenate([angle[:1], angle[1:] - 2.0 * np.pi * np.cumsum(turns)])


def _turn_expected(t: Array, angle: Array, rate: Channel | None, i: int) -> float:
    """Return the turn [rad] expected between samples *i* and *i* + 1."""
    if rate is not None and len(rate) > 1:
        grid = np.linspace(t[i], t[i + 1], 50)
        return float(np.trapezoid(np.interp(grid, rate.t, rate.values), grid))
    first = max(0, i - 3)
    if i == first:
        return 0.0
    recent = np.unwrap(angle[first : i + 1])
    return float((recent[-1] - recent[0]) / (t[i] - t[first]) * (t[i + 1] - t[i]))


def clipped(channel: Channel) -> NDArray[np.bool_]:
    """Return a mask (n,) of the samples at the limit of the sensor's range. It is False everywhere without clipping."""
    x = channel.values
    none = np.zeros(len(x), dtype=bool)
    if len(x) < 10 * DWELL or np.ptp(x) == 0.0:
        return none
    starts = np.flatnonzero(np.concatenate([[True], np.diff(x) != 0.0]))
    lengths = np.diff(np.append(starts, len(x)))
    if np.median(lengths) >= DWELL - 1:  # a sensor slower than the log repeats every value
        return none
    steps = np.abs(np.diff(x))
    usual = float(np.median(steps[steps > 0.0]))
    least = max(SPEED * usual, QUANTA * quantum(x) + EQUAL * float(np.ptp(x)))
    mask = none.copy()
    for extreme in (float(x.max()), float(x.min())):
        dwells = [(int(s), int(n)) for s, n in zip(starts, lengths, strict=True) if x[s] == extreme and n >= DWELL]
        broken_off = [d for d in dwells if _breaks_off(x, *d, least)]
        if broken_off and len(broken_off) >= 0.5 * len(dwells) and not _levels_off(x, extreme, least):
            mask |= x == extreme
    return mask


def _breaks_off(x: Array, start: int, length: int, least: float) -> bool:
    """Return whether the signal changes fast both before and after a stretch of identical values.

    The second step before and the second step after must exceed *least*. The peak of a smooth signal decelerates: from
    either side, a parabola through the steps must reach more than *least* beyond the stretch.
    """
    if start < 2 or start + length + 1 >= len(x):
        return False
    before, after = (
        np.abs(np.diff(x[max(start - 3, 0) : start + 1]))[::-1],
        np.abs(np.diff(x[start + length - 1 :][:4])),
    )
    return all(steps[1] > least and _hidden(*steps) > least for steps in (before, after))


def _hidden(touching: float, step: float, outer: float | None = None) -> float:
    """Return how far a signal would reach beyond a stretch of identical values, from the steps towards it.

    touching : step between the stretch and the sample next to it. step, outer : the two steps further away.
    """
    deceleration = 0.0 if outer is None else 0.5 * (outer - touching)
    return math.inf if deceleration <= 0.0 else step * step / (2.0 * deceleration) - touching


def _levels_off(x: Array, extreme: float, least: float) -> bool:
    """Return whether at least as many samples are within *least* of the extreme as at it.

    This is so for a craft at its steady speed.
    """
    short = np.abs(x - extreme)
    return bool(np.sum((short > 0.0) & (short <= least)) >= np.sum(short == 0.0))


def within_range(channel: Channel, run: str, notes: list[Doubt]) -> Channel:
    """Return *channel* without its samples at the limit of the sensor's range. A doubt about them is added to *notes*.

    A heading has no such limits: it may reverse quickly anywhere.
    """
    if channel.name == "psi":
        return channel
    out = clipped(channel)
    if not out.any():
        return channel
    worst = ", ".join(f"{v:.4g}" for v in sorted({float(v) for v in channel.values[out]}))
    notes.append(
        Doubt(
            "clipped",
            f"{int(out.sum())} samples of {channel.name} in run '{run}' are at the limit of the sensor's range "
            f"({worst} {channel.unit})",
            "these samples were left out. Use smaller inputs or a sensor with a wider range",
        )
    )
    return replace(channel, t=channel.t[~out], values=channel.values[~out])


def unstuck(channel: Channel, run: str, notes: list[Doubt]) -> Channel:
    """Return *channel* without its samples during which the sensor was stuck. A doubt about them is added to *notes*.

    A craft at rest in a record without noise repeats a value too, but it comes to rest slowly and sets off slowly.
    """
    x, steps = channel.values, np.abs(np.diff(channel.values))
    found = stuck(channel.t, x)
    if not found:
        return channel
    usual = float(np.median(steps[steps > 0.0]))
    least = max(SPEED * usual, QUANTA * quantum(x, TURN if channel.name == "psi" else 0.0))
    at_limit = clipped(channel) if channel.name != "psi" else np.zeros(len(x), dtype=bool)
    keep, times = np.ones(len(x), dtype=bool), []
    for first, last in found:
        if at_limit[first]:
            continue
        before, after = steps[max(first - LEAD, 0) : first], steps[last : last + LEAD]
        if len(before) == LEAD and before.mean() > least and (not len(after) or after.mean() > least):
            keep[first + 1 : last + 1] = False
            times.append(f"{channel.t[first]:.1f} to {channel.t[last]:.1f} s")
    if keep.all():
        return channel
    notes.append(
        Doubt(
            "stuck-sensor",
            f"{channel.name} of run '{run}' did not change from {', '.join(times)}, although it changes with each "
            "sample otherwise",
            "these samples were left out. Check the sensor and its connection",
        )
    )
    return replace(channel, t=channel.t[keep], values=x[keep])


def gaps_in(t: Array) -> NDArray[np.intp]:
    """Return the indices of the last samples before the gaps in the stamps *t* (n,) [s]."""
    dt = np.diff(t)
    return np.flatnonzero(dt > max(GAP_SECONDS, GAP_STEPS * float(np.median(dt))))


def holes_of(drive: Channel, run: str, notes: list[Doubt]) -> list[tuple[float, float]]:
    """Return the start and end [s] of each gap in a regularly recorded input.

    A doubt about the gaps is added to *notes*.
    """
    dt = np.diff(drive.t)
    if len(dt) < 20:
        return []
    usual = float(np.median(dt))
    if float(np.mean(np.abs(dt - usual) <= 0.5 * usual)) < STEADY:
        return []
    holes = [(float(drive.t[i]) + usual, float(drive.t[i + 1])) for i in gaps_in(drive.t)]
    if holes:
        notes.append(
            Doubt(
                "input-gaps",
                f"the input {drive.name} of run '{run}' is not recorded for {sum(b - a for a, b in holes):.1f} s",
                "the motion during the gap was left out. Stay within good radio range",
            )
        )
    return holes


def outside(channel: Channel, holes: list[tuple[float, float]]) -> Channel:
    """Return *channel* without its samples in the gaps *holes* (start and end [s])."""
    if not holes:
        return channel
    keep = np.ones(len(channel), dtype=bool)
    for start, end in holes:
        keep &= (channel.t <= start) | (channel.t >= end)
    return replace(channel, t=channel.t[keep], values=channel.values[keep])


def continuous(angle: Channel) -> Channel:
    """Return *angle* without jumps of a full turn, whether its values are radians or degrees."""
    values = angle.values
    good = values[np.isfinite(values)]
    if not len(good):
        return angle
    span = float(np.ptp(good))
    jumps = np.abs(np.diff(good))
    for turn in FULL_TURN.values():
        wraps = (jumps > 0.6 * turn) & (jumps < 1.001 * turn)
        if span <= 1.001 * turn and wraps.any():
            return replace(angle, values=np.where(np.isfinite(values), _without_turns(values, turn), values))
    return angle


def _without_turns(values: Array, turn: float) -> Array:
    held = values.copy()
    for i in range(1, len(held)):
        if not np.isfinite(held[i]):
            held[i] = held[i - 1]
    unwrapped: Array = np.unwrap(held, period=turn)
    return unwrapped
