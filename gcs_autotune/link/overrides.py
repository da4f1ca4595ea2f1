"""Force fractions to RC_CHANNELS_OVERRIDE, so that the wanted fraction comes out of the autopilot's scaling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import Firmware
from gcs_autotune.link.parameters import Parameters
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["OverrideMap", "RcChannel", "read_override_map"]

_IGNORE = 65535
_RELEASE = 0
_CHANNELS = 8
_SMALLEST = 1e-3
"""Chosen: fractions below this are neutral; half a microsecond of 500."""


@dataclass(frozen=True, slots=True)
class RcChannel:
    """One RC input as the autopilot scales it: PWM [us] limits, trim, dead zone, and sign."""

    low: float
    trim: float
    high: float
    dead_zone: float = 0.0
    sign: float = 1.0

    def pwm(self, fraction: float) -> int:
        """Return the PWM [us] that the autopilot turns into *fraction* (-1..1, clipped)."""
        wanted = self.sign * max(-1.0, min(1.0, fraction))
        if abs(wanted) < _SMALLEST:
            return round(self.trim)
        limit = self.high if wanted > 0 else self.low
        span = abs(limit - self.trim) - self.dead_zone
        deflection = self.dead_zone + abs(wanted) * span
        return round(self.trim + (deflection if wanted > 0 else -deflection))


@dataclass(frozen=True, slots=True)
class OverrideMap:
    """Which RC channel (1-based) drives which force, and how."""

    channels: Mapping[str, tuple[int, RcChannel]]

    def message(self, command: Actuate, system: int, component: int) -> Message:
        """Return the override that commands *command*; channels that we do not drive are left alone."""
        values = [_IGNORE] * _CHANNELS
        for force, (number, channel) in self.channels.items():
            values[number - 1] = channel.pwm(getattr(command, force))
        return mavlink.MAVLink_rc_channels_override_message(system, component, *values)

    def release(self, system: int, component: int) -> Message:
        """Return the override that hands the channels that we drive back to the RC receiver."""
        values = [_IGNORE] * _CHANNELS
        for number, _ in self.channels.values():
            values[number - 1] = _RELEASE
        return mavlink.MAVLink_rc_channels_override_message(system, component, *values)


def read_override_map(parameters: Parameters, firmware: Firmware) -> OverrideMap:
    """Ask the vehicle how it scales its RC inputs and return the map.

    Raises
    ------
    PreconditionFailed
        Its RC limits leave no room, or its RC_OVERRIDE_TIME makes overrides useless or everlasting.
    """
    _check_expiry(parameters)
    fields = ("MIN", "TRIM", "MAX", "DZ", "REVERSED")
    names = {n: [f"RC{n}_{field}" for field in fields] for n in firmware.channels.values()}
    values = parameters.read_all(name for group in names.values() for name in group)
    channels = {}
    for force, number in firmware.channels.items():
        low, trim, high, dead_zone, is_reversed = (values[name] for name in names[number])
        dead_zone = dead_zone if firmware.manual_dead_zone else 0.0
        if not low + dead_zone < trim < high - dead_zone:
            raise PreconditionFailed(
                f"RC{number}_MIN {low:g}, TRIM {trim:g}, MAX {high:g}, DZ {dead_zone:g} leave no room on both "
                "sides of neutral: calibrate the radio first"
            )
        sign = firmware.channel_signs[force] * (-1.0 if is_reversed else 1.0)
        channels[force] = (number, RcChannel(low, trim, high, dead_zone, sign))
    return OverrideMap(channels)


def _check_expiry(parameters: Parameters) -> None:
    expiry = parameters.read_existing(["RC_OVERRIDE_TIME"]).get("RC_OVERRIDE_TIME")
    if expiry is not None and expiry <= 0:
        meaning = "ignores overrides" if expiry == 0 else "would hold the last override for ever if the link broke"
        raise PreconditionFailed(
            f"RC_OVERRIDE_TIME is {expiry:g}: the vehicle {meaning}. Set it to 3 (seconds) and try again"
        )
