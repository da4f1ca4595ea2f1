"""The hull: its degrees of freedom, what couples them, their Runge-Kutta steps, and where they take it.

Surge, heave and yaw each obey ``alpha*nudot + beta*nu + beta2*|nu|*nu = force`` (SNAME axes, z down, SI and
radians); roll and pitch only follow a little, unless it pitches by a moment of its own. A hull that sways has surge,
sway and yaw coupled besides (Fossen2011, section 6.5): vehicles with a sway of their own, and models brought from
outside. A bare hull in open loop (:mod:`sitl.open_loop`) is this one too, stepped by another rule.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

__all__ = ["AxisDynamics", "Body", "Coupling", "Hull", "HullTerm", "Loads", "World", "coupling_of"]

_PLANE = ("X", "Y", "N")
_FACTOR = re.compile(r"\|[uvr]\||[uvr]")

_CUSHION = 3.0
"""Chosen: natural frequency [rad/s] of the soft spring that stops a body at surface and bottom."""
_HEEL = 0.05
"""Chosen: roll [rad] per m/s^2 of centripetal acceleration; the boat leans outwards a little."""
_SQUAT = 0.05
"""Chosen: pitch [rad] per m/s^2 of surge acceleration."""
_ROCK_TIME = 0.5
"""Chosen: time constant [s] with which roll and pitch follow."""


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
    """What acts on the hull: ``X`` [N] ahead, ``Y`` [N] to starboard, ``Z`` [N] down, ``N`` [N m] to starboard, ``M``
    [N m] bow up."""

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    N: float = 0.0
    M: float = 0.0


@dataclass(frozen=True, slots=True)
class World:
    """The water: surface at z = 0, bottom at ``bottom`` [m]. ``floats`` bodies do not heave at all."""

    bottom: float = math.inf
    floats: bool = False


@dataclass(frozen=True, slots=True)
class HullTerm:
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
    terms: tuple[HullTerm, ...] = ()


def coupling_of(derivatives: Mapping[str, float], *, coriolis: bool, shared: float = 0.0) -> Coupling:
    """Return what SNAME *derivatives* of surge, sway and yaw say beyond each one's own drag and inertia.

    ``Y_rdot`` and ``N_vdot`` (equal unless both are there), ``Y_r``, ``N_uv``, ``Y_|v|r`` ...; two equal letters are
    with modulus. *shared* [kg m]: mass times the distance of its centre ahead of the middle.

    Raises
    ------
    ValueError
        A name is none of these.
    """
    left = dict(derivatives)
    Y_rdot = left.pop("Y_rdot", 0.0)
    N_vdot = left.pop("N_vdot", Y_rdot)
    terms = []
    for name, value in left.items():
        force, _, rest = name.partition("_")
        factors = _FACTOR.findall(rest)
        if force not in _PLANE or "".join(factors) != rest or not factors:
            raise ValueError(f"the simulator cannot fly {name}")
        if len(factors) == 2 and factors[0] == factors[1] and "|" not in rest:
            factors[0] = f"|{factors[0]}|"
        terms.append(HullTerm(_PLANE.index(force), value, tuple(factors)))
    return Coupling(Y_rdot - shared, N_vdot - shared, coriolis, tuple(terms))


@dataclass(frozen=True, slots=True)
class Hull:
    """A plain hull: per degree of freedom inertia (> 0), linear and quadratic drag (0 where not given), SI.

    ``gain`` [N m/rad]: moment per rudder angle ``delta``; ``bottom`` [m]: depth of the water.
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


class Body:
    """The hull's true state: ``x y z`` [m, NED], ``psi`` [rad, continuous], ``u v w`` [m/s], ``r`` [rad/s].

    ``u v`` are through the water, which itself moves with ``V_x V_y`` [m/s, towards north and east]; ``over_ground``
    says what its speed sensor measures. Without a *sway* of its own it does not sway: ``v`` stays 0, and ``Y_rdot``
    (an effect's, off the diagonal of the mass matrix) has nothing to couple. A *coupling* ties surge, sway and yaw.
    """

    def __init__(
        self,
        surge: AxisDynamics,
        heave: AxisDynamics,
        yaw: AxisDynamics,
        world: World,
        *,
        sway: AxisDynamics | None = None,
        coupling: Coupling | None = None,
    ) -> None:
        self.surge = surge
        self.heave = heave
        self.yaw = yaw
        self.sway = AxisDynamics(math.inf, 0.0, 0.0)
        self.sways = False
        self.world = world
        self.coupling: Coupling | None = None
        self.x = self.y = self.z = 0.0
        self.psi = self.u = self.w = self.r = 0.0
        self.phi = self.theta = self.p = self.q = 0.0
        self.wdot = 0.0
        self.v = self.V_x = self.V_y = self.Y_rdot = 0.0
        self.over_ground = True
        self.pitch: AxisDynamics | None = None
        self.righting = 0.0
        if sway is not None:
            self.couple(sway, coupling)

    def couple(self, sway: AxisDynamics, coupling: Coupling | None) -> None:
        """From now on it sways, with surge, sway and yaw tied by *coupling*, if there is one."""
        self.sway, self.sways, self.coupling = sway, True, coupling

    def pitches(self, pitch: AxisDynamics, righting: float) -> None:
        """From now on it pitches by a moment, which *righting* [N m/rad] works against, and swings."""
        self.pitch, self.righting = pitch, righting

    def axes(self) -> tuple[tuple[float, float, float], ...]:
        """Return (alpha, beta, beta2) of surge, heave, yaw and sway."""
        return tuple((axis.alpha, axis.beta, axis.beta2) for axis in (self.surge, self.heave, self.yaw, self.sway))

    def set_axes(self, axes: tuple[tuple[float, float, float], ...]) -> None:
        """Set what :meth:`axes` returns."""
        for axis, (alpha, beta, beta2) in zip((self.surge, self.heave, self.yaw, self.sway), axes, strict=True):
            axis.alpha, axis.beta, axis.beta2 = alpha, beta, beta2

    @property
    def drift(self) -> float:
        """The sideways speed [m/s] its sensor would measure: over the ground or through the water."""
        water = self.V_y * math.cos(self.psi) - self.V_x * math.sin(self.psi) if self.over_ground else 0.0
        return self.v + water if self.sways else water

    @property
    def speed(self) -> float:
        """The surge speed [m/s] its sensor measures: over the ground or through the water."""
        if not self.over_ground:
            return self.u
        return self.u + self.V_x * math.cos(self.psi) + self.V_y * math.sin(self.psi)

    def acceleration(self, u: float, v: float, r: float, loads: Loads) -> tuple[float, float, float]:
        """Return (udot, vdot, rdot) at a velocity under *loads*."""
        surge, sway, yaw, ties = self.surge, self.sway, self.yaw, self.coupling
        X = loads.X - (surge.beta + surge.beta2 * abs(u)) * u
        Y = loads.Y - (sway.beta + sway.beta2 * abs(v)) * v
        N = loads.N - (yaw.beta + yaw.beta2 * abs(r)) * r
        if ties is None:
            if not self.Y_rdot:
                return X / surge.alpha, Y / sway.alpha, N / yaw.alpha
            m_23 = m_32 = -self.Y_rdot
        else:
            m_23, m_32 = -ties.Y_rdot - self.Y_rdot, -ties.N_vdot - self.Y_rdot
            X, Y, N = self._tied(ties, (u, v, r), (X, Y, N), 0.5 * (m_23 + m_32))
        det = sway.alpha * yaw.alpha - m_23 * m_32
        return X / surge.alpha, (yaw.alpha * Y - m_23 * N) / det, (sway.alpha * N - m_32 * Y) / det

    def _tied(
        self, ties: Coupling, nu: tuple[float, float, float], forces: tuple[float, float, float], shared: float
    ) -> tuple[float, float, float]:
        """Return *forces* (X, Y, N) with what Coriolis' term and products of the velocities *nu* (u, v, r) add."""
        (u, v, r), (X, Y, N) = nu, forces
        if ties.coriolis:
            sideways = self.sway.alpha * v + shared * r
            ahead = self.surge.alpha * u
            X, Y, N = X + sideways * r, Y - ahead * r, N + ahead * v - sideways * u
        if ties.terms:
            more = [0.0, 0.0, 0.0]
            factors = {"u": u, "v": v, "r": r, "|u|": abs(u), "|v|": abs(v), "|r|": abs(r)}
            for term in ties.terms:
                more[term.row] += term.coefficient * math.prod([factors[name] for name in term.factors])
            X, Y, N = X + more[0], Y + more[1], N + more[2]
        return X, Y, N

    def step(self, loads: Loads, dt: float) -> None:
        """Run *dt* seconds [s] under constant *loads*: Runge-Kutta, order 4."""
        old_u = self.u
        if self.coupling is None:
            self._step_uncoupled(loads, dt)
        else:
            self._step_coupled(loads, dt)
        if not self.world.floats:
            self._heave(loads.Z + self._cushion(), dt)
        self._rock((self.u - old_u) / dt, loads.M, dt)

    def _step_uncoupled(self, loads: Loads, dt: float) -> None:
        """Step each degree of freedom by itself; the track is that of the heading halfway."""
        self.r, turned = self.yaw.step(self.r, loads.N, dt)
        self.u, ahead = self.surge.step(self.u, loads.X, dt)
        middle = self.psi + 0.5 * turned
        self.x += ahead * math.cos(middle) + self.V_x * dt
        self.y += ahead * math.sin(middle) + self.V_y * dt
        self.psi += turned

    def _step_coupled(self, loads: Loads, dt: float) -> None:
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

    def _rock(self, udot: float, M: float, dt: float) -> None:
        share = dt / (_ROCK_TIME + dt)
        rolled = share * (-_HEEL * self.u * self.r - self.phi)
        self.phi += rolled
        self.p = rolled / dt
        if self.pitch is None:
            pitched = share * (_SQUAT * udot - self.theta)
            self.q = pitched / dt
        else:
            moment = M + self.righting * (_SQUAT * udot - self.theta)
            self.q, pitched = self.pitch.step(self.q, moment, dt)
        self.theta += pitched
