"""What a manoeuvre is: a generator of commands that receives observations. It touches nothing itself.

The same object is flown by the :class:`~gcs_autotune.manoeuvres.sequencer.Sequencer`, previewed on a simulation
(:mod:`~gcs_autotune.manoeuvres.preview`) and ranked by `identify --plan-next`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from gcs_autotune.craft import Command, Observation
from gcs_autotune.trial import Mark, Purpose
from gcs_autotune.watch import Progress

__all__ = ["Commands", "Ending", "Manoeuvre", "Outcome"]

Ending = Literal["completed", "stopped", "aborted"]
"""``completed``: did what it is for. ``stopped``: enough, the data are good as far as they go.
``aborted``: something went wrong; the data are kept and marked."""

Commands = Generator[Command, Observation, None]
"""What :meth:`Manoeuvre.commands` returns: each command answers the observation sent in."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a manoeuvre ended by its own lights, and why in one sentence."""

    ending: Ending
    reason: str


class Manoeuvre(ABC):
    """One manoeuvre, flown once.

    Attributes
    ----------
    kind : its name in the table of manoeuvres, as records carry it.
    purpose : what its record is for.
    in_manual : which of the firmware's two modes it wants: actuators driven directly, or the autopilot's own loops.
    by_hand : whether somebody pushes the craft.
    name : the trial's name.
    outcome : how it ended, None while it runs. It is set together with the last command.
    signal, force : what is watched and what is driven, for people. phase, target : where it stands, likewise.
    """

    kind: str
    purpose: ClassVar[Purpose] = "identification"
    in_manual: ClassVar[bool] = True
    by_hand: ClassVar[bool] = False

    def __init__(self, name: str = "", *, signal: str = "psi", force: str = "N") -> None:
        self.name = name or self.kind
        self.outcome: Outcome | None = None
        self.signal, self.force = signal, force
        self.phase, self.target = self.kind, math.nan
        self._marks: list[Mark] = []

    @abstractmethod
    def commands(self, now: Observation) -> Commands:
        """Yield a command for *now*, then one for every observation sent in, until ``outcome`` is set."""

    @property
    @abstractmethod
    def asked(self) -> Mapping[str, Any]:
        """What it was asked to do and has found (SI units), for the trial's ``meta``."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The trial's ``meta``: which manoeuvre it is, what it is for, and :attr:`asked`."""
        return {"manoeuvre": self.kind, "purpose": self.purpose, **self.asked}

    def take_marks(self) -> Sequence[Mark]:
        """Return (once) the events since the last call."""
        marks, self._marks = self._marks, []
        return marks

    def progress(self, observation: Observation) -> Progress:
        """Return where it stands, for people."""
        return Progress(
            stage="",
            manoeuvre=self.phase,
            t=observation.t,
            signal=self.signal,
            value=observation.value(self.signal),
            target=self.target,
            output=observation.output.get(self.force, math.nan),
            age=observation.age,
        )

    def _mark(self, t: float, kind: str, detail: Mapping[str, float | str]) -> None:
        self._marks.append(Mark(t, kind, detail))

    def _end(self, ending: Ending, reason: str) -> None:
        self.outcome = Outcome(ending, reason)
