"""A bare hull in the water, and how it is stepped: Heun's rule, second order.

The hull is uncoupled, ``alpha nudot + (beta + beta2 |nu|) nu = force`` per degree of freedom (SNAME, z down), with the
kinematics of the horizontal plane (Fossen2011, equations 2.40 and 6.112); effects couple it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from sitl.body import AxisDynamics, Loads

__all__ = ["SIGNALS", "Afloat", "Hull", "Step"]

SIGNALS = ("x", "y", "z", "psi", "u", "v", "w", "r")
"""What can be measured, SI and radians; the heading is continuous."""

Step = Callable[[float, float, tuple[float, ...]], tuple[float, ...]]
"""Time [s], step [s], state in the order of :data:`SIGNALS` -> state after it."""


@dataclass(frozen=True, slots=True)
class Hull:
    """A plain hull: per degree of freedom inertia (> 0), linear and quadratic drag (0 where not given), SI.

    ``gain`` [N m/rad]: moment per rudder angle ``delta``; ``bottom`` [m]: depth of the tank.
    """

    dofs: tuple[str, ...]
    inertia: Mapping[str, float]
    linear: Mapping[str, float]
    quadratic: Mapping[str, float] = field(default_factory=dict)
    gain: float = 1.0
    bottom: float = 10.0

    def axis(self, dof: str) -> AxisDynamics:
        """Return a degree of freedom's inertia and drag; infinitely heavy when the hull does not have it."""
        if dof not in self.dofs:
            return AxisDynamics(math.inf, 0.0, 0.0)
        return AxisDynamics(self.inertia[dof], self.linear.get(dof, 0.0), self.quadratic.get(dof, 0.0))


class Afloat:
    """The hull in the water: its state, drag and inertia, as effects see and change them."""

    def __init__(self, hull: Hull) -> None:
        self.x = self.y = self.z = self.psi = self.u = self.v = self.w = self.r = 0.0
        self.V_x = self.V_y = self.Y_rdot = 0.0
        self.over_ground = True
        self.surge, self.sway, self.heave, self.yaw = (hull.axis(dof) for dof in ("surge", "sway", "heave", "yaw"))
        self.loads = Loads()
        self.asked = Loads()
        """What the actuators do; ``loads``: with all else."""
        self.pushes: list[Callable[[float, Loads], None]] = []
        self._plain = [
            (axis, axis.alpha, axis.beta, axis.beta2) for axis in (self.surge, self.sway, self.heave, self.yaw)
        ]

    def restore(self) -> None:
        """Make inertia and drag the plain ones again."""
        for axis, alpha, beta, beta2 in self._plain:
            axis.alpha, axis.beta, axis.beta2 = alpha, beta, beta2

    def stepper(self, hull: Hull, state: Sequence[float]) -> Step:
        """Return the rule that steps this hull on from *state*: the short one when it only turns or only dives."""
        if any(
            speed
            for speed, dof in zip(state[4:], ("surge", "sway", "heave", "yaw"), strict=True)
            if dof not in hull.dofs
        ):
            return self.step
        if hull.dofs == ("yaw",):
            return self.step_alone(SIGNALS.index("psi"), "N", self.yaw)
        if hull.dofs == ("heave",):
            return self.step_alone(SIGNALS.index("z"), "Z", self.heave)
        return self.step

    def take(self, state: Sequence[float]) -> None:
        """Be in that state, in the order of :data:`SIGNALS`."""
        self.x, self.y, self.z, self.psi, self.u, self.v, self.w, self.r = state

    def slope(self, t: float, state: Sequence[float]) -> tuple[float, ...]:
        """Return the time derivative of *state*."""
        _, _, _, psi, u, v, w, r = state
        loads = self.asked
        if self.pushes:
            self.take(state)
            asked, loads = loads, self.loads
            loads.X, loads.Y, loads.Z, loads.N = asked.X, asked.Y, asked.Z, asked.N
            for push in self.pushes:
                push(t, loads)
        surge, sway, heave, yaw = self.surge, self.sway, self.heave, self.yaw
        udot = (loads.X - (surge.beta + surge.beta2 * abs(u)) * u) / surge.alpha
        wdot = (loads.Z - (heave.beta + heave.beta2 * abs(w)) * w) / heave.alpha
        Y = loads.Y - (sway.beta + sway.beta2 * abs(v)) * v
        N = loads.N - (yaw.beta + yaw.beta2 * abs(r)) * r
        if self.Y_rdot:
            shared = self.Y_rdot
            det = sway.alpha * yaw.alpha - shared * shared
            vdot, rdot = (yaw.alpha * Y + shared * N) / det, (sway.alpha * N + shared * Y) / det
        else:
            vdot, rdot = Y / sway.alpha, N / yaw.alpha
        c, s = math.cos(psi), math.sin(psi)
        return c * u - s * v + self.V_x, s * u + c * v + self.V_y, w, r, udot, vdot, wdot, rdot

    def step_alone(self, at: int, force: str, axis: AxisDynamics) -> Step:
        """Return Heun's rule for a hull of one degree of freedom: *axis*, its position at ``SIGNALS[at]``."""

        def step(t: float, dt: float, state: tuple[float, ...]) -> tuple[float, ...]:
            position, nu = state[at], state[at + 4]
            before = after = getattr(self.asked, force)
            first = (self._pushed(t, force, state) if self.pushes else before) - (axis.beta + axis.beta2 * abs(nu)) * nu
            there = nu + dt * first / axis.alpha
            if self.pushes:
                after = self._pushed(t + dt, force, _with(state, at, position + dt * nu, there))
            second = after - (axis.beta + axis.beta2 * abs(there)) * there
            half = 0.5 * dt
            return _with(state, at, position + half * (nu + there), nu + half * (first + second) / axis.alpha)

        return step

    def _pushed(self, t: float, force: str, state: Sequence[float]) -> float:
        """Return what actuators and effects do together in one degree of freedom."""
        self.take(state)
        asked, loads = self.asked, self.loads
        loads.X, loads.Y, loads.Z, loads.N = asked.X, asked.Y, asked.Z, asked.N
        for push in self.pushes:
            push(t, loads)
        pushed: float = getattr(loads, force)
        return pushed

    def step(self, t: float, dt: float, state: tuple[float, ...]) -> tuple[float, ...]:
        """Return the state after *dt* [s]: Heun's rule."""
        first = self.slope(t, state)
        second = self.slope(t + dt, [s + dt * a for s, a in zip(state, first, strict=True)])
        half = 0.5 * dt
        return tuple([s + half * (a + b) for s, a, b in zip(state, first, second, strict=True)])


def _with(state: tuple[float, ...], at: int, position: float, speed: float) -> tuple[float, ...]:
    return (*state[:at], position, *state[at + 1 : at + 4], speed, *state[at + 5 :])
