"""Measurements of the craft: true values with seeded noise and the compass' quantisation."""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sitl.plants import Plant, State, measured_speed

__all__ = ["Rangefinder", "SensorData", "SensorReading", "Sensors"]


@dataclass(frozen=True, slots=True)
class SensorData:
    """Standard deviations of noise, which is white from one sensor sample to the next (50 a second, constant in
    between).

    ``heading_quantum`` [rad] is the resolution of the compass (0: none). ``speed_noise`` has a value for the speed
    ahead and one for the sideways speed.
    """

    heading_noise: float
    heading_quantum: float
    gyro_noise: float
    tilt_noise: float
    speed_noise: float
    position_noise: float
    depth_noise: float
    climb_noise: float
    acceleration_noise: float


@dataclass(slots=True)
class SensorReading:
    """One sample of every sensor. SI and radians; ``r`` is the unfiltered gyro, ``az`` the acceleration down."""

    psi: float = 0.0
    r: float = 0.0
    phi: float = 0.0
    theta: float = 0.0
    p: float = 0.0
    q: float = 0.0
    u: float = 0.0
    v: float = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 0.0
    az: float = 0.0
    d: float = math.nan
    d_starboard: float = math.nan


class Rangefinder:
    """Measures the distance ahead to a flat wall, perpendicular to *heading* [rad] and *wall* [m] from the origin.

    A new distance comes every *period* [s], with *noise* [m], and is held in between; NaN while the wall is not ahead.
    With *apart* [m] or *aside* [rad] it is two: so far apart on either side of the craft, and each turned outwards by
    so much. Otherwise it is one in the middle.
    """

    def __init__(
        self,
        wall: float,
        heading: float,
        noise: float,
        period: float,
        seed: int,
        apart: float = 0.0,
        aside: float = 0.0,
    ) -> None:
        self.wall, self.heading, self._period, self.apart, self.aside = wall, heading, period, apart, aside
        self._noise = functools.partial(random.Random(f"{seed}/distance").gauss, 0.0, noise)
        self._next = 0.0
        self._sides = (-1.0, 1.0) if apart > 0.0 or aside > 0.0 else (0.0,)
        self._held = [math.nan] * len(self._sides)

    def measure(self, t: float, state: State) -> Sequence[float]:
        """Return the measured distances [m] at *t* [s], that of port first."""
        if t >= self._next:
            self._next = t + self._period
            turned = state.psi - self.heading
            gone = state.x * math.cos(self.heading) + state.y * math.sin(self.heading)
            self._held = [self._beam(side, turned, gone) for side in self._sides]
        return self._held

    @property
    def yaws(self) -> Sequence[float]:
        """Where each of them looks, from the bow to starboard [rad]."""
        return [side * self.aside for side in self._sides]

    def _beam(self, side: float, turned: float, gone: float) -> float:
        towards = math.cos(turned + side * self.aside)
        distance = self.wall - gone + 0.5 * side * self.apart * math.sin(turned)
        return distance / towards + self._noise() if towards > 0.1 else math.nan


class Sensors:
    """Samples the sensors of a plant. Every sensor has its own random numbers, so a change of one sensor's noise does
    not affect the others.
    """

    def __init__(self, data: SensorData, seed: int, *, floats: bool) -> None:
        self._data = data
        self._floats = floats

        def stream(name: str, std: float) -> Callable[[], float]:
            return functools.partial(random.Random(f"{seed}/{name}").gauss, 0.0, std)

        tilt, position = stream("tilt", data.tilt_noise), stream("position", data.position_noise)
        afloat = (
            stream("heading", data.heading_noise),
            stream("gyro", data.gyro_noise),
            tilt,
            tilt,
            stream("speed", data.speed_noise),
            position,
            position,
            stream("sway", data.speed_noise),
        )
        submerged = (
            stream("depth", data.depth_noise),
            stream("climb", data.climb_noise),
            stream("acceleration", data.acceleration_noise),
        )
        self._draws = afloat if floats else afloat + submerged
        self._noise: list[float] = []

    def sample(self, plant: Plant, reading: SensorReading, *, new: bool = True) -> None:
        """Fill *reading* with the present measurement. Unless *new* is set, the noise of the last sample is reused."""
        if new or not self._noise:
            self._noise = [draw() for draw in self._draws]
        noise, quantum = self._noise, self._data.heading_quantum
        state = plant.state
        ahead, aside, down = measured_speed(state, plant.water)
        psi = state.psi + noise[0]
        if quantum > 0.0:
            psi = round(psi / quantum) * quantum
        reading.psi = math.remainder(psi, math.tau)
        reading.r = state.r + noise[1]
        reading.phi = state.phi + noise[2]
        reading.theta = state.theta + noise[3]
        reading.p, reading.q = state.p, state.q
        reading.u = ahead + noise[4]
        reading.v = aside + noise[7]
        reading.x = state.x + noise[5]
        reading.y = state.y + noise[6]
        if not self._floats:
            reading.z = state.z + noise[8]
            reading.w = down + noise[9]
            reading.az = state.wdot + noise[10]
