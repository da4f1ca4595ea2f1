"""How well a boat followed the legs of a mission, and whether another flight of it is better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.verdict import Verdict
from gcs_autotune.notebook import Displayed

__all__ = ["TrackMetrics", "follows_better", "track_metrics"]

Array = NDArray[np.float64]

RATIO = 0.95
"""Largest ratio of the new to the old rms distance: at least 5 % lower. Project choice, as for steps."""
MEAN_RATIO, WIDEST_RATIO = 1.05, 1.1
"""Largest ratio of the new to the old mean of the corners, and of the widest. Project choice: scatter."""
LATE_RATIO, LATE = 1.25, 0.05
"""Allowed distance in the third quarter of legs, relative to that before and [of a leg]. Project choice."""
TIME_RATIO = 1.5
"""Longest time, relative to the time before. Project choice: slower is easily better."""


@dataclass(frozen=True, slots=True)
class TrackMetrics(Displayed):
    """Distances from the route [m]: from the leg under way or the one before it, whichever is nearer.

    ``rms`` over all legs; ``late`` in their second halves; ``settled`` in their third quarters, where the boat has left
    one corner behind and does not yet round the next: the median of the legs, because a boat weaves on each.
    ``corners``: the greatest one after each corner.
    ``seconds``: duration of the legs. ``leg``: length of a leg [m].
    """

    rms: float
    late: float
    settled: float
    corners: tuple[float, ...]
    seconds: float
    leg: float

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "rms": self.rms,
            "late": self.late,
            "settled": self.settled,
            "corners": list(self.corners),
            "seconds": self.seconds,
            "leg": self.leg,
        }


def track_metrics(
    t: Array, place: NDArray[np.complex128], waypoints: Sequence[complex], turned: Sequence[float]
) -> TrackMetrics:
    """Return the metrics of a flight along *waypoints* (m,) [m, north + i east].

    t, place : (n,) [s], [m, north + i east]. turned : (m,) [s] when the autopilot turned away from each waypoint.
    """
    off: list[Array] = []
    late: list[Array] = []
    settled: list[float] = []
    corners: list[float] = []
    for k in range(1, len(waypoints)):
        begin, end = waypoints[k - 1], waypoints[k]
        inside = place[(t >= turned[k - 1]) & (t < turned[k])]
        away = _distance(inside, begin, end)
        if k > 1:
            away = np.minimum(away, _distance(inside, waypoints[k - 2], begin))
            corners.append(float(away.max(initial=0.0)))
        off.append(away)
        along = ((inside - begin) / (end - begin)).real
        late.append(away[along > 0.5])
        settled.append(_rms([away[(along > 0.5) & (along < 0.75)]]))
    leg = abs(waypoints[1] - waypoints[0])
    return TrackMetrics(
        _rms(off), _rms(late), float(np.nanmedian(settled)), tuple(corners), turned[-1] - turned[0], leg
    )


def _distance(place: NDArray[np.complex128], begin: complex, end: complex) -> Array:
    """Return the distances (n,) of *place* (n,) from the straight line between *begin* and *end*."""
    length = abs(end - begin)
    turned = (place - begin) * length / (end - begin)
    found: Array = np.abs(turned - np.clip(turned.real, 0.0, length))
    return found


def _rms(pieces: Sequence[Array]) -> float:
    values = np.concatenate(pieces)
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def follows_better(before: TrackMetrics, after: TrackMetrics) -> Verdict:
    """Compare two flights of one mission: the rms distance must be lower, and nothing else clearly higher."""
    lines = [_rms_line(before, after), _settled_line(before, after), _corners_line(before, after)]
    most = TIME_RATIO * before.seconds
    slow = "" if after.seconds <= most else f", more than the {most:.0f} s allowed"
    lines.append((not slow, f"time from first to last waypoint {before.seconds:.0f} -> {after.seconds:.0f} s{slow}"))
    return Verdict(tuple(lines))


def _rms_line(before: TrackMetrics, after: TrackMetrics) -> tuple[bool, str]:
    good = after.rms <= RATIO * before.rms
    tail = "" if good else f"; at least {100.0 * (1.0 - RATIO):.0f} % less is required"
    return good, f"distance from the route {before.rms:.2f} -> {after.rms:.2f} m rms{tail}"


def _settled_line(before: TrackMetrics, after: TrackMetrics) -> tuple[bool, str]:
    most = max(LATE_RATIO * before.settled, LATE * before.leg)
    good = after.settled <= most
    tail = "" if good else f", more than the {most:.2f} m allowed"
    return good, f"in the third quarter of legs {before.settled:.2f} -> {after.settled:.2f} m rms{tail}"


def _corners_line(before: TrackMetrics, after: TrackMetrics) -> tuple[bool, str]:
    text = f"corners off by {_shown(before.corners)} -> {_shown(after.corners)} m"
    mean, most = fmean(after.corners), MEAN_RATIO * fmean(before.corners)
    if not mean <= most:
        return False, f"{text}; their mean is more than the {most:.2f} m allowed"
    widest = WIDEST_RATIO * max(before.corners)
    if not max(after.corners) <= widest:
        return False, f"{text}; the widest is more than the {widest:.2f} m allowed"
    return True, text


def _shown(corners: Sequence[float]) -> str:
    return ", ".join(f"{corner:.2f}" for corner in corners)
