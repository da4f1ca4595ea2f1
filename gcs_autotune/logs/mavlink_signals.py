"""Which MAVLink message brings which sources, in SI: one table. Degrees, centimetres and hectopascals end here.

SIMSTATE, SIM_STATE and the like are not in it: what a simulator knows no craft measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

__all__ = ["BOOT_MS", "BOOT_US", "SIGNALS", "TRUTH", "sticks"]

Message: TypeAlias = Any

BOOT_MS = frozenset(
    {
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "GLOBAL_POSITION_INT",
        "SCALED_PRESSURE2",
        "SCALED_PRESSURE",
        "SYSTEM_TIME",
        "RC_CHANNELS",
    }
)
"""Messages whose ``time_boot_ms`` is the autopilot's own."""
BOOT_US = frozenset({"SERVO_OUTPUT_RAW", "GPS_RAW_INT"})
"""Messages whose ``time_usec`` ArduPilot counts from its boot too (32 bits of it in SERVO_OUTPUT_RAW)."""
TRUTH = frozenset({"SIMSTATE", "SIM_STATE", "SIM", "SIM2"})
"""What only a simulator can tell: listed, never used."""

NO_PULSE = 0.0
"""Of outputs 9 to 16, which MAVLink 1 does not have."""
FIX_3D = 3
UNKNOWN = 65535


def _attitude(m: Message) -> dict[str, float]:
    return {
        "attitude.phi": m.roll,
        "attitude.theta": m.pitch,
        "attitude.psi": m.yaw,
        "attitude.p": m.rollspeed,
        "attitude.q": m.pitchspeed,
        "attitude.r": m.yawspeed,
    }


def _ahrs2(m: Message) -> dict[str, float]:
    return {"ahrs2.phi": m.roll, "ahrs2.theta": m.pitch, "ahrs2.psi": m.yaw, "ahrs2.z": -m.altitude}


def _local(m: Message) -> dict[str, float]:
    return {"local.x": m.x, "local.y": m.y, "local.z": m.z, "local.vn": m.vx, "local.ve": m.vy, "local.w": m.vz}


def _global(m: Message) -> dict[str, float]:
    found = {"global.z": -m.relative_alt * 1e-3, "global.w": m.vz * 1e-2}
    if m.lat != 0 or m.lon != 0:
        found |= {"global.lat": m.lat * 1e-7, "global.lon": m.lon * 1e-7}
        found |= {"global.vn": m.vx * 1e-2, "global.ve": m.vy * 1e-2}
    return found


def _gps(m: Message) -> dict[str, float]:
    if m.fix_type < FIX_3D or UNKNOWN in (m.vel, m.cog):
        return {}
    speed, course = m.vel * 1e-2, math.radians(m.cog * 1e-2)
    return {
        "gps.lat": m.lat * 1e-7,
        "gps.lon": m.lon * 1e-7,
        "gps.U": speed,
        "gps.vn": speed * math.cos(course),
        "gps.ve": speed * math.sin(course),
    }


def _servos(m: Message) -> dict[str, float]:
    if m.port != 0:
        return {}
    found = {f"servo.{n}": float(getattr(m, f"servo{n}_raw")) for n in range(1, 9)}
    return found | {f"servo.{n}": float(getattr(m, f"servo{n}_raw", NO_PULSE)) for n in range(9, 17)}


def _rc(m: Message) -> dict[str, float]:
    values = {n: float(getattr(m, f"chan{n}_raw")) for n in range(1, 9)}
    return {f"rc.{n}": v for n, v in values.items() if 0.0 < v < UNKNOWN}


def sticks(m: Message) -> dict[str, float]:
    """Return ArduSub's sticks of a MANUAL_CONTROL: z runs from 0 to 1000 with 500 in the middle, up positive."""
    return {
        "stick.X": m.x * 1e-3,
        "stick.Y": m.y * 1e-3,
        "stick.Z": -(m.z - 500) / 500.0,
        "stick.N": m.r * 1e-3,
    }


SIGNALS: Mapping[str, Callable[[Message], dict[str, float]]] = {
    "ATTITUDE": _attitude,
    "LOCAL_POSITION_NED": _local,
    "GLOBAL_POSITION_INT": _global,
    "GPS_RAW_INT": _gps,
    "SERVO_OUTPUT_RAW": _servos,
    "RC_CHANNELS": _rc,
    "VFR_HUD": lambda m: {"hud.U": m.groundspeed},
    "AHRS2": _ahrs2,
    "SCALED_PRESSURE2": lambda m: {"pressure.z": (m.press_abs - 1013.25) * 100.0 / (1000.0 * 9.80665)},
}
"""Message -> sources on the tape."""
