"""What a craft shows and what it can be told: the words manoeuvres and link room share.

Everything here is inert. A manoeuvre reads :class:`Observation` and returns a :data:`Command`; only the
link room turns commands into messages.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

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
    "TurnRateTarget",
]


@dataclass(frozen=True, slots=True)
class Observation:
    """The craft at one moment of its own time. Unknown numbers are NaN. SI and radians.

    ``t`` is the vehicle's time stamp [s] of the attitude that made this observation; ``psi`` is unwrapped
    (continuous from the first one); ``d`` is the distance to a wall ahead [m]. ``output`` holds the *measured* actuator
    demand per force name (``{"N": 0.3, "Z": 0.0, "X": 0.5}``, fractions of full output, from SERVO_OUTPUT_RAW);
    ``output_t`` its stamp. ``age`` is seconds of link-clock time since the last message.
    """

    t: float
    psi: float
    r: float = math.nan
    phi: float = math.nan
    theta: float = math.nan
    x: float = math.nan
    y: float = math.nan
    z: float = math.nan
    u: float = math.nan
    v: float = math.nan
    w: float = math.nan
    speed: float = math.nan
    d: float = math.nan
    output: Mapping[str, float] = field(default_factory=dict)
    output_t: float = math.nan
    armed: bool = False
    mode: str = ""
    battery_voltage: float = math.nan
    battery_remaining: float = math.nan
    age: float = 0.0

    def value(self, name: str) -> float:
        """Return the signal called *name* (``psi``, ``z``, ``speed``...)."""
        return float(getattr(self, name))


@dataclass(frozen=True, slots=True)
class Actuate:
    """Drive the actuators directly (manual mode): fractions of full output, -1..1, SNAME signs.

    ``Z`` pushes down, ``N`` turns to starboard. A boat's ``N`` is its steering output, ``X`` its throttle. ``K`` and
    ``M`` are for previews on a model: no firmware gives them a channel here.
    """

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    K: float = 0.0
    M: float = 0.0
    N: float = 0.0


@dataclass(frozen=True, slots=True)
class HeadingTarget:
    """Let the autopilot's own heading loop hold ``psi`` [rad] at forward ``speed`` [m/s] (0 for an ROV)."""

    psi: float
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class TurnRateTarget:
    """Let the autopilot's own rate loop turn at ``r`` [rad/s] at forward ``speed`` [m/s] (0 for an ROV)."""

    r: float
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class DepthTarget:
    """Let the autopilot's own depth loop hold ``z`` [m, down]."""

    z: float


Command = Actuate | HeadingTarget | TurnRateTarget | DepthTarget


@dataclass(frozen=True, slots=True)
class Intervention:
    """A change of mode or armed state, while a craft is ours, that we did not order.

    ``what`` : in words, with its cause as far as that is known. ``mode_stands``, ``armed_stands`` : whether nobody here
    may undo it. ``is_certain`` : False where a late copy of an order of ours may have done it. ``may_go_on`` : whether
    the operator may be asked to go on, because a failsafe that waits for our overrides does just this.
    """

    what: str
    mode_stands: bool
    armed_stands: bool
    is_certain: bool = True
    may_go_on: bool = False

    @property
    def stands(self) -> bool:
        """Whether any of it stands."""
        return self.mode_stands or self.armed_stands


class Craft(Protocol):
    """A vehicle one can watch and command. Implemented by the link room, and by nobody else for real water."""

    @property
    def firmware(self) -> Firmware:
        """What kind of autopilot it is."""
        ...

    @property
    def clock(self) -> Clock:
        """The link's clock (not the vehicle's)."""
        ...

    @property
    def armed(self) -> bool:
        """Whether it is armed, as last heard."""
        ...

    @property
    def mode(self) -> str:
        """Its flight mode, as last heard."""
        ...

    def await_heartbeat(self) -> None:
        """Wait for the next heartbeat, after which ``armed`` and ``mode`` are of now. Raises ``LinkLost``."""
        ...

    def take_over(self) -> None:
        """From now on mode and armed state are ours to change; any other change is an intervention."""
        ...

    def give_back(self) -> None:
        """End that: the craft is its owner's again."""
        ...

    def intervention(self) -> Intervention | None:
        """Ask for mode and armed state, and return the first intervention since :meth:`take_over`; None without any."""
        ...

    def accept_intervention(self) -> None:
        """Take mode and armed state as they are now; the next intervention counts as the first."""
        ...

    def observe(self) -> Observation:
        """Wait for the next control tick and return it.

        Raises ``LinkLost`` when nothing comes, ``TelemetryFault`` when what comes cannot be trusted,
        ``OperatorStopped`` when the operator asked to stop.
        """
        ...

    def send(self, command: Command) -> None:
        """Put a command on the wire; it is repeated by :meth:`observe` often enough to stay in force."""
        ...

    def set_mode(self, mode: str) -> None:
        """Change the flight mode and wait until the heartbeat confirms it."""
        ...

    def arm(self) -> None:
        """Arm and wait until the heartbeat confirms it."""
        ...

    def disarm(self) -> None:
        """Disarm, wait until the heartbeat confirms it, and let go of the sticks."""
        ...

    def neutral(self) -> None:
        """Bring every actuator to neutral and check the measured outputs; while armed, hold it there."""
        ...

    def release(self) -> None:
        """Let go of the sticks, if they are held."""
        ...

    def start_recording(self, name: str) -> None:
        """Begin a new trial; everything heard from now on belongs to it."""
        ...

    def mark(self, mark: Mark) -> None:
        """Attach an event to the running trial."""
        ...

    def stop_recording(self, ending: str) -> Trial:
        """End the running trial and return it."""
        ...

    def shielded(self) -> AbstractContextManager[None]:
        """While inside, the operator's stop is remembered but not raised: for clean-up."""
        ...
