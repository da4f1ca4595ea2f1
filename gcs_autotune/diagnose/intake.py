"""Runs as they are handed in, made fit for a diagnosis, or refused with the reason.

Nothing is mended that an effect in the book could be: wrong units, signs and clocks that are merely fast or late pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose.implausible import check_clock, check_heading, check_roles
from gcs_autotune.diagnose.worth import MOTIONS
from gcs_autotune.errors import BadFile, DataError, MissingChannel, UsageError
from gcs_autotune.identify.intake import parts_of
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.segment import MIN_SAMPLES
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["taken_in", "without_repeats"]

CHECKS: tuple[Callable[[Trial], None], ...] = (check_clock, check_roles, check_heading)


def taken_in(runs: Sequence[Trial]) -> tuple[list[Trial], list[Doubt]]:
    """Return the runs that can be used, split where their clocks restart, and what is doubtful about the others.

    Raises
    ------
    BadFile, MissingChannel
        No run can be used: why the first one cannot.
    """
    found: list[Trial] = []
    doubts: list[Doubt] = []
    failures: list[tuple[str, DataError]] = []
    for run in runs:
        try:
            found += _usable(run, doubts)
        except DataError as error:
            failures.append((run.name, error))
    if not found:
        raise failures[0][1]
    for name, failure in failures:
        doubts.append(Doubt("run-left-out", f"run '{name}' was left out: {failure}", "mend or drop that run"))
    return found, doubts


def without_repeats(runs: Sequence[Trial], unseen: Sequence[Trial]) -> tuple[list[Trial], list[Doubt]]:
    """Return *runs* each once, and a doubt for those given twice.

    Raises
    ------
    UsageError
        A run is among the *unseen* ones too: it would be judged on what it was fitted to.
    """
    kept: list[Trial] = []
    doubts: list[Doubt] = []
    for run in runs:
        twin = next((k for k in kept if _same(k, run)), None)
        if twin is None:
            kept.append(run)
        else:
            cause = f"runs '{twin.name}' and '{run.name}' are the same recording: it was used once"
            doubts.append(Doubt("run-twice", cause, "give every run once"))
    for run in unseen:
        if any(_same(run, k) for k in kept):
            raise UsageError(
                f"run '{run.name}' is given both to fit and to validate: the gain would be measured on what was "
                "fitted; give another run to --validate, or none to leave out blocks in turn"
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
        doubts.append(
            Doubt(
                "clock-jump",
                f"the clock of run '{run.name}' jumps back {len(parts) - 1} time(s)",
                "the parts were taken as runs of their own; check the logger, and that it is one craft",
            )
        )
    usable = []
    for part in parts:
        known = _numbers_only(part, doubts)
        for check in CHECKS:
            check(known)
        usable.append(known)
    return usable


def _numbers_only(run: Trial, doubts: list[Doubt]) -> Trial:
    """Return *run* without samples that are no numbers, and without motions that stand still while others move."""
    channels: dict[str, Channel] = {}
    for name, channel in run.channels.items():
        good = np.isfinite(channel.t) & np.isfinite(channel.values)
        if good.any():
            channels[name] = channel if good.all() else replace(channel, t=channel.t[good], values=channel.values[good])
            continue
        if len(channel):
            doubts.append(_doubt(run, name, "holds no numbers", "check the sensor and the logger"))
    if not channels:
        raise BadFile(f"run '{run.name}' holds no samples: is it the right file?")
    motions = [n for n in channels if n in MOTIONS and len(channels[n]) >= MIN_SAMPLES]
    if not motions and not any(n in SIGNALS and n not in MOTIONS for n in channels):
        raise MissingChannel(
            f"run '{run.name}' has no column this program knows; it has {', '.join(channels)}, wanted are such as "
            "t[s], psi[rad], r[rad/s], N[N m]"
        )
    still = {n for n in motions if np.ptp(channels[n].values) == 0.0}
    for dof in DOFS.values():
        pair = {dof.velocity, dof.position} & set(motions)
        dead = pair & still
        if dead and pair - still:
            name = dead.pop()
            doubts.append(
                _doubt(run, name, "never changes while the craft moves", "check that sensor; it was left out")
            )
            del channels[name]
    return replace(run, channels=channels)


def _doubt(run: Trial, name: str, what: str, cure: str) -> Doubt:
    return Doubt("dead-column", f"{name} of run '{run.name}' {what}", cure)
