"""Flying a stored mission in the autopilot's own mission mode, and the course that proves how a boat follows lines."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.observer import Progress

__all__ = ["CORNERS", "FlyMission", "ProofCourse"]

CORNERS = (math.radians(90.0), math.radians(150.0), math.radians(180.0))
"""Turns of the course between its legs [rad]: the required corners and the U-turn."""
RUN_IN = 0.7
"""Length of the run-in to the first leg, as a fraction of a leg. Project choice: the boat is on the line at its end."""
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

    The sticks stay neutral. Marks ``waypoint`` give the moment at which the autopilot turned to each ``item``.

    Parameters
    ----------
    patience : longest duration [s].
    """

    kind, purpose, in_manual = "mission", "proof", False
    in_mission: ClassVar[bool] = True

    def __init__(self, waypoints: Sequence[tuple[float, float]], patience: float, name: str = "") -> None:
        super().__init__(name)
        self._waypoints = tuple(waypoints)
        self._patience = patience
        self._item = 0

    @property
    def asked(self) -> Mapping[str, Any]:
        """The waypoints [m]."""
        return {"waypoints_x": [x for x, _ in self._waypoints], "waypoints_y": [y for _, y in self._waypoints]}

    def commands(self, now: Observation) -> Commands:
        """Yield neutral sticks until the last leg ends."""
        start, last = now.t, len(self._waypoints)
        while True:
            if not math.isfinite(now.x + now.y):
                self._end("aborted", "the vehicle reports no position. Check its GPS")
            self._take(now)
            if self._item >= last:
                self._end("completed", f"{last - 1} waypoints in {now.t - start:.0f} s")
            elif now.t - start > self._patience:
                self._end(
                    "aborted",
                    f"waypoint {max(self._item, 1)} of {last - 1} was not reached within {self._patience:.0f} s of the "
                    "start. The boat does not follow a mission: tune speed and heading first",
                )
            now = yield Actuate()

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
            self._mark(now.t, "waypoint", {"item": float(item)})
