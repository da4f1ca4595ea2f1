"""Share the capacity of a link among the requested messages, in order of need.

A 57600 baud telemetry radio carries three to four kilobytes a second at best, or half of that in poor conditions. A
full link loses messages at random. This module decides which messages to reduce.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.link.vehicle.latency import least_period

__all__ = ["CHATTER", "FASTER", "USUAL_SIZE", "Demand", "least", "plan", "shortfall"]

FASTER = "Use a faster link (a higher baud rate, a better radio), or close other programs on this one"
USUAL_SIZE = 40.0
"""Assumed size [bytes] of a message until one has arrived."""

_SHARE = 0.8
"""Fraction of a full link's measured capacity that is used.

The rest is for commands, parameters and fading. Project choice.
"""

_ORDER = (
    "ATTITUDE",
    "SERVO_OUTPUT_RAW",
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "RC_CHANNELS",
    "SYS_STATUS",
    "VFR_HUD",
)
"""Messages in order of priority: control, outputs, position, other stations, battery, speed."""

_FLOORS: Mapping[str, float] = {
    "ATTITUDE": 5.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "GLOBAL_POSITION_INT": 2.0,
    "LOCAL_POSITION_NED": 2.0,
    "RC_CHANNELS": 2.0,
    "SYS_STATUS": 0.5,
    "VFR_HUD": 1.0,
}
"""Message -> rate [Hz] granted to it before any message gets more. Project choice.

A relay needs five attitudes a second, and its switching times come from the outputs. A boat at 2 m/s moves a metre
between two positions. The movement of a stick is detected within two seconds.
"""

_FLOOR = 0.5

CHATTER = frozenset(
    {
        "AHRS",
        "AHRS2",
        "AHRS3",
        "BATTERY_STATUS",
        "DISTANCE_SENSOR",
        "EKF_STATUS_REPORT",
        "ESC_TELEMETRY_1_TO_4",
        "ESC_TELEMETRY_5_TO_8",
        "GIMBAL_DEVICE_ATTITUDE_STATUS",
        "GPS2_RAW",
        "HWSTATUS",
        "MEMINFO",
        "NAV_CONTROLLER_OUTPUT",
        "POWER_STATUS",
        "RANGEFINDER",
        "RAW_IMU",
        "RC_CHANNELS_SCALED",
        "SCALED_IMU2",
        "SCALED_IMU3",
        "SCALED_PRESSURE",
        "SCALED_PRESSURE3",
        "SIMSTATE",
        "TERRAIN_REPORT",
        "VIBRATION",
    }
)
"""Messages that ArduPilot streams by default and that a tuning run does not need."""


@dataclass(frozen=True, slots=True)
class Demand:
    """A requested message: ``rate`` [Hz], ``size`` [bytes], and ``needed`` [Hz], the lowest useful rate."""

    name: str
    rate: float
    size: float
    needed: float = 0.0

    @property
    def floor(self) -> float:
        """Rate [Hz] granted to this message before any other message gets more than its minimum."""
        return min(self.rate, max(self.needed, _FLOORS.get(self.name, _FLOOR)))


def least(demands: Sequence[Demand]) -> float:
    """Return the capacity [bytes/s] that the minimum rates of *demands* need. With less capacity nothing can be
    flown.
    """
    return sum(d.floor * d.size for d in demands)


def shortfall(carried: float, demands: Sequence[Demand], about: str = "") -> str:
    """Return a sentence on a link that carries *carried* [bytes/s] while *demands* need more; *about* precedes their
    number.

    The capacity is also given as the shortest oscillation period that it allows, with all messages reduced equally.
    """
    needed, wanted = least(demands), ", ".join(f"{d.name} {d.floor:.3g} Hz" for d in demands)
    period = least_period(math.nan, next((d.floor for d in demands if d.name == "ATTITUDE"), 0.0))
    shortage = f"it carries {carried:.0f} bytes/s, but an experiment needs at least {about}{needed:.0f} ({wanted})"
    if not 0.0 < carried < needed or period <= 0.0:
        return shortage
    return (
        f"{shortage} to record an oscillation with a period of {period:.1f} s. Its shortest period is "
        f"{period * needed / carried:.1f} s"
    )


def plan(
    demands: Sequence[Demand], chatter: Mapping[str, float], capacity: float
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return (message -> rate [Hz] that fits, names of the *chatter* messages that have to be switched off).

    chatter : message -> bytes per second of messages streamed without a request. capacity : bytes per second.

    Streamed messages stay unchanged as long as the minimum rates fit.
    """
    room = _SHARE * capacity - sum(chatter.values())
    hushed: list[str] = []
    floors = least(demands)
    for name in sorted(chatter, key=lambda n: -chatter[n]):
        if room >= floors:
            break
        room += chatter[name]
        hushed.append(name)
    rates = {d.name: d.floor for d in demands}
    room -= floors
    for d in sorted(demands, key=_rank):
        if room <= 0.0:
            break
        extra = min(d.rate - d.floor, room / d.size)
        rates[d.name] += extra
        room -= extra * d.size
    return rates, tuple(hushed)


def _rank(demand: Demand) -> int:
    return _ORDER.index(demand.name) if demand.name in _ORDER else len(_ORDER)
