"""A hull that sways: surge, sway and yaw coupled (Fossen2011, section 6.5), for models brought from outside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sitl.body import AxisDynamics, Body, Loads, World

__all__ = ["Coupling", "PlaneBody", "Term"]


@dataclass(frozen=True, slots=True)
class Term:
    """A force that goes with a product of velocities: ``row`` 0 X, 1 Y, 2 N; factors ``u v r |u| |v| |r|``."""

    row: int
    coefficient: float
    factors: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Coupling:
    """What couples the horizontal degrees of freedom.

    ``Y_rdot``, ``N_vdot``: off-diagonal inertia (SNAME: minus the matrix' entry); ``coriolis``: whether C(nu) follows
    from M; ``terms``: everything else.
    """

    Y_rdot: float = 0.0
    N_vdot: float = 0.0
    coriolis: bool = False
    terms: tuple[Term, ...] = ()


class PlaneBody(Body):
    """A :class:`~sitl.body.Body` with ``v`` [m/s] as a degree of freedom of its own."""

    sways = True

    def __init__(
        self,
        surge: AxisDynamics,
        sway: AxisDynamics,
        heave: AxisDynamics,
        yaw: AxisDynamics,
        world: World,
        coupling: Coupling,
    ) -> None:
        super().__init__(surge, heave, yaw, world)
        self.sway = sway
        self.coupling = coupling

    def axes(self) -> tuple[tuple[float, float, float], ...]:
        """Return (alpha, beta, beta2) of surge, heave, yaw and sway."""
        return (*super().axes(), (self.sway.alpha, self.sway.beta, self.sway.beta2))

    def set_axes(self, axes: tuple[tuple[float, float, float], ...]) -> None:
        """Set what :meth:`axes` returns."""
        super().set_axes(axes[:-1])
        self.sway.alpha, self.sway.beta, self.sway.beta2 = axes[-1]

    @property
    def drift(self) -> float:
        """The sideways speed [m/s], over the ground or through the water."""
        return self.v + super().drift

    def acceleration(self, u: float, v: float, r: float, loads: Loads) -> tuple[float, float, float]:
        """Return (udot, vdot, rdot) at a velocity under *loads*."""
        surge, sway, yaw, ties = self.surge, self.sway, self.yaw, self.coupling
        X = loads.X - (surge.beta + surge.beta2 * abs(u)) * u
        Y = loads.Y - (sway.beta + sway.beta2 * abs(v)) * v
        N = loads.N - (yaw.beta + yaw.beta2 * abs(r)) * r
        m_23, m_32 = -ties.Y_rdot - self.Y_rdot, -ties.N_vdot - self.Y_rdot
        if ties.coriolis:
            sideways = sway.alpha * v + 0.5 * (m_23 + m_32) * r
            ahead = surge.alpha * u
            X, Y, N = X + sideways * r, Y - ahead * r, N + ahead * v - sideways * u
        if ties.terms:
            more = [0.0, 0.0, 0.0]
            factors = {"u": u, "v": v, "r": r, "|u|": abs(u), "|v|": abs(v), "|r|": abs(r)}
            for term in ties.terms:
                more[term.row] += term.coefficient * math.prod([factors[name] for name in term.factors])
            X, Y, N = X + more[0], Y + more[1], N + more[2]
        det = sway.alpha * yaw.alpha - m_23 * m_32
        return X / surge.alpha, (yaw.alpha * Y - m_23 * N) / det, (sway.alpha * N - m_32 * Y) / det

    def step(self, loads: Loads, dt: float) -> None:
        """Run *dt* seconds [s] under constant *loads*: Runge-Kutta, order 4."""
        start = (self.u, self.v, self.r, self.psi, self.x, self.y)

        def slope(state: Sequence[float]) -> tuple[float, ...]:
            u, v, r, psi, _, _ = state
            c, s = math.cos(psi), math.sin(psi)
            return (*self.acceleration(u, v, r, loads), r, c * u - s * v + self.V_x, s * u + c * v + self.V_y)

        k1 = slope(start)
        k2 = slope([a + 0.5 * dt * k for a, k in zip(start, k1, strict=True)])
        k3 = slope([a + 0.5 * dt * k for a, k in zip(start, k2, strict=True)])
        k4 = slope([a + dt * k for a, k in zip(start, k3, strict=True)])
        slopes = zip(start, k1, k2, k3, k4, strict=True)
        end = [a + dt / 6.0 * (p + 2.0 * (q + r) + s) for a, p, q, r, s in slopes]
        self.u, self.v, self.r, self.psi, self.x, self.y = end
        if not self.world.floats:
            self._heave(loads.Z + self._cushion(), dt)
        self._rock((self.u - start[0]) / dt, dt)
