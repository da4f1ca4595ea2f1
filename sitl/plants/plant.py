"""Interface of every simulated body: its state, a step under a wrench, and its parameters by name.

Actuators and effects access a body only through :class:`Plant`. They apply a :class:`Wrench` and change its
``parameters``, but not its equations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

__all__ = ["GRAVITY", "Parameters", "Plant", "State", "Water", "Wrench", "measured_speed"]

GRAVITY = 9.80665
"""Standard gravity [m/s^2], as ArduPilot's GRAVITY_MSS."""

Parameters = dict[str, float]
"""Parameter name -> present value, SI.

``DOF.alpha`` is the inertia of a degree of freedom, ``DOF.beta`` and ``DOF.beta2`` its linear and quadratic drag, with
DOF ``surge sway heave roll pitch yaw``, as in the vehicle files. A degree of freedom that the body does not have is
infinitely heavy. ``Y_rdot`` is the off-diagonal inertia of sway and yaw (SNAME: minus the entry of the matrix).
"""


@dataclass(slots=True)
class State:
    """Position and motion of a body: SI, NED, SNAME.

    ``x y z`` [m]; ``phi theta psi`` [rad], ``psi`` continuous; ``u v w`` [m/s] through the water and ``p q r`` [rad/s],
    in body axes; ``wdot`` [m/s^2], the acceleration down. ``tilts``: whether velocities and forces follow roll and
    pitch. Otherwise the body moves as if level, and its roll and pitch are only a slight lean.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    phi: float = 0.0
    theta: float = 0.0
    psi: float = 0.0
    u: float = 0.0
    v: float = 0.0
    w: float = 0.0
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0
    wdot: float = 0.0
    tilts: bool = False


@dataclass(slots=True)
class Wrench:
    """Forces [N] and moments [N m] on the body, in body axes (SNAME): z down, ``K`` to starboard, ``M`` bow up."""

    X: float = 0.0
    Y: float = 0.0
    Z: float = 0.0
    N: float = 0.0
    M: float = 0.0
    K: float = 0.0


@dataclass(slots=True)
class Water:
    """The water a body is in.

    The surface is at z = 0, the bottom at ``bottom`` [m]. The water moves with ``V_x`` and ``V_y`` [m/s] towards north
    and east. A body that ``floats`` does not heave. ``over_ground``: whether the speed sensor measures over the ground.
    """

    bottom: float = math.inf
    floats: bool = False
    V_x: float = 0.0
    V_y: float = 0.0
    over_ground: bool = True


class Plant(Protocol):
    """A body in water."""

    state: State
    water: Water
    parameters: Parameters

    @property
    def dofs(self) -> tuple[str, ...]:
        """Names of the degrees of freedom in which the body can move."""

    def step(self, wrench: Wrench, dt: float) -> None:
        """Advance the state by *dt* [s] under a constant *wrench*."""

    def specific_force(self) -> tuple[float, float, float]:
        """Return the reading of an accelerometer at the origin [m/s^2] in body axes, as the mean over the last step."""


def measured_speed(state: State, water: Water) -> tuple[float, float, float]:
    """Return the speeds ahead, to starboard and down [m/s] that a speed sensor measures in *state* and *water*.

    They are in the axes of the heading, as an autopilot reports them, over the ground or through the water.
    """
    ahead, aside, down = state.u, state.v, state.w
    if state.tilts:
        u, v, w = ahead, aside, down
        c, s, d, e = math.cos(state.phi), math.sin(state.phi), math.cos(state.theta), math.sin(state.theta)
        across = s * v + c * w
        ahead, aside, down = d * u + e * across, c * v - s * w, d * across - e * u
    if not water.over_ground:
        return ahead, aside, down
    c, s = math.cos(state.psi), math.sin(state.psi)
    return ahead + water.V_x * c + water.V_y * s, aside + (water.V_y * c - water.V_x * s), down
