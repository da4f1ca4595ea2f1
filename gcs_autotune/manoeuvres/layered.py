"""Manoeuvres in three layers over our own loops: planning, guidance, control.

Gomes2003, table 1; Miskovic2010, fig. 8.1. A row of the table plans a path from where the craft is. A helm
(``gcs_autotune.control``) guides and controls the craft along it. The same object is previewed on a model and flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.hold_controller import HELD_BEFORE, HoldController, hold
from gcs_autotune.manoeuvres.keep_distance import KeepDistance
from gcs_autotune.manoeuvres.kind import ManoeuvreKind
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

if TYPE_CHECKING:
    from gcs_autotune.control import AxisLoop, Helm, Reach, TimedPath

__all__ = ["KINDS", "FollowWall", "Layered", "OwnLoops", "Trajectory", "read_points", "seen_from"]

SETTLE = 10.0
"""Shortest time at the end of a path that ends at rest [s]."""
SETTLED_TIMES = 8.0
"""That time in reciprocals of the characteristic frequency: a third-order Bessel loop settles in four. Project choice.
"""
SHARE = 0.5
"""Speed of a path without a required speed, relative to the greatest speed of the craft."""
MOST_SHARE = 0.9
"""Greatest speed of a path, relative to that of the craft: the rest is for the loops."""
STRAYED = 5.0
"""Distance from the target [m] beyond which the craft counts as unable to follow it; at least five turning radii."""
PATIENCE = 2.0
"""Longest duration of a path under way, as a multiple of that planned."""

Plan = Callable[[Observation, "Reach"], "TimedPath"]


@dataclass(frozen=True, slots=True)
class OwnLoops:
    """The loops of a craft by degree of freedom, and how it moves.

    ``throttle``: cruise of a craft that steers only under way [fraction of full]. ``under_way``: whether it is one.
    ``spot``: whether it turns on the spot. ``apart``: distance between its two rangefinders ahead [m].
    """

    loops: Mapping[str, AxisLoop]
    throttle: float = 0.0
    under_way: bool = False
    spot: bool = True
    apart: float = 0.2

    @property
    def reach(self) -> Reach:
        """What the craft can do with them."""
        from gcs_autotune.control import reach_of  # a second to import, which the table need not take

        return reach_of(self.loops, under_way=self.under_way, spot=self.spot)

    @property
    def settle(self) -> float:
        """Time at the end of a path until the slowest loop has settled [s]."""
        return max(SETTLE, *(SETTLED_TIMES / loop.design.wanted.omega_0 for loop in self.loops.values()))

    def helm(self, *, places: bool = True) -> Helm:
        """Return a helm that has not begun; *places*: whether it follows positions, not only headings."""
        from gcs_autotune.control import helm_for

        return helm_for(self.loops, self.reach, self.throttle, places=places)


class Layered(Manoeuvre):
    """Follow the path that *plan* makes from the first observation, with the loops of :meth:`over`.

    holds : whether it counts how the position is kept; False: only the heading is controlled.
    """

    kind, purpose = "layered", "proof"

    def __init__(self, kind: str, plan: Plan, name: str = "") -> None:
        self.kind = kind
        super().__init__(name or kind)
        self._plan, self._own = plan, OwnLoops({})
        self._path: TimedPath | None = None

    def over(self, own: OwnLoops) -> Layered:
        """Set the loops that fly it, and return it."""
        self._own = own
        return self

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """The path, once it is planned."""
        path = self._path
        if path is None:
            return {}
        return {
            "path_t": list(path.times),
            "path": [list(place) for place in path.places],
            "path_velocity": [list(velocity) for velocity in path.velocities],
        }

    def planned(self, now: Observation) -> TimedPath:
        """Return the path from *now*.

        Raises
        ------
        UsageError
            The craft cannot follow it; the message has the number and the nearest that is feasible.
        """
        reach = self._own.reach
        path = self._plan(now, reach)
        if not math.isfinite(path.places[0][0]):
            return path
        speed, t = path.fastest()
        if speed > reach.speed:
            raise UsageError(
                f"{self.kind} needs {speed:.2f} m/s {t:.0f} s after its start. The craft makes {reach.speed:.2f} m/s. "
                f"Use at most --speed {MOST_SHARE * reach.speed:.2g}, or later points"
            )
        rate, speed, t = path.sharpest()
        if reach.under_way and rate > reach.rate:
            raise UsageError(
                f"{self.kind} has a corner of {speed / rate:.1f} m radius {t:.0f} s after its start, tighter than the "
                f"turning circle of {reach.radius(speed):.1f} m radius at {speed:.2f} m/s. Use points further apart"
            )
        return path

    def commands(self, now: Observation) -> Commands:
        """Yield the outputs along the path."""
        own, start = self._own, now.t
        try:
            path = self._path = self.planned(now)
        except UsageError as error:
            self._end("aborted", str(error))
            yield Actuate()
            return
        places = math.isfinite(path.places[0][0])
        moves = any(path.velocities[-1][:2])
        helm, depth = own.helm(places=places), [] if own.under_way or "heave" in own.loops else _depth_hold()
        reach = own.reach
        leash = max(STRAYED, 5.0 * reach.radius(path.fastest()[0])) if places else math.inf
        self._mark(now.t, "target", {"phase": "path"})
        nearest = math.inf
        while True:
            t = now.t - start
            target = path.target(t)
            self.target = target.position[3]
            away = math.hypot(now.x - target.position[0], now.y - target.position[1]) if places else 0.0
            left = math.hypot(now.x - path.places[-1][0], now.y - path.places[-1][1]) if places else 0.0
            nearest = min(nearest, left) if t > 0.5 * path.seconds else nearest
            if not _known(now, places=places, sideways=reach.sideways):
                self._end("aborted", "the vehicle does not report its position or velocity. Check its position sensor")
            elif away > leash:
                self._end(
                    "stopped", f"the craft is {away:.1f} m from its target, more than {leash:.1f} m. It cannot follow"
                )
            elif moves and t > 0.5 * path.seconds and (_passed(path, now) or t > PATIENCE * path.seconds):
                self._end("completed", f"the end is passed at {nearest:.2f} m")
            elif not moves and t >= path.seconds + own.settle:
                self._end("completed", f"at the end {left:.2f} m from the target" if places else "turned")
            command = Actuate() if self.outcome is not None else hold(helm.update(target, now), depth, now)
            now = yield command


def _depth_hold() -> list[HoldController]:
    return [HoldController(gains) for gains in HELD_BEFORE.values()]


def _known(now: Observation, *, places: bool, sideways: bool) -> bool:
    wanted = [now.psi, now.r]
    if places:
        wanted += [now.x, now.y, now.u if sideways else now.speed, now.v if sideways else 0.0]
    return all(math.isfinite(value) for value in wanted)


def _passed(path: TimedPath, now: Observation) -> bool:
    """Return whether the craft is abeam of the last point of the path, or beyond it."""
    x, y = path.places[-1][:2]
    u, v = path.velocities[-1][:2]
    return (now.x - x) * u + (now.y - y) * v >= 0.0


class FollowWall(KeepDistance):
    """Face a wall, go to a distance from it, and move along it: sideways if the craft can, else vertically.

    distance : to the wall [m]; NaN: the present one. length : along it [m], to starboard or down. speed : along it
        [m/s].
    """

    kind = "follow-wall"
    _flown = "followed the wall"

    def __init__(self, distance: float, length: float, speed: float, name: str = "") -> None:
        super().__init__(None, 0.0, 0.0, 0.0, SETTLE, (_as_it_is, _as_it_is), name or self.kind)
        self._wanted, self._length, self._rate = distance, length, speed or ALONG_WALL
        self._own = OwnLoops({})
        self._motion: _AlongWall | None = None

    def over(self, own: OwnLoops) -> FollowWall:
        """Set the loops that fly it, and return it."""
        from gcs_autotune.control import design_distance

        self._own = own
        surge, yaw = own.loops["surge"], own.loops["yaw"]
        law = design_distance(surge.design.model, yaw.design.model, surge.design.wanted, yaw.design.wanted)
        self._law = law.with_limits(X=surge.design.law.limits, N=yaw.design.law.limits)
        self._outputs, self._apart = (surge.output, yaw.output), own.apart
        return self

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Distance, length and speed."""
        return {**super().meta_fields, "distance": self._wanted, "length": self._length, "speed": self._rate}

    def _phases(self, base: float) -> Sequence[tuple[str, float, float]]:
        """Return name, time [s] and distance from *base* [m] of each phase."""
        offset = self._wanted - base if math.isfinite(self._wanted) else 0.0
        return ("hold", self._settle, 0.0), ("approach", 2.0 * SETTLE, offset), ("along", self._along, offset)

    @property
    def _along(self) -> float:
        return abs(self._length) / self._rate

    def _beside(self, command: Actuate, now: Observation, depth: Sequence[HoldController]) -> Actuate:
        """Return *command* with the motion along the wall, once its phase has begun."""
        if self.phase != "along" or self.outcome is not None:
            return hold(command, depth, now)
        along = self._motion = self._motion or _AlongWall(self._own.loops, math.copysign(self._rate, self._length))
        return along.added(command, now, depth)


class _AlongWall:
    """Moves a craft along a wall at *rate* [m/s]: to starboard by its sway loop, or down by its heave loop."""

    def __init__(self, loops: Mapping[str, AxisLoop], rate: float) -> None:
        from gcs_autotune.control import STRUCTURES

        self._sideways = "sway" in loops
        self._loop, self._rate = loops["sway" if self._sideways else "heave"], rate
        law = replace(self._loop.design.law, structure=STRUCTURES["PID"])
        self._controller = law.started(-self._loop.design.model.delta)
        self._begun = self._y = self._start = self._t = math.nan

    def added(self, command: Actuate, now: Observation, depth: Sequence[HoldController]) -> Actuate:
        """Return *command* with the output along the wall; the depth is held if it is sideways."""
        speed = now.v if self._sideways else now.w
        speed = speed if math.isfinite(speed) else 0.0
        if math.isnan(self._start):
            self._start = self._t = now.t
            self._y = 0.0
            self._begun = 0.0 if self._sideways else now.z
        self._y += speed * (now.t - self._t)
        self._t = now.t
        place = self._y if self._sideways else now.z
        wanted = self._begun + self._rate * (now.t - self._start)
        out = self._loop.output(self._controller.update(wanted, place, speed, now.t))
        return hold(replace(command, Y=out), depth, now) if self._sideways else replace(command, Z=out)


def _as_it_is(force: float) -> float:
    return force


ALONG_WALL = 0.1
"""Speed along a wall if none is required [m/s]. Chosen: an inspection camera sees every spot for seconds."""


# --- planning: one function per manoeuvre ---------------------------------------------------------------------------


def _speed(options: Mapping[str, float], reach: Reach) -> float:
    return options.get("speed", 0.0) or SHARE * reach.speed


def seen_from(now: Observation, ahead: float, starboard: float) -> tuple[float, float]:
    """Return (north, east) [m] of the point that far *ahead* and to *starboard* [m] of the craft."""
    s, c = math.sin(now.psi), math.cos(now.psi)
    return now.x + ahead * c - starboard * s, now.y + ahead * s + starboard * c


def _hover(options: Mapping[str, float], now: Observation, reach: Reach) -> TimedPath:
    from gcs_autotune.control import TimedPath

    here = (now.x, now.y, now.z, now.psi)
    return TimedPath.through((0.0, options["duration"]), (here, here))


def _orientation(options: Mapping[str, float], now: Observation, reach: Reach) -> TimedPath:
    from gcs_autotune.control import TimedPath

    nowhere, turn = math.nan, options["heading-change"]
    seconds = 1.5 * abs(turn) / (SHARE * reach.rate)
    return TimedPath.through(
        (0.0, max(seconds, 1.0)), ((nowhere, nowhere, now.z, now.psi), (nowhere, nowhere, now.z, now.psi + turn))
    )


def _to(now: Observation, reach: Reach, place: tuple[float, float], speed: float, z: float) -> TimedPath:
    """Return the path straight to *place* (north, east) [m] at *speed* [m/s], and to the depth *z* on the way.

    A craft that neither goes sideways nor steers only under way first turns towards the place.
    """
    from gcs_autotune.control import TimedPath

    north, east = place[0] - now.x, place[1] - now.y
    length, bearing = math.hypot(north, east), math.atan2(east, north)
    if reach.under_way:
        _check_outside_circle(now, reach, place, speed)
        seconds = length / speed
        along = (north / seconds, east / seconds, 0.0, 0.0)
        return TimedPath.through(
            (0.0, seconds), ((now.x, now.y, z, now.psi), (*place, z, now.psi)), starts=along, leaves=along
        )
    psi, times, places = now.psi, [0.0], [(now.x, now.y, now.z, now.psi)]
    if not reach.sideways:
        turn = math.remainder(bearing - now.psi, 2.0 * math.pi)
        psi = now.psi + turn
        times.append(max(1.5 * abs(turn) / (SHARE * reach.rate), 1.0) + SETTLE / 2.0)
        places.append((now.x, now.y, now.z, psi))
    parts = [TimedPath.through(times, places)] if len(times) > 1 else []
    seconds = 1.5 * length / speed
    run = TimedPath.through((0.0, seconds), ((now.x, now.y, now.z, psi), (*place, z, psi)))
    return _after(parts[0], run) if parts else run


def _after(first: TimedPath, then: TimedPath) -> TimedPath:
    """Return *first* and, at its end, *then*; both begin and end at rest."""
    from gcs_autotune.control import TimedPath

    late = tuple(first.seconds + t for t in then.times[1:])
    return TimedPath(
        (*first.times, *late), (*first.places, *then.places[1:]), (*first.velocities, *then.velocities[1:])
    )


def _check_outside_circle(now: Observation, reach: Reach, place: tuple[float, float], speed: float) -> None:
    radius = reach.radius(speed)
    north, east = place[0] - now.x, place[1] - now.y
    s, c = math.sin(now.psi), math.cos(now.psi)
    ahead, aside = north * c + east * s, abs(east * c - north * s)
    if math.hypot(ahead, aside - radius) < radius:
        raise UsageError(
            f"the point is inside the turning circle of {radius:.1f} m radius at {speed:.2f} m/s, which the craft "
            f"cannot reach directly. Use a point at least {2.0 * radius:.1f} m away, or less --speed"
        )


def _goto(options: Mapping[str, float], now: Observation, reach: Reach) -> TimedPath:
    place = seen_from(now, options["ahead"], options["starboard"])
    return _to(now, reach, place, _speed(options, reach), now.z)


def _plane(options: Mapping[str, float], now: Observation, reach: Reach) -> TimedPath:
    from gcs_autotune.control import TimedPath

    z = options.get("depth", now.z)
    dive = TimedPath.through(
        (0.0, max(1.5 * abs(z - now.z) / DIVE_SPEED, 1.0) + SETTLE / 2.0),
        ((now.x, now.y, now.z, now.psi), (now.x, now.y, z, now.psi)),
    )
    return _after(dive, _to(replace(now, z=z), reach, seen_from(now, options["ahead"], 0.0), _speed(options, reach), z))


DIVE_SPEED = 0.15
"""Vertical speed on the way to a plane [m/s]. Chosen: any ROV of the table reaches it."""

Points = tuple[tuple[float, float, float], ...]


class Trajectory(Layered):
    """Follow timed points: (time [s], metres ahead, metres to starboard of the start)."""

    def __init__(self, points: Points = (), name: str = "") -> None:
        super().__init__("trajectory", self._through, name)
        self.points = points

    def _through(self, now: Observation, reach: Reach) -> TimedPath:
        from gcs_autotune.control import TimedPath

        places = [(now.x, now.y, now.z, now.psi)]
        for _, ahead, starboard in self.points:
            x, y = seen_from(now, ahead, starboard)
            bearing = math.atan2(y - places[-1][1], x - places[-1][0])
            # a craft without thrust sideways points along its way
            psi = now.psi if reach.sideways else places[-1][3] + math.remainder(bearing - places[-1][3], 2.0 * math.pi)
            places.append((x, y, now.z, psi))
        times = [0.0, *(t for t, _, _ in self.points)]
        u = now.u if math.isfinite(now.u) else now.speed
        begins = (u * math.cos(now.psi), u * math.sin(now.psi), 0.0, 0.0)
        if reach.under_way:
            return TimedPath.through(times, places, starts=begins, leaves=None)
        return TimedPath.through(times, places)


def read_points(text: str) -> Points:
    """Return the points of "t,ahead,starboard t,ahead,starboard ...", times [s] rising from more than zero.

    Raises
    ------
    UsageError
        It is not such a list.
    """
    try:
        found = [tuple(float(number) for number in point.split(",")) for point in text.split()]
    except ValueError:
        found = []
    points = tuple((p[0], p[1], p[2]) for p in found if len(p) == 3 and all(map(math.isfinite, p)))
    if not points or len(points) != len(found):
        raise UsageError(f'--points must be "seconds,ahead,starboard ..." in s and m, not "{text[:60]}"')
    times = [0.0, *(t for t, _, _ in points)]
    late = next((k for k in range(1, len(times)) if times[k] <= times[k - 1]), 0)
    if late:
        raise UsageError(f"--points: the time of point {late}, {times[late]:g} s, must be after {times[late - 1]:g} s")
    return points


def _kind(
    name: str, help: str, drives: str, plan: Any, *, room: str, options: tuple[str, ...], **more: Any
) -> ManoeuvreKind:
    def make(given: Mapping[str, float]) -> Manoeuvre:
        return Layered(name, lambda now, reach: plan(given, now, reach))

    return ManoeuvreKind(
        name=name,
        help=help,
        excites=frozenset(),
        drives=frozenset(drives),
        make=more.pop("make", make),
        options=options,
        room=room,
        identifies=False,
        turns=True,
        layered=True,
        **more,
    )


KINDS = (
    _kind("hover", "hold position and heading, and the depth of an ROV, with our own controllers", "NXY", _hover,
          room="at the spot", options=("duration",), stays=True),
    _kind("goto", "go to a point and stop there; a boat passes it", "NX", _goto,
          room="the way to the point, and a turning circle of a boat", options=("ahead", "starboard")),
    _kind("orientation", "turn to another heading, on the spot if the hull can", "N", _orientation,
          room="at the spot; a boat keeps its speed", options=("heading-change",)),
    _kind("trajectory", "follow points at given times (--points)", "NX", None,
          room="the points", options=(), make=lambda options: Trajectory(), timed=True),
    _kind("plane", "go to a depth and run ahead at that depth", "NXZ", _plane,
          room="the way ahead", options=("depth", "ahead"), stays=True),
    _kind("follow-wall", "keep a distance to a wall ahead while moving along it, sideways or vertically", "NX", None,
          room="along the wall", options=("wall-distance", "length-along", "apart"), stays=True, needs="d",
          make=lambda o: FollowWall(o.get("wall-distance", math.nan), o["length-along"], o.get("speed", 0.0))),
)  # fmt: skip
"""Rows of the elemental manoeuvres, Gomes2003, table 1."""
