"""Prepare runs for a diagnosis, or reject them with the reason.

Nothing that an effect could explain is corrected: wrong units, signs, offsets, and clocks that are fast or late. Runs
from which no cause could be identified are rejected: a clock in the wrong unit, a broken heading, exchanged columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.excitation_check import MOTIONS, coherence, held_share, on_grid
from gcs_autotune.errors import BadFile, DataError, MissingChannel, UsageError
from gcs_autotune.identify import MIN_SAMPLES, Doubt
from gcs_autotune.identify.signals import INPUTS, check_axes, clock_jump, left_out, parts_of
from gcs_autotune.models import FORCES
from gcs_autotune.rounding import counted
from gcs_autotune.sname import DOFS, SIGNALS, Dof
from gcs_autotune.trial import Channel, Trial

__all__ = ["is_one_flight", "taken_in", "within_manoeuvre", "without_repeats"]

Array = NDArray[np.float64]


SLOW, FAST = 5.0, 5e-4
"""Longest (SLOW) and shortest (FAST) sample interval [s] of a marine craft's telemetry.

An interval outside this range is accepted if another column confirms the clock.
"""

CONFIRMED = 3.0
"""Largest ratio, either way, of a position's rate of change to its measured rate, for the clock to be confirmed."""

TORN, ISOLATED, NEIGHBOURS = 0.5, 8.0, 5
"""Limits for a jump of the heading.

A jump exceeds TORN [rad], and ISOLATED times each of the NEIGHBOURS steps on either side.
"""

TURNS = (2.0 * math.pi, 360.0)
"""A full turn in radians and in degrees; degrees count too, because a wrong unit of the heading is an effect."""

SAME = 0.1
"""Relative difference from a full turn up to which a jump counts as one."""

LEADS, ALONE, HELD = 0.9, 0.25, 0.5
"""Limits for exchanged input and output columns.

LEADS: least fraction of the input's variance that the output explains by a first-order lag. ALONE: upper limit of the
unexplained fraction, relative to that of the output explained by the input. HELD: the output repeats its previous value
in at least this fraction of its samples, and the input in at most this fraction.
"""


STEADY, GRID, LEAST_LEFT = 0.25, 1000, 0.5
"""Limits that separate the manoeuvre in a run from its approach and final stretch.

STEADY: largest deviation of another axis' command from its usual value, relative to that value, that counts as steady.
GRID: number of points along a run from which the usual value (median) is calculated. LEAST_LEFT: least fraction of a
run that must remain.
"""


def check_clock(run: Trial) -> None:
    """Raise an error for a clock in milliseconds whose column header states seconds, or the reverse.

    Raises
    ------
    BadFile
        The sample interval is implausibly long or short, and no position with its rate confirms it.
    """
    steps = [float(np.median(np.diff(c.t))) for c in run.channels.values() if len(c) > 2]
    steps = [s for s in steps if s > 0.0]
    if not steps or FAST <= min(steps) < SLOW or _confirmed(run):
        return
    step = min(steps)
    if step >= SLOW:
        spacing = (
            f"{step:.4g} s apart and the run lasts {run.duration / 3600.0:.3g} h. The time seems to be in milliseconds"
        )
        head = "t[ms]"
        if step >= 1e4:
            spacing, head = spacing.replace("milliseconds", "microseconds"), "t[us]"
    else:
        spacing = f"{step:.2g} s apart and the run lasts {run.duration:.2g} s. The time seems to be in seconds already"
        head = "t[s]"
    raise BadFile(f"the samples of run '{run.name}' are {spacing}. Rename the time column to {head}")


def _confirmed(run: Trial) -> bool:
    """Return whether some position changes at about its measured rate, on this clock."""
    for dof in DOFS.values():
        if dof.name in ("surge", "sway") or dof.position not in run or dof.velocity not in run:
            continue
        position, rate = run[dof.position], run[dof.velocity]
        if len(position) < 4 or len(rate) < 4:
            continue
        grid = np.linspace(max(position.t[0], rate.t[0]), min(position.t[-1], rate.t[-1]), 4 * len(rate))
        speed = np.interp(grid, rate.t, rate.values)
        angle = np.unwrap(position.values) if dof.angular else position.values
        moved = np.diff(np.interp(grid, position.t, angle)) / np.diff(grid)
        size, rate_std = float(np.std(moved)), float(np.std(speed))
        if rate_std > 0.0 and 1.0 / CONFIRMED < size / rate_std < CONFIRMED:
            return True
    return False


def check_heading(run: Trial) -> None:
    """Raise an error for a heading that jumps by something other than a full turn.

    Raises
    ------
    BadFile
        The heading was wrapped at another value, or averaged across the wrap.
    """
    if "psi" not in run or len(run["psi"]) < 4 * NEIGHBOURS:
        return
    torn = _tears(run["psi"].values)
    if torn:
        raise BadFile(
            f"the heading of run '{run.name}' jumps {counted(len(torn), 'time')} by "
            f"{math.degrees(float(np.median(torn))):.0f} deg instead of a full turn. It was wrapped wrongly, or "
            "averaged across north. Log psi unaltered, from 0 to 360 deg or from -180 to 180 deg"
        )


def _tears(x: Array) -> list[float]:
    """Return the heights of heading jumps that are no wraps.

    A jump is one or more steps that are far larger than their neighbours. A single step is a wrap if it is a full turn.
    Several steps are a jump if they add up to a full turn in one direction. Spikes return to their start and do not
    count.
    """
    d = np.diff(x)
    large = np.flatnonzero(np.abs(d) > TORN)
    jumps = []
    for group in np.split(large, np.flatnonzero(np.diff(large) > 1) + 1):
        if not 0 < len(group) <= NEIGHBOURS:
            continue
        first, last = int(group[0]), int(group[-1])
        around = np.abs(np.r_[d[max(0, first - NEIGHBOURS) : first], d[last + 1 : last + 1 + NEIGHBOURS]])
        steps = np.abs(d[group])
        if len(around) < NEIGHBOURS or float(steps.min()) < ISOLATED * float(around.max()):
            continue
        turn = any(abs(float(steps.sum()) / whole - 1.0) < SAME for whole in TURNS)
        if len(group) == 1 and not turn:
            jumps.append(float(steps[0]))
        elif len(group) > 1 and turn and abs(float(np.sign(d[group]).sum())) == len(group):
            jumps.append(float(steps.max()))
    return jumps


def check_roles(run: Trial) -> None:
    """Raise an error for exchanged input and output columns.

    The "input" then follows the "output", and the "output" is held like a command.

    Raises
    ------
    BadFile
        The message lists both columns.
    """
    for dof in DOFS.values():
        for name in INPUTS[dof.name]:
            for output in (dof.velocity, dof.position):
                if name in run and output in run:
                    _check_pair(run, dof, name, output)


def _check_pair(run: Trial, dof: Dof, name: str, output: str) -> None:
    grid = on_grid(run[name], run[output])
    if grid is None:
        return
    u, y = grid[1]
    if held_share(y) < HELD or held_share(u) > HELD:
        return
    if dof.angular:
        u = np.unwrap(u)
    integrated = output == dof.position
    backward = max(coherence(u, y), coherence(u, y, integrated=True) if integrated else 0.0)
    forward = max(coherence(y, u), coherence(y, u, integrated=True) if integrated else 0.0)
    if backward > LEADS and 1.0 - backward < ALONE * (1.0 - forward):
        raise BadFile(
            f"columns {name} and {output} of run '{run.name}' look swapped. {name} is smooth and follows "
            f"{output} ({100 * backward:.0f} % of it), while {output} jumps like a command. Swap the names of the two "
            "columns"
        )


CHECKS: tuple[Callable[[Trial], None], ...] = (check_clock, check_roles, check_heading, check_axes)


def taken_in(runs: Sequence[Trial]) -> tuple[list[Trial], list[Doubt]]:
    """Return the usable runs, split where their clocks restart, and the doubts about the others.

    Raises
    ------
    BadFile, MissingChannel
        No run can be used; the error raised is that of the first run.
    """
    usable: list[Trial] = []
    doubts: list[Doubt] = []
    failures: list[tuple[str, DataError]] = []
    for run in runs:
        try:
            usable += _usable(run, doubts)
        except DataError as error:
            failures.append((run.name, error))
    if not usable:
        raise failures[0][1]
    return usable, [*doubts, *(left_out(name, failure) for name, failure in failures)]


def within_manoeuvre(run: Trial, driven: Collection[str]) -> Trial:
    """Return a run flown by this program without its approach and its final stretch.

    The craft behaves differently while the command of another axis is far from its usual value, as when throttle is
    applied. A rudder, for example, acts through the propeller's wash. Such stretches at both ends are left out. The
    inputs *driven* are kept whole, because an actuator lag depends on earlier commands.
    """
    if "manoeuvre" not in run.meta:
        return run
    begins, ends = run.start, run.end
    for name in FORCES:
        if name in driven or name not in run or len(run[name]) < 2:
            continue
        t, values = run[name].t, run[name].values
        grid = np.linspace(begins, ends, GRID)
        usual = float(np.median(values[np.maximum(np.searchsorted(t, grid, side="right") - 1, 0)]))
        near = np.flatnonzero(np.abs(values - usual) <= STEADY * abs(usual))
        if usual == 0.0 or not len(near):
            continue
        begins = max(begins, float(t[near[0]]))
        ends = min(ends, float(t[near[-1] + 1])) if near[-1] + 1 < len(t) else ends
    if (begins, ends) == (run.start, run.end) or ends - begins < LEAST_LEFT * run.duration:
        return run
    channels = {n: c if n in driven else c.between(begins, ends) for n, c in run.channels.items()}
    return replace(run, channels=channels)


def is_one_flight(runs: Sequence[Trial]) -> bool:
    """Return whether *runs* come from one flight of this program: a step, and relays of several sizes, each flown
    once.

    No such run can predict another, because each contains one size of command, or none that is steady.
    """
    flown = [(run.meta.get("manoeuvre"), run.meta.get("C", run.meta.get("size"))) for run in runs]
    return len(runs) > 1 and all("manoeuvre" in run.meta for run in runs) and len(set(flown)) == len(flown)


def without_repeats(runs: Sequence[Trial], unseen: Sequence[Trial]) -> tuple[list[Trial], list[Doubt]]:
    """Return *runs* without duplicates, and a doubt for each duplicate.

    Raises
    ------
    UsageError
        A run is also among the *unseen* ones. The model would be tested on the data it was fitted to.
    """
    kept: list[Trial] = []
    doubts: list[Doubt] = []
    for run in runs:
        twin = next((k for k in kept if _same(k, run)), None)
        if twin is None:
            kept.append(run)
        else:
            cause = f"runs '{twin.name}' and '{run.name}' are the same recording. Only the first was used"
            doubts.append(Doubt("run-twice", cause, "list each run once"))
    for run in unseen:
        if any(_same(run, k) for k in kept):
            raise UsageError(
                f"run '{run.name}' is used both to fit and to validate. The gain would then be measured on fitted "
                "data. Pass another run to --validate, or omit --validate to hold out parts of each run in turn"
            )
    return kept, doubts


def _same(a: Trial, b: Trial) -> bool:
    if a.channels.keys() != b.channels.keys():
        return False
    return all(
        len(c) == len(b[n])
        and np.array_equal(c.t, b[n].t, equal_nan=True)
        and np.array_equal(c.values, b[n].values, equal_nan=True)
        for n, c in a.channels.items()
    )


def _usable(run: Trial, doubts: list[Doubt]) -> list[Trial]:
    parts = parts_of(run)
    if len(parts) > 1:
        doubts.append(clock_jump(run.name, len(parts) - 1))
    usable = []
    for part in parts:
        known = _numbers_only(part, doubts)
        for check in CHECKS:
            check(known)
        usable.append(known)
    return usable


def _numbers_only(run: Trial, doubts: list[Doubt]) -> Trial:
    """Return *run* without invalid samples, and without motions that are constant while others change."""
    channels: dict[str, Channel] = {}
    empty = []
    for name, channel in run.channels.items():
        good = np.isfinite(channel.t) & np.isfinite(channel.values)
        if good.any():
            channels[name] = channel if good.all() else replace(channel, t=channel.t[good], values=channel.values[good])
            continue
        if len(channel):
            empty.append(name)
    if empty:
        doubts.append(_doubt(run, empty, "left out, without numbers", "check the sensor and the logger"))
    if not channels:
        raise BadFile(f"run '{run.name}' contains no samples. Check that it is the right file")
    motions = [n for n in channels if n in MOTIONS and len(channels[n]) >= MIN_SAMPLES]
    if not motions and not any(n in SIGNALS and n not in MOTIONS for n in channels):
        raise MissingChannel(
            f"run '{run.name}' has no column with a known name. Its columns are {', '.join(channels)}. Rename them, "
            "for example to t[s], psi[rad], r[rad/s], N[N m]"
        )
    still = {n for n in motions if np.ptp(channels[n].values) == 0.0}
    pairs = [{dof.velocity, dof.position} & set(motions) for dof in DOFS.values()]
    dead = [name for pair in pairs if pair - still for name in pair & still]
    needed = [name for name in dead if name in _needed(run)]
    if needed:
        doubts.append(_doubt(run, needed, "left out, constant while the craft moves", "check the sensor"))
    return replace(run, channels={name: channel for name, channel in channels.items() if name not in dead})


def _needed(run: Trial) -> set[str]:
    """Return the motions that a model of *run* may need: all but roll and pitch that no input drives."""
    dofs = (d for d in DOFS.values() if not d.restored or any(name in run for name in INPUTS[d.name]))
    return {name for dof in dofs for name in (dof.velocity, dof.position)}


def _doubt(run: Trial, names: Sequence[str], why: str, cure: str) -> Doubt:
    return Doubt("dead-column", f"run '{run.name}': {counted(len(names), 'column')} {why} ({', '.join(names)})", cure)
