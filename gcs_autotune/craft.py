"""Observations and commands of a craft, shared by ``manoeuvres`` and ``link``.

A manoeuvre reads an :class:`Observation` and returns a :data:`Command`; only ``link`` converts commands into messages.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Literal, Protocol

from gcs_autotune.clock import Clock
from gcs_autotune.firmware import Firmware
from gcs_autotune.trial import Mark, Trial

__all__ = [
    "Actuate",
    "Command",
    "Craft",
    "DepthTarget",
    "HeadingTarget",
    "Intervention",
    "Observation",
    "PositionTarget",
    "SteeredBy",
    "TurnRateTarget",
    "set_point",
]


@dataclass(frozen=True, slots=True)
class Observation:
    """The state of the craft at one moment of its own time. Unknown numbers are NaN. SI and radians.

    ``t`` is the vehicle's timestamp [s] of the attitude in this observation; ``psi`` is unwrapped
    (continuous from the first one); ``d`` is the distance to a wall ahead [m]; ``d_starboard`` that of a second
    rangefinder; ``wall_angle`` the heading minus that at a right angle to the wall. ``waypoint`` is the number of the
    mission item under way. ``output`` holds the *measured* actuator demand per force name
    (``{"N": 0.3, "Z": 0.0, "X": 0.5}``, fractions of full output, from SERVO_OUTPUT_RAW); ``output_t`` [s] is its time
    stamp. ``age`` is seconds of link-clock time since the last message.
    """

    t: float
    psi: float
    r: float = math.nan
    phi: float = math.nan
    theta: float = math.nan
    p: float = math.nan
    q: float = math.nan
    x: float = math.nan
    y: float = math.nan
    z: float = math.nan
    u: float = math.nan
    v: float = math.nan
    w: float = math.nan
    speed: float = math.nan
    d: float = math.nan
    d_starboard: float = math.nan
    wall_angle: float = math.nan
    waypoint: float = math.nan
    output: Mapping[str, float] = field(default_factory=dict)
    output_t: float = math.nan
    armed: bool = False
    mode: str = ""
    battery_voltage: float = math.nan
    battery_remaining: float = math.nan
    age: float = 0.0

    def value(self, name: str) -> float:
        """Return the value [SI] of the signal called *name* (``psi``, ``z``, ``speed``...)."""
        return float(getattr(self, name))


@dataclass(frozen=True, slots=True)
class Actuate:
    """Drive the actuators directly (manual mode): fractions of full output, -1..1, SNAME signs.

    ``Z`` pushes down, ``N`` turns to starboard. A boat's ``N`` is its steering output, ``X`` its throttle. ``K`` rolls
    to starboard, ``M`` lifts the bow.
    """

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    K: float = 0.0
    M: float = 0.0
    N: float = 0.0


@dataclass(frozen=True, slots=True)
class HeadingTarget:
    """Command the autopilot's own heading loop to hold ``psi`` [rad] at forward ``speed`` [m/s] (0 for an ROV).

    An ROV also holds ``phi`` and ``theta`` [rad].
    """

    psi: float
    speed: float = 0.0
    phi: float = 0.0
    theta: float = 0.0


@dataclass(frozen=True, slots=True)
class TurnRateTarget:
    """Command the autopilot's own rate loop to turn at ``r`` [rad/s] at forward ``speed`` [m/s] (0 for an ROV)."""

    r: float
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class DepthTarget:
    """Command the autopilot's own depth loop to hold ``z`` [m, down]."""

    z: float


@dataclass(frozen=True, slots=True)
class PositionTarget:
    """Command the autopilot's own position loop to hold ``x``, ``y``, the depth ``z`` [m] and the heading ``psi``
    [rad], all as in :class:`Observation`.
    """

    x: float
    y: float
    z: float
    psi: float


SteeredBy = Literal["rudder", "thrusters", "rov"]
"""How a craft turns: by a boat's rudder, by its two thrusters, or by the thrusters of an ROV, which turns on the
spot."""
Command = Actuate | HeadingTarget | TurnRateTarget | DepthTarget | PositionTarget


def set_point(signal: str, value: float, *, course: float = math.nan, speed: float = 0.0) -> Command:
    """Return the command for the autopilot's own loop to hold *signal* at *value* [SI].

    course : heading [rad] to hold if the signal is the speed, roll or pitch. speed : speed ahead [m/s] for other
        signals.
    """
    match signal:
        case "psi":
            return HeadingTarget(value, speed)
        case "r":
            return TurnRateTarget(value, speed)
        case "u":
            return HeadingTarget(course, value)
        case "z":
            return DepthTarget(value)
        case "phi":
            return HeadingTarget(course, phi=value)
        case "theta":
            return HeadingTarget(course, theta=value)
    raise KeyError(signal)


@dataclass(frozen=True, slots=True)
class Intervention:
    """A change of mode or armed state during a run that this program did not command.

    ``what`` : text of the change, with its cause if known. ``mode_stands``, ``armed_stands`` : whether it must not be
    undone. ``is_certain`` : False if a late copy of our own command may have caused it. ``may_go_on`` : whether the
    operator may continue, because a failsafe for missing overrides caused it. ``failsafe`` : name of the autopilot's
    failsafe that caused it, or may have caused it; empty if none explains it. ``has_reported`` : whether the vehicle
    reported that failsafe.
    """

    what: str
    mode_stands: bool
    armed_stands: bool
    is_certain: bool = True
    may_go_on: bool = False
    failsafe: str = ""
    has_reported: bool = False

    @property
    def stands(self) -> bool:
        """Whether the change of mode or of armed state must not be undone."""
        return self.mode_stands or self.armed_stands


class Craft(Protocol):
    """A vehicle that can be observed and commanded. ``link`` implements it for real vehicles."""

    @property
    def firmware(self) -> Firmware:
        """The firmware profile of the autopilot."""
        ...

    @property
    def clock(self) -> Clock:
        """The link's clock, which is not that of the vehicle."""
        ...

    @property
    def armed(self) -> bool:
        """Whether the craft is armed, from the last heartbeat."""
        ...

    @property
    def mode(self) -> str:
        """Name of the craft's flight mode, from the last heartbeat."""
        ...

    @property
    def lateness(self) -> float:
        """Present delay [s of the vehicle's time] from a command to its report by the vehicle."""
        ...

    def await_heartbeat(self) -> None:
        """Wait for the next heartbeat, so that ``armed`` and ``mode`` are current. Raises ``LinkLost``."""
        ...

    def take_over(self) -> None:
        """Start to monitor mode and armed state. Any change from elsewhere counts as an intervention."""
        ...

    def give_back(self) -> None:
        """Stop monitoring mode and armed state."""
        ...

    def intervention(self) -> Intervention | None:
        """Request mode and armed state.

        Return the first intervention since :meth:`take_over`; None if there is none.
        """
        ...

    def accept_intervention(self) -> None:
        """Accept the present mode and armed state. The next intervention then counts as the first."""
        ...

    def observe(self) -> Observation:
        """Wait for the next control tick and return its observation.

        Raises ``LinkLost`` without messages, ``TelemetryFault`` for implausible ones, ``OperatorStopped`` after a
        stop request.
        """
        ...

    def send(self, command: Command) -> None:
        """Send a command. :meth:`observe` repeats it often enough to keep it in force."""
        ...

    def set_mode(self, mode: str) -> None:
        """Change the flight mode and wait until the heartbeat confirms it."""
        ...

    def arm(self) -> None:
        """Arm and wait until the heartbeat confirms it."""
        ...

    def disarm(self) -> None:
        """Disarm, wait until the heartbeat confirms it, and release the sticks."""
        ...

    def neutral(self) -> None:
        """Bring every actuator to neutral and check the measured outputs. While armed, keep the actuators neutral."""
        ...

    def release(self) -> None:
        """Release the sticks if this program controls them."""
        ...

    def start_recording(self, name: str) -> None:
        """Start a new trial; all messages received from now on belong to it."""
        ...

    def mark(self, mark: Mark) -> None:
        """Add an event at the present time to the running trial."""
        ...

    def stop_recording(self, ending: str) -> Trial:
        """End the running trial and return it."""
        ...

    def shielded(self) -> AbstractContextManager[None]:
        """Return a context for clean-up in which the operator's stop is deferred."""
        ...
