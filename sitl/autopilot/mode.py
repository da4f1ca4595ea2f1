"""Interface of a flight mode."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

__all__ = ["Mode", "WayReport"]


@dataclass(frozen=True, slots=True)
class WayReport:
    """Where a mode is going: place (north + i east [m]), distance [m], bearing and heading [rad], cross-track [m]."""

    destination: complex
    distance: float
    bearing: float
    heading: float
    cross_track: float


class Mode(ABC):
    """One flight mode: ``run`` is called every loop while armed.

    ``flags`` are the MAV_MODE_FLAG bits the heartbeat shows in addition to custom-mode and armed. ``arms``: the
    craft can be armed in it. ``in_mission``: it flies the mission.
    """

    number: int
    name: str
    flags: int
    needs_position = False
    arms = True
    in_mission = False

    def refusal(self) -> str | None:
        """Return why the mode cannot be taken up now; None when it can."""
        return None

    def enter(self) -> None:  # noqa: B027 - most modes need no preparation
        """Prepare the mode. The autopilot calls this on the change to the mode, and on arming."""

    def leave(self) -> None:  # noqa: B027 - most modes leave nothing behind
        """Called once when another mode is taken up."""

    def report(self) -> WayReport | None:
        """Return where it goes; None where it does not go anywhere."""
        return None

    def set_speed(self, speed: float) -> bool:
        """Take a new speed limit [m/s]; return whether that means anything now."""
        return False

    @abstractmethod
    def run(self) -> None:
        """Convert sticks or targets to demands on the motors."""
