"""A hull that moves in the horizontal plane and dives, with the coupling of its degrees of freedom, integrated by
Runge-Kutta.

Surge, heave and yaw each obey ``alpha*nudot + beta*nu + beta2*|nu|*nu = force`` (SNAME axes, z down, SI and radians).
Roll and pitch only change slightly with the motion, unless the hull has a pitch moment of its own. If it sways, surge,
sway and yaw are also coupled (Fossen2011, section 6.5). A bare hull in open loop (:mod:`sitl.open_loop`) has the same
equations, with another integrator.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sitl.plants.plant import GRAVITY, Parameters, State, Water, Wrench

__all__ = ["AxisDynamics", "Coupling", "PlanarHull", "PlanarTerm", "coupling_of"]

_PLANE = ("X", "Y", "N")
_FACTOR = re.compile(r"\|[uvr]\||[uvr]")

_CUSHION = 3.0
"""Natural frequency [rad/s] of the soft spring that stops a body at surface and bottom. Project choice."""
_HEEL = 0.05
"""Roll [rad] per m/s^2 of centripetal acceleration; the boat leans outwards slightly. Project choice."""
_SQUAT = 0.05
"""Pitch [rad] per m/s^2 of surge acceleration. Project choice."""
_ROCK_TIME = 0.5
"""Time constant [s] with which roll and pitch follow. Project choice."""


@dataclass(frozen=True, slots=True)
class AxisDynamics:
    """One degree of freedom: inertia ``alpha``, linear drag ``beta``, quadratic drag ``beta2``, SI."""

    alpha: float
    beta: float
    beta2: float

    def acceleration(self, nu: float, force: float) -> float:
        """Return nudot [m/s^2 or rad/s^2] at velocity *nu* under *force* [N or N m]."""
        return (force - (self.beta + self.beta2 * abs(nu)) * nu) / self.alpha

    def step(self, nu: float, force: float, dt: float) -> tuple[float, float]:
        """Return (velocity after *dt*, distance covered) under a constant *force*, by Runge-Kutta of order 4."""
        return _advance(self.alpha, self.beta, self.beta2, nu, force, dt)


_ABSENT = AxisDynamics(math.inf, 0.0, 0.0)
"""A degree of freedom that does not move."""


def _advance(a: float, b: float, c: float, nu: float, force: float, dt: float) -> tuple[float, float]:
    """Return (velocity, distance covered) after *dt* with inertia *a*, drag *b* and *c*, by Runge-Kutta of order 4."""
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


@dataclass(frozen=True, slots=True)
class PlanarTerm:
    """A force proportional to a product of velocities. ``row``: index of the force, 0 X, 1 Y, 2 N. Factors are of ``u v
    r u

    v

    r
    ``.
    """

    row: int
    coefficient: float
    factors: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Coupling:
    """Coupling of the horizontal degrees of freedom.

    ``Y_rdot``, ``N_vdot``: off-diagonal inertia (SNAME: minus the matrix' entry); ``coriolis``: whether C(nu) follows
    from M; ``terms``: all other forces.
    """

    Y_rdot: float = 0.0
    N_vdot: float = 0.0
    coriolis: bool = False
    terms: tuple[PlanarTerm, ...] = ()


def coupling_of(derivatives: Mapping[str, float], *, coriolis: bool, shared: float = 0.0) -> Coupling:
    """Return the coupling defined by the SNAME *derivatives* of surge, sway and yaw, without their own drag and
    inertia.

    They are ``Y_rdot`` and ``N_vdot`` (equal unless both exist), ``Y_r``, ``N_uv``, ``Y_|v|r`` ... Two equal letters
    mean a velocity times its absolute value. *shared* [kg m]: mass times the distance of its centre ahead of the
    middle.

    Raises
    ------
    ValueError
        A name has none of these forms.
    """
    left = dict(derivatives)
    Y_rdot = left.pop("Y_rdot", 0.0)
    N_vdot = left.pop("N_vdot", Y_rdot)
    terms = []
    for name, value in left.items():
        force, _, rest = name.partition("_")
        factors = _FACTOR.findall(rest)
        if force not in _PLANE or "".join(factors) != rest or not factors:
            raise ValueError(f"the simulator cannot simulate {name}")
        if len(factors) == 2 and factors[0] == factors[1] and "|" not in rest:
            factors[0] = f"|{factors[0]}|"
        terms.append(PlanarTerm(_PLANE.index(force), value, tuple(factors)))
    return Coupling(Y_rdot - shared, N_vdot - shared, coriolis, tuple(terms))


class PlanarHull:
    """A hull that moves in the horizontal plane and dives, a :class:`~sitl.plants.Plant`. ``u v`` are through the
    water.

    Without *sway* dynamics it does not sway: ``v`` stays 0 and ``Y_rdot`` has no effect. A *coupling* connects surge,
    sway and yaw. With *pitch* dynamics it responds to a moment ``M`` against ``pitch.righting`` [N m/rad].
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
    ) -> None:
        self.state = State()
        self.water = water or Water()
        self.parameters: Parameters = {"Y_rdot": 0.0}
        self.dofs: tuple[str, ...] = ("surge", "heave", "yaw")
        self._coupling: Coupling | None = None
        self._pitches = pitch is not None
        self._before = (0.0, 0.0, 0.0, 0.0)
        self._dt = math.inf
        for dof, axis in (("surge", surge), ("sway", _ABSENT), ("heave", heave), ("yaw", yaw)):
            self.set_axis(dof, axis)
        if sway is not None:
            self.couple(sway, coupling)
        if pitch is not None:
            self.dofs = (*self.dofs, "pitch")
            self.set_axis("pitch", pitch)
            self.parameters["pitch.righting"] = righting

    def axis(self, dof: str) -> AxisDynamics:
        """Return the present inertia, linear and quadratic drag of the degree of freedom *dof*."""
        numbers = self.parameters
        return AxisDynamics(numbers[f"{dof}.alpha"], numbers[f"{dof}.beta"], numbers[f"{dof}.beta2"])

    def set_axis(self, dof: str, axis: AxisDynamics) -> None:
        """Set the inertia, linear and quadratic drag of the degree of freedom *dof*."""
        numbers = self.parameters
        numbers[f"{dof}.alpha"], numbers[f"{dof}.beta"], numbers[f"{dof}.beta2"] = axis.alpha, axis.beta, axis.beta2

    def couple(self, sway: AxisDynamics, coupling: Coupling | None) -> None:
        """Enable sway, with surge, sway and yaw connected by *coupling*, if supplied."""
        if "sway" not in self.dofs:
            self.dofs = (*self.dofs, "sway")
        self.set_axis("sway", sway)
        self._coupling = coupling

    def specific_force(self) -> tuple[float, float, float]:
        """Return the mean specific force over the last step [m/s^2], body axes, of a hull that stays level.

        It is the change of the velocity over ground minus gravity, in the axes of the heading at half the step.
        """
        if self._dt == math.inf:
            return 0.0, 0.0, -GRAVITY
        at = self.state
        before, after = self._over_ground(*self._before), self._over_ground(at.u, at.v, at.w, at.psi)
        north, east, down = ((b - a) / self._dt for a, b in zip(before, after, strict=True))
        psi = 0.5 * (self._before[3] + at.psi)
        c, s = math.cos(psi), math.sin(psi)
        return c * north + s * east, c * east - s * north, down - GRAVITY

    def _over_ground(self, u: float, v: float, w: float, psi: float) -> tuple[float, float, float]:
        """Return the velocity north, east and down [m/s] of a hull level at heading *psi*."""
        c, s = math.cos(psi), math.sin(psi)
        return c * u - s * v + self.water.V_x, s * u + c * v + self.water.V_y, w

    def acceleration(self, u: float, v: float, r: float, wrench: Wrench) -> tuple[float, float, float]:
        """Return the accelerations (udot, vdot, rdot) [m/s^2, m/s^2, rad/s^2] at velocity (*u*, *v*, *r*) under
        *wrench*.
        """
        p, ties = self.parameters, self._coupling
        X = wrench.X - (p["surge.beta"] + p["surge.beta2"] * abs(u)) * u
        Y = wrench.Y - (p["sway.beta"] + p["sway.beta2"] * abs(v)) * v
        N = wrench.N - (p["yaw.beta"] + p["yaw.beta2"] * abs(r)) * r
        Y_rdot, surging, swaying, yawing = p["Y_rdot"], p["surge.alpha"], p["sway.alpha"], p["yaw.alpha"]
        if ties is None:
            if not Y_rdot:
                return X / surging, Y / swaying, N / yawing
            m_23 = m_32 = -Y_rdot
        else:
            m_23, m_32 = -ties.Y_rdot - Y_rdot, -ties.N_vdot - Y_rdot
            X, Y, N = self._tied(ties, (u, v, r), (X, Y, N), 0.5 * (m_23 + m_32))
        det = swaying * yawing - m_23 * m_32
        return X / surging, (yawing * Y - m_23 * N) / det, (swaying * N - m_32 * Y) / det

    def _tied(
        self, ties: Coupling, nu: tuple[float, float, float], forces: tuple[float, float, float], shared: float
    ) -> tuple[float, float, float]:
        """Return *forces* (X, Y, N) plus those of the Coriolis term and of the products of the velocities *nu* (u, v,
        r)."""
        (u, v, r), (X, Y, N) = nu, forces
        if ties.coriolis:
            sideways = self.parameters["sway.alpha"] * v + shared * r
            ahead = self.parameters["surge.alpha"] * u
            X, Y, N = X + sideways * r, Y - ahead * r, N + ahead * v - sideways * u
        if ties.terms:
            more = [0.0, 0.0, 0.0]
            factors = {"u": u, "v": v, "r": r, "|u|": abs(u), "|v|": abs(v), "|r|": abs(r)}
            for term in ties.terms:
                more[term.row] += term.coefficient * math.prod([factors[name] for name in term.factors])
            X, Y, N = X + more[0], Y + more[1], N + more[2]
        return X, Y, N

    def step(self, wrench: Wrench, dt: float) -> None:
        """Advance the state by *dt* [s] under a constant *wrench*, by Runge-Kutta of order 4."""
        at = self.state
        self._before, self._dt = (at.u, at.v, at.w, at.psi), dt
        old_u = at.u
        if self._coupling is None:
            self._step_uncoupled(wrench, dt)
        else:
            self._step_coupled(wrench, dt)
        if not self.water.floats:
            self._heave(wrench.Z + self._cushion(), dt)
        self._rock((at.u - old_u) / dt, wrench.M, dt)

    def _step_axis(self, dof: str, nu: float, force: float, dt: float) -> tuple[float, float]:
        p = self.parameters
        return _advance(p[dof + ".alpha"], p[dof + ".beta"], p[dof + ".beta2"], nu, force, dt)

    def _step_uncoupled(self, wrench: Wrench, dt: float) -> None:
        """Step each degree of freedom separately. The track uses the heading at half the step."""
        at, water = self.state, self.water
        at.r, turned = self._step_axis("yaw", at.r, wrench.N, dt)
        at.u, ahead = self._step_axis("surge", at.u, wrench.X, dt)
        middle = at.psi + 0.5 * turned
        at.x += ahead * math.cos(middle) + water.V_x * dt
        at.y += ahead * math.sin(middle) + water.V_y * dt
        at.psi += turned

    def _step_coupled(self, wrench: Wrench, dt: float) -> None:
        at, water = self.state, self.water
        start = (at.u, at.v, at.r, at.psi, at.x, at.y)

        def slope(state: Sequence[float]) -> tuple[float, ...]:
            u, v, r, psi, _, _ = state
            c, s = math.cos(psi), math.sin(psi)
            return (*self.acceleration(u, v, r, wrench), r, c * u - s * v + water.V_x, s * u + c * v + water.V_y)

        k1 = slope(start)
        k2 = slope([a + 0.5 * dt * k for a, k in zip(start, k1, strict=True)])
        k3 = slope([a + 0.5 * dt * k for a, k in zip(start, k2, strict=True)])
        k4 = slope([a + dt * k for a, k in zip(start, k3, strict=True)])
        slopes = zip(start, k1, k2, k3, k4, strict=True)
        end = [a + dt / 6.0 * (p + 2.0 * (q + r) + s) for a, p, q, r, s in slopes]
        at.u, at.v, at.r, at.psi, at.x, at.y = end

    def _heave(self, force: float, dt: float) -> None:
        at = self.state
        at.w, down = self._step_axis("heave", at.w, force, dt)
        at.z += down
        p = self.parameters
        at.wdot = (force - (p["heave.beta"] + p["heave.beta2"] * abs(at.w)) * at.w) / p["heave.alpha"]

    def _cushion(self) -> float:
        """Return the force of the soft spring [N, down] beyond surface or bottom; zero between them."""
        z, bottom = self.state.z, self.water.bottom
        if 0.0 <= z <= bottom:
            return 0.0
        beyond = z if z < 0.0 else z - bottom
        return -self.parameters["heave.alpha"] * _CUSHION * (_CUSHION * beyond + 2.0 * self.state.w)

    def _rock(self, udot: float, M: float, dt: float) -> None:
        at = self.state
        share = dt / (_ROCK_TIME + dt)
        rolled = share * (-_HEEL * at.u * at.r - at.phi)
        at.phi += rolled
        at.p = rolled / dt
        if not self._pitches:
            pitched = share * (_SQUAT * udot - at.theta)
            at.q = pitched / dt
        else:
            moment = M + self.parameters["pitch.righting"] * (_SQUAT * udot - at.theta)
            at.q, pitched = self._step_axis("pitch", at.q, moment, dt)
        at.theta += pitched
