"""How a vehicle's inputs and outputs are connected, as read from its parameters.

A force fraction is converted to RC_CHANNELS_OVERRIDE so that the autopilot's scaling results in the required fraction.
In the stabilised modes ArduSub's yaw stick commands a turn rate, outside a dead zone that the joystick gain scales.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import Firmware, ServoMap
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.mavlink import Message, mavlink

__all__ = ["OverrideMap", "RateStick", "RcChannel", "VehicleConfig", "read_override_map", "read_rate_stick", "why_deaf"]

_IGNORE = 65535
_RELEASE = 0
_CHANNELS = 8
_SMALLEST = 1e-3
"""Fraction below which a command counts as neutral: half a microsecond of 500. Project choice."""
_PROBE = 8
"""Offset of the probe overrides [us].

It shows in RC_CHANNELS but does not move the craft: it is inside a dead zone, or 2 % of a thruster that has its own
dead zone. A receiver's trim is unlikely to be off by exactly that on every channel. Project choice.
"""
_LONGEST_EXPIRY = 10.0
"""Longest time [s] for which a vehicle may keep the last override after a link loss.

A longer one is not flown. Project choice.
"""
_IGNORE_OVERRIDES = 2
"""Bit 1 of RC_OPTIONS: ignore overrides."""
_ENFORCE_SYSTEM = 1
"""Bit 0 of MAV_OPTIONS: accept only the configured system id."""
_OVERRIDE_SWITCH = 46
"""Value of RCn_OPTION for a switch that disables overrides."""
_RC_OPTION_CHANNELS = range(1, 17)


@dataclass(frozen=True, slots=True)
class RcChannel:
    """One RC input as the autopilot scales it: PWM [us] limits, trim, dead zone, and sign."""

    low: float
    trim: float
    high: float
    dead_zone: float = 0.0
    sign: float = 1.0

    def pwm(self, fraction: float) -> int:
        """Return the PWM [us] for *fraction* (-1..1, clipped)."""
        wanted = self.sign * max(-1.0, min(1.0, fraction))
        if abs(wanted) < _SMALLEST:
            return round(self.trim)
        limit = self.high if wanted > 0 else self.low
        span = abs(limit - self.trim) - self.dead_zone
        deflection = self.dead_zone + abs(wanted) * span
        return round(self.trim + (deflection if wanted > 0 else -deflection))


@dataclass(frozen=True, slots=True)
class OverrideMap:
    """Relation between forces and RC channels (1-based).

    ``channels``: force -> (channel that drives it, scaling of the channel).
    ``held``: other channel -> PWM [us] at which it is kept.
    """

    channels: Mapping[str, tuple[int, RcChannel]]
    held: Mapping[int, int] = field(default_factory=dict)

    def values(self, command: Actuate) -> dict[int, int]:
        """Return channel -> PWM [us] for *command*."""
        driven = {n: channel.pwm(getattr(command, force)) for force, (n, channel) in self.channels.items()}
        return {**self.held, **driven}

    @property
    def probe(self) -> dict[int, int]:
        """Channel -> PWM [us] of a nearly neutral but recognisable override."""
        return {n: pwm + _PROBE for n, pwm in self.values(Actuate()).items()}

    def message(self, values: Mapping[int, int], system: int, component: int) -> Message:
        """Return the override that sets *values* (channel -> PWM [us]); other channels are unchanged."""
        fields = [values.get(n, _IGNORE) for n in range(1, _CHANNELS + 1)]
        return mavlink.MAVLink_rc_channels_override_message(system, component, *fields)

    def release(self, system: int, component: int) -> Message:
        """Return the message that returns the overridden channels to the RC receiver."""
        return self.message(dict.fromkeys(self.values(Actuate()), _RELEASE), system, component)


def read_override_map(parameters: Parameters, firmware: Firmware) -> OverrideMap:
    """Read from the parameters how the vehicle scales its RC inputs, and return the relation between forces and
    channels.

    Raises
    ------
    PreconditionFailed
        Its RC limits leave no usable range, it ignores overrides, or it would keep the last one for ever.
    """
    settings = parameters.read_existing(["RC_OVERRIDE_TIME", "RC_OPTIONS", *firmware.rc_map.values()])
    _check_expiry(settings.get("RC_OVERRIDE_TIME"))
    if int(settings.get("RC_OPTIONS", 0.0)) & _IGNORE_OVERRIDES:
        raise PreconditionFailed(
            f"RC_OPTIONS is {settings['RC_OPTIONS']:g}: its bit 1 makes the vehicle ignore overrides. "
            f"Set it to {int(settings['RC_OPTIONS']) & ~_IGNORE_OVERRIDES} and try again"
        )
    numbers = {f: _channel(settings, firmware, f) for f in firmware.channels if f not in firmware.levelling}
    for force in firmware.levelling:
        number = int(settings.get(firmware.rc_map[force], firmware.channels[force]))
        if 1 <= number <= _CHANNELS and number not in numbers.values():
            numbers[force] = number
    fields = ("MIN", "TRIM", "MAX", "DZ", "REVERSED")
    names = {n: [f"RC{n}_{field}" for field in fields] for n in numbers.values()}
    values = parameters.read_all(name for group in names.values() for name in group)
    channels, held = {}, {}
    for force, number in numbers.items():
        low, trim, high, dead_zone, is_reversed = (values[name] for name in names[number])
        dead_zone = dead_zone if firmware.manual_dead_zone else 0.0
        if force in firmware.from_one_end and not settings.keys() & set(firmware.rc_map.values()):
            trim = _middle(number, low, trim, high, is_reversed != 0.0)
        if not low + dead_zone < trim < high - dead_zone:
            if force in firmware.levelling:
                held[number] = round(trim)
                continue
            raise PreconditionFailed(
                f"RC{number}_MIN {low:g}, TRIM {trim:g}, MAX {high:g}, DZ {dead_zone:g} leave no travel on both "
                "sides of neutral. Calibrate the radio first"
            )
        sign = firmware.channel_signs[force] * (-1.0 if is_reversed else 1.0)
        channels[force] = (number, RcChannel(low, trim, high, dead_zone, sign))
    return OverrideMap(channels, held)


def _middle(number: int, low: float, trim: float, high: float, is_reversed: bool) -> float:
    """Return the neutral PWM [us] of a stick whose trim is at its low end."""
    if trim != low or is_reversed:
        turned = f", RC{number}_REVERSED 0" if is_reversed else ""
        raise PreconditionFailed(
            f"RC{number}_TRIM is {trim:g}: this firmware scales the throttle stick from there to RC{number}_MAX "
            f"({high:g}), so neutral is not the middle of its travel. Set RC{number}_TRIM {low:g}{turned} and try again"
        )
    return 0.5 * (low + high)


def _channel(values: Mapping[str, float], firmware: Firmware, force: str) -> int:
    """Return the RC channel of *force* as mapped on the vehicle, else the firmware's default."""
    name = firmware.rc_map.get(force, "")
    number = int(values.get(name, firmware.channels[force]))
    if not 1 <= number <= _CHANNELS:
        raise PreconditionFailed(
            f"{name} is {number}, but overrides reach only channels 1 to {_CHANNELS}. Map it to one of these"
        )
    return number


def _check_expiry(expiry: float | None) -> None:
    if expiry is None or 0.0 < expiry <= _LONGEST_EXPIRY:
        return
    if expiry == 0.0:
        meaning = "ignores overrides"
    elif expiry < 0.0:
        meaning = "would hold the last override forever after a loss of the link"
    else:
        meaning = f"would hold the last override for {expiry:g} s after a loss of the link"
    raise PreconditionFailed(
        f"RC_OVERRIDE_TIME is {expiry:g}: the vehicle {meaning}. Set it to 3 (seconds) and try again"
    )


def why_deaf(parameters: Parameters, firmware: Firmware, source_system: int) -> str:
    """Return one sentence on why the vehicle probably ignores our overrides, with the remedy."""
    switches = [f"RC{n}_OPTION" for n in _RC_OPTION_CHANNELS]
    names = [*firmware.gcs_id_parameters, "MAV_GCS_SYSID_HI", "MAV_OPTIONS", "RC_OPTIONS", "RC_OVERRIDE_TIME"]
    values = parameters.read_existing([*names, *switches])
    if not values:
        return "the vehicle does not answer requests either: the uplink is broken (a one-way link, or a weak radio)"
    name = next((n for n in firmware.gcs_id_parameters if n in values), "")
    low, high = int(values.get(name, source_system)), int(values.get("MAV_GCS_SYSID_HI", 0.0))
    if not low <= source_system <= max(low, high):
        return f"{name} is {low}, but this tool's system id is {source_system}. Use --source-system {low}"
    if int(values.get("RC_OPTIONS", 0.0)) & _IGNORE_OVERRIDES:
        return f"RC_OPTIONS is {values['RC_OPTIONS']:g}: its bit 1 makes the vehicle ignore overrides. Clear this bit"
    if values.get("RC_OVERRIDE_TIME", 3.0) == 0.0:
        return "RC_OVERRIDE_TIME is 0, so the vehicle ignores overrides. Set it to 3 (seconds)"
    switch = next((n for n in switches if values.get(n) == _OVERRIDE_SWITCH), "")
    if switch:
        return (
            f"{switch} is {_OVERRIDE_SWITCH}: this transmitter switch disables overrides. Set it to its other position"
        )
    signed = "; MAV_OPTIONS bit 0 is set" if int(values.get("MAV_OPTIONS", 0.0)) & _ENFORCE_SYSTEM else ""
    return (
        f"its parameters show no reason ({name or 'station id'} {low}, RC_OPTIONS {values.get('RC_OPTIONS', 0.0):g}"
        f"{signed}). Check for a router that filters RC_CHANNELS_OVERRIDE, a signed link, or another station's stream"
    )


_FULL_STICK = math.radians(45.0)
"""Yaw input of a full stick [rad/s] before ACRO_YAW_P is applied. Measured: 152 deg/s at ACRO_YAW_P 3.375."""
_USUAL_GAIN = 0.5
_NAMES = ("ACRO_YAW_P", "RC4_DZ", "RC4_MAX", "RC4_TRIM", "JS_GAIN_DEFAULT")


@dataclass(frozen=True, slots=True)
class RateStick:
    """Scaling of the yaw stick in ArduSub's stabilised modes.

    ``full_rate`` [rad/s]: turn rate of a full stick. ``dead_zone``: fraction of the stick's travel at joystick gain 1.
    ``usual_gain``: the joystick gain assumed until the vehicle reports another.
    """

    full_rate: float
    dead_zone: float
    usual_gain: float = _USUAL_GAIN

    def deflection(self, rate: float, gain: float) -> float:
        """Return the stick position (-1 to 1) that commands *rate* [rad/s] at joystick *gain* (NaN: unknown)."""
        if rate == 0.0:
            return 0.0
        dead = self.dead_zone * (gain if math.isfinite(gain) else self.usual_gain)
        size = dead + abs(rate) / self.full_rate * (1.0 - dead)
        return math.copysign(min(size, 1.0), rate)


def read_rate_stick(parameters: Parameters, firmware: Firmware) -> RateStick | None:
    """Return the scaling of the yaw stick, read from the parameters. None for a vehicle that takes turn rates
    as targets.
    """
    if not firmware.turns_by_stick:
        return None
    known = parameters.read_existing(_NAMES)
    travel = known.get("RC4_MAX", 1900.0) - known.get("RC4_TRIM", 1500.0)
    return RateStick(
        _FULL_STICK * known.get("ACRO_YAW_P", 3.375),
        known.get("RC4_DZ", 40.0) / travel if travel > 0.0 else 0.0,
        known.get("JS_GAIN_DEFAULT", _USUAL_GAIN),
    )


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """How a vehicle is wired, as read from its parameters.

    ``full_speed`` [m/s]: speed commanded by full thrust in guided mode (WP_SPEED); 0 if there is none. ``loop_period``
    [s]: period of the autopilot's main loop; 0 if unknown. ``rate_lag`` [s]: delay of turn rates in its gyro filter.
    ``rate_stick``: turn rate commanded by the yaw stick in the stabilised modes; None if targets are used instead
    (boats).
    """

    overrides: OverrideMap
    servos: ServoMap
    full_speed: float = 0.0
    loop_period: float = 0.0
    rate_lag: float = 0.0
    rate_stick: RateStick | None = None
