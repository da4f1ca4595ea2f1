"""Guidance and control of a whole craft: from where it should be to its outputs (Miskovic2010, fig. 8.1 and 8.2).

A craft with thrust sideways holds a pose. Any other craft is steered: line of sight to the moving target commands a
heading, and the distance along the path commands the thrust ahead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from gcs_autotune.control.choice import AxisLoop
from gcs_autotune.control.feedback import FeedbackController
from gcs_autotune.control.line import LINE_LAWS, DirectLine, Line, LineOfHeading, LineQuestion
from gcs_autotune.control.position import POSITION_LAWS, Pose, PositionController, PositionTarget
from gcs_autotune.control.structure import STRUCTURES
from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.notebook import Displayed

__all__ = ["Helm", "PoseHelm", "Reach", "SteeredHelm", "helm_for", "reach_of"]

STILL = 0.02
"""Speed of the target [m/s] below which it counts as at rest: a steered craft then keeps its heading."""
BEHIND = 2.0
"""Largest lead of the target that the thrust ahead makes up [m]. Chosen: a turn at the start must not saturate it."""
LEAST_THRUST = 0.3
"""Smallest thrust of a craft that steers only under way, relative to that of its cruise."""


@dataclass(frozen=True, slots=True)
class Reach(Displayed):
    """What a craft can do.

    ``speed``: greatest speed that its loops use [m/s]; ``rate``: turn rate [rad/s]; ``sideways``: whether it thrusts
    sideways; ``under_way``: whether it steers only under way; ``spot``: whether it turns on the spot.
    """

    speed: float
    rate: float
    sideways: bool
    under_way: bool
    spot: bool

    def radius(self, speed: float) -> float:
        """Return the smallest radius of a turn at *speed* [m/s]; 0 for a craft that turns on the spot at rest."""
        return 0.0 if self.sideways else speed / self.rate


class Helm(Protocol):
    """What brings a craft to a moving target: one call of :meth:`update` per control tick."""

    def update(self, target: PositionTarget, now: Observation) -> Actuate:
        """Return the outputs. A coordinate of the target that is NaN is not controlled."""


class _Depth:
    """Depth by our own loop, if there is one; else no output."""

    def __init__(self, loop: AxisLoop | None) -> None:
        self._loop = loop
        self._controller = None if loop is None else loop.design.law.started(-loop.design.model.delta)

    def output(self, target: PositionTarget, now: Observation) -> float:
        z = target.position[2]
        if self._loop is None or self._controller is None or not math.isfinite(z + now.z):
            return 0.0
        rate = now.w if math.isfinite(now.w) else 0.0
        return self._loop.output(self._controller.update(z, now.z, rate, now.t))


class PoseHelm:
    """Helm of a craft with thrust sideways: a position law in three degrees of freedom, and the depth loop."""

    def __init__(self, loops: Mapping[str, AxisLoop], law: str = "sliding") -> None:
        three = [loops[dof] for dof in ("surge", "sway", "yaw")]
        self._outputs = [loop.output for loop in three]
        self._controller: PositionController = POSITION_LAWS[law](*(loop.design for loop in three))()
        self._depth = _Depth(loops.get("heave"))

    def update(self, target: PositionTarget, now: Observation) -> Actuate:
        """Return the outputs."""
        flat = PositionTarget(_flat(target.position), _flat(target.velocity), _flat(target.acceleration))
        pose = Pose((now.x, now.y, 0.0, now.psi), (now.u, now.v, 0.0, now.r))
        X, Y, _, N = self._controller.update(flat, pose, now.t)
        ahead, sideways, turning = self._outputs
        return Actuate(X=ahead(X), Y=sideways(Y), N=turning(N), Z=self._depth.output(target, now))


def _flat(values: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return values[0], values[1], 0.0, values[3]


class SteeredHelm:
    """Helm of a craft that is steered: heading by line of sight, thrust by the distance along the path.

    A target without a position (NaN) is a heading: then the thrust is ``throttle``.

    least : smallest thrust while a target moves [fraction of full]. throttle : thrust ahead without a position.
    """

    def __init__(
        self,
        loops: Mapping[str, AxisLoop],
        guidance: Callable[[float], LineOfHeading],
        *,
        least: float = -math.inf,
        throttle: float = 0.0,
    ) -> None:
        self._yaw, self._surge = loops["yaw"], loops.get("surge")
        self._guidance, self._least, self._throttle = guidance, least, throttle
        self._heading = self._yaw.design.law.started(-self._yaw.design.model.delta)
        self._thrust: FeedbackController | None = None
        self._depth = _Depth(loops.get("heave"))
        self._memory, self._t = 0.0, math.nan
        self._along = 0.0
        self._begins = throttle if math.isfinite(least) else 0.0

    def update(self, target: PositionTarget, now: Observation) -> Actuate:
        """Return the outputs."""
        dt = 0.0 if math.isnan(self._t) else max(now.t - self._t, 0.0)
        self._t = now.t
        psi, X = target.position[3], self._throttle
        if math.isfinite(target.position[0]):
            psi, X = self._followed(target, now, dt)
        N = self._heading.update(psi, now.psi, now.r, now.t)
        return Actuate(X=X, N=self._yaw.output(N), Z=self._depth.output(target, now))

    def _followed(self, target: PositionTarget, now: Observation, dt: float) -> tuple[float, float]:
        """Return the heading [rad] and the thrust ahead [fraction] that follow the moving target."""
        assert self._surge is not None
        north, east = target.velocity[:2]
        speed = math.hypot(north, east)
        moves = speed > STILL
        gamma = math.atan2(east, north) if moves else target.position[3]
        u = now.u if math.isfinite(now.u) else now.speed
        v = now.v if math.isfinite(now.v) else 0.0
        s, c = math.sin(now.psi), math.cos(now.psi)
        line = Line(target.position[0], target.position[1], gamma)
        state = line.state(now.x, now.y, now.psi, now.r, (u * c - v * s, u * s + v * c))
        relative = 0.0
        if moves:
            relative, self._memory = self._guidance(speed).heading(state, self._memory, dt)
        lead = min(max(-state.along, -BEHIND), BEHIND)
        law = self._surge.design.law
        if self._thrust is None:
            self._thrust = replace(law, structure=STRUCTURES["PID"]).started(self._begins)
        self._along += speed * dt
        psi = gamma + relative
        demand = self._thrust.update(self._along, self._along - lead, u, now.t)
        if self._least > -math.inf:
            X = self._surge.output(demand)
            return psi, max(X, self._least) if moves else X
        # a craft that turns on the spot turns before it goes
        return psi, self._surge.output(demand * max(math.cos(psi - now.psi), 0.0))


def reach_of(loops: Mapping[str, AxisLoop], *, under_way: bool, spot: bool) -> Reach:
    """Return what a craft with those *loops* can do; arguments as in :class:`Reach`."""

    def steady(name: str) -> float:
        design = loops[name].design
        low, high = design.law.limits
        return min(design.model.steady_velocity(high), -design.model.steady_velocity(low))

    surge, sideways = loops.get("surge"), "sway" in loops
    speed = math.inf if surge is None else surge.design.model.steady_velocity(surge.design.law.limits[1])
    return Reach(min(speed, steady("sway")) if sideways else speed, steady("yaw"), sideways, under_way, spot)


def helm_for(loops: Mapping[str, AxisLoop], reach: Reach, throttle: float = 0.0, *, places: bool = True) -> Helm:
    """Return a helm that has not begun.

    throttle : cruise of a craft that steers under way [fraction of full]. places : whether it follows positions; else
        only headings, with thrust ahead at the throttle.
    """
    if places and reach.sideways and "surge" in loops:
        return PoseHelm(loops)
    yaw = loops["yaw"].design

    def guidance(speed: float) -> LineOfHeading:
        question = LineQuestion(yaw.model, yaw.law.closed_loop(yaw.model), yaw.wanted.kind, yaw.wanted.omega_0, speed)
        law = LINE_LAWS["integral"](question)
        assert not isinstance(law, DirectLine)
        return law

    least = LEAST_THRUST * throttle if reach.under_way else -math.inf
    return SteeredHelm(loops, guidance, least=least, throttle=0.0 if reach.spot else throttle)
