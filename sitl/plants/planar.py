"""A hull that moves in the horizontal plane and dives: a rigid body that stays level.

Surge, heave and yaw each obey ``alpha*nudot + beta*nu + beta2*|nu|*nu = force`` (SNAME axes, z down, SI and radians).
Roll and pitch only change slightly with the motion, unless the hull has a pitch moment of its own. If it sways, surge,
sway and yaw are also coupled (Fossen2011, section 6.5). A bare hull in open loop (:mod:`sitl.open_loop`) has the same
equations, with another integrator.
"""

from __future__ import annotations

import math

from sitl.plants import kernel
from sitl.plants.plant import GRAVITY, Water, Wrench
from sitl.plants.rigid_body import Array, AxisDynamics, Coupling, RigidBody

__all__ = ["PlanarHull"]

_HEEL = 0.05
"""Roll [rad] per m/s^2 of centripetal acceleration; the boat leans outwards slightly. Project choice."""
_SQUAT = 0.05
"""Pitch [rad] per m/s^2 of surge acceleration. Project choice."""
_ROCK_TIME = 0.5
"""Time constant [s] with which roll and pitch follow. Project choice."""


class PlanarHull(RigidBody):
    """A hull that moves in the horizontal plane and dives, a :class:`~sitl.plants.Plant`. ``u v`` are through the
    water.

    Without *sway* dynamics it does not sway: ``v`` stays 0 and ``Y_rdot`` has no effect. A *coupling* connects surge,
    sway and yaw. Without one, the track of a step follows the heading at half the step. With *pitch* dynamics it
    responds to a moment ``M`` against ``pitch.righting`` [N m/rad].
    """

    def __init__(
        self,
        surge: AxisDynamics,
        heave: AxisDynamics,
        yaw: AxisDynamics,
        water: Water | None = None,
        *,
        sway: AxisDynamics | None = None,
        coupling: Coupling | None = None,
        pitch: AxisDynamics | None = None,
        righting: float = 0.0,
        propellers: Array | None = None,
        rudders: Array | None = None,
    ) -> None:
        axes = {"surge": surge, "heave": heave, "yaw": yaw}
        self._rocker = None if pitch is None else RigidBody({"pitch": pitch})
        super().__init__(axes, water, propellers=propellers, rudders=rudders)
        self.dofs = ("surge", "heave", "yaw")
        self.state.tilts, self._along_chord = False, True
        if sway is not None:
            self.couple(sway, coupling)
        if pitch is not None:
            self.dofs = (*self.dofs, "pitch")
            self.set_axis("pitch", pitch)
            self.parameters["pitch.righting"] = righting

    def couple(self, sway: AxisDynamics, coupling: Coupling | None) -> None:
        """Enable sway, with surge, sway and yaw connected by *coupling*, if supplied."""
        if "sway" not in self.dofs:
            self.dofs = (*self.dofs, "sway")
        self.set_axis("sway", sway)
        self._coupling, self._along_chord = coupling, coupling is None

    def _moves(self, dof: str) -> bool:
        return dof in ("surge", "sway", "yaw") or (dof == "heave" and not self.water.floats)

    def _attitude(self) -> tuple[float, float, float, float]:
        """Return the attitude of a level hull."""
        half = 0.5 * self.state.psi
        return math.cos(half), 0.0, 0.0, math.sin(half)

    def step(self, wrench: Wrench, dt: float) -> None:
        """Advance the state by *dt* [s] under a constant *wrench*, by Runge-Kutta of order 4."""
        at = self.state
        old_u = at.u
        attitude = self._attitude()
        self._before, self._dt = (at.u, at.v, at.w, *attitude, at.psi, 0.0, 0.0), dt
        self._quaternion = attitude
        self._array[0] = (at.x, at.y, at.z, *attitude, at.u, at.v, at.w, 0.0, 0.0, at.r)
        self._fly(self._cushioned(wrench), dt, 1)
        at.x, at.y, at.z, _, _, _, _, at.u, at.v, at.w, _, _, at.r = self._array[0].tolist()
        work = self._work
        at.psi += float(work[kernel.TURNED, 2])
        at.wdot = float(work[kernel.RATE, 2])
        self._rock((at.u - old_u) / dt, wrench.M, dt)

    def specific_force(self) -> tuple[float, float, float]:
        """Return the mean specific force over the last step [m/s^2], body axes, of a hull that stays level.

        It is the change of the velocity over ground minus gravity, in the axes of the heading at half the step.
        """
        if self._dt == math.inf:
            return 0.0, 0.0, -GRAVITY
        at = self.state
        u, v, w, *_ = self._before
        old = self._before[7]
        before, after = self._over_ground(u, v, w, old), self._over_ground(at.u, at.v, at.w, at.psi)
        north, east, down = ((b - a) / self._dt for a, b in zip(before, after, strict=True))
        psi = 0.5 * (old + at.psi)
        c, s = math.cos(psi), math.sin(psi)
        return c * north + s * east, c * east - s * north, down - GRAVITY

    def _over_ground(self, u: float, v: float, w: float, psi: float) -> tuple[float, float, float]:
        """Return the velocity north, east and down [m/s] of a hull level at heading *psi*."""
        c, s = math.cos(psi), math.sin(psi)
        return c * u - s * v + self.water.V_x, s * u + c * v + self.water.V_y, w

    def _rock(self, udot: float, M: float, dt: float) -> None:
        at = self.state
        share = dt / (_ROCK_TIME + dt)
        rolled = share * (-_HEEL * at.u * at.r - at.phi)
        at.phi += rolled
        at.p = rolled / dt
        if self._rocker is None:
            pitched = share * (_SQUAT * udot - at.theta)
            at.q = pitched / dt
        else:
            moment = M + self.parameters["pitch.righting"] * (_SQUAT * udot - at.theta)
            self._rocker.set_axis("pitch", self.axis("pitch"))
            self._rocker.state.q, self._rocker.state.theta = at.q, 0.0
            self._rocker.step(Wrench(M=moment), dt)
            at.q, pitched = self._rocker.state.q, self._rocker.state.theta
        at.theta += pitched
