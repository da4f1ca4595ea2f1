"""From a tape to channels: which source to believe, globe to map, map to body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.frames import flat, to_body
from gcs_autotune.logs.tape import Tape
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel

__all__ = ["motion_channels"]

Array = NDArray[np.float64]

ENOUGH = 20
"""Fewest samples that make a source worth preferring."""

ATTITUDES = ("attitude", "ahrs2")
"""Sources of ``phi theta psi``, preferred first: the estimate the autopilot steers by, then its second one."""
POSITIONS = ("local", "ekf", "global", "gps")
"""Sources of ``x y`` and of velocity over ground, preferred first; never mixed, because their origins differ."""
DEPTHS = ("global", "local", "ekf", "control", "ahrs2", "pressure", "baro")
"""Sources of ``z``, preferred first."""
RATES = ("attitude", "rate", "imu", "steering")
"""Sources of ``p q r``, preferred first, but those that carry a stamp of their own before those that do not."""
SPEEDS = ("hud", "gps")
"""Sources of ``U`` when no velocity over ground is there."""


@dataclass(frozen=True, slots=True)
class _Pick:
    """The sources chosen, for the run's meta data."""

    channels: dict[str, Channel]
    sources: dict[str, str]


def motion_channels(tape: Tape) -> tuple[dict[str, Channel], dict[str, str]]:
    """Return the motion channels of a whole tape and, per channel, the source it came from.

    ``psi`` stays wrapped as recorded; ``u v`` are velocity over ground turned by the heading at their own stamps.
    """
    pick = _Pick({}, {})
    for source in ATTITUDES:
        if _has(tape, f"{source}.psi"):
            for name in ("phi", "theta", "psi"):
                _put(pick, name, source, *tape.series(f"{source}.{name}"))
            break
    rates = [s for s in RATES if _has(tape, f"{s}.r")]
    for source in sorted(rates, key=lambda s: s in tape.dated_by_arrival)[:1]:
        for name in "pqr":
            _put(pick, name, source, *tape.series(f"{source}.{name}"))
    _position(pick, tape)
    _depth(pick, tape)
    return pick.channels, pick.sources


def _position(pick: _Pick, tape: Tape) -> None:
    for source in POSITIONS:
        if _has(tape, f"{source}.x"):
            t, x = tape.series(f"{source}.x")
            y = tape.series(f"{source}.y")[1]
        elif _has(tape, f"{source}.lat"):
            t, lat = tape.series(f"{source}.lat")
            lon = tape.series(f"{source}.lon")[1]
            x, y = flat(lat, lon, (float(lat[0]), float(lon[0])))
        else:
            continue
        if np.ptp(x) == 0.0 and np.ptp(y) == 0.0:
            continue
        _put(pick, "x", source, t, x)
        _put(pick, "y", source, t, y)
        _velocity(pick, tape, source)
        break
    if "U" not in pick.channels:
        for source in SPEEDS:
            if _has(tape, f"{source}.U"):
                _put(pick, "U", source, *tape.series(f"{source}.U"))
                break


def _velocity(pick: _Pick, tape: Tape, source: str) -> None:
    if not _has(tape, f"{source}.vn"):
        return
    t, north = tape.series(f"{source}.vn")
    east = tape.series(f"{source}.ve")[1]
    _put(pick, "U", source, t, np.hypot(north, east))
    psi = pick.channels.get("psi")
    if psi is None or len(psi) < 2:
        return
    inside = (t >= psi.t[0] - 1.0) & (t <= psi.t[-1] + 1.0)
    heading = np.interp(t[inside], psi.t, np.unwrap(psi.values))
    u, v = to_body(north[inside], east[inside], heading)
    _put(pick, "u", source, t[inside], u)
    _put(pick, "v", source, t[inside], v)


def _depth(pick: _Pick, tape: Tape) -> None:
    there = [s for s in DEPTHS if _has(tape, f"{s}.z")]
    moving = [s for s in there if np.ptp(tape.series(f"{s}.z")[1]) > 0.0]
    for source in (moving or there)[:1]:
        _put(pick, "z", source, *tape.series(f"{source}.z"))
        if _has(tape, f"{source}.w"):
            _put(pick, "w", source, *tape.series(f"{source}.w"))


def _has(tape: Tape, source: str) -> bool:
    return source in tape and len(tape.series(source)[0]) >= ENOUGH


def _put(pick: _Pick, name: str, source: str, t: Array, values: Array) -> None:
    if len(t):
        pick.channels[name] = Channel(name, SIGNALS[name][0], t, values)
        pick.sources[name] = source
