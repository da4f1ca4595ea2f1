"""Holes in a steadily recorded input: what drove the craft there is not known, so what it did there is not used.

An input recorded only when it changes has no holes; one is told from the other by the steadiness of the stamps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Channel

__all__ = ["holes_of", "outside"]

STEADY = 0.9
"""Share of the time steps near the usual one that makes a steadily recorded input."""
LONGEST, STEPS = 1.0, 10.0
"""A longer silence than both (seconds, usual steps) is a hole."""


def holes_of(drive: Channel, run: str, notes: list[Doubt]) -> list[tuple[float, float]]:
    """Return the times [s] from and to which a steadily recorded input is unknown, and note them."""
    dt = np.diff(drive.t)
    if len(dt) < 20:
        return []
    usual = float(np.median(dt))
    if float(np.mean(np.abs(dt - usual) <= 0.5 * usual)) < STEADY:
        return []
    found = [
        (float(drive.t[i]) + usual, float(drive.t[i + 1])) for i in np.flatnonzero(dt > max(LONGEST, STEPS * usual))
    ]
    if found:
        notes.append(
            Doubt(
                "input-gaps",
                f"the input {drive.name} of run '{run}' is not recorded for {sum(b - a for a, b in found):.1f} s",
                "fly within good radio range; what the craft did meanwhile was left out",
            )
        )
    return found


def outside(channel: Channel, holes: list[tuple[float, float]]) -> Channel:
    """Return *channel* without its samples in *holes*."""
    if not holes:
        return channel
    keep = np.ones(len(channel), dtype=bool)
    for start, end in holes:
        keep &= (channel.t <= start) | (channel.t >= end)
    return replace(channel, t=channel.t[keep], values=channel.values[keep])
