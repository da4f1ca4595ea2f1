"""The shape of a firmware entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

from gcs_autotune.axes import AxisKind, Excitation, axis_kind
from gcs_autotune.firmware.aliases import ALIASES
from gcs_autotune.firmware.failsafe import Failsafe
from gcs_autotune.firmware.names import Names

__all__ = ["Axis", "Firmware", "FixedOutputs", "Gain", "Unsuited", "pid_context"]


def pid_context(prefix: str) -> tuple[str, ...]:
    """Return the parameters of an AC_PID *prefix* other than its gains: limit of the integral, filters."""
    return tuple(f"{prefix}_{suffix}" for suffix in ("IMAX", "FLTT", "FLTE", "FLTD"))


@dataclass(frozen=True, slots=True)
class Gain:
    """One tunable parameter, with the range its vendor documents."""

    parameter: str
    low: float
    high: float
    meaning: str


@dataclass(frozen=True, slots=True)
class Unsuited:
    """A setting of vehicles that this firmware drives otherwise than we could: ``values`` of ``parameter``, and why
    with the cure."""

    parameter: str
    values: Sequence[int]
    why: str


@dataclass(frozen=True, slots=True)
class FixedOutputs:
    """How a firmware drove its outputs before SERVOn_FUNCTION: a force on the output of its RC channel's number.

    Attributes
    ----------
    last : (major, minor) of the last version that still had parameters of this time.
    skid_parameter : not zero where two side thrusters steer.
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
    context : other parameters the law needs to know (limits, filters, scalings); read, never written.
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
        """The row of ``axes.AXES``."""
        return axis_kind(self.name)

    @property
    def dof(self) -> str:
        """Name in ``sname.DOFS`` of the motion identified."""
        return self.kind.dof

    @property
    def excitation(self) -> Excitation:
        """How it is identified."""
        return self.kind.excitation

    @property
    def steers_by_way(self) -> bool:
        """Whether it turns the craft with a force that depends on throttle or speed."""
        return self.needs_speed and not self.excitation.by_throttle

    def called(self, names: Names) -> Self:
        """Return this axis on a vehicle with those *names*: its ranges are the ones documented for them."""
        gains = []
        for gain in self.gains:
            low, high = names.limits(gain.parameter, gain.low, gain.high)
            gains.append(replace(gain, low=low, high=high))
        return replace(self, gains=tuple(gains), names=names)


@dataclass(frozen=True, slots=True)
class Firmware:
    """The profile of one autopilot firmware.

    ``channels`` maps a force name to the RC channel (1-based) that RC_CHANNELS_OVERRIDE drives in
    ``manual_mode``; how far is read from the vehicle's own RCn parameters. ``mixing`` maps a frame
    (value of ``frame_parameter``) to the motors' factors per force; firmwares that route outputs by
    ``SERVOn_FUNCTION`` use ``servo_functions`` (function number -> force name) instead, or, with two side
    thrusters, ``skid_functions`` (function number -> factor per force).
    ``rc_map`` maps a force name to the parameter that moves its channel elsewhere (RCMAP_*), and ``idle`` maps those
    of sticks that ``manual_mode`` listens to although we drive nothing with them to their channels where there is no
    such parameter: they are kept at neutral. ``from_one_end`` are the forces whose stick counts from RCn_TRIM, at
    RCn_MIN, to RCn_MAX, neutral in the middle, where there is none of the parameters of ``rc_map``.
    ``mission_mode`` flies the stored mission; empty where ours knows none.
    ``manual_dead_zone`` says whether ``manual_mode`` applies the channel's dead zone ``RCn_DZ``.
    ``fixed_outputs`` says how versions before SERVOn_FUNCTION were wired, None where none of ours ever was.
    ``unsuited`` are the settings of vehicles that cannot be worked with, looked at before anything else.

    ``failsafes`` are those that act when nothing is heard of the ground station; ``stops_in`` are the modes in which
    nothing is driven, whoever ordered them. ``boots_in`` is the parameter with the number of the mode after a restart,
    and that number where there is no such parameter.

    What such craft can do: ``needs_way``: they steer under way only, at their cruise, and so need room to turn about;
    ``floats``: they have no depth; ``needs_position``: ``hold_mode`` is refused without a position estimate;
    ``holds_itself``: ``hold_mode`` keeps depth and heading with the sticks at rest; ``turns_by_stick``: a turn rate is
    asked by the yaw stick, not by a target. Nothing outside asks for ``kind``, which is a word for people.
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
    idle: Mapping[str, int] = field(default_factory=dict)
    from_one_end: Sequence[str] = ()
    mission_mode: str = ""
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
        """Return the name of a custom mode number, or ``MODE n`` when it is not in the table."""
        return next((name for name, number in self.modes.items() if number == custom_mode), f"MODE {custom_mode}")

    def misfit(self, values: Mapping[str, float]) -> str:
        """Return why a vehicle with these parameter *values* cannot be worked with, and the cure; empty when it can."""
        for case in self.unsuited:
            value = values.get(case.parameter)
            if value in case.values:
                return f"{case.parameter} is {value:g}: {case.why}"
        return ""
