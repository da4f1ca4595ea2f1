"""Holding a position and a heading at rest, with a step away from both and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.hold_controller import HELD_BEFORE, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

if TYPE_CHECKING:
    from gcs_autotune.control import PositionController

__all__ = ["KeepPosition"]

DIVERGED = 4.0
"""Distance from the target, as a multiple of the step, at which the loop counts as unstable. Chosen."""

Output = Callable[[float], float]


class KeepPosition(Manoeuvre):
    """Hold where the craft is for *settle* [s]; step by *step* [m] ahead and to starboard and by *turn* [rad]; back.

    Parameters
    ----------
    make : a controller that has not begun. outputs : inverse actuators of X, Y and N, from force to output.
    duration : time at each target [s].
    """

    kind, purpose = "keep-position", "proof"

    def __init__(
        self,
        make: Callable[[], PositionController],
        step: float,
        turn: float,
        duration: float,
        settle: float,
        outputs: tuple[Output, Output, Output],
        name: str = "",
    ) -> None:
        super().__init__(name)  # a live line shows the heading: one number cannot show a position
        self._make, self._step, self._turn, self._outputs = make, step, turn, outputs
        self._duration, self._settle = duration, settle

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Step, turn and durations."""
        return {"size": self._step, "turn": self._turn, "duration": self._duration}

    def commands(self, now: Observation) -> Commands:
        """Yield the outputs at rest, at the step, and back."""
        from gcs_autotune.control import Pose, PositionTarget  # a second to import, which the table need not take

        controller, depth = self._make(), [HoldController(gains) for gains in HELD_BEFORE.values()]
        s, c = math.sin(now.psi), math.cos(now.psi)
        north, east = self._step * (c - s), self._step * (s + c)  # as much ahead as to starboard
        legs = iter((("hold", self._settle, 0.0), ("step", self._duration, 1.0), ("back", self._duration, 0.0)))
        base, until = (now.x, now.y, now.psi), now.t
        target = PositionTarget((now.x, now.y, 0.0, now.psi))
        while True:
            if now.t >= until:
                self.phase, seconds, share = next(legs, ("", 0.0, 0.0))
                if self.phase:
                    x, y, psi = base[0] + share * north, base[1] + share * east, base[2] + share * self._turn
                    target, until, self.target = PositionTarget((x, y, 0.0, psi)), now.t + seconds, psi
                    self._mark(now.t, "target", {"x": x, "y": y, "psi": psi, "phase": self.phase})
                else:
                    self._end("completed", "step and step back flown")
            away = math.hypot(now.x - target.position[0], now.y - target.position[1])
            known = all(math.isfinite(value) for value in (away, now.psi, now.u, now.v, now.r))
            if not known:
                self._end("aborted", "the vehicle does not report its position or velocity. Check its position sensor")
            elif away > DIVERGED * abs(self._step):
                self._end(
                    "stopped",
                    f"the craft is {away:.1f} m from its target: the loop is unstable, or a disturbance is stronger",
                )
            pose = Pose((now.x, now.y, 0.0, now.psi), (now.u, now.v, 0.0, now.r))
            X, Y, _, N = controller.update(target, pose, now.t) if known else (0.0,) * 4
            command = Actuate(X=self._outputs[0](X), Y=self._outputs[1](Y), N=self._outputs[2](N))
            now = yield hold(command, depth, now)
