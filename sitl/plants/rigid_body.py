"""A rigid body in water with up to six degrees of freedom, its ballast, propellers and rudders.

The equations are in :mod:`sitl.plants.kernel`. This module keeps their numbers under names, and the state of one body.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sitl.plants import kernel
from sitl.plants.plant import GRAVITY, Parameters, State, Water, Wrench

__all__ = ["DOFS", "FORCES", "AxisDynamics", "Ballast", "Coupling", "Product", "RigidBody", "coupling_of"]

Array = NDArray[np.float64]

DOFS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FORCES, _SPEEDS = "XYZKMN", "uvwpqr"
_FACTOR = re.compile(r"\|[uvwpqr]\||[uvwpqr]")
_CUSHION = 3.0
"""Natural frequency [rad/s] of the soft spring that stops a body at surface and bottom. Project choice."""
_LOCKED = math.inf
"""Inertia of a degree of freedom that does not move."""


@dataclass(frozen=True, slots=True)
class AxisDynamics:
    """One degree of freedom: inertia ``alpha`` with added mass, linear drag ``beta``, quadratic drag ``beta2``, SI."""

    alpha: float
    beta: float
    beta2: float


_ABSENT = AxisDynamics(_LOCKED, 0.0, 0.0)
_SIX, _THIRTEEN = struct.Struct("6d"), struct.Struct("13d")
"""A wrench and a state in the kernel's arrays. A session spends less time with these than with indices of arrays."""


@dataclass(frozen=True, slots=True)
class Product:
    """A force proportional to a product of one to three velocities.

    ``row``: index of the force in ``X Y Z K M N``. Factors are of ``u v w p q r |u| |v| ...``.
    """

    row: int
    coefficient: float
    factors: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Coupling:
    """Coupling of the degrees of freedom.

    ``added``: (row, column, SNAME derivative by an acceleration), which is minus the entry of the inertia matrix.
    ``coriolis``: whether C(nu) follows from the inertia. ``terms``: all other forces.
    """

    added: tuple[tuple[int, int, float], ...] = ()
    coriolis: bool = False
    terms: tuple[Product, ...] = ()


def coupling_of(
    derivatives: Mapping[str, float], *, coriolis: bool, shared: float = 0.0, speeds: str = "uvr"
) -> Coupling:
    """Return the coupling defined by the SNAME *derivatives*, without the drag and inertia of each axis itself.

    They are ``Y_rdot`` (and ``N_vdot`` if it differs), ``Y_r``, ``N_uv``, ``Y_|v|r`` ... Two equal letters mean a
    velocity times its absolute value.

    Parameters
    ----------
    shared : mass times the distance of its centre ahead of the middle [kg m], of a hull in the plane.
    speeds : velocities of the degrees of freedom that the body has.

    Raises
    ------
    ValueError
        A name has none of these forms.
    """
    forces = [FORCES[_SPEEDS.index(speed)] for speed in speeds]
    added, terms = {}, []
    for name, value in derivatives.items():
        force, _, rest = name.partition("_")
        by_acceleration = re.fullmatch(r"([uvwpqr])dot", rest)
        letters = by_acceleration[1] if by_acceleration else rest
        factors = _FACTOR.findall(letters)
        known = all(factor.strip("|") in speeds for factor in factors)
        if force not in forces or "".join(factors) != letters or not 1 <= len(factors) <= 3 or not known:
            raise ValueError(f"the simulator cannot simulate {name}")
        row = FORCES.index(force)
        if by_acceleration:
            added[row, _SPEEDS.index(letters)] = value
            continue
        if len(factors) == 2 and factors[0] == factors[1] and "|" not in rest:
            factors[0] = f"|{factors[0]}|"
        terms.append(Product(row, value, tuple(factors)))
    for (row, column), value in list(added.items()):
        if row < column:
            added.setdefault((column, row), value)
    if shared:
        for place in ((1, 5), (5, 1)):
            added[place] = added.get(place, 0.0) - shared
    return Coupling(tuple((*place, value) for place, value in added.items()), coriolis, tuple(terms))


@dataclass(frozen=True, slots=True)
class Ballast:
    """Mass, weight and buoyancy of a body (Miskovic2010, (2.15), (2.25)).

    ``mass`` [kg] with its centre ``centre`` [m] and products of inertia ``products`` (I_xy, I_xz, I_yz) [kg m^2] give
    the entries off the diagonal of the inertia. ``weight`` acts at ``centre``, ``buoyancy`` [N] at ``centre_of_lift``
    [m]. For bodies at the surface, ``waterplane`` [N/m] is the buoyancy lost per metre that ``centre_of_lift`` rises
    from where it is on a level body at z = 0, and ``metacentric`` [N m] the righting moment per unit of tilt in roll
    and pitch.
    """

    mass: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float = 0.0
    buoyancy: float = 0.0
    centre_of_lift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    waterplane: float = 0.0
    metacentric: tuple[float, float] = (0.0, 0.0)

    def off_diagonal(self) -> Array:
        """Return the rigid body's inertia matrix (6, 6) without its diagonal."""
        (x, y, z), (xy, xz, yz), matrix = self.centre, self.products, np.zeros((6, 6))
        lever = self.mass * np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        matrix[:3, 3:], matrix[3:, :3] = lever, lever.T
        for (i, j), product in zip(((3, 4), (3, 5), (4, 5)), (xy, xz, yz), strict=True):
            matrix[i, j] = matrix[j, i] = -product
        return matrix


class RigidBody:
    """A body that moves in those degrees of freedom for which *axes* has dynamics, a :class:`~sitl.plants.Plant`.

    Velocities are through the water. ``commands`` (p + r,) drives the *propellers* (p, :data:`kernel.PROPELLER`) and
    *rudders* (r, :data:`kernel.RUDDER`), whose forces follow the motion within a step.
    """

    def __init__(
        self,
        axes: Mapping[str, AxisDynamics],
        water: Water | None = None,
        *,
        coupling: Coupling | None = None,
        ballast: Ballast | None = None,
        propellers: Array | None = None,
        rudders: Array | None = None,
    ) -> None:
        self.state, self.water = State(tilts=True), water or Water()
        self.parameters: Parameters = {"Y_rdot": 0.0}
        for dof in DOFS:
            self.set_axis(dof, axes.get(dof, _ABSENT))
        self.dofs: tuple[str, ...] = tuple(dof for dof in DOFS if dof in axes)
        self.ballast = ballast or Ballast()
        self.propellers = np.zeros((0, kernel.PROPELLER)) if propellers is None else propellers
        self.rudders = np.zeros((0, kernel.RUDDER)) if rudders is None else rudders
        self.commands = np.zeros(len(self.propellers) + len(self.rudders))
        self.rotors = np.zeros(len(self.propellers))
        if len(self.propellers) > kernel.MOST_PROPELLERS:
            raise ValueError(f"a body has at most {kernel.MOST_PROPELLERS} propellers, not {len(self.propellers)}")
        self._coupling = coupling
        self._along_chord = False
        self._work, self._wrench, self._array = (
            np.zeros((kernel.WORK, kernel.COLUMNS)),
            np.zeros((1, 6)),
            np.zeros((1, 13)),
        )
        self._state_bytes, self._wrench_bytes, self._rate_bytes = (
            array.data.cast("B") for array in (self._array, self._wrench, self._work[kernel.RATE])
        )
        self._packed: tuple[object, ...] = ()
        self._before, self._dt = (0.0,) * 10, math.inf
        self._angles, self._quaternion = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        self._fly(Wrench(), 0.0, 0)  # compiles, before time counts

    def axis(self, dof: str) -> AxisDynamics:
        """Return the present inertia, linear and quadratic drag of the degree of freedom *dof*."""
        numbers = self.parameters
        return AxisDynamics(numbers[f"{dof}.alpha"], numbers[f"{dof}.beta"], numbers[f"{dof}.beta2"])

    def set_axis(self, dof: str, axis: AxisDynamics) -> None:
        """Set the inertia, linear and quadratic drag of the degree of freedom *dof*."""
        numbers = self.parameters
        numbers[f"{dof}.alpha"], numbers[f"{dof}.beta"], numbers[f"{dof}.beta2"] = axis.alpha, axis.beta, axis.beta2

    @property
    def body(self) -> Array:
        """The numbers of the body as the kernel reads them (ROWS + t, 6), of the present parameters."""
        self._pack()
        return self._body

    def _pack(self) -> None:
        """Write parameters, ballast, coupling and water into the kernel's array, if one of them has changed."""
        water = self.water
        now = (*self.parameters.values(), water.V_x, water.V_y, water.floats, self._along_chord, self._coupling)
        if now == self._packed:
            return
        self._packed = now
        ties, p, held = self._coupling or Coupling(), self.parameters, self.ballast
        body = np.zeros((kernel.ROWS + len(ties.terms), 6))
        inertia = held.off_diagonal()
        for row, column, derivative in ties.added:
            inertia[row, column] -= derivative
        for place in ((1, 5), (5, 1)):
            inertia[place] -= p["Y_rdot"]
        for i, dof in enumerate(DOFS):
            free = math.isfinite(p[f"{dof}.alpha"]) and self._moves(dof)
            body[kernel.FREE, i], inertia[i, i] = float(free), p[f"{dof}.alpha"] if free else 0.0
            body[kernel.DRAG + i, i], body[kernel.QUADRATIC, i] = p[f"{dof}.beta"], p[f"{dof}.beta2"]
        body[kernel.MASS : kernel.MASS + 6] = inertia
        if ties.coriolis:
            body[kernel.MOMENTUM : kernel.MOMENTUM + 6] = 0.5 * (inertia + inertia.T)
        body[kernel.GRAVITY] = (*held.centre, held.weight, *held.metacentric)
        body[kernel.BUOYANCY] = (*held.centre_of_lift, held.buoyancy, held.waterplane, 0.0)
        body[kernel.WATER, :4] = water.V_x, water.V_y, 0.0, float(self._along_chord)
        for k, term in enumerate(ties.terms, start=kernel.ROWS):
            numbers = [_SPEEDS.index(name.strip("|")) + 6 * name.startswith("|") for name in term.factors]
            body[k] = (term.row, term.coefficient, *numbers, *[-1.0] * (4 - len(numbers)))
        self._body, self._out = body, np.zeros((1, 0, 13))
        self._arguments = (
            self._array, self.rotors[None], body[None], self.propellers[None], self.rudders[None], self.commands[None],
            self._wrench, self._work,
        )  # fmt: skip

    def _moves(self, dof: str) -> bool:
        """Return whether the body moves in *dof*, if it has dynamics there."""
        return True

    def _fly(self, wrench: Wrench, dt: float, steps: int) -> None:
        """Advance the kernel's state by *steps* of *dt* [s]."""
        self._pack()
        _SIX.pack_into(self._wrench_bytes, 0, wrench.X, wrench.Y, wrench.Z, wrench.K, wrench.M, wrench.N)
        kernel.fly(*self._arguments, dt, steps, self._out)

    def fly_copies(
        self, parameters: Mapping[str, Array] | Array, commands: Array, wrenches: Array, *, dt: float, steps: int
    ) -> Array:
        """Return the states (c, n, 13) of c copies of this body, flown in one call through n intervals.

        The copies differ in *parameters* and start in the state of this body, which does not change. A state is
        position [m] north, east, down, the quaternion w x y z of the attitude, velocities [m/s] and rates [rad/s] in
        body axes, at the end of an interval. There is no soft spring at surface and bottom (:meth:`step`).

        Parameters
        ----------
        parameters : name of ``self.parameters`` -> values (c,); or all numbers of the copies (c, ROWS + t, 6), each as
            :attr:`body`.
        commands : (n, p + r) commands of propellers and rudders in each interval, the same for all copies.
        wrenches : (n, 6) X Y Z [N] K M N [N m] in each interval, the same for all copies.
        dt, steps : length [s] and number of the steps of an interval.

        Raises
        ------
        ValueError
            There is no such parameter, a shape does not fit, or the motion diverges.
        """
        states, rotors, bodies, propellers, rudders = self._copies(parameters, commands, wrenches)
        commands, wrenches = (np.ascontiguousarray(each, dtype=np.float64) for each in (commands, wrenches))
        work, out = np.zeros_like(self._work), np.empty((len(bodies), len(commands), 13))
        kernel.fly(states, rotors, bodies, propellers, rudders, commands, wrenches, work, dt, steps, out)
        _verify_motion(out[:, -1:], dt)
        return out

    def steer_copies(
        self,
        parameters: Mapping[str, Array] | Array,
        commands: Array,
        wrenches: Array,
        choose: Callable[[Array], NDArray[np.int64] | None],
        *,
        dt: float,
        steps: int,
    ) -> None:
        """Fly copies of this body as :meth:`fly_copies`, but choose the commands of each copy by its motion.

        choose : called before each interval with the states (c, 13). It returns the row (c,) of *commands* and
            *wrenches* that each copy uses in the interval, or None to end the flight.

        Raises
        ------
        ValueError
            As :meth:`fly_copies`.
        """
        states, rotors, bodies, propellers, rudders = self._copies(parameters, commands, wrenches)
        commands, wrenches = (np.ascontiguousarray(each, dtype=np.float64) for each in (commands, wrenches))
        work = np.zeros_like(self._work)
        while (rows := choose(states)) is not None:
            for row in np.unique(rows):
                copies = np.flatnonzero(rows == row)
                moved, turned, unseen = states[copies], rotors[copies], np.empty((len(copies), 0, 13))
                body, propeller, rudder = bodies[copies], propellers[copies], rudders[copies]
                command, wrench = commands[row, None], wrenches[row, None]
                kernel.fly(moved, turned, body, propeller, rudder, command, wrench, work, dt, steps, unseen)
                states[copies], rotors[copies] = moved, turned
        _verify_motion(states, dt)

    def _copies(
        self, parameters: Mapping[str, Array] | Array, commands: Array, wrenches: Array
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Return states, rotors, bodies, propellers and rudders of copies of this body, after checks of the shapes."""
        bodies = self._bodies(parameters) if isinstance(parameters, Mapping) else np.ascontiguousarray(parameters)
        if bodies.shape[1:] != self.body.shape:
            raise ValueError(f"numbers of bodies {bodies.shape} must have the shape {('c', *self.body.shape)}")
        if commands.shape != (len(wrenches), len(self.commands)) or wrenches.shape[1:] != (6,):
            raise ValueError(
                f"commands {commands.shape} and wrenches {wrenches.shape} must have the shapes "
                f"(n, {len(self.commands)}) and (n, 6)"
            )
        count, at = len(bodies), self.state
        state = (at.x, at.y, at.z, *self._attitude(), at.u, at.v, at.w, at.p, at.q, at.r)
        states, rotors, propellers, rudders = (
            np.repeat(np.asarray(each, dtype=np.float64)[None], count, axis=0)
            for each in (state, self.rotors, self.propellers, self.rudders)
        )
        return states, rotors, bodies, propellers, rudders

    def _bodies(self, parameters: Mapping[str, Array]) -> Array:
        """Return the numbers (c, ROWS + t, 6) of copies of this body that differ in *parameters*."""
        unknown = sorted(set(parameters) - set(self.parameters))
        if unknown:
            raise ValueError(f"the body has no parameter {unknown[0]}. It has {', '.join(self.parameters)}")
        values = [np.asarray(each, dtype=np.float64) for each in parameters.values()]
        counts = {each.shape for each in values}
        if len(counts) != 1 or len(next(iter(counts))) != 1:
            raise ValueError(f"the values of all parameters must have one shape (c,), not {sorted(counts)}")
        (count,) = values[0].shape
        own, bodies = dict(self.parameters), np.empty((count, *self.body.shape))
        for body, numbers in zip(bodies, np.stack(values, axis=1).tolist(), strict=True):
            self.parameters.update(zip(parameters, numbers, strict=True))
            body[:] = self.body
        self.parameters.update(own)
        return bodies

    def acceleration(self, nu: Sequence[float], wrench: Wrench) -> list[float]:
        """Return ``nudot`` (6,) [m/s^2, rad/s^2] at the velocity *nu* (6,) under *wrench*, in the present attitude."""
        self._array[0] = (0.0, 0.0, self.state.z, *self._attitude(), *nu)
        self._fly(wrench, 0.0, 0)
        rates: list[float] = self._work[kernel.RATE, :6].tolist()
        return rates

    def _attitude(self) -> tuple[float, float, float, float]:
        """Return the attitude as a quaternion, which follows if someone has set the angles of the state."""
        at = self.state
        if self._angles != (at.phi, at.theta, at.psi):
            self._angles = (at.phi, at.theta, at.psi)
            self._quaternion = quaternion_of(*self._angles)
        return self._quaternion

    def step(self, wrench: Wrench, dt: float) -> None:
        """Advance the state by *dt* [s] under a constant *wrench*, by Runge-Kutta of order 4."""
        at = self.state
        attitude = self._attitude()
        self._before = (at.u, at.v, at.w, *attitude, 0.0, 0.0, 0.0)
        self._dt = dt
        _THIRTEEN.pack_into(self._state_bytes, 0, at.x, at.y, at.z, *attitude, at.u, at.v, at.w, at.p, at.q, at.r)
        self._fly(self._cushioned(wrench), dt, 1)
        at.x, at.y, at.z, a, b, c, d, u, v, w, p, q, r = _THIRTEEN.unpack_from(self._state_bytes)
        self._quaternion = turned = a, b, c, d
        phi, theta, psi = angles_of(turned)
        psi = at.psi + math.remainder(psi - at.psi, math.tau)
        self._angles = phi, theta, psi
        udot, vdot, wdot, _, _, _ = _SIX.unpack_from(self._rate_bytes)
        at.wdot = rotate(turned, (udot + q * w - r * v, vdot + r * u - p * w, wdot + p * v - q * u))[2]
        at.phi, at.theta, at.psi, at.u, at.v, at.w, at.p, at.q, at.r = phi, theta, psi, u, v, w, p, q, r

    def _cushioned(self, wrench: Wrench) -> Wrench:
        """Return *wrench* with the soft spring beyond surface or bottom, if there is need of it."""
        z, at = self.state.z, self.state
        if self.water.floats or 0.0 <= z <= self.water.bottom:
            return wrench
        beyond = z if z < 0.0 else z - self.water.bottom
        sinking = rotate(self._quaternion, (at.u, at.v, at.w))[2]
        push = -self.parameters["heave.alpha"] * _CUSHION * (_CUSHION * beyond + 2.0 * sinking)
        X, Y, Z = rotate(_opposite(self._quaternion), (0.0, 0.0, push))
        return Wrench(wrench.X + X, wrench.Y + Y, wrench.Z + Z, wrench.N, wrench.M, wrench.K)

    def specific_force(self) -> tuple[float, float, float]:
        """Return the reading of an accelerometer at the origin [m/s^2], body axes, as the mean over the last step.

        It is the change of the velocity over ground minus gravity, in the mean of the attitudes before and after.
        """
        at, (u, v, w, *old, _, _, _) = self.state, self._before
        if self._dt == math.inf:
            return rotate(_opposite(self._attitude()), (0.0, 0.0, -GRAVITY))
        before = (old[0], old[1], old[2], old[3])
        after = self._quaternion
        same = math.copysign(1.0, sum(a * b for a, b in zip(before, after, strict=True)))
        mean = [a + same * b for a, b in zip(before, after, strict=True)]
        norm = math.hypot(*mean)
        gained = zip(rotate(before, (u, v, w)), rotate(after, (at.u, at.v, at.w)), strict=True)
        north, east, down = ((b - a) / self._dt for a, b in gained)
        there = (mean[0] / norm, mean[1] / norm, mean[2] / norm, mean[3] / norm)
        return rotate(_opposite(there), (north, east, down - GRAVITY))


Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def quaternion_of(phi: float, theta: float, psi: float) -> Quaternion:
    """Return the unit quaternion (w, x, y, z), body to NED, of Euler angles [rad]."""
    (a, b, c), (d, e, f) = ([fn(0.5 * angle) for angle in (phi, theta, psi)] for fn in (math.cos, math.sin))
    return a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c


def angles_of(q: Quaternion) -> Vector:
    """Return the Euler angles (phi, theta, psi) [rad] of a unit quaternion."""
    w, x, y, z = q
    phi = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    sine = 2.0 * (w * y - z * x)
    theta = math.asin(-1.0 if sine < -1.0 else 1.0 if sine > 1.0 else sine)
    return phi, theta, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def rotate(q: Quaternion, vector: Vector) -> Vector:
    """Return *vector* in body axes as a vector in NED axes."""
    (w, x, y, z), (u, v, s) = q, vector
    a, b, c = 2.0 * (y * s - z * v), 2.0 * (z * u - x * s), 2.0 * (x * v - y * u)
    return u + w * a + y * c - z * b, v + w * b + z * a - x * c, s + w * c + x * b - y * a


def _opposite(q: Quaternion) -> Quaternion:
    return q[0], -q[1], -q[2], -q[3]


def _verify_motion(states: Array, dt: float) -> None:
    if not np.all(np.isfinite(states)):
        raise ValueError(f"the motion diverges with time steps of {dt:g} s. Use shorter steps, or correct the numbers")
