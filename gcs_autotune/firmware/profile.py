"""The classes that describe a firmware."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

from gcs_autotune.axes import AxisKind, Excitation, axis_kind
from gcs_autotune.firmware.aliases import ALIASES
from gcs_autotune.firmware.failsafe import Failsafe
from gcs_autotune.firmware.names import Names

__all__ = ["Axis", "Firmware", "FixedOutputs", "Gain", "Unsuited", "pid_context"]


def pid_context(prefix: str) -> tuple[str, ...]:
    """Return the parameters of an AC_PID *prefix* other than its gains: the limit of the integral and the filters."""
    return tuple(f"{prefix}_{suffix}" for suffix in ("IMAX", "FLTT", "FLTE", "FLTD"))


@dataclass(frozen=True, slots=True)
class Gain:
    """A tunable parameter with its documented range and the firmware's ``default`` (NaN if unknown)."""

    parameter: str
    low: float
    high: float
    meaning: str
    default: float = math.nan


@dataclass(frozen=True, slots=True)
class Unsuited:
    """A vehicle setting that is not supported: the unsupported ``values`` of a ``parameter``, and the reason with its
    remedy.
    """

    parameter: str
    values: Sequence[int]
    why: str


@dataclass(frozen=True, slots=True)
class FixedOutputs:
    """Outputs of a firmware before SERVOn_FUNCTION: each force is on the output with the number of its RC channel.

    Attributes
    ----------
    last : (major, minor) of the last version with such parameters.
    skid_parameter : parameter that is not zero if two side thrusters steer.
    skid : force -> SERVOn_FUNCTION of the thruster on that force's channel.
    marks : pattern of whole names of parameters that only such versions have.
    """

    last: tuple[int, int]
    skid_parameter: str
    skid: Mapping[str, int]
    marks: str


@dataclass(frozen=True, slots=True)
class Axis:
    """One loop of this firmware that ``tune`` can tune.

    Attributes
    ----------
    law : name in ``design.LAWS`` of the autopilot's control structure.
    gains : the parameters that may be changed.
    context : other parameters that the law depends on (limits, filters, scalings); read, never written.
    needs_speed : whether the actuator needs speed to have an effect (a rudder).
    names : the vehicle's names of ``gains`` and ``context``, which are canonical; see :meth:`called`.
    """

    name: str
    law: str
    gains: Sequence[Gain]
    context: Sequence[str]
    needs_speed: bool = False
    names: Names = field(default_factory=Names)

    @property
    def kind(self) -> AxisKind:
        """The entry of the axis in ``axes.AXES``."""
        return axis_kind(self.name)

    @property
    def dof(self) -> str:
        """Degree of freedom that is identified, by its name in ``sname.DOFS``."""
        return self.kind.dof

    @property
    def excitation(self) -> Excitation:
        """Settings by which the axis is identified."""
        return self.kind.excitation

    @property
    def steers_by_way(self) -> bool:
        """Whether the axis turns the craft with a force that depends on throttle or speed."""
        return self.needs_speed and not self.excitation.by_throttle

    def called(self, names: Names) -> Self:
        """Return this axis with the parameter *names* of a vehicle, and the ranges documented for these names."""
        gains = []
        for gain in self.gains:
            low, high = names.limits(gain.parameter, gain.low, gain.high)
            gains.append(replace(gain, low=low, high=high))
        return replace(self, gains=tuple(gains), names=names)


@dataclass(frozen=True, slots=True)
class Firmware:
    """The profile of one autopilot firmware.

    ``channels`` maps a force name to the RC channel (1-based) that RC_CHANNELS_OVERRIDE drives in ``manual_mode``. Its
    scaling is read from the vehicle's own RCn parameters. ``mixing`` maps a frame (value of ``frame_parameter``) to the
    motors' factors per force. Firmwares that route outputs by ``SERVOn_FUNCTION`` use ``servo_functions`` (function
    number -> force name) instead, or, with two side thrusters, ``skid_functions`` (function number -> factor per
    force). ``rc_map`` maps a force name to the parameter that changes its channel (RCMAP_*). ``levelling`` are
    forces that few manoeuvres need. Their sticks are kept at neutral if they are not calibrated, and left alone if
    ``rc_map`` maps them to another force's channel or to none. ``from_one_end`` are the forces whose stick ranges
    from RCn_TRIM, at RCn_MIN, to RCn_MAX, with neutral in the middle, if the parameters of ``rc_map`` do not exist.
    ``manual_dead_zone``: whether ``manual_mode`` applies the channel's dead zone ``RCn_DZ``. ``fixed_outputs``: wiring
    of versions before SERVOn_FUNCTION; None if there are none. ``unsuited``: vehicle settings that are not supported,
    checked first.
    ``mission_mode``: the mode that flies the stored mission; empty if this program knows none. ``position_mode``: the
    mode that goes to commanded positions and stays there. ``push_mode``: the mode that holds a position while sticks up
    to a tenth of their range push the craft; empty if there is none.

    ``failsafes``: those that act on the loss of the ground station. ``stops_in``: the modes in which nothing is driven,
    whoever commanded them. ``boots_in``: the parameter with the number of the mode after a restart, and that number if
    there is no such parameter.

    Properties of such craft: ``needs_way``: they steer only under way, at cruise speed, and so need space to turn
    around. ``floats``: they have no depth. ``needs_position``: ``hold_mode`` is rejected without a position estimate.
    ``holds_itself``: ``hold_mode`` holds depth and heading with the sticks at rest. ``turns_by_stick``: a turn rate is
    commanded by the yaw stick, not by a target. ``kind`` is used only in texts.
    """

    name: str
    autopilot: int
    vehicle_types: Sequence[int]
    kind: str
    modes: Mapping[str, int]
    manual_mode: str
    rest_mode: str
    hold_mode: str
    channels: Mapping[str, int]
    channel_signs: Mapping[str, float]
    neutral_pwm: int
    axes: Mapping[str, Axis]
    gcs_id_parameters: Sequence[str] = ("MAV_GCS_SYSID", *(alias.name for alias in ALIASES["MAV_GCS_SYSID"]))
    servo_functions: Mapping[int, str] = field(default_factory=dict)
    skid_functions: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    frame_parameter: str = ""
    mixing: Mapping[int, Sequence[Mapping[str, float]]] = field(default_factory=dict)
    motor_span: float = 500.0
    manual_dead_zone: bool = False
    rc_map: Mapping[str, str] = field(default_factory=dict)
    levelling: Sequence[str] = ()
    from_one_end: Sequence[str] = ()
    mission_mode: str = ""
    position_mode: str = ""
    push_mode: str = ""
    fixed_outputs: FixedOutputs | None = None
    unsuited: Sequence[Unsuited] = ()
    failsafes: Sequence[Failsafe] = ()
    stops_in: Sequence[str] = ()
    boots_in: tuple[str, float] = ("INITIAL_MODE", 0.0)
    needs_way: bool = False
    floats: bool = False
    needs_position: bool = False
    holds_itself: bool = False
    turns_by_stick: bool = False

    def mode_name(self, custom_mode: int) -> str:
        """Return the name of a custom mode number, or ``MODE n`` if it is not in the table."""
        return next((name for name, number in self.modes.items() if number == custom_mode), f"MODE {custom_mode}")

    def misfit(self, values: Mapping[str, float]) -> str:
        """Return why a vehicle with the parameter *values* is not supported, with the remedy; empty if it is."""
        for case in self.unsuited:
            value = values.get(case.parameter)
            if value in case.values:
                return f"{case.parameter} is {value:g}: {case.why}"
        return ""
