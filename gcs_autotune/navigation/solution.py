"""Fuse the sensors of a log: the filter forwards and backwards, repeated until delays and noise levels settle.

Biases, lever arms, the offset of the compass and the delays are states, not the result of a search by likelihood. One
pass then gives all of them with their common covariance, and u v w are as uncertain as they make them. A delay acts
nonlinearly, so each pass shifts the stamps by the delay that the last one estimated, and its state is the remainder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.navigation import kernel
from gcs_autotune.navigation.sensors import ARMED, DELAYED, SENSORS, Inertial, Readings, Sensor
from gcs_autotune.notebook import Displayed
from gcs_autotune.sensor import INDEPENDENT, noise_of

__all__ = ["ANGLES", "CONSTANTS", "Constant", "Mounting", "Navigation", "SensorNoise", "navigate"]

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ANGLES = ("phi", "theta", "psi")
CONSTANTS: Mapping[str, tuple[int, float, str]] = {
    **{f"gyro bias {axis}": (kernel.GYRO + i, 0.02, "rad/s") for i, axis in enumerate("pqr")},
    **{f"accelerometer bias {axis}": (kernel.ACCELEROMETER + i, 0.2, "m/s^2") for i, axis in enumerate("xyz")},
    **{f"{name} arm {axis}": (at + i, 0.4, "m") for name, at in ARMED.items() for i, axis in enumerate("xyz")},
    "compass offset": (kernel.OFFSET, 0.15, "rad"),
    **{f"{name} delay": (at, 0.2, "s") for name, at in DELAYED.items()},
    **{f"compass turn {axis}": (kernel.MOUNT + i, 0.05, "rad") for i, axis in enumerate("xyz")},
}
"""Constant -> place among the errors, standard deviation before the log is read, unit. Project choices: cheap sensors
on a craft of a few metres."""

KNOWN_ARM = 0.02
"""Standard deviation of a lever arm that the user supplies [m]. Project choice."""
PASSES = 8
"""Maximum number of passes. Noise levels and delays settle in three to six. Project choice."""
SETTLED = (0.002, 0.03)
"""Largest change of a delay [s] and relative change of a noise level for the passes to end. Project choice."""
TURNED = 1.5
"""Range of the heading [rad] from which the turn of the compass in its mount is estimated. With less, tilt errors of
the first seconds would pass for it, most of all in a steep field. Project choice."""
HELD = 10.0
"""Time at the start of a pass [s] during which the trajectory of the last pass is kept for linearisation. The filter's
first estimates are too far from the truth for it. Project choice."""
FLOOR = 0.3
"""Smallest noise level, as a fraction of the first one. Real errors are correlated in time, which less noise would take
for motion. Project choice."""
COMMON, NOTICED = 6, 5.0
"""Errors common to all samples of a log that a run contains. Project choice.

- ``COMMON``: greatest number of them.
- ``NOTICED``: least size of one, in samples: the sum of squares of what it adds to every sample, over the variance of
  the remaining error.
"""
TINY = 1e-6
"""Fraction of a variance below which it is rounding. Project choice."""
LEAST = np.array([5e-4, 0.01])
"""Smallest noise of gyro [rad/s] and accelerometer [m/s^2]. Project choice."""
DRIFTS = (2e-5, 2e-4, 0.0)
"""Drift in 1 s of the biases of gyro [rad/s] and accelerometer [m/s^2], and of the compass offset [rad]. Project
choice."""
FIRST = {"tilt": 0.1, "heading": 0.4, "velocity": 1.0, "position": 5.0, "drift": 1e-3}
"""Standard deviations of the first state [rad, m/s, m]; ``drift`` is that of a position that nothing measures."""
STILL = (1.0, 1.0)
"""Without GPS and DVL, the horizontal velocity is taken to be zero with this standard deviation [m/s], at this rate
[Hz]. Otherwise tilt and accelerometer bias would drift. ArduSub's estimator assumes the same. Project choice."""
RATE = 10.0
"""Default rate of the result [Hz]."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """Where things are, in metres ahead, to starboard and down of the inertial sensor.

    ``centre``: centre of gravity. ``arms``: device -> known lever arm.
    """

    centre: Vector = (0.0, 0.0, 0.0)
    arms: Mapping[str, Vector] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Constant:
    """Estimate of a constant: value, standard error, standard deviation before the log was read, unit."""

    value: float
    std: float
    prior: float
    unit: str

    @property
    def is_determined(self) -> bool:
        """Whether the log at least halves the uncertainty."""
        return self.std < 0.5 * self.prior


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """One measurement: number of samples used and skipped, noise, and mean squared innovation over its variance (1 if
    the filter's covariance is right)."""

    used: int
    skipped: int
    sigma: float
    nis: float


@dataclass(frozen=True, slots=True, eq=False)
class Navigation(Displayed):
    """Navigation solution of one stretch, at the centre of gravity.

    - ``t`` (k,) [s]; ``values``, ``stds``: signal -> (k,), of x y z phi theta psi u v w p q r in SI units.
    - ``covariance`` (k, 12, 12): of the signals in the order of ``values``.
    - ``memories``: signal -> (k,), correlation time of its error [s], 0 if the errors of two samples are independent.
    - ``common``: signal -> (k, c), the part of its error by c causes that last for the whole log, such as biases. Each
      column is for a cause of one standard deviation; the causes are independent of each other.
    - ``constants``, ``noise``: by name. ``passes``; ``converged``.
    - ``imu_noise``: of gyro [rad/s] and accelerometer [m/s^2].
    """

    t: Array
    values: Mapping[str, Array]
    stds: Mapping[str, Array]
    covariance: Array
    memories: Mapping[str, Array]
    common: Mapping[str, Array]
    constants: Mapping[str, Constant]
    noise: Mapping[str, SensorNoise]
    imu_noise: tuple[float, float]
    passes: int
    converged: bool

    def over_ground(self) -> dict[str, Array]:
        """Return the velocities ``vn ve`` [m/s] north and east; empty if the sensors do not determine them."""
        if "u" not in self.values:
            return {}
        (a, b, c), (u, v, w) = ([self.values[n] for n in names] for names in (ANGLES, "uvw"))
        ahead = u * np.cos(b) + (v * np.sin(a) + w * np.cos(a)) * np.sin(b)
        aside = v * np.cos(a) - w * np.sin(a)
        return {"vn": ahead * np.cos(c) - aside * np.sin(c), "ve": ahead * np.sin(c) + aside * np.cos(c)}

    def to_dict(self) -> dict[str, Any]:
        """Return constants, noise and the mean standard deviation of each signal for JSON."""
        return {
            "from": float(self.t[0]),
            "to": float(self.t[-1]),
            "samples": len(self.t),
            "constants": {n: {**asdict(c), "determined": c.is_determined} for n, c in self.constants.items()},
            "sensors": {n: asdict(s) for n, s in self.noise.items()},
            "imu_noise": list(self.imu_noise),
            "mean_std": {n: float(np.mean(s)) for n, s in self.stds.items()},
            "nis": self.nis,
            "passes": self.passes,
            "converged": self.converged,
        }

    @property
    def nis(self) -> float:
        """Mean squared innovation over its variance, over all measurements."""
        sensors = [sensor for name, sensor in self.noise.items() if name != PAUSE and sensor.used]
        return sum(sensor.used * sensor.nis for sensor in sensors) / max(sum(sensor.used for sensor in sensors), 1)


def navigate(readings: Readings, mounting: Mounting | None = None, rate: float = RATE) -> tuple[Navigation, ...]:
    """Return the navigation solution of every stretch of a log.

    rate : of the result [Hz], at most that of the inertial sensor.

    Raises
    ------
    NotInformative
        The filter diverges.
    """
    return tuple(_Stretch(readings, part, mounting or Mounting(), rate).solve() for part in readings.stretches)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Measurements of a pass: step (r,), numbers (r, COLUMNS) and series (r,) of each."""

    at: NDArray[np.int64]
    numbers: Array
    series: NDArray[np.int64]


PAUSE = "no velocity sensor"
_PAUSE = Sensor("", kernel.BODY_VELOCITY, (0, 1), (), STILL[0])
"""The measurement that stands in for a missing velocity."""


class _Stretch:
    """The passes over one stretch."""

    def __init__(self, readings: Readings, part: Inertial, mounting: Mounting, rate: float) -> None:
        self.readings, self.imu, self.mounting = readings, np.ascontiguousarray(part.samples), mounting
        t = self.imu[:, 0]
        start, end = float(t[0]), float(t[-1])
        self.series: dict[str, tuple[Sensor, Array, Array]] = {}
        for name, own in readings.series.items():
            inside = (own.t >= start) & (own.t <= end)
            if np.any(inside):
                self.series[name] = (own.sensor, own.t[inside], own.values[inside])
        self.has_position = "GPS position" in self.series
        self.has_velocity = self.has_position or {"GPS velocity", "DVL"} & self.series.keys()
        if not self.has_velocity:
            at = np.arange(start, end, 1.0 / STILL[1])
            self.series[PAUSE] = (_PAUSE, at, np.zeros((len(at), 2)))
        step = float(np.median(np.diff(t)))
        self.every = max(1, round(1.0 / (rate * step)))
        self.numbers = np.array([_gravity(readings.latitude), readings.parameters.get("COMPASS_DEC", 0.0)])
        self.delays = dict.fromkeys(DELAYED, 0.0)
        self.sigma = {name: sensor.sigma for name, (sensor, _, _) in self.series.items()}
        noise = [float(np.mean([noise_of(self.imu[:, i]) for i in columns])) for columns in ((1, 2, 3), (4, 5, 6))]
        self.imu_noise = np.maximum(noise, LEAST)
        self.start: Array | None = None
        """First state of the last pass (X_SIZE,), about which the next one is linearised."""

    def solve(self) -> Navigation:
        """Repeat the passes until delays and noise levels settle, and return the solution of the last one."""
        converged, count = False, 0
        for count in range(1, PASSES + 1):
            result = _Pass(self, self._rows())
            self.start = result.x[0].copy()
            moved, changed = self._learn(result)
            if count > 2 and moved < SETTLED[0] and changed < SETTLED[1]:
                converged = True
                break
        return self._navigation(result, count, converged=converged)

    def _rows(self) -> _Rows:
        t = self.imu[:, 0]
        at, numbers, series = [], [], []
        for place, (name, (sensor, stamps, values)) in enumerate(self.series.items()):
            true = np.clip(stamps - self.delays.get(sensor.sensor, 0.0), t[0], t[-1])
            after = np.clip(np.searchsorted(t, true), 1, len(t) - 1)
            steps = np.where(true - t[after - 1] < t[after] - true, after - 1, after)
            for column, component in enumerate(sensor.components):
                rows = np.zeros((len(stamps), kernel.COLUMNS))
                rows[:, 0], rows[:, 1] = sensor.kind, component
                if sensor.kind in (kernel.COMPASS, kernel.HEADING, kernel.DEPTH):
                    rows[:, 2 : 2 + values.shape[1]] = values
                else:
                    rows[:, 2 + component] = values[:, column]
                rows[:, 5] = stamps - t[steps]
                rows[:, 6] = self.sigma[name] ** 2
                rows[:, 7] = ARMED.get(sensor.sensor, -1)
                rows[:, 8] = DELAYED.get(sensor.sensor, -1)
                at.append(steps)
                numbers.append(rows)
                series.append(np.full(len(stamps), place))
        joined = np.concatenate(at)
        order = np.argsort(joined, kind="stable")
        return _Rows(
            np.ascontiguousarray(joined[order], dtype=np.int64),
            np.ascontiguousarray(np.concatenate(numbers)[order]),
            np.concatenate(series)[order],
        )

    def first(self) -> tuple[Array, Array]:
        """Return the first state and its covariance, from the first samples."""
        x, P = np.zeros(kernel.X_SIZE), np.zeros((kernel.SIZE, kernel.SIZE))
        t = self.imu[:, 0]
        f = self.imu[t <= t[0] + 1.0, 4:7].mean(axis=0)
        phi, theta = math.atan2(-f[1], -f[2]), math.atan2(f[0], math.hypot(f[1], f[2]))
        psi = self._first_heading(phi, theta)
        x[:4] = _quaternion(phi, theta, psi)
        spread = np.zeros(kernel.SIZE)
        spread[:2], spread[2], spread[3:6] = FIRST["tilt"], FIRST["heading"], FIRST["velocity"]
        spread[6:9] = FIRST["drift"]
        if self.has_position:
            x[7:9] = self.series["GPS position"][2][0]
            spread[6:8] = FIRST["position"]
        if "GPS velocity" in self.series:
            x[4:7] = _matrices(x[None, :4])[0, :2].T @ self.series["GPS velocity"][2][0]
        elif "DVL" in self.series:
            x[4:7] = self.series["DVL"][2][0]
        vertical = next((n for n in ("depth", "air pressure", "GPS altitude") if n in self.series), None)
        if vertical is not None:
            x[9], spread[8] = float(self.series[vertical][2][0, 0]), FIRST["position"]
        for place, size, _ in CONSTANTS.values():
            spread[place] = size
        devices = {sensor.sensor for sensor, _, _ in self.series.values()}
        for device, place in (*ARMED.items(), *DELAYED.items()):
            if device not in devices:
                spread[place : place + (3 if device in ARMED and place == ARMED[device] else 1)] = 0.0
        if not self._turns():
            spread[kernel.MOUNT : kernel.MOUNT + 3] = 0.0
        for device, arm in self.arms().items():
            x[ARMED[device] + 1 : ARMED[device] + 4] = arm
            spread[ARMED[device] : ARMED[device] + 3] = KNOWN_ARM
        np.fill_diagonal(P, spread**2)
        return x, P

    def _turns(self) -> bool:
        """Return whether the field turns enough in the compass's axes to show a turn of the mount."""
        if "compass" not in self.series:
            return False
        field = self.series["compass"][2]
        low, high = np.percentile(np.unwrap(np.arctan2(field[:, 1], field[:, 0])), (5.0, 95.0))
        return bool(high - low > TURNED)

    def arms(self) -> dict[str, Vector]:
        """Return the known lever arms: those supplied, and those in the autopilot's parameters."""
        arms: dict[str, Vector] = {}
        parameters = self.readings.parameters
        inertial = [parameters.get(f"INS_POS1_{axis}", 0.0) for axis in "XYZ"]
        for device, prefixes in (("gps", ("GPS1_POS", "GPS_POS1")), ("dvl", ("VISO_POS",))):
            for prefix in prefixes:
                place = [parameters.get(f"{prefix}_{axis}", 0.0) for axis in "XYZ"]
                if any(place):
                    arms[device] = (place[0] - inertial[0], place[1] - inertial[1], place[2] - inertial[2])
        return {**arms, **self.mounting.arms}

    def _first_heading(self, phi: float, theta: float) -> float:
        if "compass" not in self.series:
            return float(self.series["heading"][2][0, 0]) if "heading" in self.series else 0.0
        m = _matrices(_quaternion(phi, theta, 0.0)[None])[0] @ self.series["compass"][2][0]
        return float(self.numbers[1] - math.atan2(m[1], m[0]))

    def _learn(self, result: _Pass) -> tuple[float, float]:
        """Take over delays and noise levels, and return the largest change of each."""
        moved = changed = 0.0
        for device, place in DELAYED.items():
            delay = float(result.x[0, place + 1])
            moved = max(moved, abs(delay - self.delays[device]))
            self.delays[device] = delay
        for place, name in enumerate(self.series):
            mine = (result.rows.series == place) & (result.updates[:, 4] > 0.0)
            if name == PAUSE or not np.any(mine):
                continue
            sigma = math.sqrt(max(float(np.mean(result.updates[mine, 3])), 0.0))
            sigma = max(sigma, FLOOR * SENSORS[name].sigma)
            changed = max(changed, abs(sigma / self.sigma[name] - 1.0))
            self.sigma[name] = sigma
        ratios = np.maximum(np.sqrt(np.maximum(result.levels[::2] / result.levels[1::2], 0.0)), LEAST)
        changed = max(changed, float(np.max(np.abs(ratios / self.imu_noise - 1.0))))
        self.imu_noise = ratios
        return moved, changed

    def _navigation(self, result: _Pass, passes: int, *, converged: bool) -> Navigation:
        x, P = result.x, result.P
        if not np.all(np.isfinite(x)):
            raise NotInformative(
                f"{self.readings.name}: the navigation filter diverged. Check the units and signs of the inertial "
                "sensor (FRD axes, specific force -9.8 m/s^2 down at rest)"
            )
        spread = np.sqrt(np.diag(self.first()[1]))
        values, J = self._at_centre(x)
        covariance = self._covariance(J, P)
        # The filter takes tilt errors for noise of the compass, but they last. They add to the turn of the compass.
        tilt = {f"compass turn {axis}": float(np.mean(covariance[:, i, i])) for axis, i in (("x", 3), ("y", 4))}
        constants = {
            name: Constant(
                float(x[0, place + 1]),
                math.sqrt(max(float(P[0, place, place]), 0.0) + tilt.get(name, 0.0)),
                float(spread[place]),
                unit,
            )
            for name, (place, _, unit) in CONSTANTS.items()
            if spread[place] > 0.0
        }
        noise = {}
        for place, name in enumerate(self.series):
            mine = result.updates[result.rows.series == place]
            used = mine[mine[:, 2] > 0.0]
            nis = float(np.mean(used[:, 0] ** 2 / used[:, 1])) if len(used) else math.nan
            noise[name] = SensorNoise(len(used), len(mine) - len(used), self.sigma[name], nis)
        stds = {n: np.sqrt(np.maximum(covariance[:, i, i], 0.0)) for i, n in enumerate(values)}
        lost = [*("xy" if not self.has_velocity else ""), *("uv" if not self.has_velocity else "")]
        common = dict(zip(values, np.moveaxis(_common_of(J, P, covariance), 1, 0), strict=True))
        values = {n: v for n, v in values.items() if n not in lost}
        return Navigation(
            self.imu[:: self.every, 0],
            values,
            {n: stds[n] for n in values},
            covariance,
            {n: m for n, m in self._memories(result, covariance).items() if n in values},
            {n: c for n, c in common.items() if n in values},
            constants,
            noise,
            (float(self.imu_noise[0]), float(self.imu_noise[1])),
            passes,
            converged,
        )

    def _memories(self, result: _Pass, covariance: Array) -> dict[str, Array]:
        """Return signal -> correlation time of its error [s] at each kept state.

        The errors of neighbouring samples are correlated as if they decayed exponentially. An error of a turn rate is
        the gyro's noise, which is independent, and its bias, which stays.
        """
        step = self.every * float(np.median(np.diff(self.imu[:, 0])))
        rates = np.einsum("kii->ki", covariance)[:, 9:12]
        alike = np.hstack([result.alike[:, [6, 7, 8, 0, 1, 2, 3, 4, 5]], 1.0 - self.imu_noise[0] ** 2 / rates])
        times = -step / np.log(np.clip(alike, 1e-9, 1.0 - 1e-9))
        times[alike < INDEPENDENT] = 0.0
        return {name: times[:, i].copy() for i, name in enumerate((*"xyz", *ANGLES, *"uvw", *"pqr"))}

    def _at_centre(self, x: Array) -> tuple[dict[str, Array], Array]:
        """Return the signals at the centre of gravity, and their derivatives by the filter's errors (k, 12, SIZE)."""
        k, c = len(x), np.array(self.mounting.centre)
        R = _matrices(x[:, :4])
        w = self.imu[:: self.every, 1:4] - x[:, 10:13]
        velocity = x[:, 4:7] + np.cross(w, c)
        position = x[:, 7:10] + R @ c
        phi, theta = np.arctan2(R[:, 2, 1], R[:, 2, 2]), -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
        psi = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        J = np.zeros((k, 12, kernel.SIZE))
        J[:, 0:3, 6:9] = np.eye(3)
        J[:, 0:3, 0:3] = -_cross_matrix(R @ c)
        cosine = np.maximum(np.cos(theta), 1e-3)
        J[:, 3, 0] = 1.0
        J[:, 3, 1], J[:, 3, 2] = np.sin(phi) * np.tan(theta), np.cos(phi) * np.tan(theta)
        J[:, 4, 1], J[:, 4, 2] = np.cos(phi), -np.sin(phi)
        J[:, 5, 1], J[:, 5, 2] = np.sin(phi) / cosine, np.cos(phi) / cosine
        J[:, 3:6, 0:3] = J[:, 3:6, 0:3] @ np.swapaxes(R, 1, 2)
        J[:, 6:9, 3:6] = np.eye(3)
        J[:, 6:9, kernel.GYRO : kernel.GYRO + 3] = _cross_matrix(c)
        J[:, 9:12, kernel.GYRO : kernel.GYRO + 3] = -np.eye(3)
        names = (*"xyz", *ANGLES, *"uvw", *"pqr")
        columns = np.column_stack([position, phi, theta, psi, velocity, w])
        return {name: columns[:, i].copy() for i, name in enumerate(names)}, J

    def _covariance(self, J: Array, P: Array) -> Array:
        """Return the covariance (k, 12, 12) of the signals, with the noise of the gyro."""
        gyro = np.zeros((12, 3))
        gyro[6:9], gyro[9:12] = -_cross_matrix(np.array(self.mounting.centre)), np.eye(3)
        covariance: Array = J @ P @ np.swapaxes(J, 1, 2) + self.imu_noise[0] ** 2 * (gyro @ gyro.T)
        return covariance


class _Pass:
    """One pass forwards and backwards: smoothed states ``x`` (k, X_SIZE) with covariance ``P``, and the measurements.

    ``alike`` (k, MOVING): correlation of the error of each moving state with that in the state before.
    """

    def __init__(self, stretch: _Stretch, rows: _Rows) -> None:
        self.rows = rows
        imu, every = stretch.imu, stretch.every
        s, r, n = len(imu), len(rows.at), kernel.SIZE
        k = (s - 1) // every + 1
        x, P = stretch.first()
        pull, held = np.zeros(n), 0.0
        if stretch.start is not None:
            known = np.diag(P)[kernel.GYRO :] > 0.0
            away = stretch.start[kernel.GYRO + 1 :] - x[kernel.GYRO + 1 :]
            pull[kernel.GYRO :][known] = -away[known] / np.diag(P)[kernel.GYRO :][known]
            # The first heading counts too: without GPS nothing else separates it from the compass's constants.
            pull[2] = -_turned_by(x[:4], stretch.start[:4]) / P[2, 2]
            x, held = stretch.start.copy(), HELD
        noise = np.array([*stretch.imu_noise, *DRIFTS])
        steps, self.updates = np.zeros((s, kernel.STEP)), np.zeros((r, kernel.NODE + 2 * n))
        self.x, self.P = np.zeros((k, kernel.X_SIZE)), np.zeros((k, n, n))
        shifts, self.levels, lagged = np.zeros((k, n)), np.zeros(4), np.zeros((k, kernel.MOVING))
        work, rotation = np.zeros((15, n)), np.zeros((3, 3))
        kernel.forward(
            imu, rows.at, rows.numbers, stretch.numbers, noise, x, P, every, held, steps, self.updates, self.x, self.P,
            work, rotation,
        )  # fmt: skip
        kernel.backward(
            rows.at, rows.numbers, noise, every, steps, self.updates, self.x, self.P, shifts, self.levels,
            lagged, np.zeros((2 * n + kernel.MOVING, n)), work,
        )  # fmt: skip
        spread = np.sqrt(np.maximum(np.einsum("kii->ki", self.P)[:, : kernel.MOVING], 1e-300))
        self.alike = np.zeros_like(lagged)
        self.alike[1:] = lagged[1:] / (spread[1:] * spread[:-1])
        # The pass began at the state of the last one. This returns constants and heading to their prior means, by the
        # change of the information vector.
        shifts += self.P @ pull
        self.x[:, 4:] += shifts[:, 3:]
        self.x[:, :4] = _turned(self.x[:, :4], shifts[:, :3])


def _common_of(J: Array, P: Array, covariance: Array) -> Array:
    """Return the part of the error of every signal by causes that last for the whole log (k, 12, c).

    The filter's constants have correlated errors, which c independent causes explain: the principal components of the
    constants. A cause adds ``J P_xc`` times its direction, as in a consider analysis. The causes with the greatest
    effect are kept.
    """
    constants = kernel.MOVING + np.flatnonzero(np.einsum("kii->ki", P).min(axis=0)[kernel.MOVING :] > 0.0)
    own = P[:, constants[:, None], constants].mean(axis=0)  # they drift too little to matter
    spread = np.sqrt(np.diag(own))
    size, axes = np.linalg.eigh(own / np.outer(spread, spread))
    directions = axes[:, size > TINY] / (spread[:, None] * np.sqrt(size[size > TINY]))
    every = J @ P[:, :, constants] @ directions
    variance = np.einsum("kii->ki", covariance)
    rest = np.maximum(variance - np.sum(every**2, axis=2), TINY * variance)
    relative = (every / np.sqrt(rest)[:, :, None]).reshape(-1, directions.shape[1])
    effect, turn = np.linalg.eigh(relative.T @ relative)
    greatest = np.argsort(-effect)[: min(COMMON, int(np.sum(effect > NOTICED)))]
    common: Array = every @ turn[:, greatest]
    return common


def _gravity(latitude: float) -> float:
    """Return gravity [m/s^2] at a latitude [deg], by the formula of WGS 84; standard gravity if unknown."""
    if not math.isfinite(latitude):
        return 9.80665
    s = math.sin(math.radians(latitude)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * s) / math.sqrt(1.0 - 0.00669437999014 * s)


def _quaternion(phi: float, theta: float, psi: float) -> Array:
    (a, b, c), (d, e, f) = ([fn(0.5 * angle) for angle in (phi, theta, psi)] for fn in (math.cos, math.sin))
    return np.array([a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c])


def _matrices(q: Array) -> Array:
    """Return the rotation matrices (k, 3, 3), body to NED, of quaternions (k, 4)."""
    w, x, y, z = q.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _turned(q: Array, by: Array) -> Array:
    """Return the quaternions (k, 4) turned by small rotation vectors (k, 3) in NED axes."""
    (a, b, c, d), (e, f, g, h) = np.column_stack([np.ones(len(q)), 0.5 * by]).T, q.T
    turned = np.column_stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )
    result: Array = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return result


def _turned_by(one: Array, other: Array) -> float:
    """Return the angle [rad] between the headings of two quaternions, from the first to the second."""
    first, second = (math.atan2(R[1, 0], R[0, 0]) for R in _matrices(np.array([one, other])))
    return (second - first + math.pi) % (2.0 * math.pi) - math.pi


def _cross_matrix(a: Array) -> Array:
    """Return ``[a]x`` (..., 3, 3) of vectors (..., 3)."""
    M = np.zeros((*a.shape[:-1], 3, 3))
    M[..., 0, 1], M[..., 0, 2] = -a[..., 2], a[..., 1]
    M[..., 1, 0], M[..., 1, 2] = a[..., 2], -a[..., 0]
    M[..., 2, 0], M[..., 2, 1] = -a[..., 1], a[..., 0]
    return M
