"""A track over the ground: where the craft was, and the steady current that carried it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel
from gcs_autotune.identify.ship.log import ShipLog
from gcs_autotune.identify.ship.readings import local_fit

__all__ = ["Current", "Track", "current_of", "track_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Current:
    """Steady drift of the water over the ground, north and east [m/s], with the standard error of each."""

    north: float
    east: float
    std: float

    @property
    def speed(self) -> float:
        """Magnitude [m/s]."""
        return math.hypot(self.north, self.east)


STILL = Current(0.0, 0.0, math.nan)
"""No current, or none that could be told."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Positions through the water: stamps (n,) [s], north and east (n,) [m], heading (n,) [rad] at the same stamps."""

    t: Array
    x: Array
    y: Array
    psi: Array

    def without(self, current: Current, origin: float) -> Track:
        """Return the track as still water would have had it; unchanged at time *origin* [s]."""
        since = self.t - origin
        return Track(self.t, self.x - current.north * since, self.y - current.east * since, self.psi)

    def at(self, t: float, width: float) -> tuple[float, float, float]:
        """Return north, east [m] at *t* and their standard error, from local quadratics over *width* seconds."""
        keep = np.abs(self.t - t) <= 0.5 * width
        if int(keep.sum()) < 5:
            keep = np.zeros(len(self.t), dtype=bool)
            i = int(np.clip(np.searchsorted(self.t, t), 3, len(self.t) - 3))
            keep[i - 3 : i + 3] = True
        fits = [local_fit(self.t[keep], v[keep], t, 2) for v in (self.x, self.y)]
        std = math.sqrt(0.5 * sum(float(f.covariance[0, 0]) for f in fits))
        return float(fits[0].coefficients[0]), float(fits[1].coefficients[0]), std


def track_of(log: ShipLog) -> Track:
    """Return the track of a run.

    Raises
    ------
    MissingChannel
        No positions x and y.
    """
    x, y = log.channel("x"), log.channel("y")
    if x is None or y is None:
        raise MissingChannel(f"run '{log.name}' has no positions x and y; a turning circle is read from them")
    t = x.t[(x.t >= max(y.t[0], log.t[0])) & (x.t <= min(y.t[-1], log.t[-1]))]
    return Track(t, np.interp(t, x.t, x.values), np.interp(t, y.t, y.values), np.interp(t, log.t, log.psi))


def current_of(track: Track, start: float, end: float) -> Current | None:
    """Return the current from how far the track has moved on between headings 360 degrees apart.

    Once the turn is steady the craft's own circle is closed after each full turn, so all of the displacement is the
    water's. start, end : when the turn has settled, and when it ended [s]. None when less than one further full turn
    follows.
    """
    keep = (track.t >= start) & (track.t <= end)
    if int(keep.sum()) < 10:
        return None
    t, x, y, psi = track.t[keep], track.x[keep], track.y[keep], np.abs(track.psi[keep] - track.psi[keep][:1])
    psi = np.maximum.accumulate(psi) + 1e-12 * np.arange(len(psi))
    if psi[-1] < 2.0 * math.pi + 0.5:
        return None
    first = psi <= psi[-1] - 2.0 * math.pi
    later = np.interp(psi[first] + 2.0 * math.pi, psi, t)
    drift = [(np.interp(later, t, v) - v[first]) / (later - t[first]) for v in (x, y)]
    means = [local_fit(t[first], d, float(t[first].mean()), 0) for d in drift]
    std = math.sqrt(0.5 * sum(float(m.covariance[0, 0]) for m in means))
    return Current(float(means[0].coefficients[0]), float(means[1].coefficients[0]), std)
