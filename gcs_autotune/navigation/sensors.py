"""Table of the sensors that navigation fuses, and the samples of a log as the filter reads them."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.frames import flat
from gcs_autotune.logs import SampleStore
from gcs_autotune.navigation import kernel
from gcs_autotune.notebook import Displayed
from gcs_autotune.sensor import stuck
from gcs_autotune.trial import Trial

__all__ = ["ARMED", "SENSORS", "Inertial", "Readings", "Sensor", "Series", "readings_of", "store_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sensor:
    """One kind of measurement.

    - ``sensor``: device, which has one lever arm and one delay. ``kind``: as in :mod:`.kernel`.
    - ``components``: index of each number of a sample. ``sources``: alternatives in the store, preferred first, each
      with one source per number.
    - ``sigma``: standard deviation before the log determines it, in SI units.
    - ``instead_of``: measurement that makes this one superfluous.
    """

    sensor: str
    kind: int
    components: tuple[int, ...]
    sources: tuple[tuple[str, ...], ...]
    sigma: float
    instead_of: str = ""


SENSORS: Mapping[str, Sensor] = {
    "GPS position": Sensor("gps", kernel.POSITION, (0, 1), (("gps.x", "gps.y"), ("gps.lat", "gps.lon")), 1.0),
    "GPS velocity": Sensor("gps", kernel.VELOCITY, (0, 1), (("gps.vn", "gps.ve"),), 0.15),
    "GPS vertical velocity": Sensor("gps", kernel.VELOCITY, (2,), (("gps.vd",),), 0.3),
    "compass": Sensor("compass", kernel.COMPASS, (0,), (("compass.mx", "compass.my", "compass.mz"),), 0.05),
    "heading": Sensor("compass", kernel.HEADING, (0,), (("compass.psi",), ("attitude.psi",)), 0.05, "compass"),
    "DVL": Sensor("dvl", kernel.BODY_VELOCITY, (0, 1, 2), (("dvl.u", "dvl.v", "dvl.w"),), 0.03),
    "depth": Sensor("depth", kernel.DEPTH, (0,), (("depth.z",), ("pressure.z",), ("pressure.p",), ("baro1.z",)), 0.05),
    "air pressure": Sensor("depth", kernel.DEPTH, (0,), (("baro.z",),), 0.3, "depth"),
    "GPS altitude": Sensor("gps", kernel.POSITION, (2,), (("gps.z",),), 2.0, "depth"),
}
"""Name -> measurement. To add one, add a line. Standard deviations are project choices near those of cheap sensors."""

ARMED: Mapping[str, int] = {"gps": kernel.ARMS, "dvl": kernel.ARMS + 3, "depth": kernel.ARMS + 6}
"""Device with a lever arm -> place of the arm among the errors."""
DELAYED: Mapping[str, int] = {name: kernel.DELAYS + i for i, name in enumerate(("gps", "compass", "dvl", "depth"))}
"""Device with a delay -> place of the delay among the errors."""

WATER = 1000.0 * 9.80665
"""Pressure per metre of fresh water [Pa/m]."""

SLOWEST = 10.0
"""Lowest rate of the inertial sensor [Hz]. Below it, the motion of a small craft between samples is lost. Project
choice."""
FEWEST = 5
"""Smallest number of samples of a usable sensor. Project choice."""
GAP = 1.0
"""Longest gap of the inertial sensor [s] inside a stretch. Project choice."""
SHARED = 0.5
"""Smallest fraction of the inertial samples that contain both turn rates and accelerations. Project choice."""
SHORTEST = 5.0
"""Shortest stretch that is navigated [s]. Project choice."""
HEAVY = (5.0, 15.0)
"""Plausible range of the mean specific force [m/s^2]. Outside it, the unit is wrong. Project choice."""
INERTIAL = ("imu.p", "imu.q", "imu.r", "imu.ax", "imu.ay", "imu.az")


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Samples of one measurement: ``t`` (n,), ``values`` (n, components), or (n, 3) for the compass."""

    sensor: Sensor
    t: Array
    values: Array


@dataclass(frozen=True, slots=True, eq=False)
class Inertial:
    """One uninterrupted stretch of the inertial sensor: (n, 7), time, turn rates [rad/s], specific forces [m/s^2]."""

    samples: Array


@dataclass(frozen=True, slots=True, eq=False)
class Readings(Displayed):
    """What a log contains for navigation.

    - ``name``: its file. ``stretches``: inertial samples without gaps. ``series``: measurement -> samples.
    - ``latitude`` [deg], NaN if unknown. ``parameters``: of the autopilot.
    - ``stuck``: measurement, or column of the inertial sensor -> start and end [s] of each stretch in which it did not
      change. These samples are not in ``series`` and ``stretches``.
    """

    name: str
    stretches: tuple[Inertial, ...]
    series: Mapping[str, Series]
    latitude: float = np.nan
    parameters: Mapping[str, float] = field(default_factory=dict)
    stuck: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)

    @property
    def devices(self) -> tuple[str, ...]:
        """Devices with samples."""
        return tuple(dict.fromkeys(s.sensor.sensor for s in self.series.values()))


def store_of(trial: Trial, path: Path) -> SampleStore:
    """Return the columns of a table as a store. Their headings are the names of sources: ``imu.ax[m/s^2]``.

    Raises
    ------
    BadFile
        The clock goes back.
    """
    store = SampleStore(path.stem, "table")
    groups: dict[str, list[str]] = {}
    for name in trial.channels:
        if "." in name:
            groups.setdefault(name.partition(".")[0], []).append(name)
    for names in groups.values():
        columns = [trial[name] for name in names]
        shared = all(np.array_equal(c.t, columns[0].t) for c in columns)
        for group in [columns] if shared else [[c] for c in columns]:
            back = np.flatnonzero(np.diff(group[0].t) < 0.0)
            if len(back):
                raise BadFile(
                    f"{path}: the clock of {group[0].name} goes back at {group[0].t[back[0]]:.3f} s. Sort the rows by "
                    "time, or split the file where the logger restarted"
                )
            store.take_all(group[0].t, {c.name: c.values for c in group})
    return store


def readings_of(store: SampleStore, path: Path) -> Readings:
    """Return the samples in *store* that navigation uses.

    Raises
    ------
    BadFile
        The log has no inertial sensor, a slow one, one in a wrong unit, or no heading.
    """
    still: dict[str, tuple[tuple[float, float], ...]] = {}
    stretches = _inertial(store, path, still)
    series: dict[str, Series] = {}
    latitude = np.nan
    for name, sensor in SENSORS.items():
        if sensor.instead_of in series:
            continue
        for sources in sensor.sources:
            t, values = _together(store, sources)
            if len(t) < FEWEST or not np.ptp(values, axis=0).any():
                continue
            t, values = _unstuck(t, values, values, name, still)
            if sources == ("gps.lat", "gps.lon"):
                latitude = float(values[0, 0])
                values = np.column_stack(flat(values[:, 0], values[:, 1], (latitude, float(values[0, 1]))))
            elif sensor.kind == kernel.COMPASS:
                values = values @ _trim(store.parameters).T
            elif sources == ("pressure.p",):
                values = (values - values[0]) / WATER
            elif sources == ("gps.z",):
                values = values - values[0]
            series[name] = Series(sensor, t, values)
            break
    if not {"compass", "heading"} & series.keys():
        raise BadFile(
            f"{path} contains no heading: neither a compass (MAG; compass.mx, compass.my, compass.mz) nor an attitude "
            "(ATT; compass.psi). Log one of them (LOG_BITMASK), or add the column"
        )
    return Readings(path.name, stretches, series, latitude, store.parameters, still)


def _together(store: SampleStore, sources: Sequence[str]) -> tuple[Array, Array]:
    """Return stamps (n,) and values (n, k) of the samples that all k *sources* have."""
    columns = [store.series(source) for source in sources]
    t = columns[0][0]
    if any(not np.array_equal(own, t) for own, _ in columns):
        t = functools.reduce(np.intersect1d, [own for own, _ in columns])
    return t, np.column_stack(
        [values[np.searchsorted(own, t)] if len(own) != len(t) else values for own, values in columns]
    )


def _unstuck(
    t: Array, rows: Array, watched: Array, name: str, still: dict[str, tuple[tuple[float, float], ...]]
) -> tuple[Array, Array]:
    """Return *t* and *rows* without the stretches in which *watched* is stuck, and add these to *still*."""
    stretches = stuck(t, watched)
    if not stretches:
        return t, rows
    still[name] = tuple((float(t[first]), float(t[last])) for first, last in stretches)
    keep = np.ones(len(t), dtype=bool)
    for first, last in stretches:
        keep[first + 1 : last + 1] = False
    return t[keep], rows[keep]


def _trim(parameters: Mapping[str, float]) -> Array:
    """Return the rotation (3, 3) from the autopilot's board to the craft, by its parameters AHRS_TRIM_X and _Y."""
    a, b = parameters.get("AHRS_TRIM_X", 0.0), parameters.get("AHRS_TRIM_Y", 0.0)
    (c, s), (d, e) = (np.cos(a), np.sin(a)), (np.cos(b), np.sin(b))
    return np.array([[d, e * s, e * c], [0.0, c, -s], [-e, d * s, d * c]])


def _inertial(
    store: SampleStore, path: Path, still: dict[str, tuple[tuple[float, float], ...]]
) -> tuple[Inertial, ...]:
    lengths = {source: len(store.series(source)[0]) for source in INERTIAL}
    missing = [source for source, length in lengths.items() if length < FEWEST]
    if missing:
        what = "a gyro but no accelerometer" if missing[0].startswith("imu.a") else "no inertial sensor"
        raise BadFile(
            f"{path} contains {what} (missing: {', '.join(missing)}). Use the onboard log (.bin) with IMU in "
            "LOG_BITMASK, a telemetry log with RAW_IMU, or a table with these columns"
        )
    t, values = _together(store, INERTIAL)
    if len(t) < SHARED * max(lengths.values()):
        raise BadFile(f"{path}: gyro and accelerometer have different time stamps. Give both in the same rows")
    samples = np.column_stack([t, values])
    samples = samples[np.concatenate([[True], np.diff(t) > 0.0])]
    dead = [source for source, column in zip(INERTIAL, samples.T[1:], strict=True) if np.ptp(column) == 0.0]
    if dead:
        raise BadFile(f"{path}: {', '.join(dead)} never changes. The inertial sensor is dead or not logged; check it")
    for column, source in enumerate(INERTIAL, start=1):
        _, samples = _unstuck(samples[:, 0], samples, samples[:, column], source, still)
    size = float(np.mean(np.linalg.norm(samples[:, 4:7], axis=1)))
    if not HEAVY[0] < size < HEAVY[1]:
        raise BadFile(
            f"{path}: the mean specific force is {size:.3g} m/s^2, but gravity alone is 9.8. Check the unit of imu.ax, "
            "imu.ay, imu.az (m/s^2)"
        )
    step = float(np.median(np.diff(samples[:, 0])))
    if not step <= 1.0 / SLOWEST:
        raise BadFile(
            f"{path}: the inertial sensor was logged at {1.0 / step:.3g} Hz, but navigation needs {SLOWEST:g} Hz or "
            "more. Use the onboard log (.bin), or set SR0_RAW_SENS (SR1_RAW_SENS ...) to 50 for a telemetry log"
        )
    trim = _trim(store.parameters).T
    samples[:, 1:4], samples[:, 4:7] = samples[:, 1:4] @ trim, samples[:, 4:7] @ trim
    cuts = np.flatnonzero(np.diff(samples[:, 0]) > GAP) + 1
    parts = [part for part in np.split(samples, cuts) if part[-1, 0] - part[0, 0] >= SHORTEST]
    if not parts:
        raise BadFile(
            f"{path}: the inertial sensor has no uninterrupted stretch of {SHORTEST:g} s. Record longer, or on a "
            "faster SD card"
        )
    return tuple(Inertial(part) for part in parts)
