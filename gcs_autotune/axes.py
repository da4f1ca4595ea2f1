"""The definition of an axis in three tables, each of which refers to the next one.

:data:`AXES` contains the control loop, :data:`EXCITATIONS` how its motion is identified, and ``sname.DOFS`` the names
of that motion.

The firmware profile (``Firmware.axes``) adds the control law and the gains of each firmware for an axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs_autotune.sname import DOFS, Dof

__all__ = [
    "AXES",
    "EXCITATIONS",
    "OTHER_NAMES",
    "OWN_AXES",
    "SIGNAL_FORCES",
    "AxisKind",
    "Excitation",
    "axis_kind",
    "excitation_of",
    "position_axis",
]

_SPEED = {"LOCAL_POSITION_NED": 10.0, "GLOBAL_POSITION_INT": 5.0}
_PULSES = "a small pulse in each direction to check the response, then "


@dataclass(frozen=True, slots=True)
class Excitation:
    """Settings by which one degree of freedom is identified. The numbers are project choices for craft of half a metre
    to a few metres.

    Attributes
    ----------
    least_hysteresis : smallest hysteresis of a relay on it [rad or m].
    title : name of the oscillating motion, for texts.
    check : announcement of the actuator check.
    check_reach, check_time : a pulse of the check ends at this fraction of ``least_hysteresis``, or after this time
    [s]. by_throttle : whether throttle drives the degree of freedom, so that a craft under way is identified by
    throttle steps.
    below_surface : whether it can only be excited under water. turns : whether the force along it steers the craft.
    """

    dof: str
    least_hysteresis: float
    title: str
    check: str
    check_reach: float = 1.0
    check_time: float = 6.0
    by_throttle: bool = False
    below_surface: bool = False
    turns: bool = False

    @property
    def names(self) -> Dof:
        """The degree of freedom, with the names of its signals and parameters."""
        return DOFS[self.dof]

    @property
    def signal(self) -> str:
        """Feedback signal of the relay: ``x`` is the integral of the speed ahead, ``y`` of the sideways speed."""
        return self.names.position


EXCITATIONS: Mapping[str, Excitation] = {
    e.dof: e
    for e in (
        # A yaw time constant of 8 s shows 0.4 of its rate in 4 s.
        Excitation("yaw", math.radians(10.0), "heading", _PULSES, check_reach=0.6, check_time=4.0, turns=True),
        Excitation("heave", 0.15, "depth", _PULSES, below_surface=True),
        Excitation("surge", 0.3, "speed", "a pulse ahead to check the response, then ", by_throttle=True),
        Excitation("sway", 0.3, "sideways speed", _PULSES),
        # A BlueROV2 rolls by 3 deg in 0.3 s at 0.3 of full output, and turns over at full output.
        Excitation("roll", math.radians(3.0), "roll", _PULSES, below_surface=True),
        Excitation("pitch", math.radians(3.0), "pitch", _PULSES, below_surface=True),
    )
}
"""Degree of freedom -> settings by which it is identified."""


@dataclass(frozen=True, slots=True)
class AxisKind:
    """One axis that commands can tune or identify.

    Attributes
    ----------
    dof : name of its degree of freedom. stepped : the signal of the step that proves its gains.
    step, step_duration : size [SI, rad] and duration [s] of the step, each way; NaN if chosen for the craft.
    rates : message that contains the signal, in addition to ATTITUDE -> rate [Hz] that its experiments need.
    calmed : width of the centred mean that smooths the noisy stepped signal [s].
    guessed_duration : expected duration of a step, each way, if chosen for the craft [s]; for the announcement.
    example : the simulated vehicle used by default.
    """

    name: str
    dof: str
    stepped: str
    step: float = math.nan
    step_duration: float = math.nan
    rates: Mapping[str, float] = field(default_factory=dict)
    calmed: float = 0.0
    guessed_duration: float = math.nan
    example: str = "sitl:charlie"

    @property
    def excitation(self) -> Excitation:
        """Settings by which the axis' degree of freedom is identified."""
        return EXCITATIONS[self.dof]

    @property
    def names(self) -> Dof:
        """The axis' degree of freedom, with the names of its signals and parameters."""
        return DOFS[self.dof]

    @property
    def angular(self) -> bool:
        """Whether steps and hystereses of the axis are typed in degrees."""
        return self.names.angular

    @property
    def controls_velocity(self) -> bool:
        """Whether the axis' loop controls a speed or a turn rate. The step is then flown about the measured
        steady value.
        """
        return self.stepped != self.names.position


AXES: Mapping[str, AxisKind] = {
    a.name: a
    for a in (
        AxisKind("heading", "yaw", "psi", math.radians(30.0), 30.0),
        AxisKind("depth", "heave", "z", 1.0, 30.0, {"GLOBAL_POSITION_INT": 10.0}, example="sitl:videoray"),
        AxisKind("speed", "surge", "u", guessed_duration=22.0, rates=_SPEED, calmed=0.5),
        AxisKind("yaw", "yaw", "r", guessed_duration=8.0),
        AxisKind("roll", "roll", "phi", math.radians(20.0), 20.0, example="sitl:bluerov2-6dof"),
        AxisKind("pitch", "pitch", "theta", math.radians(20.0), 20.0, example="sitl:bluerov2-6dof"),
    )
}
"""Name -> axis. To add an axis, add a line here, and its law and gains in the firmwares that have it."""

OWN_AXES: Mapping[str, AxisKind] = {
    a.name: a
    for a in (
        AxisKind("ahead", "surge", "x", 0.3, 30.0),
        AxisKind("sideways", "sway", "y", 0.3, 30.0),
        AxisKind("down", "heave", "z", 0.3, 30.0),
        AxisKind("distance", "surge", "d", 0.3, 30.0),
    )
}
"""Name -> motion that only controllers of our own hold. ``distance`` is the motion ahead, seen against a wall."""

OTHER_NAMES: Mapping[str, str] = {"surge": "speed"}
"""Alias -> name of an axis."""

SIGNAL_FORCES: Mapping[str, str] = {a.stepped: a.names.force for a in AXES.values()}
"""Stepped signal -> the force that drives it."""


def axis_kind(name: str) -> AxisKind:
    """Return the axis called *name* in commands; ``KeyError`` if there is none."""
    return OWN_AXES[name] if name in OWN_AXES else AXES[OTHER_NAMES.get(name, name)]


def position_axis(dof: str) -> AxisKind:
    """Return the axis whose loop holds the position of a degree of freedom."""
    return next(a for a in AXES.values() if a.dof == dof)


def excitation_of(dof: str) -> Excitation:
    """Return the settings by which the degree of freedom *dof* is identified."""
    return EXCITATIONS[dof]
