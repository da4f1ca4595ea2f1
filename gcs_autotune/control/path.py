"""Planning: a smooth path through timed points, which guidance and control follow (Miskovic2010, fig. 8.1)."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_autotune.control.position import Four, PositionTarget
from gcs_autotune.sname import wrap

__all__ = ["TimedPath"]

NONE: Four = (0.0, 0.0, 0.0, 0.0)
FINE = 20
"""Points between two timed points at which speed and curvature are looked at."""


@dataclass(frozen=True, slots=True)
class TimedPath:
    """A path through (x, y, z, psi) [m, rad] at ``times`` [s], with a velocity at each; cubic between them.

    Before and after it the craft is to rest at its ends, or to go on at ``leaves`` if that is not zero.
    """

    times: tuple[float, ...]
    places: tuple[Four, ...]
    velocities: tuple[Four, ...]

    @classmethod
    def through(
        cls, times: Sequence[float], places: Sequence[Four], *, starts: Four = NONE, leaves: Four | None = NONE
    ) -> TimedPath:
        """Return the path through *places*; at each inner one its velocity is the mean of both sides.

        starts, leaves : velocities at the ends; None: that of the last side.
        """
        sides = [
            _four([(b - a) / (t2 - t1) for a, b in zip(p1, p2, strict=True)])
            for (t1, p1), (t2, p2) in itertools.pairwise(zip(times, places, strict=True))
        ]
        inner = [_four([0.5 * (a + b) for a, b in zip(*both, strict=True)]) for both in itertools.pairwise(sides)]
        last = sides[-1] if leaves is None else leaves
        return cls(tuple(times), tuple(places), (starts, *inner, last))

    @property
    def seconds(self) -> float:
        """Time of the last point [s]."""
        return self.times[-1]

    def target(self, t: float) -> PositionTarget:
        """Return where the craft should be at time *t* [s], with the velocity and acceleration of that point."""
        if t >= self.times[-1]:
            late = t - self.times[-1]
            place = _four([p + late * v for p, v in zip(self.places[-1], self.velocities[-1], strict=True)])
            return PositionTarget(place, self.velocities[-1])
        k = max(bisect.bisect_right(self.times, t) - 1, 0)
        span = self.times[k + 1] - self.times[k]
        s = max((t - self.times[k]) / span, 0.0)
        places, velocity, acceleration = [], [], []
        for i in range(4):
            a, b = self.places[k][i], self.places[k + 1][i]
            va, vb = span * self.velocities[k][i], span * self.velocities[k + 1][i]
            c2, c3 = 3.0 * (b - a) - 2.0 * va - vb, 2.0 * (a - b) + va + vb
            places.append(a + s * (va + s * (c2 + s * c3)))
            velocity.append((va + s * (2.0 * c2 + 3.0 * s * c3)) / span)
            acceleration.append((2.0 * c2 + 6.0 * s * c3) / span**2)
        return PositionTarget(_four(places), _four(velocity), _four(acceleration))

    def fastest(self) -> tuple[float, float]:
        """Return the greatest speed over ground [m/s] and its time [s]."""
        return max((math.hypot(*self.target(t).velocity[:2]), t) for t in self._fine())

    def sharpest(self) -> tuple[float, float, float]:
        """Return the greatest turn rate along the path [rad/s], the speed there [m/s] and its time [s].

        It is that of chords between fine points, so that a path that stops and goes back is a sharp turn too.
        """
        times = self._fine()
        places = [self.target(t).position for t in times]
        chords = [
            (t2 - t1, math.atan2(q[1] - p[1], q[0] - p[0]), math.dist(p[:2], q[:2]))
            for (t1, t2), (p, q) in zip(itertools.pairwise(times), itertools.pairwise(places), strict=True)
        ]
        turns = [
            (abs(wrap(b[1] - a[1])) / (0.5 * (a[0] + b[0])), 0.5 * (a[2] / a[0] + b[2] / b[0]), t)
            for (a, b), t in zip(itertools.pairwise(chords), times[1:], strict=False)
        ]
        return max(turns)

    def places_on_it(self) -> list[tuple[float, float]]:
        """Return points (north, east) [m] along the path."""
        return [self.target(t).position[:2] for t in self._fine()]

    def _fine(self) -> list[float]:
        spans = itertools.pairwise(self.times)
        return [*(a + (b - a) * (k + 0.5) / FINE for a, b in spans for k in range(FINE)), self.times[-1]]


def _four(values: Sequence[float]) -> Four:
    a, b, c, d = values
    return float(a), float(b), float(c), float(d)
