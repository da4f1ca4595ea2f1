"""Following a straight line under way, through a heading loop or by turn rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

from gcs_autotune.craft import Actuate, Command, HeadingTarget, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

if TYPE_CHECKING:
    from gcs_autotune.control import DirectLine, FeedbackController, Line, LineGuidance, LineOfHeading, LineState

__all__ = ["FollowLine", "state_on"]


class FollowLine(Manoeuvre):
    """Follow a line that begins *offset* [m] to starboard of the craft, parallel to its heading.

    A law of heading commands headings: the autopilot's loop or our own (:class:`UnderOwnLoop`) follows them. A
    :class:`DirectLine` commands the rudder by its turn-rate loop, in manual mode. It ends *length* [m] along the line.

    Parameters
    ----------
    speed : ahead [m/s]. throttle : thrust ahead [fraction of full], where the rudder is commanded.
    output : the inverse of the actuator in yaw, from moment to normalised output; None: they are equal.
    """

    kind, purpose = "follow-line", "proof"

    def __init__(
        self,
        law: LineOfHeading | DirectLine,
        offset: float,
        length: float,
        speed: float,
        throttle: float = 0.0,
        name: str = "",
        output: Callable[[float], float] | None = None,
    ) -> None:
        super().__init__(name)
        self._law, self._offset, self._length = law, offset, length
        self._speed, self._throttle = speed, throttle
        self._output = output
        self._line: Line | None = None
        self._guidance: LineGuidance | None = None
        self._steering: FeedbackController | None = None

    @property
    def in_manual(self) -> bool:  # type: ignore[override]
        """Whether it commands the rudder."""
        from gcs_autotune.control import DirectLine  # a second to import, which the table need not take

        return isinstance(self._law, DirectLine)

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """The law, offset, length and speed, and the line once it is known."""
        line = self._line
        place = {} if line is None else {"line_x": line.x, "line_y": line.y, "line_gamma": line.gamma}
        return {
            "law": type(self._law).__name__,
            "offset": self._offset,
            "length": self._length,
            "speed": self._speed,
            **place,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the command for every observation until the end of the line."""
        line = self._line = self._begin(now)
        start, patience = now.t, PATIENCE * (abs(self._offset) + self._length) / max(self._speed, LEAST_SPEED)
        while True:
            state = state_on(line, now)
            if not (math.isfinite(state.d) and math.isfinite(state.d_rate) and math.isfinite(now.r)):
                self._end("aborted", "the vehicle does not report its position or velocity. Check its GPS")
                now = yield Actuate(X=self._throttle) if self.in_manual else HeadingTarget(now.psi, self._speed)
                continue
            if state.along >= self._length:
                self._end("completed", f"{self._length:.0f} m along the line, {state.d:.2f} m from it at the end")
            elif now.t - start > patience:
                self._end("stopped", f"{state.along:.0f} m of {self._length:.0f} m after {patience:.0f} s")
            now = yield self._command(state, now)

    def _begin(self, now: Observation) -> Line:
        """Return the line, with the law ready to follow it."""
        from gcs_autotune.control import DirectLine, Line, LineGuidance

        gamma = now.psi
        line = Line(now.x - self._offset * math.sin(gamma), now.y + self._offset * math.cos(gamma), gamma)
        self._mark(now.t, "line", {"x": line.x, "y": line.y, "gamma": gamma})
        if isinstance(self._law, DirectLine):
            self._steering = self._law.rate.started()
        else:
            self._guidance = LineGuidance(self._law, line)
        return line

    def _command(self, state: LineState, now: Observation) -> Command:
        if self._guidance is not None:
            self.target = self._guidance.update(state, now.t)
            return HeadingTarget(self.target, self._speed)
        direct = cast("DirectLine", self._law)
        assert self._steering is not None
        N = self._steering.update(direct.turn_rate(state), now.r, now.r, now.t)
        return Actuate(X=self._throttle, N=N if self._output is None else self._output(N))


PATIENCE = 3.0
"""Longest duration, as a multiple of that at full speed straight to the end. Chosen."""
LEAST_SPEED = 0.2
"""Speed assumed of a craft whose speed is unknown [m/s]. Chosen."""


def state_on(line: Line, now: Observation) -> LineState:
    """Return the state relative to *line*; a craft that does not report its sideways speed has none."""
    u = now.u if math.isfinite(now.u) else now.speed
    v = now.v if math.isfinite(now.v) else 0.0
    s, c = math.sin(now.psi), math.cos(now.psi)
    return line.state(now.x, now.y, now.psi, now.r, (u * c - v * s, u * s + v * c))
