"""What a manoeuvre is: a small object that turns observations into commands. It touches nothing itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from gcs_autotune.craft import Command, Observation
from gcs_autotune.trial import Mark
from gcs_autotune.watch import Progress

__all__ = ["Ending", "Manoeuvre", "Outcome"]

Ending = Literal["completed", "stopped", "aborted"]
"""``completed``: did what it is for. ``stopped``: enough, the data are good as far as they go.
``aborted``: something went wrong; the data are kept and marked."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a manoeuvre ended by its own lights, and why in one sentence."""

    ending: Ending
    reason: str


class Manoeuvre(Protocol):
    """Turns telemetry into commands. The sequencer calls ``start`` once, then ``update`` at every tick.

    ``in_manual`` tells which of the firmware's two modes it wants: actuators driven directly, or the
    autopilot's own loops closed.
    """

    @property
    def name(self) -> str:
        """Short name, e.g. ``relay`` or ``step``; also the trial's name."""
        ...

    @property
    def in_manual(self) -> bool:
        """Whether it drives the actuators itself."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """What it was asked to do, for the trial's ``meta`` (SI units)."""
        ...

    @property
    def outcome(self) -> Outcome | None:
        """How it ended, or None while it runs."""
        ...

    def start(self, observation: Observation) -> None:
        """Take the present state as the starting point."""
        ...

    def update(self, observation: Observation) -> Command:
        """Return what the craft shall do until the next tick."""
        ...

    def take_marks(self) -> Sequence[Mark]:
        """Return (once) the events since the last call."""
        ...

    def progress(self, observation: Observation) -> Progress:
        """Return where it stands, for people."""
        ...
