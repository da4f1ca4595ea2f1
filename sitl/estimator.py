"""The autopilot's estimate from its own instruments, as fixed-gain filters.

ArduPilot runs an extended Kalman filter. This is simpler, and has the properties that matter to a tune:

* The gyro gives the rates. The compass corrects the heading slowly (gains of ArduPilot's DCM), so a deflected compass
  turns the heading within seconds, and a noisy one does not disturb it.
* The accelerometer carries velocity and position between two measurements of GPS or DVL. The velocities' errors also
  level the estimate, because a wrong tilt mistakes gravity for an acceleration.
* A measurement is compared with the estimate of the time when it was taken. So a lag costs no accuracy.
* A GPS position too far off is rejected, but not for ever. Without any velocity the estimate is dead reckoning, and
  after some seconds the autopilot has no position any more.

Places and lags of the instruments count as entered correctly in the autopilot's parameters. A quantity that no
instrument measures comes from :mod:`sitl.sensors`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping

from sitl.instruments import Instrument, Sample
from sitl.plants import GRAVITY, State, angles_of, quaternion_of, rotate
from sitl.sensors import SensorReading

__all__ = ["Estimator"]

Vector = tuple[float, float, float]

_HEADING = 0.2
"""Rate at which the compass corrects the heading [1/s], ArduPilot's default of AHRS_YAW_P."""
_DRIFT = 0.01
"""Rate at which the compass corrects the gyro's bias [1/s^2], as ArduPilot's DCM does."""
_VELOCITY = {"gps": 2.0, "dvl": 5.0}
"""Rate at which a measured velocity corrects the estimate [1/s]: a DVL is less noisy. Project choice."""
_PLACE = 0.5
"""Rate at which a measured position corrects the estimate [1/s]. Project choice."""
_LEVEL = 1.0
"""Rate at which the velocity's error levels the estimate [1/s^2]. Project choice."""
_LEVEL_DRIFT = 0.1
"""Rate at which it corrects the gyro's bias [1/s^3]. Project choice."""
_DEPTH = (3.0, 3.0, 0.5)
"""Rates at which a pressure gauge corrects depth [1/s], climb [1/s^2] and the accelerometer's bias [1/s^3]. Project
choice."""
_GATE, _LEAST_NOISE = 5.0, 0.5
"""A GPS position is rejected beyond that many standard deviations, of at least that size [m]: defaults of
EK3_POS_I_GATE and EK3_POSNE_M_NSE."""
_UNAIDED = 10.0
"""After that time [s] without velocity or position ArduPilot's filter gives up the position, and takes a rejected one.
"""
_KEPT = 1.5
"""How long past estimates are kept [s]: longer than the lag of any instrument here. Project choice."""
_ALPHA, _BETA = 0.75, 0.25
"""Gains of the heading filter without a gyro: critically damped, half of a difference is left after a sample. Project
choice."""


class _Past:
    """Estimate at one time *t* [s]: attitude, rates, velocity and place."""

    __slots__ = ("attitude", "p", "rates", "t", "v")

    def __init__(self, t: float, attitude: tuple[float, ...], rates: Vector, v: list[float], p: list[float]) -> None:
        self.t, self.rates = t, rates
        self.attitude = (attitude[0], attitude[1], attitude[2], attitude[3])
        self.v, self.p = (v[0], v[1], v[2]), (p[0], p[1], p[2])

    def apart(self, arm: Vector) -> Vector:
        """Return where the point *arm* [m] of the body is from the origin, NED."""
        return rotate(self.attitude, arm)

    def swept(self, arm: Vector) -> Vector:
        """Return the velocity [m/s] of that point about the origin, NED."""
        (p, q, r), (x, y, z) = self.rates, arm
        return rotate(self.attitude, (q * z - r * y, r * x - p * z, p * y - q * x))


class Estimator:
    """Turns the measurements of *instruments* into the reading that the autopilot uses.

    Parameters
    ----------
    instruments : instruments on board, by heading.
    start : state of the craft at power-up. The estimate begins there.
    model : heading ``[filter]`` of the vehicle file: without gyro and accelerometer, the estimate changes ``rate`` [Hz]
        times a second. The turn rate comes from the compass and a model of yaw with ``time_constant`` [s] and ``gain``
        [rad/s], the turn rate at full steering (Charlie: Miskovic2010, section 3.3). Empty: the craft has a gyro.

    ``aided``: whether the position can be used. ``has_gps``: whether the autopilot uses a GPS on board.
    """

    def __init__(
        self, instruments: Mapping[str, Instrument], start: State, model: Mapping[str, float] | None = None
    ) -> None:
        self._own, self._counts = instruments, dict.fromkeys(instruments, 0)
        model = model or {}
        self._rate, self._next = model.get("rate", 0.0), 0.0
        self._gain, self._time = model.get("gain", 0.0), model.get("time_constant", math.inf)
        self._q = quaternion_of(start.phi, start.theta, start.psi) if start.tilts else quaternion_of(0, 0, start.psi)
        self._v, self._p = [0.0, 0.0, 0.0], [start.x, start.y, start.z]
        self._rates: Vector = (0.0, 0.0, 0.0)
        self._gyro_bias, self._lift, self._down = [0.0, 0.0, 0.0], 0.0, 0.0
        self._past: deque[_Past] = deque([_Past(0.0, self._q, self._rates, self._v, self._p)])
        self._helped = self._placed = -math.inf
        self._t = 0.0
        self._moves, self._tilts = bool({"gps", "dvl"} & set(instruments)), start.tilts
        self.aided = self.has_gps = True

    def update(self, t: float, reading: SensorReading, steering: float = 0.0) -> None:
        """Replace in *reading* what the instruments measure, at *t* [s]; the rest of it stays.

        steering : normalised command of yaw (-1 to 1), for the filter's model.
        """
        if not self._own:
            return
        if self._is_due(t):
            self._predict(t, reading, steering)
            for heading, correct in (("compass", self._compass), ("gps", self._gps), ("dvl", self._dvl)):
                self._correct(heading, correct)
            self._correct("pressure", self._pressure)
            self._past.append(_Past(t, self._q, self._rates, self._v, self._p))
            while self._past[0].t < t - _KEPT:
                self._past.popleft()
        self.aided = not self._moves or t - self._helped <= _UNAIDED
        self._fill(reading)

    def _is_due(self, t: float) -> bool:
        """Return whether the estimate advances now: with the IMU, at the filter's rate, or at every tick."""
        if self._rate > 0.0:
            if t < self._next - 1e-9:
                return False
            self._next += 1.0 / self._rate
            return True
        return "imu" not in self._own or self._own["imu"].count != self._counts["imu"]

    def _predict(self, t: float, reading: SensorReading, steering: float) -> None:
        dt, self._t = t - self._t, t
        force: Vector | None = None
        if self._rate > 0.0:
            r = self._rates[2]
            self._rates = (0.0, 0.0, r + dt * (self._gain * steering - r) / self._time)
        elif "imu" in self._own:
            self._counts["imu"] = self._own["imu"].count
            sample = self._own["imu"].sample
            if sample is not None and sample.valid:
                a, b, c, *gyro = sample.values
                force = self._at_origin((a, b, c), gyro)
                p, q, r = (value - bias for value, bias in zip(gyro, self._gyro_bias, strict=True))
                self._rates = (p, q, r)
        else:
            self._rates = (reading.p, reading.q, reading.r)
        half = tuple(0.5 * dt * rate for rate in self._rates)
        self._q = _product(self._q, (1.0, *half))
        if force is not None:
            north, east, down = rotate(self._q, force)
            self._down = down + GRAVITY - self._lift
            for k, gained in enumerate((north, east, self._down)):
                self._p[k] += dt * (self._v[k] + 0.5 * dt * gained)
                self._v[k] += dt * gained
        else:
            for k in range(3):
                self._p[k] += dt * self._v[k]
        if self._moves and t - self._helped > _UNAIDED:
            self._level(-self._v[0], -self._v[1], _VELOCITY["gps"], dt)

    def _at_origin(self, force: Vector, gyro: list[float]) -> Vector:
        """Return the specific force [m/s^2] at the origin: the IMU's without the centripetal part of its place."""
        (x, y, z), (p, q, r) = self._own["imu"].arm, gyro
        along = p * x + q * y + r * z
        square = p * p + q * q + r * r
        return force[0] - p * along + square * x, force[1] - q * along + square * y, force[2] - r * along + square * z

    def _correct(self, heading: str, use: Callable[[Instrument, Sample, _Past], None]) -> None:
        """Let *use* see a new valid measurement of the instrument, with the estimate of the time it was taken."""
        instrument = None if heading == "gps" and not self.has_gps else self._own.get(heading)
        if instrument is None or instrument.sample is None or instrument.count == self._counts[heading]:
            return
        self._counts[heading] = instrument.count
        if instrument.sample.valid:
            then = next(
                (past for past in reversed(self._past) if past.t <= instrument.sample.taken + 1e-9), self._past[0]
            )
            use(instrument, instrument.sample, then)

    def _compass(self, own: Instrument, sample: Sample, then: _Past) -> None:
        phi, theta, psi = angles_of(then.attitude)
        ahead, aside, _ = rotate(quaternion_of(phi, theta, 0.0), (sample.values[0], sample.values[1], sample.values[2]))
        off = math.remainder(math.atan2(-aside, ahead) - psi, math.tau)
        gain = 1.0 if own.count == 1 else _ALPHA if self._rate > 0.0 else _HEADING * own.period
        self._q = _product((1.0, 0.0, 0.0, 0.5 * gain * off), self._q)
        if own.count > 1 and self._rate > 0.0:
            self._rates = (0.0, 0.0, self._rates[2] + _BETA * off / own.period)
        elif own.count > 1:
            self._gyro_bias[2] -= _DRIFT * own.period * off

    def _gps(self, own: Instrument, sample: Sample, then: _Past) -> None:
        apart, swept = then.apart(own.arm), then.swept(own.arm)
        off = [sample.values[k] - apart[k] - then.p[k] for k in range(2)]
        gate = _GATE * max(own.numbers["noise"], _LEAST_NOISE)
        if math.hypot(*off) <= gate:
            share = min(1.0, _PLACE * own.period)
            self._p[0], self._p[1] = self._p[0] + share * off[0], self._p[1] + share * off[1]
            self._placed = self._t
        elif self._t - self._placed > _UNAIDED:
            self._p[0], self._p[1] = self._p[0] + off[0], self._p[1] + off[1]
            self._placed = self._t
        self._velocity(own, tuple(sample.values[3 + k] - swept[k] - then.v[k] for k in range(2)))

    def _dvl(self, own: Instrument, sample: Sample, then: _Past) -> None:
        values, swept = (sample.values[0], sample.values[1], sample.values[2]), then.swept(own.arm)
        over_ground = rotate(then.attitude, values)
        self._velocity(own, tuple(over_ground[k] - swept[k] - then.v[k] for k in range(2)))

    def _velocity(self, own: Instrument, off: tuple[float, ...]) -> None:
        self._helped = self._t
        self._level(off[0], off[1], _VELOCITY[own.heading], own.period)

    def _level(self, north: float, east: float, gain: float, dt: float) -> None:
        """Correct velocity and tilt by the error of the velocity [m/s] over *dt* [s]; *gain* [1/s] of the velocity."""
        share = min(1.0, gain * dt)
        self._v[0] += share * north
        self._v[1] += share * east
        if self._rate > 0.0 or "imu" not in self._own:
            return
        about = (dt * east / GRAVITY, -dt * north / GRAVITY)
        self._q = _product((1.0, 0.5 * _LEVEL * about[0], 0.5 * _LEVEL * about[1], 0.0), self._q)
        w, x, y, z = self._q
        for k, value in enumerate(rotate((w, -x, -y, -z), (about[0], about[1], 0.0))):
            self._gyro_bias[k] -= _LEVEL_DRIFT * value

    def _pressure(self, own: Instrument, sample: Sample, then: _Past) -> None:
        off = sample.values[0] - then.apart(own.arm)[2] - then.p[2]
        depth, climb, bias = (gain * own.period for gain in _DEPTH)
        self._p[2] += min(1.0, depth) * off
        self._v[2] += climb * off
        self._lift -= bias * off

    def _fill(self, reading: SensorReading) -> None:
        instruments = self._own
        phi, theta, psi = angles_of(self._q)
        if "compass" in instruments:
            reading.psi = psi
        if self._rate > 0.0:
            reading.r = self._rates[2]
        elif "imu" in instruments:
            reading.r = self._rates[2]
            if self._tilts:
                reading.phi, reading.theta = phi, theta
                reading.p, reading.q = self._rates[:2]
        if self._moves:
            c, s = math.cos(reading.psi), math.sin(reading.psi)
            reading.u, reading.v = c * self._v[0] + s * self._v[1], c * self._v[1] - s * self._v[0]
            reading.x, reading.y = self._p[0], self._p[1]
        if "pressure" in instruments:
            reading.z, reading.w = self._p[2], self._v[2]
            if "imu" in instruments:
                reading.az = self._down


def _product(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Return the unit quaternion along *a* times *b*."""
    (w, x, y, z), (e, f, g, h) = a, b
    out = (
        w * e - x * f - y * g - z * h,
        w * f + x * e + y * h - z * g,
        w * g - x * h + y * e + z * f,
        w * h + x * g - y * f + z * e,
    )
    size = math.sqrt(sum(value * value for value in out))
    return out[0] / size, out[1] / size, out[2] / size, out[3] / size
