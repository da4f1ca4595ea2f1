"""Holding a position and heading in four degrees of freedom: sliding mode beside four separate PID laws.

Gomes2003, section 4, eq. (18), with a boundary layer in place of the sign function, so that the thrusters do not
chatter. Vectors are (x, y, z, psi), (u, v, w, r) and (X, Y, Z, N). Roll and pitch are left to the stability of the
craft.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control.choice import OwnDesign
from gcs_autotune.control.feedback import FeedbackController, FeedbackLaw
from gcs_autotune.control.structure import STRUCTURES
from gcs_autotune.sname import wrap

__all__ = [
    "POSITION_LAWS",
    "IntegralSlidingMode",
    "PidPosition",
    "Pose",
    "PositionController",
    "PositionTarget",
    "RigidModel",
    "SlidingMode",
]

Array = NDArray[np.float64]
Four = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the craft is and how it moves: position (x, y, z, psi), body velocity (u, v, w, r). SI and radians."""

    position: Four
    velocity: Four


@dataclass(frozen=True, slots=True)
class PositionTarget:
    """Where it should be, and the velocity and acceleration of that point over ground. SI and radians."""

    position: Four
    velocity: Four = (0.0, 0.0, 0.0, 0.0)
    acceleration: Four = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RigidModel:
    """Diagonal masses with added mass, linear and quadratic drag, and the constant force on the craft, per axis.

    ``couples``: whether the masses are in one unit, so that the Coriolis forces follow from them.
    """

    mass: Four
    drag: Four
    drag_quadratic: Four
    constant: Four = (0.0, 0.0, 0.0, 0.0)
    couples: bool = True

    def coriolis(self, velocity: Array) -> Array:
        """Return the Coriolis and centripetal matrix (4, 4) that belongs to the masses, Gomes2003, eq. (7)."""
        u, v = velocity[0], velocity[1]
        m_u, m_v = self.mass[0], self.mass[1]
        C = np.zeros((4, 4))
        if not self.couples:
            return C
        C[0, 3], C[1, 3] = -m_v * v, m_u * u
        C[3, 0], C[3, 1] = m_v * v, -m_u * u
        return C

    def damping(self, velocity: Array) -> Array:
        """Return the drag matrix (4, 4) at *velocity*."""
        return np.diag(np.array(self.drag) + np.array(self.drag_quadratic) * np.abs(velocity))

    def acceleration(self, velocity: Array, force: Array) -> Array:
        """Return the acceleration of the body velocities (4,) under *force* (4,)."""
        drag = (self.coriolis(velocity) + self.damping(velocity)) @ velocity
        return np.asarray((force + np.array(self.constant) - drag) / np.array(self.mass))


class PositionController(Protocol):
    """What holds a position: one call of ``update`` per control tick."""

    def update(self, target: PositionTarget, pose: Pose, t: float) -> Four:
        """Return the forces and the moment (X, Y, Z, N) at time *t* [s]."""


@dataclass(frozen=True, slots=True)
class SlidingMode:
    """Sliding-mode law with a boundary layer; it has no memory, so it is its own controller.

    Attributes
    ----------
    model : the identified craft, its estimate in (18).
    bandwidth : lambda of the sliding surface ``s = e_rate + lambda e`` [1/s].
    damping : K_D [input per m/s or rad/s].
    layer : half thickness of the boundary layer of s [m/s or rad/s].
    uncertainty : relative error of the model that the switching term covers (the sliding condition).
    reserve : l of the sliding condition, for forces that the model lacks [input].
    limits : largest input per axis.
    """

    model: RigidModel
    bandwidth: Four
    damping: Four
    layer: Four
    uncertainty: float
    reserve: Four
    limits: Four = (math.inf, math.inf, math.inf, math.inf)

    def update(self, target: PositionTarget, pose: Pose, t: float) -> Four:
        """Return the forces and the moment (X, Y, Z, N); *t* is not needed."""
        return self.limited(self.forces(target, pose))

    def forces(self, target: PositionTarget, pose: Pose, integral: Array | None = None) -> Array:
        """Return the forces and the moment (4,) before the limits of the actuators.

        integral : integral of the error (4,) [m s or rad s]. With it the surface is
            ``s = e_rate + 2 lambda e + lambda^2 integral``, which leaves no steady error.
        """
        model, velocity, bandwidth = self.model, np.array(pose.velocity), np.array(self.bandwidth)
        J, J_rate = _rotation(pose.position[3], pose.velocity[3])
        x_rate, error = J @ velocity, _error(pose.position, target.position)
        rate_error = x_rate - np.array(target.velocity)
        if integral is None:
            pull, pull_rate = bandwidth * error, bandwidth * rate_error
        else:
            pull = 2.0 * bandwidth * error + bandwidth**2 * integral
            pull_rate = 2.0 * bandwidth * rate_error + bandwidth**2 * error
        wanted_rate = np.array(target.velocity) - pull
        s = x_rate - wanted_rate
        q_rate = J.T @ wanted_rate
        q_acceleration = J.T @ (np.array(target.acceleration) - pull_rate - J_rate @ q_rate)
        inertia = np.array(model.mass) * q_acceleration
        drag = (model.coriolis(velocity) + model.damping(velocity)) @ q_rate
        body_s = J.T @ s
        switching = self.uncertainty * (np.abs(inertia) + np.abs(drag)) + np.array(self.reserve)
        force = inertia + drag - np.array(model.constant) - self.damping * body_s
        return np.asarray(force - switching * np.clip(body_s / np.array(self.layer), -1.0, 1.0))

    def limited(self, force: Array) -> Four:
        """Return *force* (4,) within the limits of the actuators."""
        found = np.clip(force, -np.array(self.limits), self.limits)
        return (float(found[0]), float(found[1]), float(found[2]), float(found[3]))


class IntegralSlidingMode:
    """A sliding-mode law with the integral of the error in its surface: it holds against a constant push.

    The integral stops while an actuator is at its limit. At a step of the target it is reset such that the surface
    stays where it was, so that the craft approaches without overshoot.
    """

    def __init__(self, law: SlidingMode) -> None:
        self.law = law
        self._integral = np.zeros(4)
        self._t = math.nan
        self._target: Four | None = None

    def update(self, target: PositionTarget, pose: Pose, t: float) -> Four:
        """Return the forces and the moment (X, Y, Z, N) at time *t* [s]."""
        error = _error(pose.position, target.position)
        if self._target is not None and target.velocity == (0.0,) * 4 and target.position != self._target:
            self._integral -= 2.0 * (error - _error(pose.position, self._target)) / np.array(self.law.bandwidth)
        force = self.law.forces(target, pose, self._integral)
        command = self.law.limited(force)
        dt = 0.0 if math.isnan(self._t) else max(t - self._t, 0.0)
        if np.all(np.abs(force - np.array(command)) < 1e-12):
            self._integral += error * dt
        self._t, self._target = t, target.position
        return command


class PidPosition:
    """Four laws of one motion each, on the error seen from the craft: what sliding mode is compared with.

    They ignore how the motions couple while the craft turns. Take structures whose derivative acts on the output.
    """

    def __init__(self, laws: Sequence[FeedbackLaw]) -> None:
        self._controllers: list[FeedbackController] = [law.started() for law in laws]

    def update(self, target: PositionTarget, pose: Pose, t: float) -> Four:
        """Return the forces and the moment (X, Y, Z, N) at time *t* [s]."""
        J, _ = _rotation(pose.position[3], 0.0)
        error = J.T @ _error(pose.position, target.position)
        wanted = J.T @ np.array(target.velocity)
        X, Y, Z, N = (
            controller.update(-float(e), 0.0, float(rate - w), t)
            for controller, e, rate, w in zip(self._controllers, error, pose.velocity, wanted, strict=True)
        )
        return X, Y, Z, N


def _rotation(psi: float, r: float) -> tuple[Array, Array]:
    """Return J from body to earth (4, 4) and its time derivative; J is orthogonal."""
    c, s = math.cos(psi), math.sin(psi)
    J, J_rate = np.eye(4), np.zeros((4, 4))
    J[:2, :2] = [[c, -s], [s, c]]
    J_rate[:2, :2] = r * np.array([[-s, -c], [c, -s]])
    return J, J_rate


def _error(position: Four, target: Four) -> Array:
    """Return how far *position* is from *target*, the heading the short way round."""
    error: Array = np.array(position) - np.array(target)
    error[3] = wrap(error[3])
    return error


# --- laws for a craft, from the loops of its single motions ---------------------------------------------------------

SLIDING = 0.5
"""Bandwidth of the sliding surface relative to the fastest loop of its axis. Chosen: error and surface each take half
of what the delay allows."""
RESERVE = 0.05
"""Switching gain for forces that the model lacks [of full output]. Chosen: a tether, a light current."""
UNCERTAIN = 0.1
"""Relative error of the model that the switching term covers at least."""


def design_sliding(surge: OwnDesign, sway: OwnDesign, yaw: OwnDesign) -> SlidingMode:
    """Return the sliding-mode law whose axes are as fast as the delay and the actuators allow; heave is left out."""
    three = (surge, sway, yaw)
    omega = [SLIDING * d.wanted.omega_0 for d in three]
    alpha = [d.model.alpha for d in three]

    def axes(values: Sequence[float], heave: float) -> Four:
        return (values[0], values[1], heave, values[2])

    model = RigidModel(
        axes(alpha, 1.0),
        axes([d.model.beta for d in three], 0.0),
        axes([d.model.beta_quadratic for d in three], 0.0),
        axes([d.model.delta for d in three], 0.0),
        # masses in units of each axis' own input do not show how the axes push each other
        couples=False,
    )
    # within the layer the switching term acts as damping of RESERVE/layer; half of the surface's own
    layer = [RESERVE / (0.5 * a * w) for a, w in zip(alpha, omega, strict=True)]
    return SlidingMode(
        model,
        axes(omega, 1.0),
        axes([0.5 * a * w for a, w in zip(alpha, omega, strict=True)], 0.0),
        axes(layer, 1.0),
        UNCERTAIN,
        axes([RESERVE] * 3, 0.0),
        axes([min(-d.law.limits[0], d.law.limits[1]) for d in three], 0.0),
    )


def design_pid(surge: OwnDesign, sway: OwnDesign, yaw: OwnDesign) -> list[FeedbackLaw]:
    """Return PI-D laws of the three axes with the gains of their I-PD loops, and none of heave."""
    laws = [replace(d.law, structure=STRUCTURES["PI-D"], is_angle=False) for d in (surge, sway, yaw)]
    none = FeedbackLaw(STRUCTURES["P"], K_P=0.0)
    return [laws[0], laws[1], none, laws[2]]


POSITION_LAWS: Mapping[str, Callable[[OwnDesign, OwnDesign, OwnDesign], Callable[[], PositionController]]] = {
    "sliding": lambda *designs: partial(IntegralSlidingMode, design_sliding(*designs)),
    "pid": lambda *designs: partial(PidPosition, design_pid(*designs)),
}
"""Name -> rule that returns a maker of controllers from the designs of surge, sway and yaw."""
