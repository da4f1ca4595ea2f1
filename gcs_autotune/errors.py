"""All errors that this package raises, as a tree.

::

    AutotuneError
    ├── LinkError
    │   ├── CannotOpenLink          port in use, no such device, wrong connection string
    │   ├── NoVehicle               the link is open but no autopilot sends a heartbeat
    │   ├── SigningMismatch         only one side signs, or the keys differ
    │   ├── LinkLost                the vehicle was connected and has fallen silent
    │   ├── NoReply                 a request was never answered (also a TimeoutError)
    │   └── TelemetryFault          NaN, frozen or backwards telemetry, or too slow
    ├── VehicleRefused              the vehicle rejected a command
    │   ├── WrongVehicle            not a boat or ROV, or without this axis
    │   ├── CommandDenied           contains the MAV_RESULT
    │   ├── ModeRefused
    │   ├── ArmingRefused           contains the STATUSTEXTs with the reasons
    │   ├── ParameterMissing        this firmware has no parameter of that name
    │   └── ParameterNotAccepted    the value read back differs from that written
    ├── ManoeuvreError
    │   ├── PreconditionFailed
    │   ├── NotAchieved             e.g. the limit cycle never settled
    │   ├── GuardTripped            contains guard, value, limit
    │   ├── OperatorStopped         Ctrl-C, SIGTERM or "no" at a question
    │   └── NotAsFound              clean-up incomplete; lists what differs
    ├── DataError
    │   ├── BadFile                 truncated, unreadable, wrong header
    │   ├── MissingChannel
    │   └── NotInformative          too short, no excitation: nothing can be identified from it
    ├── DesignError
    │   └── NoGainsMeetSpec
    └── UsageError
        └── UnknownName             contains the nearest spellings (also a KeyError)

A message states what happened, to what, and what to do. A poor result is not an error; it is
returned with doubts. The command line maps the families to exit codes in one table (:data:`EXIT_CODES`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

__all__ = [
    "EXIT_CODES",
    "ArmingRefused",
    "AutotuneError",
    "BadFile",
    "CannotOpenLink",
    "CommandDenied",
    "DataError",
    "DesignError",
    "GuardTripped",
    "LinkError",
    "LinkLost",
    "ManoeuvreError",
    "MissingChannel",
    "ModeRefused",
    "NoGainsMeetSpec",
    "NoReply",
    "NoVehicle",
    "NotAchieved",
    "NotAsFound",
    "NotInformative",
    "OperatorStopped",
    "ParameterMissing",
    "ParameterNotAccepted",
    "PreconditionFailed",
    "SigningMismatch",
    "TelemetryFault",
    "UnknownName",
    "UsageError",
    "VehicleRefused",
    "WrongVehicle",
    "exit_code",
]


class AutotuneError(Exception):
    """Root of all errors that this package raises intentionally."""


class LinkError(AutotuneError):
    """The connection to the vehicle failed."""


class CannotOpenLink(LinkError):
    """The port or socket could not be opened."""


class NoVehicle(LinkError):
    """The link is open, but no autopilot's HEARTBEAT was received."""


class SigningMismatch(LinkError):
    """Vehicle and ground station do not agree on MAVLink signing, so each rejects the other's messages."""


class LinkLost(LinkError):
    """The vehicle was connected and has fallen silent."""


class NoReply(LinkError, TimeoutError):
    """A request was sent and repeated, but never answered."""


class TelemetryFault(LinkError):
    """Telemetry arrives but is not usable: NaN, frozen, running backwards, or too slow."""


class VehicleRefused(AutotuneError):
    """The vehicle rejected a command."""


class WrongVehicle(VehicleRefused):
    """This command cannot tune a vehicle of this type."""


class CommandDenied(VehicleRefused):
    """A COMMAND_ACK has a MAV_RESULT other than accepted."""

    def __init__(self, message: str, *, command: int = 0, result: int = 0) -> None:
        super().__init__(message)
        self.command = command
        self.result = result


class ModeRefused(VehicleRefused):
    """The vehicle did not change to the commanded flight mode."""


class ArmingRefused(VehicleRefused):
    """Arming failed; :attr:`reasons` are the vehicle's own STATUSTEXTs."""

    def __init__(self, message: str, *, reasons: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.reasons = tuple(reasons)


class ParameterMissing(VehicleRefused):
    """This firmware has no parameter of that name."""

    def __init__(self, message: str, *, name: str = "") -> None:
        super().__init__(message)
        self.name = name


class ParameterNotAccepted(VehicleRefused):
    """A parameter was written but another value was read back."""

    def __init__(
        self, message: str, *, name: str = "", wanted: float = float("nan"), found: float = float("nan")
    ) -> None:
        super().__init__(message)
        self.name = name
        self.wanted = wanted
        self.found = found


class ManoeuvreError(AutotuneError):
    """A manoeuvre could not be completed."""


class PreconditionFailed(ManoeuvreError):
    """A condition required before moving is not fulfilled."""


class OutputsUnassigned(PreconditionFailed):
    """No known output drives a required force. ``received`` of ``of`` SERVOn_FUNCTION parameters are known."""

    def __init__(self, message: str, *, received: int = 0, of: int = 0) -> None:
        super().__init__(message)
        self.received = received
        self.of = of


class NotAchieved(ManoeuvreError):
    """The manoeuvre ran but did not reach its goal."""


class GuardTripped(ManoeuvreError):
    """A limit of the safety envelope was exceeded.

    happened : the message without the advice, which applies only if the record does not show a cause.
    """

    def __init__(
        self,
        message: str,
        *,
        guard: str = "",
        value: float = float("nan"),
        limit: float = float("nan"),
        advice: str = "",
    ) -> None:
        super().__init__(f"{message}. {advice}" if advice else message)
        self.happened = message
        self.advice = advice
        self.guard = guard
        self.value = value
        self.limit = limit

    def during(self, manoeuvre: str) -> GuardTripped:
        """Return this error with the name of the *manoeuvre* in which it occurred."""
        told = f"{manoeuvre}: {self.happened}"
        return GuardTripped(told, guard=self.guard, value=self.value, limit=self.limit, advice=self.advice)


class OperatorStopped(ManoeuvreError):
    """The operator pressed Ctrl-C or answered no."""


class NotAsFound(ManoeuvreError):
    """Clean-up could not restore everything; :attr:`differences` lists what still differs."""

    def __init__(self, message: str, *, differences: Mapping[str, str] | None = None) -> None:
        super().__init__(message)
        self.differences = dict(differences or {})


class DataError(AutotuneError):
    """A recorded run cannot be used."""


class BadFile(DataError):
    """A file is truncated, unreadable or of another type than its name."""


class MissingChannel(DataError):
    """A run lacks a signal that is needed."""


class NotInformative(DataError):
    """The run does not determine the requested result: too short, or not excited."""


class DesignError(AutotuneError):
    """Gains could not be designed."""


class NoGainsMeetSpec(DesignError):
    """No gains inside the documented ranges give an acceptable loop."""


class UsageError(AutotuneError):
    """The command or its options are not valid."""


class UnknownName(UsageError, KeyError):
    """A name is not in any table; :attr:`nearest` are the closest spellings."""

    def __init__(self, message: str, *, name: str = "", nearest: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.name = name
        self.nearest = tuple(nearest)

    def __str__(self) -> str:
        return str(self.args[0])


EXIT_CODES: tuple[tuple[type[BaseException], int, str], ...] = (
    (OperatorStopped, 130, "stopped by the operator, and the vehicle was restored"),
    (NotAsFound, 9, "the vehicle was not restored completely: run `gcs-autotune restore`"),
    (UsageError, 2, "wrong usage of the command"),
    (LinkError, 3, "the link or its telemetry failed"),
    (VehicleRefused, 4, "the vehicle rejected a command"),
    (ManoeuvreError, 5, "a manoeuvre was aborted"),
    (DataError, 6, "the recorded data cannot be used"),
    (DesignError, 7, "no acceptable gains"),
    (AutotuneError, 1, "any other failure"),
)
"""Exception family, exit code, meaning; the first match counts."""


def exit_code(error: BaseException) -> int:
    """Return the process exit code for *error*; 1 for an error that is not listed."""
    return next((code for kind, code, _ in EXIT_CODES if isinstance(error, kind)), 1)
