"""Convert PX4's log (``.ulg``) to samples, read by pyulog (extra ``formats``).

PX4 uses the same heading, body axes and depth (north over east; ahead, starboard, down). Inputs are the normalised
force and torque set-points of its controllers; the functions of outputs are not evaluated.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.logs.format import Format, Head, absent
from gcs_autotune.logs.sample_store import Census, Note, Recording, SampleStore
from gcs_autotune.untrusted_text import visible

__all__ = ["FORMAT", "SIGNALS", "record_ulog"]

Array: TypeAlias = NDArray[np.float64]
Columns: TypeAlias = Mapping[str, Any]

MAGIC = b"ULog\x01\x12\x35"
INSTEAD = "convert it with ulog2csv (pip install pyulog) and map the columns with --columns"
ARMED = 2
"""Value of vehicle_status.arming_state when armed."""


def _picked(**columns: str) -> Callable[[Columns], dict[str, Array]]:
    """Return the sources (``__`` for a dot) for the columns that the topic has."""

    def read(c: Columns) -> dict[str, Array]:
        return {s.replace("__", "."): np.asarray(c[n], np.float64) for s, n in columns.items() if n in c}

    return read


def _attitude(c: Columns) -> dict[str, Array]:
    w, x, y, z = (np.asarray(c[f"q[{i}]"], dtype=np.float64) for i in range(4))
    return {
        "attitude.phi": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "attitude.theta": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "attitude.psi": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


SIGNALS: Mapping[str, Callable[[Columns], dict[str, Array]]] = {
    "vehicle_attitude": _attitude,
    "vehicle_angular_velocity": _picked(rate__p="xyz[0]", rate__q="xyz[1]", rate__r="xyz[2]"),
    "vehicle_local_position": _picked(
        local__x="x", local__y="y", local__z="z", local__vn="vx", local__ve="vy", local__w="vz"
    ),
    "vehicle_thrust_setpoint": _picked(setpoint__X="xyz[0]", setpoint__Y="xyz[1]", setpoint__Z="xyz[2]"),
    "vehicle_torque_setpoint": _picked(setpoint__K="xyz[0]", setpoint__M="xyz[1]", setpoint__N="xyz[2]"),
    "actuator_controls_0": _picked(
        setpoint__K="control[0]", setpoint__M="control[1]", setpoint__N="control[2]", setpoint__X="control[3]"
    ),
    "rover_throttle_setpoint": _picked(setpoint__X="throttle_body_x"),
}
"""PX4 topic -> function that returns its sources in the store; ``actuator_controls_0`` was used until PX4 1.13."""


def record_ulog(path: Path, system: int | None = None) -> Recording:
    """Return the content of the ULog at *path*. *system* is ignored, because the log is of one vehicle.

    Raises
    ------
    BadFile
        The file is unreadable or not a ULog, or pyulog is not installed.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise absent(path, "a PX4 ULog", "pyulog", INSTEAD) from None
    try:
        with path.open("rb") as stream, contextlib.redirect_stdout(io.StringIO()):  # pyulog prints what it doubts
            log = ULog(stream, [*SIGNALS, "vehicle_status"])
        topics = [(str(d.name), d.data) for d in log.data_list if d.multi_id == 0 and "timestamp" in d.data]
        info = {key: visible(str(log.msg_info_dict.get(key, ""))) for key in ("sys_name", "ver_sw_release", "ver_sw")}
        parameters = {str(k): float(v) for k, v in log.initial_parameters.items()}
        damaged = bool(log.file_corruption)
    except Exception as error:  # noqa: BLE001 - what reads a damaged file may raise anything
        why = visible(str(error).partition("\n")[0][:80]) or type(error).__name__
        raise BadFile(f"{path} is a PX4 ULog that cannot be read ({why}): {INSTEAD}") from None
    store = SampleStore(path.stem, "vehicle (ULog)", f"PX4 {info['ver_sw'][:12]}".strip())
    store.parameters = {k: v for k, v in parameters.items() if math.isfinite(v)}
    census = Census()
    for topic, columns in topics:
        _take(store, census, topic, columns)
    if store.span == (0.0, 0.0):
        raise BadFile(
            f"{path} is a PX4 ULog without attitude, position and force set-points, so nothing can be identified from "
            "it. ulog2csv (pip install pyulog) shows its contents"
        )
    notes: list[Note] = []
    if damaged:
        notes.append(("damaged-log", "segments of the log were damaged and skipped", "fetch the log again"))
    messages = sum(int(row[0]) for row in census.seen.values())
    meta = {"source": path.name, "messages": messages, "damaged": int(damaged), "truncated": False}
    return Recording("PX4 ULog", [store], meta, notes, census)


def _take(store: SampleStore, census: Census, topic: str, columns: Columns) -> None:
    """Write one topic into the store. A topic with unexpected columns is skipped."""
    t = np.asarray(columns["timestamp"], dtype=np.float64) * 1e-6
    if not len(t):
        return
    census.count(topic, float(t[0]), len(t), float(t[-1]))
    try:
        if topic == "vehicle_status":
            _take_status(store, t, columns)
            return
        with np.errstate(invalid="ignore", over="ignore"):  # a damaged number may be infinite
            values = SIGNALS[topic](columns)
    except (KeyError, TypeError, ValueError):
        return
    if values and all(v.shape == t.shape for v in values.values()):
        store.take_all(t, values)


def _take_status(store: SampleStore, t: Array, columns: Columns) -> None:
    """Write the changes of armed state and mode."""
    for moment, state, mode in zip(t, columns["arming_state"], columns["nav_state"], strict=True):
        if not store.arming or store.arming[-1][1] != (state == ARMED):
            store.arming.append((float(moment), bool(state == ARMED)))
        if not store.modes or store.modes[-1][1] != int(mode):
            store.modes.append((float(moment), int(mode)))


def _fits(head: Head) -> bool:
    return head.data.startswith(MAGIC)


FORMAT = Format("a PX4 ULog", _fits, (".ulg", ".ulog"), record=record_ulog)
