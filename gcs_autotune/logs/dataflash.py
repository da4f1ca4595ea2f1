"""Convert ArduPilot's onboard log (dataflash: ``.bin`` binary, ``.log`` text) to samples.

One table contains the sources of each message, in SI; degrees are converted here. SIM, SIM2 and similar messages (a
simulator's true state) are not in it. An onboard log has no checksums, but its messages are in order of time, so
damaged time stamps can be detected.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs.aboard_record import ENDS, ROWS, sources_of
from gcs_autotune.logs.dataflash_format import HEAD, BinaryLog, Block, DataflashTextLog, TextBlock
from gcs_autotune.logs.sample_store import UNKNOWN, Census, Note, Recording, SampleStore

__all__ = ["EVENTS", "SIGNALS", "WATER_PRESSURE", "Columns", "Missing", "record_dataflash", "signals_of", "strays_of"]

Array = NDArray[np.float64]
Columns: TypeAlias = Mapping[str, Any]
"""Column name (as in the log's own FMT) -> its values in many messages, or in one."""

RAD = math.pi / 180.0
FIX_3D = 3
EVENTS = frozenset({"PARM", "MSG", "VER", "MODE", "ARM", "EV"})
"""Names of the messages that are processed one by one."""
INSTANCE = ("C", "I")
"""Names of the columns that number the instances of a sensor or filter. Only the first instance is read."""


class Missing(KeyError):
    """Raised if a message lacks a column that all its known versions have, or contains text in such a column."""


def _picked(**columns: tuple[str, float]) -> Callable[[Columns], dict[str, Array]]:
    def read(c: Columns) -> dict[str, Array]:
        return {source.replace("__", "."): c[name] * factor for source, (name, factor) in columns.items()}

    return read


def _gps(c: Columns) -> dict[str, Array]:
    course = c["GCrs"] * RAD
    speed = np.where(c["Status"] >= FIX_3D, c["Spd"], np.nan)
    return {
        "gps.lat": c["Lat"],
        "gps.lon": c["Lng"],
        "gps.U": speed,
        "gps.vn": speed * np.cos(course),
        "gps.ve": speed * np.sin(course),
        **_if_there(c, gps__z=("Alt", -1.0), gps__vd=("VZ", 1.0)),
    }


def _if_there(c: Columns, **columns: tuple[str, float]) -> dict[str, Array]:
    """Return the sources whose columns the message has; older firmware lacks some."""
    return _picked(**{source: row for source, row in columns.items() if row[0] in c})(c)


def _imu(c: Columns) -> dict[str, Array]:
    rates = _picked(imu__p=("GyrX", 1.0), imu__q=("GyrY", 1.0), imu__r=("GyrZ", 1.0))(c)
    return rates | _if_there(c, imu__ax=("AccX", 1.0), imu__ay=("AccY", 1.0), imu__az=("AccZ", 1.0))


def _ekf(c: Columns) -> dict[str, Array]:
    angles = _if_there(c, ekf__phi=("Roll", RAD), ekf__theta=("Pitch", RAD), ekf__psi=("Yaw", RAD))
    return _EKF(c) | angles


def _visual_odometry(c: Columns) -> dict[str, Array]:
    """Return the velocity that a DVL reports as displacement since its last report."""
    return {f"dvl.{name}": c[f"PosD{axis}"] / c["dt"] for name, axis in zip("uvw", "XYZ", strict=True)}


def _shafts(c: Columns) -> dict[str, Array]:
    """Return the speed [1/s] of each ESC, NaN in the messages of the others."""
    return {f"esc.{n}": np.where(c["Instance"] == n - 1, c["RPM"] / 60.0, np.nan) for n in range(1, 9)}


CHANNEL = ("C", "Ch", "Chan")
"""Prefixes of a column name before the number of an output or RC channel. The last two were used until 2015."""


def _numbered(source: str) -> Callable[[Columns], dict[str, Array]]:
    def read(c: Columns) -> dict[str, Array]:
        return {f"{source}.{n}": c[f"{w}{n}"] * 1.0 for n in range(1, 15) for w in CHANNEL if f"{w}{n}" in c}

    return read


_EKF = _picked(
    ekf__x=("PN", 1.0), ekf__y=("PE", 1.0), ekf__z=("PD", 1.0), ekf__vn=("VN", 1.0), ekf__ve=("VE", 1.0),
    ekf__w=("VD", 1.0),
)  # fmt: skip

SIGNALS: Mapping[str, Callable[[Columns], dict[str, Array]]] = {
    "ATT": _picked(attitude__phi=("Roll", RAD), attitude__theta=("Pitch", RAD), attitude__psi=("Yaw", RAD)),
    "AHR2": _picked(ahrs2__phi=("Roll", RAD), ahrs2__theta=("Pitch", RAD), ahrs2__psi=("Yaw", RAD)),
    "RATE": _picked(rate__p=("R", RAD), rate__q=("P", RAD), rate__r=("Y", RAD)),
    "IMU": _imu,
    "MAG": _picked(compass__mx=("MagX", 1.0), compass__my=("MagY", 1.0), compass__mz=("MagZ", 1.0)),
    "VISO": _visual_odometry,
    "STER": _picked(steering__r=("TurnRt", RAD)),
    "XKF1": _ekf,
    "NKF1": _ekf,
    "EKF1": _ekf,
    "POS": _picked(global__lat=("Lat", 1.0), global__lon=("Lng", 1.0), global__z=("RelHomeAlt", -1.0)),
    "GPS": _gps,
    "CTUN": _picked(control__z=("Alt", -1.0)),
    "BARO": _picked(baro__z=("Alt", -1.0)),
    "RCOU": _numbered("servo"),
    "RCIN": _numbered("rc"),
    "ESC": _shafts,
    ROWS.name: partial(sources_of, ROWS),
    ENDS.name: partial(sources_of, ENDS),
}
"""Message -> function that returns its sources in the store, from arrays or single numbers."""


WATER_PRESSURE = "baro1"
"""Name of the second pressure sensor. It is outside the hull of a usual ArduSub vehicle, the first one inside."""


def signals_of(kind: str, columns: Columns, instance: int = 0) -> dict[str, Array]:
    """Return source -> values of the messages of one *kind*. Values of instances other than *instance* are NaN.

    Raises
    ------
    Missing
        A column is missing.
    """
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # a damaged number may be infinite
            found = {source: np.asarray(v, dtype=np.float64) for source, v in SIGNALS[kind](columns).items()}
    except (KeyError, TypeError, ValueError) as error:  # a damaged FMT makes words of numbers
        raise Missing(str(error)) from None
    for name in INSTANCE:
        if name in columns and columns[name].dtype == np.float64:
            found = {source: np.where(columns[name] == instance, values, np.nan) for source, values in found.items()}
    return found


STRAY = 2.0
"""Deviation of a time stamp [s] from the median of its neighbours on each side, above which it counts as damaged.
Project choice.
"""
FAR = 600.0
"""Deviation of a time stamp [s] from its neighbours, if there are neighbours on one side only, above which it counts as
damaged. Project choice.
"""
NEIGHBOURS = 5
"""Number of neighbouring messages on either side with which a time stamp is compared. Project choice."""


def strays_of(t: Array) -> NDArray[np.bool_]:
    """Return a mask (n,) of the time stamps, in order of the file, that are earlier or later than both their
    neighbourhoods.

    If there is only one neighbourhood (at the ends of a piece), a time stamp far from it is also in the mask.
    """
    if not np.any(~(np.abs(np.diff(t)) <= STRAY)):
        return np.zeros(len(t), dtype=bool)
    beyond = np.full(NEIGHBOURS, np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([beyond, t, beyond]), NEIGHBOURS)
    middle = np.median(windows, axis=1)
    before, after = middle[: len(t)], middle[NEIGHBOURS + 1 : NEIGHBOURS + 1 + len(t)]
    is_ahead = (t > before + STRAY) & (t > after + STRAY)
    is_behind = (t < before - STRAY) & (t < after - STRAY)
    is_alone = np.isnan(before) | np.isnan(after)
    nearest = np.fmin(np.abs(t - before), np.abs(t - after))
    strays: NDArray[np.bool_] = is_ahead | is_behind | (is_alone & (nearest > FAR)) | ~np.isfinite(t)
    return strays


AnyBlock: TypeAlias = Block | TextBlock

FMT_LINE = re.compile(rb"^[\xef\xbb\xbf \t]*FMT\s*,", re.MULTILINE)
EV_ARMED, EV_DISARMED = 10, 11
"""Numbers of ArduPilot's events for arming and disarming, in logs older than the ARM message."""
REBOOT = 5.0
"""Step back in time [s] above which a piece of log counts as belonging to another boot. Project choice."""


def record_dataflash(path: Path, system: int | None = None) -> Recording:
    """Return the content of the dataflash log at *path*, which is read a piece at a time. *system* is ignored, because
    an onboard log is of one vehicle.

    Raises
    ------
    BadFile
        The file is unreadable or not a dataflash log.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
        is_binary = HEAD in start
        if not is_binary and not FMT_LINE.search(start):
            raise BadFile(f"{path} is not an ArduPilot log: it does not start with a binary message or an FMT line")
        log: BinaryLog | DataflashTextLog = (
            BinaryLog(path.open("rb"))
            if is_binary
            else DataflashTextLog(path.open(encoding="utf-8-sig", errors="replace", newline=None))
        )
        decoder = _Decoder(path.stem)
        for blocks in log:
            decoder.write(blocks)
        for line in log.preamble:
            decoder.name_by(line)
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror or error}") from error
    if not decoder.blocks:
        raise BadFile(f"{path} contains no dataflash message. It is not an ArduPilot log, or it is damaged")
    if not decoder.is_dated:
        raise BadFile(_undated(path, decoder))
    notes: list[Note] = []
    if log.damaged or decoder.strays:
        what = f"{log.damaged} segments of the log ({log.damaged_bytes} bytes)" if log.damaged else ""
        stamps = f"{decoder.strays} timestamps" if decoder.strays else ""
        notes.append(
            (
                "damaged-log",
                f"{' and '.join(w for w in (what, stamps) if w)} were damaged and skipped",
                "fetch the log again. These logs have no checksums, so check the plots before you use the result",
            )
        )
    meta = {
        "source": path.name,
        "messages": log.messages,
        "damaged": log.damaged,
        "damaged_bytes": log.damaged_bytes,
        "damaged_stamps": decoder.strays,
        "truncated": log.truncated,
    }
    form = "onboard log (binary)" if is_binary else "onboard log (text)"
    return Recording(form, decoder.stores(), meta, notes, decoder.census)


def _undated(path: Path, decoder: _Decoder) -> str:
    """Return the error for a log without time stamps of the boot clock, with the remedy."""
    if "TIME" in decoder.census.seen:
        return (
            f"{path} is a log of PX4's old logger (sdlog2), which is not supported. Convert it with sdlog2_dump.py, "
            "and map its columns with --columns"
        )
    store = decoder.stores()[-1]
    whose = f"of {store.vehicle}" if store.vehicle != UNKNOWN else "of an early ArduPilot"
    return (
        f"{path} is a log {whose} whose messages have no timestamp (TimeUS, or TimeMS until 2015), so nothing can be "
        "identified from it. Use the telemetry log (.tlog), or a newer firmware"
    )


STAMPS = {"TimeUS": 1e-6, "TimeMS": 1e-3}
"""Name of a column with the boot clock -> seconds per unit; TimeMS was used until 2015."""
WEEK = frozenset({"Week", "GWk"})
"""Names of the columns that mark TimeMS as the time of the GPS week. The boot clock [ms] is then in ``T``."""


def _stamps(block: AnyBlock) -> Array | None:
    """Return when the messages of *block* were written [s since boot]; None if they have no time stamp.

    A zero means the same time as the previous message. It is used for events without a stamp, and for GPS with the week
    only.
    """
    column, factor = next(((n, f) for n, f in STAMPS.items() if n in block.names), ("", 0.0))
    is_gps_time = column == "TimeMS" and not WEEK.isdisjoint(block.names)
    if is_gps_time:
        column = "T" if "T" in block.names else ""
    if not column:
        return np.zeros(len(block.order)) if is_gps_time or block.kind in EVENTS else None
    stamps = block.column(column)
    return stamps * factor if stamps.dtype == np.float64 and stamps.ndim == 1 else None


class _Decoder:
    """Writes blocks of messages into sample stores, a new one each time the boot clock restarts."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.census = Census()
        self.blocks = 0
        self.strays = 0
        self.is_dated = False
        self.unstamped: set[str] = set()
        self._stores = [SampleStore(name, "vehicle (TimeUS)")]

    def write(self, blocks: Iterable[AnyBlock]) -> None:
        """Write the messages of one piece of the file into the stores."""
        here = list(blocks)
        self.blocks += len(here)
        stamps = self._believable(here)
        self.is_dated |= any(np.any(t > 0.0) for t in stamps.values())
        if any("TimeMS" in b.names and WEEK.isdisjoint(b.names) for b in here):
            self._stores[-1].clock = "vehicle (TimeMS)"
        for block in here:
            if block.kind not in stamps:
                self.census.count(block.kind, self._now(), len(block.order))
        for start, end in _boots(here, stamps):
            part = {
                b.kind: (b, (np.asarray(b.order) >= start) & (np.asarray(b.order) < end))
                for b in here
                if b.kind in stamps
            }
            self._write(part, stamps)

    def _write(self, part: Mapping[str, tuple[AnyBlock, NDArray[np.bool_]]], stamps: Mapping[str, Array]) -> None:
        """Write the selected messages of one boot."""
        seen = {kind: t[np.isfinite(t)] for kind, (_, mine) in part.items() for t in (stamps[kind][mine],)}
        begins = min((float(t[0]) for t in seen.values() if len(t)), default=np.nan)
        if begins < self._stores[-1].span[1] - REBOOT:
            old = self._stores[-1]
            self._stores.append(SampleStore(self.name, old.clock, old.vehicle, old.firmware, dict(old.parameters)))
        store = self._stores[-1]
        for kind, (block, mine) in part.items():
            if len(seen[kind]):
                self.census.count(kind, float(seen[kind][0]), len(seen[kind]), float(seen[kind][-1]))
            if kind not in EVENTS and kind not in SIGNALS:
                continue
            columns = {name: block.column(name)[mine] for name in block.names if name != "TimeUS"}
            try:
                if kind in EVENTS:
                    _events(store, kind, stamps[kind][mine], columns)
                else:
                    self._signals(store, kind, stamps[kind][mine], columns)
            except Missing:
                continue

    def name_by(self, text: str) -> None:
        """Use the firmware's name from a line above the log if the log itself does not contain it."""
        for store in self._stores:
            _name(store, text)

    def stores(self) -> list[SampleStore]:
        """Return the stores written, one per boot. If only armed time is logged (LOG_DISARMED 0), the log counts as
        armed from its start.
        """
        for store in self._stores:
            store.arming.sort(key=lambda a: a[0])
            store.modes.sort(key=lambda m: m[0])
            if store.arming:
                store.arming.insert(0, (store.span[0], not store.arming[0][1]))
            elif not store.parameters.get("LOG_DISARMED", 0.0):
                store.arming.append((store.span[0], True))
        return self._stores

    def _now(self) -> float:
        return self._stores[-1].span[1]

    def _believable(self, blocks: list[AnyBlock]) -> dict[str, Array]:
        """Return stamps [s] by kind, with NaN for a stamp that does not fit between its neighbours in the file."""
        stamps = {b.kind: _stamps(b) for b in blocks}
        kinds = {kind: t for kind, t in stamps.items() if t is not None}
        if not kinds:
            return {}
        order = np.concatenate([b.order for b in blocks if b.kind in kinds])
        t = np.concatenate(list(kinds.values()))
        place = np.argsort(order, kind="stable")
        unstamped = {kind for kind, stamps in kinds.items() if not np.any(stamps)}
        if len(unstamped) == len(kinds):
            t[:] = self._now()
        elif unstamped:  # PARM and MSG until 2015, ArduSub 4.7's RATE: as old as the message before it in the file
            self.unstamped |= unstamped
            blank = np.concatenate([np.full(len(s), k in unstamped) for k, s in kinds.items()])[place]
            last = np.maximum.accumulate(np.where(blank, -1, np.arange(len(place))))
            last[last < 0] = int(np.argmax(~blank))
            t[place] = t[place[last]]
        strays = strays_of(t[place])
        self.strays += int(np.sum(strays))
        t[place[strays]] = np.nan
        ends = np.cumsum([len(s) for s in kinds.values()])
        return dict(zip(kinds, np.split(t, ends[:-1]), strict=True))

    def _signals(self, store: SampleStore, kind: str, stamps: Array, columns: Mapping[str, Any]) -> None:
        values = signals_of(kind, columns)
        if kind in self.unstamped:
            store.dated_by_arrival.update(source.partition(".")[0] for source in values)
        for part in [{name: column} for name, column in values.items()] if kind == "ESC" else [values]:
            store.take_all(*_whole(stamps, part))
        if kind == "BARO":
            second = signals_of(kind, columns, 1)["baro.z"] if "I" in columns else np.full(len(stamps), np.nan)
            store.take_all(*_whole(stamps, {f"{WATER_PRESSURE}.z": second}))


def _boots(blocks: list[AnyBlock], stamps: Mapping[str, Array]) -> list[tuple[float, float]]:
    """Return the ranges of messages (by number in the file) within which the clock did not restart."""
    here = [b for b in blocks if b.kind in stamps]
    if not here:
        return []
    order = np.concatenate([b.order for b in here])
    t = np.concatenate([stamps[b.kind] for b in here])
    place = np.argsort(order, kind="stable")
    place = place[np.isfinite(t[place])]
    again = np.flatnonzero(np.diff(t[place]) < -REBOOT) + 1
    cuts = [-np.inf, *order[place[again]].astype(float), np.inf]
    return list(itertools.pairwise(cuts))


def _whole(t: Array, values: Mapping[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Remove the messages without a time stamp and those of another instance (NaN)."""
    keep = np.isfinite(t)
    for column in values.values():
        keep &= ~np.isnan(column)
    return t[keep], {name: column[keep] for name, column in values.items()}


def _events(store: SampleStore, kind: str, stamps: Array, columns: Mapping[str, Any]) -> None:
    try:
        for i, t in enumerate(stamps):
            if kind == "PARM" or np.isfinite(t):
                _event(store, kind, float(t), {name: values[i] for name, values in columns.items()})
    except (KeyError, TypeError, ValueError) as error:
        raise Missing(str(error)) from None


def _event(store: SampleStore, kind: str, t: float, m: Mapping[str, Any]) -> None:
    if kind == "PARM":  # a parameter counts without a time, too
        if np.isfinite(m["Value"]):
            store.parameters[str(m["Name"])] = float(m["Value"])
    elif kind == "MSG":
        store.texts.append((t, str(m["Message"])))
        _name(store, str(m["Message"]))
    elif kind == "VER":
        _name(store, str(m["FWS"]))
    elif kind == "MODE":
        number = str(m.get("ModeNum", m.get("Mode"))).partition(".")[0]
        if number.isdecimal():
            store.modes.append((t, int(number)))
    elif kind == "ARM":
        store.arming.append((t, bool(m["ArmState"])))
    elif m["Id"] in (EV_ARMED, EV_DISARMED):
        store.arming.append((t, bool(m["Id"] == EV_ARMED)))


_PRODUCT = re.compile(
    r"(?:APM:|Ardu|APM)\s?(Rover|Sub|Copter|Plane|Blimp)\w*|(?:Antenna)?Tracker|Rover|Sub", re.IGNORECASE
)
"""Pattern of a firmware's own name: ``ArduRover V4.6.0``, or until 2018 ``APM:Rover v3.1``."""


def _name(store: SampleStore, text: str) -> None:
    """Read the firmware's name and version from its own messages."""
    product = _PRODUCT.match(text.strip())
    if product is None or store.firmware is not None or store.vehicle != UNKNOWN:
        return
    store.firmware = FIRMWARE.get(f"ardu{(product[1] or product[0]).lower()}")
    store.vehicle = text.strip()
