"""Keeping a distance to a wall ahead, facing it, with two rangefinders."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.hold_controller import HELD_BEFORE, HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

if TYPE_CHECKING:
    from gcs_autotune.control import DistanceLaw, WallReading

__all__ = ["FaceWall", "KeepDistance"]

FACING = math.radians(5.0)
"""Angle to the wall below which the distance controller may begin, Miskovic2010, section 8.2.2: the angle first."""
FACED_FOR = 2.0
"""How long the angle must be that small [s]. Chosen."""
LOST = 10.0
"""Longest time without the wall, after which the manoeuvre ends [s]: twice the drop-outs of Miskovic2010, fig. 8.17."""
PATIENCE = 60.0
"""Longest time to face the wall [s]. Chosen."""

Output = Callable[[float], float]


class FaceWall(Manoeuvre):
    """Turn to *heading* [rad] and hold it, until the craft faces the wall and measures the distance to it.

    Relays on the heading leave a craft that does not face the wall. Two laser dots, or beams that look aside, are then
    out of sight.
    """

    kind, purpose = "face-wall", "transit"

    def __init__(self, heading: float) -> None:
        super().__init__()
        self._heading = self.target = heading

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Heading."""
        return {"signal": "psi", "heading": self._heading}

    def commands(self, now: Observation) -> Commands:
        """Yield the outputs that turn the craft and hold heading and depth."""
        holds = [HoldController(g, self._heading if g.signal == "psi" else math.nan) for g in HELD_DURING["d"]]
        start = faced = now.t
        while True:
            if not abs(now.psi - self._heading) <= FACING or not math.isfinite(now.d):
                faced = now.t
            if now.t - faced >= FACED_FOR:
                self._end("completed", f"faces the wall, {now.d:.2f} m ahead")
            elif now.t - start > PATIENCE:
                seen = "" if math.isfinite(now.d) else " and the rangefinders do not see the wall"
                off = abs(math.degrees(now.psi - self._heading))
                self._end("aborted", f"after {PATIENCE:.0f} s the heading is {off:.0f} deg off{seen}")
            now = yield hold(Actuate(), holds, now)


class KeepDistance(Manoeuvre):
    """Face the wall, step the distance by *step* [m] after *settle* [s], and step back.

    Parameters
    ----------
    apart : distance between the two rangefinders [m]; not used if the craft reports the angle to the wall.
    outputs : the inverse of the actuators ahead and in yaw, from force to normalised output.
    """

    kind, purpose = "keep-distance", "proof"

    def __init__(
        self,
        law: DistanceLaw | None,
        apart: float,
        step: float,
        duration: float,
        settle: float,
        outputs: tuple[Output, Output],
        name: str = "",
    ) -> None:
        super().__init__(name, signal="d", force="X")
        self._law, self._apart, self._outputs = law, apart, outputs
        self._step, self._duration, self._settle = step, duration, settle
        self._seen: tuple[float, float] = (math.nan, math.nan)

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Step, durations and rangefinders."""
        return {"signal": "d", "size": self._step, "duration": self._duration, "apart": self._apart}

    def commands(self, now: Observation) -> Commands:
        """Yield the outputs: facing, settling, step, step back."""
        assert self._law is not None
        controller = self._law.started()
        depth = [HoldController(gains) for gains in HELD_BEFORE.values()]
        phases: Iterator[tuple[str, float, float]] = iter(())
        start = faced = now.t
        base, until = math.nan, math.inf
        self.phase = "facing the wall"
        while True:
            reading = self._reading(now)
            X, N = controller.update(self.target if math.isfinite(self.target) else 0.0, reading, now.t)
            unseen = controller.unseen(now.t)
            if math.isnan(base):
                X = 0.0
                controller.hold_thrust()
                if math.isinf(unseen) or abs(controller.estimate.phi) > FACING:
                    faced = now.t
                if now.t - faced >= FACED_FOR:
                    base, until = controller.estimate.d, now.t
                    phases = iter(self._phases(base))
                elif now.t - start > PATIENCE:
                    self._end("aborted", f"the craft does not face the wall after {PATIENCE:.0f} s")
            elif unseen > LOST:
                self._end("aborted", f"the rangefinders have not seen the wall for {LOST:.0f} s")
            if now.t >= until:
                self.phase, seconds, offset = next(phases, ("", 0.0, 0.0))
                if self.phase:
                    self.target, until = base + offset, now.t + seconds
                    self._mark(now.t, "target", {"value": self.target, "phase": self.phase})
                else:
                    self._end("completed", self._flown)
            command = Actuate(X=self._outputs[0](X), N=self._outputs[1](N))
            now = yield self._beside(command, now, depth)

    _flown = "step and step back flown"

    def _phases(self, base: float) -> Sequence[tuple[str, float, float]]:
        """Return name, time [s] and distance [m] from that at the start, *base* [m], of each phase."""
        return ("hold", self._settle, 0.0), ("step", self._duration, self._step), ("back", self._duration, 0.0)

    def _beside(self, command: Actuate, now: Observation, depth: Sequence[HoldController]) -> Actuate:
        """Return *command* with the outputs of the other axes."""
        return hold(command, depth, now)

    def _reading(self, now: Observation) -> WallReading:
        """Return what is new: a distance that repeats the last one is not a new measurement."""
        from gcs_autotune.control import WallReading  # a second to import, which the table need not take

        has_angle = math.isfinite(now.wall_angle)
        pair = (now.d, now.wall_angle if has_angle else now.d_starboard)
        if not (math.isfinite(pair[0]) and math.isfinite(pair[1])) or pair == self._seen:
            return WallReading(now.psi)
        self._seen = pair
        if has_angle:
            return WallReading(now.psi, now.d * math.cos(now.wall_angle), now.wall_angle)
        return WallReading.of_two(now.psi, *pair, self._apart)
