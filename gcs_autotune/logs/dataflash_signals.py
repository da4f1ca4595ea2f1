"""Which message of ArduPilot's log on board brings which sources, in SI: one table. Degrees end here.

SIM, SIM2 and the like (a simulator's own truth) are not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["EVENTS", "SIGNALS", "Columns", "Missing", "signals_of"]

Array = NDArray[np.float64]
Columns: TypeAlias = Mapping[str, Any]
"""Column name (as in the log's own FMT) -> values of many messages, or of one."""

RAD = math.pi / 180.0
FIX_3D = 3
EVENTS = frozenset({"PARM", "MSG", "VER", "MODE", "ARM", "EV"})
"""Messages that are looked at one by one."""
INSTANCE = ("C", "I")
"""Columns that number the instances of a sensor or filter; only the first one is read."""


class Missing(KeyError):
    """A message lacks a column that every version of it known here has, or holds words there."""


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
    }


def _numbered(source: str) -> Callable[[Columns], dict[str, Array]]:
    def read(c: Columns) -> dict[str, Array]:
        return {f"{source}.{n}": c[f"C{n}"] * 1.0 for n in range(1, 15) if f"C{n}" in c}

    return read


_EKF = _picked(
    ekf__x=("PN", 1.0), ekf__y=("PE", 1.0), ekf__z=("PD", 1.0), ekf__vn=("VN", 1.0), ekf__ve=("VE", 1.0),
    ekf__w=("VD", 1.0),
)  # fmt: skip

SIGNALS: Mapping[str, Callable[[Columns], dict[str, Array]]] = {
    "ATT": _picked(attitude__phi=("Roll", RAD), attitude__theta=("Pitch", RAD), attitude__psi=("Yaw", RAD)),
    "AHR2": _picked(ahrs2__phi=("Roll", RAD), ahrs2__theta=("Pitch", RAD), ahrs2__psi=("Yaw", RAD)),
    "RATE": _picked(rate__p=("R", RAD), rate__q=("P", RAD), rate__r=("Y", RAD)),
    "IMU": _picked(imu__p=("GyrX", 1.0), imu__q=("GyrY", 1.0), imu__r=("GyrZ", 1.0)),
    "STER": _picked(steering__r=("TurnRt", RAD)),
    "XKF1": _EKF,
    "NKF1": _EKF,
    "POS": _picked(global__lat=("Lat", 1.0), global__lon=("Lng", 1.0), global__z=("RelHomeAlt", -1.0)),
    "GPS": _gps,
    "CTUN": _picked(control__z=("Alt", -1.0)),
    "BARO": _picked(baro__z=("Alt", -1.0)),
    "RCOU": _numbered("servo"),
    "RCIN": _numbered("rc"),
}
"""Message -> sources on the tape, of arrays as of single numbers."""


def signals_of(kind: str, columns: Columns) -> dict[str, Array]:
    """Return the sources a *kind* of message brings, values of other instances than the first as NaN.

    Raises
    ------
    Missing
        It lacks a column.
    """
    try:
        found = {source: np.asarray(v, dtype=np.float64) for source, v in SIGNALS[kind](columns).items()}
    except (KeyError, TypeError, ValueError) as error:  # a damaged FMT makes words of numbers
        raise Missing(str(error)) from None
    for name in INSTANCE:
        if name in columns and columns[name].dtype == np.float64:
            found = {source: np.where(columns[name] == 0, values, np.nan) for source, values in found.items()}
    return found
