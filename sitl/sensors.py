"""What the craft measures: the truth, with seeded noise and the compass' quantisation."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from sitl.body import Body

__all__ = ["Reading", "SensorData", "Sensors"]


@dataclass(frozen=True, slots=True)
class SensorData:
    """Standard deviations of white noise per sample; ``heading_quantum`` [rad] is the compass' step (0: none)."""

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
class Reading:
    """One sample of every sensor. SI and radians; ``r`` is the bare gyro, ``az`` acceleration down."""

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


class Sensors:
    """Sample the body. Every sensor has a random stream of its own, so one cannot disturb another."""

    def __init__(self, data: SensorData, seed: int, *, floats: bool) -> None:
        self._data = data
        self._floats = floats

        def stream(name: str) -> random.Random:
            return random.Random(f"{seed}/{name}")

        self._heading = stream("heading").gauss
        self._gyro = stream("gyro").gauss
        self._tilt = stream("tilt").gauss
        self._speed = stream("speed").gauss
        self._position = stream("position").gauss
        self._depth = stream("depth").gauss
        self._climb = stream("climb").gauss
        self._acceleration = stream("acceleration").gauss

    def sample(self, body: Body, reading: Reading) -> None:
        """Fill *reading* with the present measurement."""
        data = self._data
        psi = body.psi + self._heading(0.0, data.heading_noise)
        if data.heading_quantum > 0.0:
            psi = round(psi / data.heading_quantum) * data.heading_quantum
        reading.psi = math.remainder(psi, math.tau)
        reading.r = body.r + self._gyro(0.0, data.gyro_noise)
        reading.phi = body.phi + self._tilt(0.0, data.tilt_noise)
        reading.theta = body.theta + self._tilt(0.0, data.tilt_noise)
        reading.p, reading.q = body.p, body.q
        reading.u = body.speed + self._speed(0.0, data.speed_noise)
        reading.v = body.drift
        reading.x = body.x + self._position(0.0, data.position_noise)
        reading.y = body.y + self._position(0.0, data.position_noise)
        if not self._floats:
            reading.z = body.z + self._depth(0.0, data.depth_noise)
            reading.w = body.w + self._climb(0.0, data.climb_noise)
            reading.az = body.wdot + self._acceleration(0.0, data.acceleration_noise)
