"""The turning circle: advance, transfer, tactical diameter, the steady turn, and the current.

Definitions are those of IMO MSC.137(76), 4.2, and ITTC 7.5-04-02-01. Positions are those of the recorded point (the GPS
antenna or the model's midship point). From two full turns or more a steady current is estimated and removed. With fewer
turns it is not identifiable.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import Hold, Reading, ShipLog, find_holds, local_fit, mean_reading

__all__ = ["Current", "Track", "TurningCircle", "current_of", "read_turning_circle", "track_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Current:
    """Steady current of the water over the ground.

    - ``north``, ``east`` [m/s]: components.
    - ``std`` [m/s]: standard error of each component.
    """

    north: float
    east: float
    std: float

    @property
    def speed(self) -> float:
        """Speed of the current [m/s]."""
        return math.hypot(self.north, self.east)


STILL = Current(0.0, 0.0, math.nan)
"""Current of zero, which is also used if no current can be identified."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Positions through the water.

    - ``t`` (n,) [s]: stamps.
    - ``x``, ``y`` (n,) [m]: north and east.
    - ``psi`` (n,) [rad]: heading.
    """

    t: Array
    x: Array
    y: Array
    psi: Array

    def without(self, current: Current, origin: float) -> Track:
        """Return the track with *current* removed. The position at the time *origin* [s] stays unchanged."""
        since = self.t - origin
        return Track(self.t, self.x - current.north * since, self.y - current.east * since, self.psi)

    def at(self, t: float, width: float) -> tuple[float, float, float]:
        """Return north and east [m] at the time *t* [s] with their standard error [m], from local quadratics over
        *width* [s].
        """
        keep = np.abs(self.t - t) <= 0.5 * width
        if int(keep.sum()) < 5:
            keep = np.zeros(len(self.t), dtype=bool)
            i = int(np.clip(np.searchsorted(self.t, t), 3, len(self.t) - 3))
            keep[i - 3 : i + 3] = True
        fits = [local_fit(self.t[keep], v[keep], t, 2) for v in (self.x, self.y)]
        std = math.sqrt(0.5 * sum(float(f.covariance[0, 0]) for f in fits))
        return float(fits[0].coefficients[0]), float(fits[1].coefficients[0]), std


def track_of(log: ShipLog) -> Track:
    """Return the track of the run *log*.

    Raises
    ------
    MissingChannel
        The run has no positions x and y.
    """
    x, y = log.channel("x"), log.channel("y")
    if x is None or y is None:
        raise MissingChannel(f"run '{log.name}' has no positions x and y, which a turning circle needs")
    t = x.t[(x.t >= max(y.t[0], log.t[0])) & (x.t <= min(y.t[-1], log.t[-1]))]
    return Track(t, np.interp(t, x.t, x.values), np.interp(t, y.t, y.values), np.interp(t, log.t, log.psi))


def current_of(track: Track, start: float, end: float) -> Current | None:
    """Return the current from the displacement of the track between headings 360 degrees apart.

    In a steady turn the craft's own circle is closed after each full turn, so that the whole displacement is due to the
    water. Return None if less than one further full turn follows.

    start, end : times [s] at which the turn has settled and at which it ended.
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


AMIDSHIPS, STRAIGHT = 0.15, 0.1
"""Largest helm and largest yaw rate of an approach, relative to those of the turn. Project choice."""

LAST = 5.0
"""Length of the approach [s] for speed and course, if the run contains the time of execute. Project choice."""

SETTLED_TURN = math.pi
"""Change of heading [rad] after which a turn counts as steady. Project choice: ITTC requires 540 degrees in total."""


@dataclass(frozen=True, slots=True, eq=False)
class TurningCircle:
    """Figures of one turning circle. NaN marks figures for which the turn was too short.

    - ``rudder`` [unit of the input]: rudder angle.
    - ``turned`` [rad]: total change of heading.
    - ``advance``, ``transfer`` [m]: at 90 degrees of heading change.
    - ``tactical_diameter`` [m]: at 180 degrees; ``steady_diameter`` [m]: of the steady turn.
    - ``time_90``, ``time_180`` [s]: times to 90 and 180 degrees of heading change.
    - ``approach`` and ``steady`` speed [m/s] through the water, and ``speed_loss``, the fraction of speed that is lost.
    - ``drift``: drift angle [rad], positive with the bow inside the turn.
    - ``rate`` [rad/s]: steady yaw rate.
    - ``current``: current that was removed.
    - ``track``: positions through the water from the execute (n,) [m]: ahead, and abeam to the side of the turn.
    """

    run: str
    input: str
    rudder: float
    starboard: bool
    turned: float
    advance: Reading
    transfer: Reading
    tactical_diameter: Reading
    time_90: Reading
    time_180: Reading
    steady_diameter: Reading
    approach: Reading
    steady: Reading
    speed_loss: Reading
    drift: Reading
    rate: Reading
    current: Current
    track: tuple[Array, Array]
    doubts: tuple[Doubt, ...]


def read_turning_circle(log: ShipLog, orders: Sequence[float] = ()) -> TurningCircle:
    """Return the figures of the turning circle in the run *log*.

    orders : times of execute [s], if the run contains them. The turn is then the longest one between two of these
        times.

    Raises
    ------
    MissingChannel
        The run has no positions.
    NotInformative
        The heading never changes by 90 degrees at one rudder angle after an approach.
    """
    track = track_of(log)
    start, end, level = _turn(log) if not orders else _ordered(log, orders)
    before = (track.t <= start) & (track.t >= start - (LAST if orders else 0.5 * (end - start)))
    if int(before.sum()) < 5:
        raise NotInformative(
            f"run '{log.name}' contains no approach before its turn. Start recording on the straight course"
        )
    t, psi = log.heading(float(track.t[before][0]), start)
    course = mean_reading(t, psi, "rad", log.floor)
    side = math.copysign(1.0, float(np.interp(end, log.t, log.psi)) - course.value)
    turned = side * (float(np.interp(end, log.t, log.psi)) - course.value)
    moment = _passing(log, start, end, course.value, side)
    current = current_of(track, moment(SETTLED_TURN).value, end) if turned > SETTLED_TURN else None
    water = track if current is None else track.without(current, start)
    origin = water.at(start, _width(track))

    def offset(when: Reading, along: bool) -> Reading:
        if not math.isfinite(when.value):
            return Reading(math.nan, math.nan, "m")
        x, y, std = water.at(when.value, _width(track))
        north, east = x - origin[0], y - origin[1]
        c, s = math.cos(course.value), math.sin(course.value)
        ahead, abeam = north * c + east * s, side * (east * c - north * s)
        speed = math.hypot(*_velocity(water, when.value))
        drifted = 0.0 if current is None else current.std * (when.value - start)
        lever = abs(abeam if along else ahead) * course.std
        spread = math.sqrt(std**2 + origin[2] ** 2 + (speed * when.std) ** 2 + lever**2 + drifted**2)
        return Reading(ahead if along else abeam, spread, "m")

    flown = (water.t >= start - LAST) & (water.t <= end)
    north, east = water.x[flown] - origin[0], water.y[flown] - origin[1]
    c, s = math.cos(course.value), math.sin(course.value)
    at_90, at_180 = moment(0.5 * math.pi), moment(math.pi)
    steady = _steady(water, moment(max(SETTLED_TURN, turned - 2.0 * math.pi)).value, end, side)
    approach = _speed(water, before)
    loss = math.nan if not approach.value > 0.0 else 1.0 - steady["speed"].value / approach.value
    loss_std = math.hypot(steady["speed"].std, approach.std) / approach.value if approach.value > 0.0 else math.nan
    was_steady = _was_steady(water, before, steady["speed"].value - approach.value)
    return TurningCircle(
        run=log.name,
        input=log.steering.name,
        rudder=level,
        starboard=side > 0.0,
        turned=turned,
        advance=offset(at_90, True),
        transfer=offset(at_90, False),
        tactical_diameter=offset(at_180, False),
        time_90=Reading(at_90.value - start, at_90.std, "s"),
        time_180=Reading(at_180.value - start, at_180.std, "s"),
        steady_diameter=steady["diameter"],
        approach=approach,
        steady=steady["speed"],
        speed_loss=Reading(loss, loss_std, "1"),
        drift=steady["drift"],
        rate=steady["rate"],
        current=STILL if current is None else current,
        track=(north * c + east * s, side * (east * c - north * s)),
        doubts=(*log.doubts, *_doubts(turned, current, Reading(loss, loss_std, "1"), was_steady)),
    )


def _turn(log: ShipLog) -> tuple[float, float, float]:
    """Return start and end [s] of the longest turn under one helm, and that helm."""
    holds = find_holds(log.steering.t, log.steering.values, log.end)
    best, most = None, 0.0
    for previous, hold in itertools.pairwise(holds):
        if abs(previous.level) > AMIDSHIPS * abs(hold.level) or not _is_straight(log, previous, hold):
            continue
        change = abs(float(np.interp(hold.end, log.t, log.psi)) - float(np.interp(hold.before, log.t, log.psi)))
        if change > most:
            best, most = hold, change
    if best is None or most < 0.5 * math.pi:
        raise NotInformative(
            f"run '{log.name}' contains no turning circle: the heading never changes by 90 degrees at one helm "
            "after a straight approach with the helm amidships"
        )
    return best.before, best.end, best.level


def _ordered(log: ShipLog, orders: Sequence[float]) -> tuple[float, float, float]:
    """Return start and end [s] of the largest turn between two helm orders, and its helm."""
    turns = list(itertools.pairwise([*orders, log.end]))
    start, end = max(turns, key=lambda turn: abs(float(np.ptp(np.interp(turn, log.t, log.psi)))))
    if abs(float(np.ptp(np.interp([start, end], log.t, log.psi)))) < 0.5 * math.pi:
        raise NotInformative(f"run '{log.name}' contains no turning circle: the heading never changes by 90 degrees")
    return start, end, float(np.median(log.steering.between(start + 0.3 * (end - start), end).values))


def _is_straight(log: ShipLog, before: Hold, turn: Hold) -> bool:
    """Return whether the yaw rate in the approach is far below that in the turn."""
    rates = []
    for start, end in ((max(before.start, before.end - turn.duration), before.end), (turn.start, turn.end)):
        change = np.interp([start, end], log.t, log.psi)
        rates.append(abs(float(change[1] - change[0])) / max(end - start, 1e-9))
    return rates[0] < STRAIGHT * rates[1]


def _passing(log: ShipLog, start: float, end: float, course: float, side: float) -> Callable[[float], Reading]:
    """Return a function from change of heading [rad] to the time at which it was reached [s], with its standard error.

    The time is NaN if the change was never reached.
    """
    t, psi = log.heading(start, end)
    turned = side * (psi - course)

    def moment(angle: float) -> Reading:
        beyond = np.flatnonzero(turned >= angle)
        if len(beyond) == 0 or beyond[0] == 0:
            return Reading(math.nan, math.nan, "s")
        i = int(beyond[0])
        near = slice(max(i - 5, 0), i + 5)
        fit = local_fit(t[near], turned[near], float(t[i]), 1, log.floor)
        slope = float(fit.coefficients[1])
        if slope <= 0.0:
            return Reading(float(t[i]), math.nan, "s")
        when = float(t[i]) + (angle - float(fit.coefficients[0])) / slope
        return Reading(when, math.sqrt(float(fit.covariance[0, 0])) / slope, "s")

    return moment


def _width(track: Track) -> float:
    return 9.0 * float(np.median(np.diff(track.t)))


def _velocity(track: Track, t: float) -> tuple[float, float]:
    """Return the local velocity north and east [m/s]."""
    i = int(np.clip(np.searchsorted(track.t, t), 4, len(track.t) - 5))
    near = slice(i - 4, i + 5)
    slopes = [float(local_fit(track.t[near], v[near], t, 1).coefficients[1]) for v in (track.x, track.y)]
    return slopes[0], slopes[1]


def _speed(track: Track, keep: NDArray[np.bool_]) -> Reading:
    """Return the speed on a straight stretch."""
    fits = [local_fit(track.t[keep], v[keep], float(track.t[keep].mean()), 1) for v in (track.x, track.y)]
    slopes = [f.slope("m/s") for f in fits]
    value = math.hypot(slopes[0].value, slopes[1].value)
    return Reading(value, math.hypot(*(s.std * s.value for s in slopes)) / value if value > 0.0 else math.nan, "m/s")


def _steady(track: Track, start: float, end: float, side: float) -> dict[str, Reading]:
    """Return diameter, speed, drift angle and rate of the steady turn, by least squares over its last full turn.

    The track is a circle at constant rate: x = a + b cos + c sin of the heading, and likewise y. Radius, and the angle
    between bow and track, follow from the coefficients.
    """
    none = {"diameter": "m", "speed": "m/s", "drift": "rad", "rate": "rad/s"}
    keep = (track.t >= start) & (track.t <= end) if math.isfinite(start) else np.zeros(len(track.t), dtype=bool)
    psi = track.psi[keep]
    if int(keep.sum()) < 20 or float(np.ptp(psi)) < 0.5 * math.pi:
        return {name: Reading(math.nan, math.nan, unit) for name, unit in none.items()}
    # a craft at drift angle beta on a circle of radius R turning to `side` is at centre + R (sin, -cos)(chi) * side,
    # chi = psi - side*beta the direction of its track: linear in P = R cos(beta), Q = R sin(beta)
    n = int(keep.sum())
    one, nil, c, s = np.ones(n), np.zeros(n), np.cos(psi), np.sin(psi)
    table = np.vstack([np.column_stack([one, nil, side * s, -c]), np.column_stack([nil, one, -side * c, -s])])
    target = np.concatenate([track.x[keep], track.y[keep]])
    inverse = np.linalg.pinv(table.T @ table)
    found = inverse @ (table.T @ target)
    left = target - table @ found
    # errors of neighbouring positions are alike: count as many as there are signs of the residuals' runs
    colour = max(1.0, len(left) / max(float(np.sum(np.diff(np.sign(left)) != 0.0)) * 2.0, 1.0))
    variance = float(left @ left) / max(len(left) - 4, 1) * colour
    P, Q = float(found[2]), float(found[3])
    radius, std = math.hypot(P, Q), math.sqrt(variance * float(inverse[2, 2]))
    line = local_fit(track.t[keep], psi, float(track.t[keep].mean()), 1)
    rate = line.slope("rad/s")
    speed = radius * abs(rate.value)
    speed_std = math.hypot(std * rate.value, radius * rate.std)
    return {
        "diameter": Reading(2.0 * radius, 2.0 * std, "m"),
        "speed": Reading(speed, speed_std, "m/s"),
        "drift": Reading(math.atan2(Q, P), std / max(radius, 1e-9), "rad"),
        "rate": rate,
    }


GAINED, GAINED_STDS = 0.02, 2.0
"""Limits of an increase of speed in a turn: relative, and in standard errors.

Project choice. An increase above both indicates an approach that was not yet steady, or two thrusters that push
more in total while they steer.
"""
GAINING = 0.1
"""Change of speed from one half of the approach to the other below which the approach was steady, relative to the
increase in the turn. Project choice.
"""


def _was_steady(water: Track, before: NDArray[np.bool_], gain: float) -> bool:
    """Return whether the speed in the approach changed too little to explain an increase by *gain* [m/s] in the turn.

    False if the noise of the positions hides it.
    """
    halves = np.array_split(np.flatnonzero(before), 2)
    if min(len(half) for half in halves) < 5:
        return False
    first, second = (_speed(water, np.isin(np.arange(len(before)), half)) for half in halves)
    noise = 2.0 * math.hypot(first.std, second.std)
    return noise < 0.25 * gain and abs(second.value - first.value) < max(noise, GAINING * gain)


def _doubts(turned: float, current: Current | None, loss: Reading, steady: bool) -> list[Doubt]:
    doubts = []
    gained = loss.value < -GAINED and loss.value < -GAINED_STDS * loss.std
    if gained and steady:
        doubts.append(
            Doubt(
                "thrust-while-steering",
                f"the craft is {-loss.value:.0%} faster in the steady turn than in its approach, and the approach was "
                "steady: the thrust is larger while steering",
                "no action. The figures are valid for this thrust",
            )
        )
    elif gained:
        doubts.append(
            Doubt(
                "approach-not-steady",
                f"the craft is {-loss.value:.0%} faster in the steady turn than in its approach: the approach was "
                "not steady, or the thrust is larger while steering",
                "approach on a straight course until the speed no longer changes. If it was steady, trust the figures",
            )
        )
    if current is None:
        doubts.append(
            Doubt(
                "current-unknown",
                f"the turn of {math.degrees(turned):.0f} deg is too short to estimate a current. No current is assumed",
                "turn for 720 degrees or more",
            )
        )
    if turned < 1.5 * math.pi + math.pi:
        doubts.append(
            Doubt(
                "turn-short",
                f"the heading changed by only {math.degrees(turned):.0f} deg, so the steady turn is uncertain",
                "hold the helm for at least 540 degrees",
            )
        )
    return doubts
