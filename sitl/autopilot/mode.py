"""Interface of a flight mode."""

from __future__ import annotations

from abc import ABC, abstractmethod

__all__ = ["Mode"]


class Mode(ABC):
    """One flight mode: ``run`` is called every loop while armed.

    ``flags`` are the MAV_MODE_FLAG bits the heartbeat shows besides custom-mode and armed.
    """

    number: int
    name: str
    flags: int
    needs_position = False

    def enter(self) -> None:  # noqa: B027 - most modes need no preparation
        """Prepare; called once when the mode is taken up."""

    @abstractmethod
    def run(self) -> None:
        """Convert sticks or targets into demands on the motors."""
