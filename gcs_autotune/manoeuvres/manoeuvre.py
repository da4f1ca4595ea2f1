"""The base class of manoeuvres: a generator of commands that receives observations. It does not command a craft
itself.

The same object is flown by the :class:`~gcs_autotune.manoeuvres.sequencer.Sequencer`, previewed on a simulation
(:mod:`~gcs_autotune.manoeuvres.preview`) and ranked by `identify --plan-next`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from gcs_autotune.craft import Command, Observation
from gcs_autotune.firmware import Firmware
from gcs_autotune.observer import Progress
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Mark, Purpose, Trial

__all__ = ["Commands", "Ending", "Manoeuvre", "Outcome", "limited_orders"]

Ending = Literal["completed", "stopped", "aborted"]
"""How a manoeuvre ended.

``completed``: it reached its purpose. ``stopped``: it ended early, and its data are usable. ``aborted``: something went
wrong; the data are kept and marked.
"""

Commands = Generator[Command, Observation, None]
"""Generator returned by :meth:`Manoeuvre.commands`. It receives an observation and yields the next command."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a manoeuvre that ended by itself: how it ended, and the reason in one sentence."""

    ending: Ending
    reason: str


class Manoeuvre(ABC):
    """One manoeuvre, to be flown once.

    Attributes
    ----------
    kind : its name in the table of manoeuvres and in records.
    purpose : purpose of its record.
    in_manual : mode required: True for direct control of actuators, False for the autopilot's own loops.
    in_mission : whether it is the autopilot's mission mode.
    by_hand : whether the operator pushes the craft.
    name : name of the trial.
    outcome : how the manoeuvre ended, None while it runs. It is set together with the last command.
    signal, force : the controlled signal and the driven force, for display.
    phase, target : the current phase and target, for display.
    at_most : longest duration [s] with a poorly damped loop; NaN: as computed by the preview.
    drifts : the limited signal (``psi``, ``z``) that changes for as long as a command lasts, because no loop holds it;
        empty if there is none.
    """

    kind: str
    purpose: ClassVar[Purpose] = "identification"
    in_manual: ClassVar[bool] = True
    in_mission: ClassVar[bool] = False
    by_hand: ClassVar[bool] = False
    at_most: float = math.nan
    drifts: str = ""

    def __init__(self, name: str = "", *, signal: str = "psi", force: str = "N") -> None:
        self.name = name or self.kind
        self.outcome: Outcome | None = None
        self.signal, self.force = signal, force
        self.phase, self.target = self.kind, math.nan
        self._marks: list[Mark] = []

    def mode_of(self, firmware: Firmware) -> str:
        """Return the name of the flight mode that it is flown in."""
        if self.in_mission:
            return firmware.mission_mode
        return firmware.manual_mode if self.in_manual else firmware.hold_mode

    @abstractmethod
    def commands(self, now: Observation) -> Commands:
        """Yield a command for *now*, then one for every observation received, until ``outcome`` is set."""

    @property
    @abstractmethod
    def meta_fields(self) -> Mapping[str, Any]:
        """Name -> setting or result (SI units) of the manoeuvre, for the trial's ``meta``."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """Content of the trial's ``meta``: manoeuvre, purpose, and :attr:`meta_fields`."""
        return {"manoeuvre": self.kind, "purpose": self.purpose, **self.meta_fields}

    def take_marks(self) -> Sequence[Mark]:
        """Return the events marked since the last call, each once."""
        marks, self._marks = self._marks, []
        return marks

    def where_room_ends(self, where: str) -> Outcome | None:
        """Return the outcome if the manoeuvre should end at the space limit *where*; None: it continues up to the
        limit.

        It ends at the limit if its record is sufficient by then.
        """
        return None

    def where_drift_ends(self, where: str, side: float) -> Outcome | None:
        """Stop a drift to the *side* (-1 or 1) at *where*, before the limit. Return the outcome if the manoeuvre ends.

        It is called at every tick at which the craft could not stop before the limit.
        """
        return None

    def progress(self, observation: Observation) -> Progress:
        """Return the present state of the manoeuvre, for display."""
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


_NOTED, _LIMITED = 0.1, 0.9
"""Smallest command whose output is checked (normalised), and the fraction of the command that must reach the output.
Project choice.
"""
_MOST, _STEADY = (0.1, 0.9), 0.5
"""Quantiles of an output, and their largest distance as a fraction of the command. Project choice.

A larger distance indicates another source of commands (a clock or a controller) instead of a limit.
"""
_LASTED = 1.0
"""Duration [s] below which a command is not evaluated, because it ends before a slow link shows its effect. Project
choice."""


def limited_orders(trial: Trial) -> Mapping[str, tuple[float, float]]:
    """Return the forces whose output is clearly less than commanded: force -> (commanded, output) of the largest
    commands.

    Both are normalised. Thrusters that also drive ahead have less range left for steering.
    """
    forces = {d.force for d in DOFS.values()}
    found: dict[str, tuple[float, float]] = {}
    orders = [m for m in trial.marks if m.kind in ("execute", "level")]
    for k, order in enumerate(orders):
        until = orders[k + 1].t if k + 1 < len(orders) else trial.end
        if until - order.t < _LASTED:
            continue
        for force, commanded in order.detail.items():
            if force not in forces or force not in trial or not isinstance(commanded, float) or abs(commanded) < _NOTED:
                continue
            held = trial[force].between(order.t + 0.5 * (until - order.t), until).values
            if len(held) and float(np.ptp(np.quantile(held, _MOST))) > _STEADY * abs(commanded):
                continue
            came = float(np.median(held)) / commanded if len(held) else 1.0
            if came < _LIMITED and abs(commanded) > found.get(force, (0.0, 0.0))[0]:
                found[force] = (abs(commanded), abs(came * commanded))
    return found
