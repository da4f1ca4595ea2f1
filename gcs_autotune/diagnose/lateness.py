"""Late commands, late sensors, late clocks: with one input they differ only in what they make of the time before.

A late command shows what the craft did under the first one; a late sensor what it did before the run, of which no file
tells. So the first moments of each run, as long as things are late and the craft remembers them, say nothing of which
it was.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_autotune.diagnose.judging import ALIKE, Judged
from gcs_autotune.identify.extended.fitting import Fitted

__all__ = ["differ_only_at_first"]

LATE: Mapping[str, str] = {"input-delay": "delay", "measurement-delay": "delay", "time-offset": "offset"}
"""Slug -> by how much things are late [s]."""


def differ_only_at_first(one: Judged, other: Judged, pace: float) -> bool:
    """Whether both are about something late, and fit alike once each run has gone on for that long and a time constant
    *pace* [s] of the craft, in which it forgets where it began.
    """
    if one.own.slug not in LATE or other.own.slug not in LATE:
        return False
    late = pace + max(abs(j.own[LATE[j.own.slug]]) for j in (one, other))
    left = [_left_after(j.fitted, late, one.fitted.levels) for j in (one, other)]
    return abs(left[0] - left[1]) < ALIKE


def _left_after(fitted: Fitted, late: float, levels: Mapping[str, float]) -> float:
    """Return the sum of squares, over *levels*, of what is left from *late* [s] after the start of each run on."""
    total = 0.0
    for rest in fitted.rests:
        known = np.isfinite(rest.judged) & (rest.t > rest.t[0] + late)
        total += float(np.sum(rest.judged[known] ** 2)) / levels[rest.signal] ** 2
    return total
