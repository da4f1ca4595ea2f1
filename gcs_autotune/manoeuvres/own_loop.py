"""A manoeuvre flown under our own loop instead of the autopilot's: its set-points become direct output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gcs_autotune.axes import SIGNAL_FORCES
from gcs_autotune.craft import Observation, set_point
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome
from gcs_autotune.observer import Progress
from gcs_autotune.trial import Mark

if TYPE_CHECKING:
    from gcs_autotune.control import OwnLoop

__all__ = ["KeepSetPoint", "UnderOwnLoop"]


class UnderOwnLoop(Manoeuvre):
    """*manoeuvre*, with its set-point commands carried out by *loop* in manual mode.

    Parameters
    ----------
    controller : what the loop is, for the record's ``meta``.
    keeps_still : whether an ROV's other axes are held in this time.
    """

    in_manual = True

    def __init__(
        self, manoeuvre: Manoeuvre, loop: OwnLoop, controller: Mapping[str, Any], *, keeps_still: bool = False
    ) -> None:
        self.kind = manoeuvre.kind
        super().__init__(manoeuvre.name, signal=manoeuvre.signal, force=manoeuvre.force)
        self._manoeuvre, self._loop, self._controller = manoeuvre, loop, dict(controller)
        self._held = [HoldController(gains) for gains in HELD_DURING[self.signal]] if keeps_still else []

    @property
    def settings(self) -> Mapping[str, Any]:
        """Those of the manoeuvre, and the ``controller``."""
        return {**self._manoeuvre.settings, "controller": self._controller}

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Those of the manoeuvre."""
        return self._manoeuvre.meta_fields

    def commands(self, now: Observation) -> Commands:
        """Yield the output that the loop gives for each command of the manoeuvre."""
        inner = self._manoeuvre.commands(now)
        command = next(inner)
        while True:
            self.outcome, self.phase, self.target = (
                self._manoeuvre.outcome,
                self._manoeuvre.phase,
                self._manoeuvre.target,
            )
            now = yield hold(self._loop.update(command, now), self._held, now)
            command = inner.send(now)

    def take_marks(self) -> Sequence[Mark]:
        """Return (once) the events of the manoeuvre."""
        return self._manoeuvre.take_marks()

    def where_room_ends(self, where: str) -> Outcome | None:
        """As the manoeuvre ends there."""
        return self._manoeuvre.where_room_ends(where)

    def progress(self, observation: Observation) -> Progress:
        """Return where the manoeuvre stands."""
        return self._manoeuvre.progress(observation)


class KeepSetPoint(Manoeuvre):
    """Hold *signal* where it is at the start, for *seconds*; a boat at *speed* ahead [m/s]."""

    kind, purpose, in_manual = "keep", "proof", False

    def __init__(self, signal: str, seconds: float, speed: float, name: str = "keep") -> None:
        super().__init__(name, signal=signal, force=SIGNAL_FORCES[signal])
        self._seconds, self._speed = seconds, speed

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Signal, duration [s] and speed [m/s]."""
        return {"signal": self.signal, "duration": self._seconds, "speed": self._speed}

    def commands(self, now: Observation) -> Commands:
        """Yield the value of the start until the time is over."""
        start, course, self.target = now.t, now.psi, now.value(self.signal)
        self._mark(now.t, "target", {"value": self.target, "phase": "hold"})
        while True:
            if now.t - start >= self._seconds:
                self._end("completed", f"held for {self._seconds:.0f} s")
            now = yield set_point(self.signal, self.target, course=course, speed=self._speed)
