"""What an axis is: the loop that is tuned, what is flown to identify it, and the words and numbers of both. Told once.

Which firmware has which loop, by which law and gains, is told by its profile (``Firmware.axes``).
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
    "SIGNAL_FORCES",
    "AxisKind",
    "Excitation",
    "axis_kind",
    "excitation_of",
    "position_axis",
]

_SPEED = {"LOCAL_POSITION_NED": 10.0, "GLOBAL_POSITION_INT": 5.0}
_PULSES = "a small pulse each way to see that it answers rightly, then "


@dataclass(frozen=True, slots=True)
class Excitation:
    """What one degree of freedom is identified by. Chosen for craft of half a metre to a few metres.

    Attributes
    ----------
    signal : what a relay watches; ``x`` is speed ahead, integrated, ``y`` speed to the side.
    least_hysteresis : of a relay on it [rad or m].
    title : what oscillates, to people.
    check : what is said of the check of its actuator beforehand.
    check_reach, check_time : a pulse of the check ends at this share of ``least_hysteresis``, or after so long [s].
    by_throttle : what moves it is the throttle: a craft under way is told by steps of it, in the room that is left.
    below_surface : it shows under water only.
    """

    dof: str
    signal: str
    least_hysteresis: float
    title: str
    check: str
    check_reach: float = 1.0
    check_time: float = 6.0
    by_throttle: bool = False
    below_surface: bool = False

    @property
    def names(self) -> Dof:
        """The names of its signals and parameters."""
        return DOFS[self.dof]


EXCITATIONS: Mapping[str, Excitation] = {
    e.dof: e
    for e in (
        # A yaw time constant of 8 s shows 0.4 of its rate in 4 s.
        Excitation("yaw", "psi", math.radians(10.0), "heading", _PULSES, check_reach=0.6, check_time=4.0),
        Excitation("heave", "z", 0.15, "depth", _PULSES, below_surface=True),
        Excitation("surge", "x", 0.3, "speed", "a pulse ahead to see that it answers rightly, then ", by_throttle=True),
        Excitation("sway", "y", 0.3, "speed to the side", ""),
    )
}
"""Degree of freedom -> how it is identified."""


@dataclass(frozen=True, slots=True)
class AxisKind:
    """One axis as commands name it.

    Attributes
    ----------
    dof : the motion identified for it. stepped : the signal that proves its gains.
    step, step_duration : size [SI, rad] and seconds each way of that step; NaN where the craft decides.
    rates : messages that show it, beside ATTITUDE, with the rates [Hz] its experiments live on.
    calmed : the stepped signal is so noisy that it is read through a centred mean of so many seconds.
    guessed_duration : seconds each way that a step takes of which the craft decides, for what is told beforehand.
    example : the simulated vehicle that stands in when none is given.
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
        """How it is identified."""
        return EXCITATIONS[self.dof]

    @property
    def angular(self) -> bool:
        """Whether people give its steps and hystereses in degrees."""
        return DOFS[self.dof].angular


AXES: Mapping[str, AxisKind] = {
    a.name: a
    for a in (
        AxisKind("heading", "yaw", "psi", math.radians(30.0), 30.0),
        AxisKind("depth", "heave", "z", 1.0, 30.0, {"GLOBAL_POSITION_INT": 10.0}, example="sitl:videoray"),
        AxisKind("speed", "surge", "u", guessed_duration=22.0, rates=_SPEED, calmed=0.5),
        AxisKind("yaw", "yaw", "r", guessed_duration=8.0),
    )
}
"""Name -> axis; adding one is one line here, and its law and gains in the firmwares that have it."""

OTHER_NAMES: Mapping[str, str] = {"surge": "speed"}
"""What an axis is called too."""

SIGNAL_FORCES: Mapping[str, str] = {a.stepped: DOFS[a.dof].force for a in AXES.values()}
"""Signal that is stepped -> the actuator that does it."""


def axis_kind(name: str) -> AxisKind:
    """Return the axis called *name* in commands (``KeyError`` when there is none)."""
    return AXES[OTHER_NAMES.get(name, name)]


def position_axis(dof: str) -> AxisKind:
    """Return the axis whose loop holds the position of a degree of freedom."""
    return next(a for a in AXES.values() if a.dof == dof)


def excitation_of(dof: str) -> Excitation:
    """Return how a degree of freedom is identified."""
    return EXCITATIONS[dof]
