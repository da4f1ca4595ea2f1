"""A straight leg flown with limited speed, acceleration, jerk and snap, and the corner that blends two legs.

Source: ArduPilot's S-curve navigation (``libraries/AP_Math/SCurve``). The jerk rises and falls as a raised cosine, so
that its slope, the snap, stays finite. Places on the plane are complex numbers, north + i east [m].
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

__all__ = ["Limits", "Motion", "SCurve", "advance_along"]

_RISING, _LEVEL, _FALLING = -1, 0, 1
_BISECTIONS = 60
_SLOWEST_CHANGE = 12.0
"""A change of speed on the way must fit twelve times its jerk pulse into the rest of the leg (ArduPilot's rule)."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Greatest speed [m/s], acceleration [m/s^2], jerk [m/s^3] and snap [m/s^4] along a leg."""

    speed: float
    acceleration: float
    jerk: float
    snap: float


@dataclass(slots=True)
class Motion:
    """Where a target is and how it moves: complex numbers, north + i east; SI."""

    place: complex = 0j
    velocity: complex = 0j
    acceleration: complex = 0j

    def add(self, along: complex, distance: float, speed: float, acceleration: float) -> None:
        """Add a motion in the direction *along* (of length 1)."""
        self.place += distance * along
        self.velocity += speed * along
        self.acceleration += acceleration * along


@dataclass(frozen=True, slots=True)
class _Phase:
    """A piece of the leg: jerk ``J (1 + s cos(pi t/T)) / (1 + |s|)`` for *duration* T, with s = *shape*."""

    duration: float
    jerk: float
    shape: int

    def from_(self, start: _Knot, t: float) -> tuple[float, float, float]:
        """Return (acceleration, speed, distance) *t* [s] after *start*: the jerk integrated three times."""
        a, v, p = start.acceleration, start.speed, start.distance
        flat = self.jerk / (1.0 + abs(self.shape))
        wave_a = wave_v = wave_p = 0.0
        if self.shape and self.duration > 0.0:
            w = math.pi / self.duration
            wave = flat * self.shape
            wave_a = wave * math.sin(w * t) / w
            wave_v = wave * (1.0 - math.cos(w * t)) / w**2
            wave_p = wave * (t - math.sin(w * t) / w) / w**2
        return (
            a + flat * t + wave_a,
            v + t * (a + 0.5 * flat * t) + wave_v,
            p + t * (v + t * (0.5 * a + flat * t / 6.0)) + wave_p,
        )


@dataclass(frozen=True, slots=True)
class _Knot:
    """The state along the leg at the beginning of a phase."""

    t: float
    acceleration: float
    speed: float
    distance: float


@dataclass(frozen=True, slots=True)
class _Change:
    """A change of speed: jerk pulse (*rise*, *hold*, *rise*), constant acceleration for *coast*, the opposite pulse."""

    jerk: float = 0.0
    rise: float = 0.0
    hold: float = 0.0
    coast: float = 0.0

    @property
    def duration(self) -> float:
        """Seconds it takes."""
        return 4.0 * self.rise + 2.0 * self.hold + self.coast

    @property
    def gain(self) -> float:
        """The change of speed [m/s]."""
        return self.jerk * (self.rise + self.hold) * (2.0 * self.rise + self.hold + self.coast)

    def phases(self, sign: float) -> Iterator[_Phase]:
        """Yield its phases, to speed up (*sign* 1) or to slow down (-1)."""
        for way in (sign, -sign):
            yield _Phase(self.rise, way * self.jerk, _RISING)
            yield _Phase(self.hold, way * self.jerk, _LEVEL)
            yield _Phase(self.rise, way * self.jerk, _FALLING)
            if way == sign:
                yield _Phase(self.coast, 0.0, _LEVEL)


def _time_change(limits: Limits, slow: float, fast: float, length: float) -> _Change:
    """Return the change between the speeds *slow* and *fast* [m/s] that fits into *length* [m].

    With jerk J, rise time r and hold h it accelerates to ``A = J (r + h)`` and gains ``A (2 r + h + coast)``; being
    symmetric, it covers ``(slow + gain/2) * duration``. The snap S fixes ``r = pi J / (2 S)``. What does not fit is cut
    in this order: coast, hold, then the pulse itself. From rest the pulse keeps its snap, else its duration.
    """
    if slow >= fast or length <= 0.0:
        return _Change()
    jerk, rise = limits.jerk, limits.jerk * math.pi / (2.0 * limits.snap)
    top = min(limits.acceleration, (fast - slow) / (2.0 * rise), (length - 4.0 * slow * rise) / (4.0 * rise**2))
    if top <= 0.0:
        return _Change()
    if top < jerk * rise:  # a pulse of full height is too much
        if slow == 0.0:
            rise = min(
                rise,
                (length * math.pi / (8.0 * limits.snap)) ** 0.25,
                (fast * math.pi / (4.0 * limits.snap)) ** (1.0 / 3.0),
                math.sqrt(limits.acceleration * math.pi / (2.0 * limits.snap)),
            )
            jerk = 2.0 * limits.snap * rise / math.pi
        else:
            jerk = top / rise
        return _Change(jerk, rise, 0.0, _coast(jerk, rise, 0.0, slow, fast, length))
    hold = limits.acceleration / jerk - rise
    if not _fits(jerk, rise, hold, slow, fast, length):
        low, high = 0.0, hold
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _fits(jerk, rise, middle, slow, fast, length) else (low, middle)
        return _Change(jerk, rise, low, 0.0)
    return _Change(jerk, rise, hold, _coast(jerk, rise, hold, slow, fast, length))


def _fits(jerk: float, rise: float, hold: float, slow: float, fast: float, length: float) -> bool:
    change = _Change(jerk, rise, hold)
    return change.gain <= fast - slow and (slow + 0.5 * change.gain) * change.duration <= length


def _coast(jerk: float, rise: float, hold: float, slow: float, fast: float, length: float) -> float:
    """Return the time at constant acceleration that reaches *fast*, or as much of it as *length* allows.

    ``(slow + A (c + x)/2) (2 c + x) = length`` with c half the duration of both pulses, solved for x.
    """
    a, c = jerk * (rise + hold), 2.0 * rise + hold
    by_speed = (fast - slow) / a - c
    half = (slow + 1.5 * a * c) / a
    by_length = math.sqrt(max(half**2 - 2.0 * (c * (2.0 * slow + a * c) - length) / a, 0.0)) - half
    return max(min(by_speed, by_length), 0.0)


class SCurve:
    """The motion along one straight leg from rest to rest, as a function of a time that the caller advances."""

    def __init__(self, origin: complex = 0j, destination: complex = 0j, limits: Limits | None = None) -> None:
        self._track = destination - origin
        self._length = abs(self._track)
        self._limits = limits
        self._knots: list[_Knot] = [_Knot(0.0, 0.0, 0.0, 0.0)]
        self._phases: list[_Phase] = []
        self._turn_end = self._brake_start = 0.0
        self.t = 0.0
        self.distance = 0.0
        if limits is None or self._length == 0.0:
            self._length, self.along, self._track = 0.0, 0j, 0j
            return
        self.along = self._track / self._length
        self._build(limits.speed)

    # -- times

    @property
    def track(self) -> complex:
        """The vector from origin to destination [m]."""
        return self._track

    @property
    def top_speed(self) -> float:
        """The speed limit of the leg [m/s]; 0 without a leg."""
        return self._limits.speed if self._phases and self._limits is not None else 0.0

    @property
    def end(self) -> float:
        """The time at the destination [s]."""
        return self._knots[-1].t

    @property
    def remaining(self) -> float:
        """Seconds to the destination."""
        return self.end - self.t

    @property
    def acceleration_end(self) -> float:
        """The time at which the speed is reached [s]."""
        return self._turn_end

    @property
    def braking_start(self) -> float:
        """The time at which braking starts [s]."""
        return self._brake_start

    @property
    def finished(self) -> bool:
        """Whether the target has come to the destination."""
        return self.t >= self.end or self.distance >= self._length

    # -- motion

    def at(self, t: float) -> tuple[float, float, float]:
        """Return (acceleration, speed, distance) along the leg at *t* [s], which is cut to the leg's duration."""
        t = max(t, 0.0)
        if t >= self.end:
            last = self._knots[-1]
            return last.acceleration, last.speed, last.distance
        for knot, phase in zip(self._knots, self._phases, strict=False):
            if t < knot.t + phase.duration:
                break
        return phase.from_(knot, t - knot.t)

    def move(self, dt: float, motion: Motion, *, from_end: bool = False) -> None:
        """Advance by *dt* [s] and add the motion, relative to the origin or (*from_end*) to the destination."""
        self.t = min(self.t + dt, self.end)
        acceleration, speed, self.distance = self.at(self.t)
        motion.add(self.along, self.distance - (self._length if from_end else 0.0), speed, acceleration)

    # -- construction

    def set_speed(self, speed: float) -> None:
        """Change the speed limit [m/s] on the way; nothing changes once the target brakes for its destination."""
        limits = self._limits
        if limits is None or not self._phases or speed <= 0.0 or speed == limits.speed or self.t >= self._brake_start:
            return
        self._limits = limits = Limits(speed, limits.acceleration, limits.jerk, limits.snap)
        if self.t == 0.0:
            self._build(speed)
            return
        begun = self.t < self._turn_end
        self._cut(self._turn_end if begun else self.t)
        at = self._knots[-1]
        room = self._length - at.distance
        braking = _time_change(limits, 0.0, at.speed, room)
        remaining = room - 0.5 * at.speed * braking.duration
        pulse = min(1.0, limits.jerk * math.pi / (2.0 * limits.snap))
        reach = remaining / (_SLOWEST_CHANGE * pulse)
        if reach > at.speed:
            low, high = sorted((at.speed, min(speed, max(reach, at.speed))))
            change = _time_change(limits, low, high, 0.5 * remaining)
            self._extend(change.phases(math.copysign(1.0, speed - at.speed)))
        self._finish()

    def _build(self, speed: float) -> None:
        assert self._limits is not None
        self._knots, self._phases = [_Knot(0.0, 0.0, 0.0, 0.0)], []
        change = _time_change(self._limits, 0.0, speed, 0.5 * self._length)
        self._extend(change.phases(1.0))
        self._finish(change)

    def _finish(self, braking: _Change | None = None) -> None:
        """Cruise, then brake so that the leg ends at its destination."""
        assert self._limits is not None
        self._turn_end = self._knots[-1].t
        at = self._knots[-1]
        room = self._length - at.distance
        braking = braking or _time_change(self._limits, 0.0, at.speed, room)
        cruise = max(room - 0.5 * at.speed * braking.duration, 0.0) / max(at.speed, 1e-9)
        self._extend([_Phase(cruise, 0.0, _LEVEL)])
        self._brake_start = self._knots[-1].t
        self._extend(braking.phases(-1.0))
        end = self._knots[-1]
        self._knots[-1] = _Knot(end.t, 0.0, 0.0, self._length)  # without rounding errors

    def _cut(self, t: float) -> None:
        """Forget what comes after *t* [s]."""
        while len(self._knots) > 1 and self._knots[-2].t >= t:
            self._knots.pop()
            self._phases.pop()
        if self._knots[-1].t > t:
            phase, start = self._phases[-1], self._knots[-2]
            acceleration, speed, distance = phase.from_(start, t - start.t)
            self._phases[-1] = _Phase(t - start.t, phase.jerk, phase.shape)
            self._knots[-1] = _Knot(t, acceleration, speed, distance)

    def _extend(self, phases: Sequence[_Phase] | Iterator[_Phase]) -> None:
        for phase in phases:
            if phase.duration <= 0.0:
                continue
            start = self._knots[-1]
            self._phases.append(phase)
            self._knots.append(_Knot(start.t + phase.duration, *phase.from_(start, phase.duration)))


def advance_along(
    legs: tuple[SCurve, SCurve, SCurve], origin: complex, dt: float, corner: tuple[float, float], *, blend: bool
) -> tuple[Motion, bool]:
    """Return the target *dt* [s] later on the middle one of *legs* (last, this, next), and whether this leg is done.

    The target of the last leg, which may still brake, and of the next one, which may already start, add up: that rounds
    the corner. With *blend* the next leg starts when this one brakes, would end before the next one is at speed, and
    half way through the turn the target is within *corner* (distance [m], acceleration [m/s^2]) and slower than on
    either leg. The leg is then done half way through the turn. *origin* is where this leg begins.
    """
    last, this, next_ = legs
    motion = Motion(place=origin)
    last.move(dt, motion, from_end=True)
    this.move(dt, motion)
    done = this.finished
    if blend and next_.t == 0.0 and this.t >= this.braking_start and this.remaining <= next_.acceleration_end:
        if _turn_is_gentle(this, next_, corner):
            next_.move(dt, motion)
    elif next_.t != 0.0:
        next_.move(dt, motion)
        done = done or next_.t >= this.remaining
    return motion, done


def _turn_is_gentle(this: SCurve, next_: SCurve, corner: tuple[float, float]) -> bool:
    half = 0.5 * this.remaining
    middle = Motion(place=-this.track)
    for leg, t in ((this, this.t + half), (next_, half)):
        acceleration, speed, distance = leg.at(t)
        middle.add(leg.along, distance, speed, acceleration)
    slower = abs(middle.velocity) < min(this.top_speed, next_.top_speed)
    return slower and abs(middle.place) < corner[0] and abs(middle.acceleration) < corner[1]
