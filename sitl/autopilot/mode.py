"""Interface of a flight mode."""

from __future__ import annotations

from abc import ABC, abstractmethod

__all__ = ["Mode"]


class Mode(ABC):
    """One flight mode: ``run`` is called every loop while armed.

    ``flags`` are the MAV_MODE_FLAG bits in the heartbeat in addition to custom-mode and armed.
    """

    number: int
    name: str
    flags: int
    needs_position = False

    def enter(self) -> None:  # noqa: B027 - most modes need no preparation
        """Prepare the mode. The autopilot calls this on the change to the mode, and on arming."""

    @abstractmethod
    def run(self) -> None:
        """Convert sticks or targets to demands on the motors."""
