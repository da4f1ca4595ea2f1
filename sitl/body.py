"""The hull: three uncoupled degrees of freedom, their own Runge-Kutta steps, and where they take it.

Surge, heave and yaw each obey ``alpha*nudot + beta*nu + beta2*|nu|*nu = force`` (SNAME axes, z down, SI and
radians); they are uncoupled on purpose, sway is absent, and roll and pitch only follow the motion a little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["AxisDynamics", "Body", "Loads", "World"]


class AxisDynamics:
    """One degree of freedom: inertia ``alpha``, linear drag ``beta``, quadratic drag ``beta2``."""

    __slots__ = ("alpha", "beta", "beta2")

    def __init__(self, alpha: float, beta: float, beta2: float) -> None:
        self.alpha = alpha
        self.beta = beta
        self.beta2 = beta2

    def acceleration(self, nu: float, force: float) -> float:
        """Return nudot [m/s^2 or rad/s^2] at velocity *nu* under *force* [N or N m]."""
        return (force - (self.beta + self.beta2 * abs(nu)) * nu) / self.alpha

    def step(self, nu: float, force: float, dt: float) -> tuple[float, float]:
        """Return (velocity after *dt*, distance covered) under a constant *force*: Runge-Kutta, order 4."""
        a, b, c = self.alpha, self.beta, self.beta2
        half = 0.5 * dt
        k1 = (force - (b + c * abs(nu)) * nu) / a
        nu2 = nu + half * k1
        k2 = (force - (b + c * abs(nu2)) * nu2) / a
        nu3 = nu + half * k2
        k3 = (force - (b + c * abs(nu3)) * nu3) / a
        nu4 = nu + dt * k3
        k4 = (force - (b + c * abs(nu4)) * nu4) / a
        sixth = dt / 6.0
        return nu + sixth * (k1 + 2.0 * (k2 + k3) + k4), sixth * (nu + 2.0 * (nu2 + nu3) + nu4)


@dataclass(slots=True)
class Loads:
    """What acts on the hull: ``X`` [N] ahead, ``Y`` [N] to starboard, ``Z`` [N] down, ``N`` [N m] to starboard."""

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    N: float = 0.0


@dataclass(frozen=True, slots=True)
class World:
    """The water: surface at z = 0, bottom at ``bottom`` [m]. ``floats`` bodies do not heave at all."""

    bottom: float = math.inf
    floats: bool = False


_CUSHION = 3.0
"""Chosen: natural frequency [rad/s] of the soft spring that stops a body at surface and bottom."""
_HEEL = 0.05
"""Chosen: roll [rad] per m/s^2 of centripetal acceleration; the boat leans outwards a little."""
_SQUAT = 0.05
"""Chosen: pitch [rad] per m/s^2 of surge acceleration."""
_ROCK_TIME = 0.5
"""Chosen: time constant [s] with which roll and pitch follow."""


class Body:
    """The hull's true state: ``x y z`` [m, NED], ``psi`` [rad, continuous], ``u w`` [m/s], ``r`` [rad/s].

    ``u`` is through the water, which itself moves with ``V_x V_y`` [m/s, towards north and east]; ``over_ground`` says
    what its speed sensor measures. It does not sway: ``v`` stays 0, and ``Y_rdot`` has nothing to couple.
    """

    sways = False

    def __init__(self, surge: AxisDynamics, heave: AxisDynamics, yaw: AxisDynamics, world: World) -> None:
        self.surge = surge
        self.heave = heave
        self.yaw = yaw
        self.world = world
        self.x = self.y = self.z = 0.0
        self.psi = self.u = self.w = self.r = 0.0
        self.phi = self.theta = self.p = self.q = 0.0
        self.wdot = 0.0
        self.v = self.V_x = self.V_y = self.Y_rdot = 0.0
        self.over_ground = True

    def axes(self) -> tuple[tuple[float, float, float], ...]:
        """Return (alpha, beta, beta2) of surge, heave and yaw."""
        return tuple((axis.alpha, axis.beta, axis.beta2) for axis in (self.surge, self.heave, self.yaw))

    def set_axes(self, axes: tuple[tuple[float, float, float], ...]) -> None:
        """Set what :meth:`axes` returns."""
        for axis, (alpha, beta, beta2) in zip((self.surge, self.heave, self.yaw), axes, strict=True):
            axis.alpha, axis.beta, axis.beta2 = alpha, beta, beta2

    @property
    def drift(self) -> float:
        """The sideways speed [m/s] over the ground, which is the water's; 0 when measured through the water."""
        return self.V_y * math.cos(self.psi) - self.V_x * math.sin(self.psi) if self.over_ground else 0.0

    @property
    def speed(self) -> float:
        """The surge speed [m/s] its sensor measures: over the ground or through the water."""
        if not self.over_ground:
            return self.u
        return self.u + self.V_x * math.cos(self.psi) + self.V_y * math.sin(self.psi)

    def step(self, loads: Loads, dt: float) -> None:
        """Run *dt* seconds [s] under constant *loads*."""
        old_u = self.u
        self.r, turned = self.yaw.step(self.r, loads.N, dt)
        self.u, ahead = self.surge.step(old_u, loads.X, dt)
        middle = self.psi + 0.5 * turned
        self.x += ahead * math.cos(middle) + self.V_x * dt
        self.y += ahead * math.sin(middle) + self.V_y * dt
        self.psi += turned
        if not self.world.floats:
            self._heave(loads.Z + self._cushion(), dt)
        self._rock((self.u - old_u) / dt, dt)

    def _heave(self, force: float, dt: float) -> None:
        self.w, down = self.heave.step(self.w, force, dt)
        self.z += down
        self.wdot = self.heave.acceleration(self.w, force)

    def _cushion(self) -> float:
        """Return the soft spring's force [N, down] beyond surface or bottom, zero between them."""
        if 0.0 <= self.z <= self.world.bottom:
            return 0.0
        beyond = self.z if self.z < 0.0 else self.z - self.world.bottom
        return -self.heave.alpha * _CUSHION * (_CUSHION * beyond + 2.0 * self.w)

    def _rock(self, udot: float, dt: float) -> None:
        share = dt / (_ROCK_TIME + dt)
        rolled = share * (-_HEEL * self.u * self.r - self.phi)
        pitched = share * (_SQUAT * udot - self.theta)
        self.phi += rolled
        self.theta += pitched
        self.p, self.q = rolled / dt, pitched / dt
