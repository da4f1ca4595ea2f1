"""The safety envelope: limits that end a manoeuvre. They are checked at every tick, independently of the manoeuvre."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace

from gcs_autotune.craft import Observation
from gcs_autotune.errors import GuardTripped, UsageError
from gcs_autotune.manoeuvres.area import Area, how_far
from gcs_autotune.observer import Room

__all__ = ["FAR_OUT", "GUARDS", "NEARLY", "RATES", "STOPPING", "TO_COME_ABOUT", "Envelope", "Guard", "Watch", "far_out"]

NEARLY = 0.9
"""Fraction of the distance limit at which manoeuvres end early. Project choice."""
FAR_OUT = 0.4
"""Fraction of the distance limit beyond which a boat turns around before a further manoeuvre. Project choice."""
TO_COME_ABOUT = 12.0
"""Distance that a boat needs to turn around, as the time [s] of straight travel at cruise speed, until its records show
that it needs more. The boat Charlie needs 8 to 11 s after an unsteady step. Project choice.
"""
STOPPING = 1.0
"""Time [s] that a craft is assumed to need to stop a turn or a change of depth, in addition to the delay of the link.
Project choice: the turn of the slowest simulated ROV, FALCON, has a time constant of 0.3 s, its heave one of 0.6 s.
"""
RATES: Mapping[str, str] = {"psi": "r", "z": "w", "x": "u"}
"""Signal of an observation -> the signal that is its time derivative."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Safety limits of a flight, in SI units and radians; ``inf`` switches a limit off.

    ``heading_excursion`` and ``depth_excursion`` count from the start of the manoeuvre, ``distance`` from the start of
    the run; ``depth_min`` and ``depth_max`` bound the depth itself; ``battery_voltage`` [V] and ``battery_remaining``
    [0..1] are lower limits; ``time`` limits one manoeuvre. ``speed`` and ``distance`` None: 4 m/s and 300 m, or more if
    ``cruise`` [m/s] requires it. ``turning`` is the distance needed to turn around, as the time [s] of straight travel
    at ``cruise``. ``area`` is the permitted area, in the metres of ``x`` and ``y``. Defaults are chosen
    for boats and ROVs of up to a few metres in a few boat lengths of free water.

    Raises
    ------
    UsageError
        A limit is negative or not a number, so it would have no effect.
    """

    heading_excursion: float = math.radians(120.0)
    depth_min: float = 0.0
    depth_max: float = math.inf
    depth_excursion: float = 3.0
    speed: float | None = None
    distance: float | None = None
    roll: float = math.radians(45.0)
    pitch: float = math.radians(45.0)
    battery_voltage: float = 0.0
    battery_remaining: float = 0.1
    time: float = 600.0
    cruise: float = 0.0
    area: Area | None = None
    turn_rate: float = math.inf
    turning: float = TO_COME_ABOUT

    def __post_init__(self) -> None:
        """Check that every limit is a valid number."""
        for limit in fields(self):
            value = getattr(self, limit.name)
            if isinstance(value, (int, float)) and not value >= 0.0:
                raise UsageError(f"safety limit {limit.name}: {value:g} is not valid. Use a number of 0 or more")

    @property
    def speed_limit(self) -> float:
        """Return the limit of the speed over ground [m/s].

        It leaves a margin because a boat slightly overshoots its cruise speed.
        """
        return max(4.0, 1.5 * self.cruise) if self.speed is None else self.speed

    @property
    def distance_limit(self) -> float:
        """Return the limit of the distance from the start [m]: 100 s of straight travel, at least 300 m."""
        return max(300.0, 100.0 * self.cruise) if self.distance is None else self.distance


def far_out(envelope: Envelope, away: float, ahead: float, *, last: bool = False) -> bool:
    """Return whether a boat *away* [m] from its start must turn around before a stage of *ahead* [s].

    It must turn if it is far out, or may be too far out at the end of the stage. *last*: whether no stage follows.
    """
    limit = envelope.distance_limit
    share = NEARLY if last else FAR_OUT
    near = envelope.area is None and away <= share * limit and away + envelope.cruise * ahead <= NEARLY * limit
    return not near


@dataclass(frozen=True, slots=True)
class Guard:
    """One safety limit of the envelope. ``share`` is the fraction of the limit that is used, above 1 if it is exceeded.

    ``measure`` returns (value, limit) in SI units, or None if the signal does not exist. ``option`` is the command-line
    option that sets the limit.
    """

    name: str
    unit: str
    option: str
    measure: Callable[[Envelope, Observation, Observation], tuple[float, float] | None]
    below: bool = False

    def share(self, envelope: Envelope, anchor: Observation, now: Observation) -> float:
        """Return the used fraction of the limit; 0 if it does not apply, ``inf`` if value or limit is NaN."""
        pair = self.measure(envelope, anchor, now)
        if pair is None or self._never_trips(pair[1]):
            return 0.0
        value, limit = pair
        holds = value >= limit if self.below else value <= limit
        if not (holds and math.isfinite(value)):
            return math.inf
        if self.below:
            return limit / value
        return value / limit if limit > 0.0 else 0.0

    def applies(self, envelope: Envelope, now: Observation) -> bool:
        """Return whether *envelope* has a limit that can trip; it depends on no value of *now*."""
        pair = self.measure(envelope, now, now)
        return pair is not None and not self._never_trips(pair[1])

    def _never_trips(self, limit: float) -> bool:
        return limit == math.inf or (self.below and limit == 0.0)

    def is_known(self, envelope: Envelope, anchor: Observation, now: Observation) -> bool:
        """Return whether the guarded signal exists."""
        pair = self.measure(envelope, anchor, now)
        return pair is not None and math.isfinite(pair[0])


def _distance(anchor: Observation, now: Observation) -> float:
    return math.hypot(now.x - anchor.x, now.y - anchor.y)


def _outside(envelope: Envelope, now: Observation) -> tuple[float, float] | None:
    if envelope.area is None:
        return None
    return (envelope.area.beyond(now.x, now.y) if math.isfinite(now.x + now.y) else math.nan), 0.0


OUTSIDE = "outside the area"

GUARDS: tuple[Guard, ...] = (
    Guard(
        "heading excursion", "rad", "max-heading-excursion", lambda e, a, o: (abs(o.psi - a.psi), e.heading_excursion)
    ),
    Guard("depth excursion", "m", "max-depth-excursion", lambda e, a, o: (abs(o.z - a.z), e.depth_excursion)),
    Guard("greatest depth", "m", "max-depth", lambda e, a, o: (o.z, e.depth_max)),
    Guard(
        "least depth", "m", "min-depth", lambda e, a, o: (o.z, e.depth_min) if e.depth_min > 0.0 else None, below=True
    ),
    Guard("speed", "m/s", "max-speed", lambda e, a, o: (o.speed, e.speed_limit)),
    Guard("distance from start", "m", "max-distance", lambda e, a, o: (_distance(a, o), e.distance_limit)),
    Guard(OUTSIDE, "m", "area", lambda e, a, o: _outside(e, o)),
    Guard("turn rate", "rad/s", "max-turn-rate", lambda e, a, o: (abs(o.r), e.turn_rate)),
    Guard("roll", "rad", "max-roll", lambda e, a, o: (abs(o.phi), e.roll)),
    Guard("pitch", "rad", "max-pitch", lambda e, a, o: (abs(o.theta), e.pitch)),
    Guard(
        "battery voltage",
        "V",
        "min-battery-voltage",
        lambda e, a, o: (o.battery_voltage, e.battery_voltage),
        below=True,
    ),
    Guard(
        "battery remaining", "1", "min-battery", lambda e, a, o: (o.battery_remaining, e.battery_remaining), below=True
    ),
    Guard("time", "s", "max-time", lambda e, a, o: (o.t - a.t, e.time)),
)
"""All safety limits. To add a limit, add a line here and a field in :class:`Envelope`."""


class Watch:
    """Monitors the envelope of one manoeuvre, relative to the manoeuvre's start. Positions count from *home* if it is
    supplied.

    A signal that the craft does not have (a battery monitor, a position indoors) is not guarded. A signal that becomes
    invalid trips its guard. A signal that appears later is guarded from then on.
    """

    def __init__(self, envelope: Envelope, anchor: Observation, home: Observation | None = None) -> None:
        self.envelope = envelope
        self.anchor = anchor if home is None else replace(anchor, x=home.x, y=home.y)
        began = (anchor,) if home is None else (anchor, home)
        self._guards = [g for g in GUARDS if g.applies(envelope, anchor)]
        self._known = {g.name for g in self._guards if any(g.is_known(envelope, o, o) for o in began)}

    @property
    def room(self) -> Room:
        """The limits of the space around the start, for the observer."""
        e, a = self.envelope, self.anchor
        zones = () if e.area is None else tuple((z.corners, z.radius, z.inside) for z in e.area.zones)
        bounds = {
            "psi": (a.psi - e.heading_excursion, a.psi + e.heading_excursion),
            "z": (max(a.z - e.depth_excursion, e.depth_min), min(a.z + e.depth_excursion, e.depth_max)),
        }
        return Room(a.x, a.y, e.distance_limit, zones, bounds)

    def away(self, now: Observation) -> float:
        """Return the distance [m] from the start of the run; NaN if unknown."""
        return _distance(self.anchor, now)

    def room_ends(self, now: Observation) -> str:
        """Return a sentence on the space limit to which the craft is too close; empty if there is none."""
        envelope, limit, away = self.envelope, self.envelope.distance_limit, self.away(now)
        to_turn_around = envelope.turning * envelope.cruise
        least = min(to_turn_around, 0.5 * limit)  # a small room is not over at its start
        if away >= min(NEARLY * limit, limit - least):
            return f"{away:.0f} m from the start, limit {limit:.0f} m (--max-distance)"
        if envelope.area is None or not to_turn_around:
            return ""
        ahead = now.x + to_turn_around * math.cos(now.psi), now.y + to_turn_around * math.sin(now.psi)
        if not envelope.area.beyond(*ahead):
            return ""
        return f"{to_turn_around:.0f} m before the edge of {envelope.area.source}"

    def drift_ends(self, signal: str, now: Observation, late: float) -> tuple[str, float]:
        """Return a sentence on the limit that *signal*, which no loop holds, would reach before the craft stops, and
        the side (-1 or 1) to which it drifts. The sentence is empty if there is space left.

        late : delay of the link [s], in addition to :data:`STOPPING`.
        """
        if signal not in ("psi", "z"):
            return "", 0.0
        moved = now.value(signal) - self.anchor.value(signal)
        side = math.copysign(1.0, moved)
        rate = side * now.value(RATES[signal])
        ahead = rate * (STOPPING + late) if rate > 0.0 else 0.0
        for limit, option in self._limits_of(signal, side):
            if abs(moved) + ahead >= NEARLY * limit:
                far, most = (
                    f"{math.degrees(x):.0f} deg" if signal == "psi" else f"{x:.1f} m" for x in (abs(moved), limit)
                )
                return f"{far} from its start, limit {most} (--{option})", side
        return "", side

    def _limits_of(self, signal: str, side: float) -> Iterator[tuple[float, str]]:
        """Yield how far *signal* may go from its start to the *side*, and the option that limits it."""
        e = self.envelope
        if signal == "psi":
            yield e.heading_excursion, "max-heading-excursion"
            return
        yield e.depth_excursion, "max-depth-excursion"
        if side > 0.0:
            yield e.depth_max - self.anchor.z, "max-depth"
        elif e.depth_min > 0.0:
            yield self.anchor.z - e.depth_min, "min-depth"

    def check(self, now: Observation) -> tuple[str, float]:
        """Return the guard nearest to tripping and the fraction of it that is used (0..1).

        Raises
        ------
        GuardTripped
            A limit is crossed or can no longer be monitored; the error contains guard, value and limit.
        """
        self._anchor_late(now)
        nearest, most = "", 0.0
        for guard in self._guards:
            if guard.name not in self._known:
                if not guard.is_known(self.envelope, self.anchor, now):
                    continue
                self._known.add(guard.name)
            share = guard.share(self.envelope, self.anchor, now)
            if share > 1.0:
                self._trip(guard, now)
            if share > most:
                nearest, most = guard.name, share
        return nearest, most

    def _anchor_late(self, now: Observation) -> None:
        """Use the first position or depth as reference if there was none at the start."""
        if not math.isfinite(self.anchor.x + self.anchor.y) and math.isfinite(now.x + now.y):
            self.anchor = replace(self.anchor, x=now.x, y=now.y)
        if not math.isfinite(self.anchor.z) and math.isfinite(now.z):
            self.anchor = replace(self.anchor, z=now.z)

    def _trip(self, guard: Guard, now: Observation) -> None:
        pair = guard.measure(self.envelope, self.anchor, now)
        value, limit = pair if pair is not None else (math.nan, math.nan)
        shown = _shown(guard, value), _shown(guard, limit)
        if not math.isfinite(value):
            raise GuardTripped(
                f"safety limit '{guard.name}' can no longer be monitored: the vehicle reports no usable value any more "
                f"(limit {shown[1]}). The actuators were set to neutral. Check the sensor",
                guard=guard.name,
                value=value,
                limit=limit,
            )
        if guard.name == OUTSIDE and self.envelope.area is not None:
            raise GuardTripped(
                f"the craft is {how_far(value)} outside {self.envelope.area.source}. The actuators were set to "
                "neutral. Take the craft to more open water, or use a larger area",
                guard=guard.name,
                value=value,
                limit=limit,
            )
        cure = (
            "Charge the battery, or set"
            if guard.name.startswith("battery")
            else "Fly a smaller, slower or shorter manoeuvre, or, if there is space, set"
        )
        raise GuardTripped(
            f"safety limit '{guard.name}' tripped: {shown[0]}, limit {shown[1]}. The actuators were set to neutral",
            guard=guard.name,
            value=value,
            limit=limit,
            advice=f"{cure} another limit (--{guard.option})",
        )


def _shown(guard: Guard, value: float) -> str:
    if guard.unit.startswith("rad"):
        return f"{math.degrees(value):.1f} {guard.unit.replace('rad', 'deg')}"
    return f"{value:.2f} {guard.unit}" if guard.unit != "1" else f"{100.0 * value:.0f} %"
