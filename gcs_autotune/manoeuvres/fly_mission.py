"""Flying a stored mission in the autopilot's own mission mode, and the course that proves how a boat follows lines."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, ClassVar

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.observer import Progress

__all__ = ["CORNERS", "FlyMission", "ProofCourse"]

CORNERS = (math.radians(90.0), math.radians(150.0), math.radians(180.0))
"""Turns of the course between its legs [rad]: the required corners and the U-turn."""
RUN_IN = 0.7
"""Length of the run-in to the first leg, as a fraction of a leg. Project choice: the boat is on the line at its end."""
FULL = 0.8
"""Mean output ahead [fraction of full] above which a waypoint is missed for lack of thrust. Project choice."""
JUMP = 3.0
"""Change of position [m] beyond what the speed explains: an EKF reset or a GPS fault. Project choice: noise is less."""
START = 30.0
"""Time that reaching a waypoint may take beyond its way [s]: to set out, and to turn around. Project choice."""
CLEAR = 5.0
"""Distance from the boat to the run-in [m]. Project choice: ahead of it, so that it does not turn around."""


@dataclass(frozen=True, slots=True)
class ProofCourse:
    """The course as metres (north, east): a run-in, then legs of *length* [m] with :data:`CORNERS` between them.

    It begins at (x, y) [m] in the direction *psi* [rad]. The last waypoint leads back to the run-in and is not reached:
    the flight ends as the last leg does, before the autopilot acts on the end of its mission.
    """

    x: float
    y: float
    psi: float
    length: float

    @property
    def waypoints(self) -> tuple[tuple[float, float], ...]:
        """Waypoints from item 1 of the mission on."""
        heading = self.psi
        places = [self._ahead((self.x, self.y), CLEAR, heading)]
        places.append(self._ahead(places[-1], RUN_IN * self.length, heading))
        for turn in (0.0, *CORNERS):
            heading += turn
            places.append(self._ahead(places[-1], self.length, heading))
        return (*places, places[0])

    @property
    def reach(self) -> float:
        """Greatest distance of a waypoint from the boat [m]."""
        return max(math.hypot(x - self.x, y - self.y) for x, y in self.waypoints)

    @property
    def way(self) -> float:
        """Length of the whole way [m]."""
        places = ((self.x, self.y), *self.waypoints[:-1])
        return sum(math.dist(a, b) for a, b in itertools.pairwise(places))

    @staticmethod
    def _ahead(place: tuple[float, float], metres: float, heading: float) -> tuple[float, float]:
        return place[0] + metres * math.cos(heading), place[1] + metres * math.sin(heading)


class FlyMission(Manoeuvre):
    """Fly the stored mission, whose item 1 is the first of *waypoints*, until the last one but one is reached.

    The sticks stay neutral. Marks ``waypoint`` give the moment at which the autopilot turned to each ``item``. The
    flight is aborted if a waypoint takes too long or the position jumps.

    Parameters
    ----------
    slowest : speed [m/s] at which a waypoint counts as not reached, after another ``START`` seconds.
    """

    kind, purpose, in_manual = "mission", "proof", False
    in_mission: ClassVar[bool] = True

    def __init__(self, waypoints: Sequence[tuple[float, float]], slowest: float, name: str = "") -> None:
        super().__init__(name)
        self._waypoints = tuple(waypoints)
        self._slowest = slowest
        self._item = 0
        self._last: Observation
        self._since: Observation
        self._outputs: list[float] = []

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """The waypoints [m]."""
        return {"waypoints_x": [x for x, _ in self._waypoints], "waypoints_y": [y for _, y in self._waypoints]}

    def commands(self, now: Observation) -> Commands:
        """Yield neutral sticks until the last leg ends."""
        start, last = now.t, len(self._waypoints)
        self._last = self._since = now
        while True:
            fault = self._fault(now)
            self._take(now)
            if fault:
                self._end("aborted", fault)
            elif self._item >= last:
                self._end("completed", f"{last - 1} waypoints in {now.t - start:.0f} s")
            now = yield Actuate()

    def _fault(self, now: Observation) -> str:
        """Return why the flight must end; empty if it need not."""
        if not math.isfinite(now.x + now.y):
            return "the vehicle reports no position. Check its GPS"
        last, self._last = self._last, now
        return self._jump(last, now) or self._late(now)

    def _jump(self, last: Observation, now: Observation) -> str:
        jump = math.hypot(now.x - last.x, now.y - last.y)
        speeds = [seen.speed for seen in (last, now) if math.isfinite(seen.speed)]
        if jump <= JUMP + 2.0 * max(speeds, default=0.0) * (now.t - last.t):
            return ""
        return (
            f"the position jumped by {jump:.1f} m within {now.t - last.t:.1f} s; up to {JUMP:g} m are accepted. Check "
            "GPS and EKF, then start again"
        )

    def _late(self, now: Observation) -> str:
        """Return why the next waypoint takes too long, with what the boat made of its thrust."""
        self._outputs.append(abs(now.output.get("X", math.nan)))
        since, k = self._since, max(self._item, 1)
        to = self._waypoints[k - 1]
        way, spent = math.dist((since.x, since.y), to), now.t - since.t
        patience = START + way / self._slowest
        if spent <= patience:
            return ""
        made = (way - math.dist((now.x, now.y), to)) / spent
        known = [value for value in self._outputs if math.isfinite(value)]
        output = fmean(known) if known else 0.0
        why = (
            "The current or the wind may be stronger than the boat. Wait for less"
            if output > FULL
            else "The boat does not follow a mission. Tune speed and heading first"
        )
        return (
            f"waypoint {k} of {len(self._waypoints) - 1} was not reached within {patience:.0f} s: the boat made "
            f"{made:.2f} m/s towards it with {100.0 * output:.0f} % of full output. {why}"
        )

    def where_room_ends(self, where: str) -> Outcome | None:
        """End there: the record is of no use."""
        return Outcome("aborted", f"no room for the mission: {where}")

    def progress(self, observation: Observation) -> Progress:
        """Return which waypoint is next."""
        self.phase = f"waypoint {max(self._item, 1)} of {len(self._waypoints) - 1}"
        return super().progress(observation)

    def _take(self, now: Observation) -> None:
        item = int(now.waypoint) if math.isfinite(now.waypoint) else 0
        if item > self._item and (self._item > 0 or item == 1):
            self._item = item
            self._since, self._outputs = now, []
            self._mark(now.t, "waypoint", {"item": float(item)})
