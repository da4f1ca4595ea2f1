"""Instruments whose own measurements the vehicle reports: IMU, compass, GPS, DVL and pressure gauge.

Each samples the true motion at its own rate and place, with its own lag, noise and failures. The autopilot's estimate
comes from them (:mod:`sitl.estimator`). A vehicle file has a heading for each instrument on board. An instrument
without a heading is not there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from typing import ClassVar

from sitl.plants import Plant, quaternion_of, rotate

__all__ = ["INSTRUMENTS", "Compass", "Dvl", "Gps", "Imu", "Instrument", "Motion", "PressureGauge", "Sample", "Suite"]

Vector = tuple[float, float, float]

FIELD = (240.0, 0.0, 405.0)
"""Magnetic field of the earth, north, east and down [mGauss], as in Genoa, but without declination. Project choice."""
_CLEAR = 0.1
"""Depth of the antenna [m] below which GPS has no fix. Project choice."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Motion:
    """True motion of a body at the end of one tick.

    ``t`` [s]. ``attitude``: unit quaternion (w, x, y, z), body to NED. ``position`` [m] and ``velocity`` [m/s] over
    ground are NED, of the origin. ``rates`` [rad/s], ``turning`` [rad/s^2] and ``force``, the specific force [m/s^2],
    are in body axes; the last two are means over the tick. ``current`` [A] is drawn from the battery.
    """

    t: float
    attitude: tuple[float, float, float, float]
    position: Vector
    velocity: Vector
    rates: Vector
    turning: Vector
    force: Vector
    current: float

    def velocity_at(self, arm: Vector) -> Vector:
        """Return the velocity over ground [m/s], body axes, at *arm* [m] from the origin."""
        w, x, y, z = self.attitude
        return _sum(rotate((w, -x, -y, -z), self.velocity), _cross(self.rates, arm))

    def force_at(self, arm: Vector) -> Vector:
        """Return the specific force [m/s^2] at *arm* [m] from the origin."""
        inward = _cross(self.rates, _cross(self.rates, arm))
        return _sum(self.force, _sum(_cross(self.turning, arm), inward))

    def position_at(self, arm: Vector) -> Vector:
        """Return the position [m], NED, at *arm* [m] from the origin."""
        return _sum(self.position, rotate(self.attitude, arm))


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement: taken at ``taken`` [s], reported at ``t`` [s]. If not ``valid``, the values mean nothing."""

    taken: float
    t: float
    values: tuple[float, ...]
    valid: bool


class _Spells:
    """Random periods of failure: every *every* [s] on average, each of *length* [s]. Never, if one of them is 0."""

    def __init__(self, every: float, length: float, random: Random) -> None:
        self._every, self._length, self._random = every, length, random
        self._begin, self._met = self._draw(0.0), -1.0
        self.count = 0

    def at(self, t: float) -> bool:
        """Return whether *t* [s] is in such a period; *t* never decreases. ``count``: how many have begun."""
        while t >= self._begin + self._length:
            self._begin = self._draw(self._begin + self._length)
        if t < self._begin:
            return False
        self.count += self._met != self._begin
        self._met = self._begin
        return True

    def _draw(self, after: float) -> float:
        is_off = self._every <= 0.0 or self._length <= 0.0
        return math.inf if is_off else after + self._random.expovariate(1.0 / self._every)


class Instrument(ABC):
    """One instrument. ``sample`` is the last measurement reported, None before the first, ``count`` how many there
    were.

    Parameters
    ----------
    numbers : entries of its heading in the vehicle file. ``rate`` [Hz] is required. ``lag`` [s] passes between a
        measurement and its report. ``x y z`` [m] is its place. ``noise`` is the standard deviation of its main
        quantity. ``lost_every`` and ``lost_for`` [s]: mean time between failures, and how long one lasts.
    seed : seed of its random numbers, which are its own.

    Raises
    ------
    ValueError
        The rate is missing.
    """

    heading: ClassVar[str]

    def __init__(self, numbers: Mapping[str, float], seed: int) -> None:
        if "rate" not in numbers:
            raise ValueError(f"{self.heading}: the rate is missing. Add rate, in Hz")
        self.numbers = {"lag": 0.0, "noise": 0.0, **numbers}
        self.period, self._lag = 1.0 / self.numbers["rate"], self.numbers["lag"]
        self.arm = (numbers.get("x", 0.0), numbers.get("y", 0.0), numbers.get("z", 0.0))
        self._random = Random(f"{seed}/{self.heading}")
        self._lost = self._spells("lost", seed)
        self._taken = 0
        self._waiting: deque[Sample] = deque()
        self.sample: Sample | None = None
        self.count = 0

    def step(self, motion: Motion, dt: float) -> None:
        """Take a measurement of *motion* if one is due, *dt* [s] after the last tick, and report what is due."""
        self._collect(motion, dt)
        if motion.t >= (self._taken + 1) * self.period - _ROUNDING:
            self._taken = math.floor(motion.t / self.period + _ROUNDING)
            values, lost = self._measure(motion), self._lost.at(motion.t)
            reported = motion.t + self._lag
            self._waiting.append(Sample(motion.t, reported, values, not lost and self._is_working(motion)))
        while self._waiting and self._waiting[0].t <= motion.t + _ROUNDING:
            self.sample = self._waiting.popleft()
            self.count += 1

    def _spells(self, kind: str, seed: int) -> _Spells:
        every, length = (self.numbers.get(f"{kind}_{name}", 0.0) for name in ("every", "for"))
        return _Spells(every, length, Random(f"{seed}/{self.heading}/{kind}"))

    def _noisy(self, values: Vector, std: float) -> Vector:
        draw = self._random.gauss
        return _sum(values, (draw(0.0, std), draw(0.0, std), draw(0.0, std)))

    def _biased(self, name: str) -> Vector:
        x, y, z = (self.numbers.get(f"{name}_bias_{axis}", 0.0) for axis in "xyz")
        return x, y, z

    def _collect(self, motion: Motion, dt: float) -> None:  # noqa: B027  # most measure nothing between their samples
        """Take part of a measurement at every tick."""

    def _is_working(self, motion: Motion) -> bool:
        """Return whether the instrument can measure here."""
        return True

    @abstractmethod
    def _measure(self, motion: Motion) -> tuple[float, ...]:
        """Return one measurement."""


class Imu(Instrument):
    """Accelerometer and gyro. Measures the specific force [m/s^2] and the rates [rad/s] (6,), as means over its period.

    ``noise`` [m/s^2] and ``gyro_noise`` [rad/s] are standard deviations of such a mean. ``bias_x`` to ``bias_z``
    [m/s^2] and ``gyro_bias_x`` to ``gyro_bias_z`` [rad/s] are constant.
    """

    heading = "imu"

    def __init__(self, numbers: Mapping[str, float], seed: int) -> None:
        super().__init__(numbers, seed)
        x, y, z = (numbers.get(f"bias_{axis}", 0.0) for axis in "xyz")
        self._bias, self._gyro_bias = (x, y, z), self._biased("gyro")
        self._sums, self._time = [0.0] * 6, 0.0

    def _collect(self, motion: Motion, dt: float) -> None:
        felt = (*motion.force_at(self.arm), *motion.rates)
        self._sums = [total + dt * value for total, value in zip(self._sums, felt, strict=True)]
        self._time += dt

    def _measure(self, motion: Motion) -> tuple[float, ...]:
        a, b, c, p, q, r = (total / self._time for total in self._sums)
        self._sums, self._time = [0.0] * 6, 0.0
        force = self._noisy(_sum((a, b, c), self._bias), self.numbers["noise"])
        return (*force, *self._noisy(_sum((p, q, r), self._gyro_bias), self.numbers.get("gyro_noise", 0.0)))


class Compass(Instrument):
    """Compass. Measures the magnetic field in body axes [mGauss] (3,).

    ``iron_x`` and ``iron_y`` are the field of iron on board, ``current_x`` and ``current_y`` [1/A] that of the
    thrusters' current, all as parts of the earth's horizontal field. ``noise`` and ``quantum`` [rad] are of the
    heading.
    """

    heading = "compass"

    def _measure(self, motion: Motion) -> tuple[float, ...]:
        numbers, (w, x, y, z) = self.numbers, motion.attitude
        psi = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        ahead, aside = (numbers.get(f"iron_{k}", 0.0) + motion.current * numbers.get(f"current_{k}", 0.0) for k in "xy")
        shown = math.atan2(math.sin(psi) - aside, math.cos(psi) + ahead) + self._random.gauss(0.0, numbers["noise"])
        quantum = numbers.get("quantum", 0.0)
        if quantum > 0.0:
            shown = round(shown / quantum) * quantum
        turned = shown - psi  # the field is that of a craft with the shown heading and the true tilt
        half = 0.5 * turned
        c, s = math.cos(half), math.sin(half)
        false = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
        return rotate((false[0], -false[1], -false[2], -false[3]), FIELD)


class Gps(Instrument):
    """GPS. Measures position [m] and velocity [m/s] over ground, NED (6,).

    ``noise`` [m] and ``speed_noise`` [m/s]. While lost, and under water, it has no fix. ``jump_every`` and
    ``jump_for`` [s] are when a reflected signal displaces the position, by ``jump`` [m] (rms) in each direction.
    """

    heading = "gps"

    def __init__(self, numbers: Mapping[str, float], seed: int) -> None:
        super().__init__(numbers, seed)
        self._jumps, self._jumped, self._apart = self._spells("jump", seed), 0, (0.0, 0.0)
        self._direction = Random(f"{seed}/{self.heading}/size")

    def _is_working(self, motion: Motion) -> bool:
        return motion.position_at(self.arm)[2] <= _CLEAR

    def _measure(self, motion: Motion) -> tuple[float, ...]:
        north, east, down = self._noisy(motion.position_at(self.arm), self.numbers["noise"])
        if self._jumps.at(motion.t):
            if self._jumped != self._jumps.count:
                self._jumped, size, draw = self._jumps.count, self.numbers.get("jump", 0.0), self._direction.gauss
                self._apart = (draw(0.0, size), draw(0.0, size))
            north, east = north + self._apart[0], east + self._apart[1]
        velocity = rotate(motion.attitude, motion.velocity_at(self.arm))
        return (north, east, down, *self._noisy(velocity, self.numbers.get("speed_noise", 0.0)))


class Dvl(Instrument):
    """Doppler log. Measures the velocity over ground [m/s] (3,) in body axes; ``noise`` [m/s]."""

    heading = "dvl"

    def _measure(self, motion: Motion) -> tuple[float, ...]:
        return self._noisy(motion.velocity_at(self.arm), self.numbers["noise"])


class PressureGauge(Instrument):
    """Pressure gauge. Measures its depth [m] (1,), with ``noise`` and the constant ``bias`` [m]."""

    heading = "pressure"

    def _measure(self, motion: Motion) -> tuple[float, ...]:
        depth = motion.position_at(self.arm)[2] + self.numbers.get("bias", 0.0)
        return (depth + self._random.gauss(0.0, self.numbers["noise"]),)


INSTRUMENTS: Mapping[str, type[Instrument]] = {kind.heading: kind for kind in (Imu, Compass, Gps, Dvl, PressureGauge)}
"""Heading of a vehicle file -> its instrument."""


class Suite:
    """All instruments of one vehicle, by heading. ``sent``: message id -> number of the last measurement in it."""

    def __init__(self, instruments: Mapping[str, Instrument]) -> None:
        self.instruments, self.sent = instruments, dict[int, int]()
        self._rates: Vector = (0.0, 0.0, 0.0)

    def step(self, t: float, dt: float, plant: Plant, current: float) -> None:
        """Measure the motion of *plant* at *t* [s], *dt* [s] after the last tick. *current* [A] is drawn."""
        if not self.instruments:
            return
        motion = _motion_of(t, dt, plant, current, self._rates)
        self._rates = motion.rates
        for instrument in self.instruments.values():
            instrument.step(motion, dt)


def _motion_of(t: float, dt: float, plant: Plant, current: float, before: Vector) -> Motion:
    """Return the motion of *plant*; a hull that does not tilt is level, and has no rates but that of its heading."""
    at, water = plant.state, plant.water
    attitude = quaternion_of(at.phi, at.theta, at.psi) if at.tilts else quaternion_of(0.0, 0.0, at.psi)
    north, east, down = rotate(attitude, (at.u, at.v, at.w))
    rates = (at.p, at.q, at.r) if at.tilts else (0.0, 0.0, at.r)
    gained = tuple((new - old) / dt for new, old in zip(rates, before, strict=True))
    return Motion(
        t,
        attitude,
        (at.x, at.y, at.z),
        (north + water.V_x, east + water.V_y, down),
        rates,
        (gained[0], gained[1], gained[2]),
        plant.specific_force(),
        current,
    )
