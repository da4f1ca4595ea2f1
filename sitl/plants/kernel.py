"""Equations of motion of a rigid body in six degrees of freedom, with its propellers and rudders, compiled.

The equations are Miskovic2010, (2.13) to (2.26): ``M nudot + C(nu) nu + D(nu) nu + g = tau``, with ``nu = [u v w p q
r]`` through the water, ``M`` of the rigid body and the added mass together, and ``C`` of that ``M`` by Kirchhoff's
equations (Fossen2011, theorem 3.2). A degree of freedom that is not free keeps its velocity. So a planar hull and a
single axis are the same code with fewer free degrees.

The integrator is Runge-Kutta of order 4 on the velocity and on the rotation vector of the step (Bortz' equation). The
attitude is a unit quaternion, so that 90 degrees of pitch are like any other angle.

Arrays, all float64 and C-contiguous
------------------------------------
``state`` (13,) : ``x y z`` [m, NED], quaternion ``w x y z`` (body to NED), ``nu`` [m/s, rad/s].
``rotors`` (p,) : speed of each propeller [1/s].
``body`` (ROWS + t, 6) : rows of the constants below, and one row per product of velocities.
``propellers`` (p, PROPELLER), ``rudders`` (r, RUDDER) : columns of the constants below.
``commands`` (p + r,) : normalised output of each propeller (-1 to 1), then the angle of each rudder [rad].
``work`` (WORK, COLUMNS) : scratch. ``work[WRENCH]`` is the constant wrench, ``work[RATE]`` the last ``nudot``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "BUOYANCY",
    "COLUMNS",
    "DRAG",
    "FREE",
    "GRAVITY",
    "MASS",
    "MOMENTUM",
    "MOST_PROPELLERS",
    "MOTOR",
    "PROPELLER",
    "QUADRATIC",
    "RATE",
    "ROWS",
    "RUDDER",
    "TURNED",
    "WATER",
    "WORK",
    "WRENCH",
    "fly",
]

Array = NDArray[np.float64]
_Function = TypeVar("_Function", bound=Callable[..., Any])

MASS, MOMENTUM, DRAG = 0, 6, 12
"""First of six rows: inertia, the inertia whose Coriolis forces act, linear drag (positive: it slows)."""
QUADRATIC, FREE, GRAVITY, BUOYANCY, WATER, ROWS = 18, 19, 20, 21, 22, 23
"""Rows: quadratic drag of each degree; 1 where the degree is free; ``r_G``, weight [N], metacentric moments [N m] in
roll and pitch per unit of tilt; ``r_B``, buoyancy [N], stiffness [N/m] of the waterplane, whose force acts at ``r_B``
and follows the depth of this point; velocity of the water north, east, down, and 1 where the track of a step follows
the heading at half the step."""
PROPELLER, MOTOR, RUDDER = 24, 17, 10
"""Columns of a propeller: position (0-2), direction (3-5), per n|n|, n and |n| u_a of the thrust ahead (6-8) and astern
(9-11), per n|n| and |n| u_a of the torque (12, 13), hand of the shaft (14), wake fraction (15), speed at full command
(16), then from :data:`MOTOR` on its motor: kind (0 none, 1 lag, 2 DC), time constant or inertia, torque constant,
resistance, full voltage, friction, largest current. Columns of a rudder: position (0-2), coefficient, stall angle,
C_T, wake fraction, number of its propeller or -1, whether the flow angle counts, unused."""

_FACTORED, _NU, _A, _B, RATE, _FORCE, _P, _Q, WRENCH, TURNED, _THRUST, WORK = 0, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16
"""Rows of the scratch array; columns of ``_NU``, ``RATE``, ``_A`` and ``_B`` follow."""
_ANGLE, _PLACE, _WAY, _DEPTH, _SPIN, COLUMNS = 6, 9, 12, 15, 16, 32
"""First columns of the rotation vector, the position, the way in body axes, the depth, and the propellers' speeds."""
MOST_PROPELLERS = COLUMNS - _SPIN
"""The most propellers for which the scratch array has columns; ArduSub drives 12 motors."""
_TWO_PI = 2.0 * math.pi

_LEAN: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True, "error_model": "numpy", "cache": True}
_entry: Callable[[_Function], _Function] = njit(**_LEAN)
_called: Callable[[_Function], _Function] = njit(**{**_LEAN, "no_cpython_wrapper": True})


@_called
def _factor(body: Array, work: Array) -> None:
    """Factorise the inertia of the free degrees into lower and upper triangle (Doolittle)."""
    free = body[FREE]
    for i in range(6):
        row = work[_FACTORED + i]
        for j in range(6):
            row[j] = body[MASS + i, j] * free[i] * free[j] if i != j or free[i] != 0.0 else 1.0
    for k in range(6):
        pivot = work[_FACTORED + k]
        for i in range(k + 1, 6):
            row = work[_FACTORED + i]
            row[k] /= pivot[k]
            for j in range(k + 1, 6):
                row[j] -= row[k] * pivot[j]


@_called
def _add_force(f: Array, at: Array, X: float, Y: float, Z: float) -> None:
    """Add a force [N] that acts at the first three of *at* [m] to the wrench *f*."""
    x, y, z = at[0], at[1], at[2]
    f[0] += X
    f[1] += Y
    f[2] += Z
    f[3] += y * Z - z * Y
    f[4] += z * X - x * Z
    f[5] += x * Y - y * X


@_called
def _propel(propellers: Array, commands: Array, work: Array) -> None:
    """Add thrust and torque of the propellers, and write the rates of their speeds into ``work[RATE]``.

    Thrust is ``a |n| n + b n - c |n| u_a`` with coefficients of the direction of turning (Miskovic2010, (2.4), (2.8)),
    torque likewise. K_T and K_Q that are linear in J are the same law (Gomes2003, (10) to (17)).
    """
    v, f = work[_NU], work[_FORCE]
    for k in range(len(propellers)):
        each, n = propellers[k], v[_SPIN + k]
        x, y, z, dx, dy, dz = each[0], each[1], each[2], each[3], each[4], each[5]
        flow = dx * (v[0] + v[4] * z - v[5] * y) + dy * (v[1] + v[5] * x - v[3] * z) + dz * (v[2] + v[3] * y - v[4] * x)
        size, flow = abs(n), flow * (1.0 - each[15])
        way = each[6:9] if n >= 0.0 else each[9:12]
        thrust = (way[0] * size + way[1]) * n - way[2] * size * flow
        torque = each[12] * size * n - each[13] * size * flow
        work[_THRUST, k] = thrust
        _add_force(f, each, thrust * dx, thrust * dy, thrust * dz)
        for i in range(3):
            f[3 + i] -= each[14] * torque * each[3 + i]
        motor, rate = each[MOTOR:], 0.0
        if motor[0] == 1.0:
            rate = (commands[k] * each[16] - n) / motor[1]
        elif motor[0] == 2.0:
            volts = min(1.0, max(-1.0, commands[k])) * motor[4]
            current = min(motor[6], max(-motor[6], (volts - motor[2] * _TWO_PI * n) / motor[3]))
            rate = ((motor[2] * current - torque) / _TWO_PI - motor[5] * n) / motor[1]
        work[RATE, _SPIN + k] = rate


@_called
def _steer(rudders: Array, commands: Array, work: Array) -> None:
    """Add the forces of the rudders at the angles *commands* [rad] (Miskovic2010, (2.9), (2.10), (2.35)).

    The flow angle is that of the water at the rudder. The printed formula has the sway in it with the other sign, by
    which a rudder would push a drifting stern further.
    """
    v = work[_NU]
    for k in range(len(rudders)):
        each, delta = rudders[k], commands[k]
        along = (1.0 - each[6]) * math.hypot(v[0], v[1])
        flow = math.copysign(along * along, v[0])
        if each[7] >= 0.0:
            flow += each[5] * work[_THRUST, int(each[7])]
        attack = math.copysign(1.0, flow) * delta
        if each[8] != 0.0:
            attack += math.atan2(v[1] + each[0] * v[5], math.sqrt(abs(flow)))
        lift = math.sin(0.5 * math.pi * attack / each[4]) if abs(attack) < each[4] else math.sin(attack)
        force = each[3] * abs(flow) * lift
        _add_force(work[_FORCE], each, -force * math.sin(delta), -force * math.cos(delta), 0.0)


@_called
def _accelerate(body: Array, propellers: Array, rudders: Array, commands: Array, work: Array) -> None:
    """Write the acceleration at the velocity ``work[_NU]`` and attitude ``work[_Q]`` into ``work[RATE]``."""
    v, f, p, rate, free = work[_NU], work[_FORCE], work[_P], work[RATE], body[FREE]
    for i in range(6):
        drag, inertia = body[DRAG + i], body[MOMENTUM + i]
        force, momentum = work[WRENCH, i] - (drag[i] + body[QUADRATIC, i] * abs(v[i])) * v[i], 0.0
        for j in range(6):
            if j != i:
                force -= drag[j] * v[j]
            momentum += inertia[j] * v[j]
        f[i], p[i] = force, momentum
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        f[i] += p[j] * v[3 + k] - p[k] * v[3 + j]
        f[3 + i] += p[j] * v[k] - p[k] * v[j] + (p[3 + j] * v[3 + k] - p[3 + k] * v[3 + j])
    for t in range(ROWS, len(body)):
        term = body[t]
        product = term[1]
        for column in range(2, 5):
            factor = int(term[column])
            if factor >= 0:
                product *= v[factor] if factor < 6 else abs(v[factor - 6])
        f[int(term[0])] += product
    q, g, b = work[_Q], body[GRAVITY], body[BUOYANCY]
    down_x, down_y = 2.0 * (q[1] * q[3] - q[0] * q[2]), 2.0 * (q[2] * q[3] + q[0] * q[1])
    down_z = 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])
    lift = -b[3] - b[4] * (v[_DEPTH] + b[0] * down_x + b[1] * down_y + b[2] * (down_z - 1.0))
    _add_force(f, g, g[3] * down_x, g[3] * down_y, g[3] * down_z)
    _add_force(f, b, lift * down_x, lift * down_y, lift * down_z)
    # Conservative, and without a moment about the vertical, which water at rest cannot apply.
    f[3] -= g[4] * down_y
    f[4] += (g[4] + (g[5] - g[4]) * down_z) * down_x
    f[5] -= (g[5] - g[4]) * down_x * down_y
    _propel(propellers, commands, work)
    _steer(rudders, commands[len(propellers) :], work)
    for i in range(6):
        row, value = work[_FACTORED + i], f[i] if free[i] != 0.0 else 0.0
        for j in range(i):
            value -= row[j] * rate[j]
        rate[i] = value
    for back in range(6):
        i = 5 - back
        row, value = work[_FACTORED + i], rate[i]
        for j in range(i + 1, 6):
            value -= row[j] * rate[j]
        rate[i] = value / row[i]


@_called
def _turn(state: Array, way: Array, part: float, q: Array) -> None:
    """Write the attitude of *state* into *q*, turned by *part* of the rotation vector in *way* [rad, body axes]."""
    a, b, c = part * way[_ANGLE], part * way[_ANGLE + 1], part * way[_ANGLE + 2]
    angle = math.sqrt(a * a + b * b + c * c)
    s = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    r, a, b, c = math.cos(0.5 * angle), s * a, s * b, s * c
    w, x, y, z = state[3], state[4], state[5], state[6]
    q[0] = w * r - x * a - y * b - z * c
    q[1] = w * a + x * r + y * c - z * b
    q[2] = w * b - x * c + y * r + z * a
    q[3] = w * c + x * b - y * a + z * r


@_called
def _to_earth(q: Array, body_way: Array, water: Array, scale: float, ned: Array) -> None:
    """Write a way or velocity in body axes of attitude *q* into *ned*, plus *scale* times the velocity of the water."""
    u, v, w = body_way[0], body_way[1], body_way[2]
    a, b, c = 2.0 * (q[2] * w - q[3] * v), 2.0 * (q[3] * u - q[1] * w), 2.0 * (q[1] * v - q[2] * u)
    ned[0] = u + q[0] * a + q[2] * c - q[3] * b + scale * water[0]
    ned[1] = v + q[0] * b + q[3] * a - q[1] * c + scale * water[1]
    ned[2] = w + q[0] * c + q[1] * b - q[2] * a + scale * water[2]


@_called
def _begin(state: Array, rotors: Array, work: Array) -> None:
    """Copy velocities, depth and speeds of the propellers into ``work[_NU]``, with no rotation yet."""
    v, rate = work[_NU], work[RATE]
    for i in range(6):
        v[i], rate[_ANGLE + i] = state[7 + i], 0.0
    for k in range(len(rotors)):
        v[_SPIN + k] = rotors[k]
    v[_DEPTH] = state[2]


@_called
def _step(
    state: Array, rotors: Array, body: Array, propellers: Array, rudders: Array, commands: Array, work: Array, dt: float
) -> None:
    """Advance by *dt* [s]."""
    v, rate, first, middle, q, water = work[_NU], work[RATE], work[_A], work[_B], work[_Q], body[WATER]
    for k in range(len(rotors)):
        if propellers[k, MOTOR] == 0.0:
            rotors[k] = commands[k] * propellers[k, 16]
    _begin(state, rotors, work)
    for stage in range(4):
        a, b, c = rate[_ANGLE], rate[_ANGLE + 1], rate[_ANGLE + 2]
        _turn(state, rate, 1.0, q)
        _accelerate(body, propellers, rudders, commands, work)
        d, e, f = b * v[5] - c * v[4], c * v[3] - a * v[5], a * v[4] - b * v[3]
        rate[_ANGLE] = v[3] + 0.5 * d + (b * f - c * e) / 12.0
        rate[_ANGLE + 1] = v[4] + 0.5 * e + (c * d - a * f) / 12.0
        rate[_ANGLE + 2] = v[5] + 0.5 * f + (a * e - b * d) / 12.0
        _to_earth(q, v, water, 1.0, rate[_PLACE:])
        for i in range(3):
            rate[_WAY + i] = v[i]
        # The weights 1 2 2 1 are summed in the order in which one axis gives the same digits as its own formula.
        ahead = 0.5 * dt if stage < 2 else dt if stage == 2 else dt / 6.0
        for i in range(_SPIN + len(rotors)):
            if stage == 0:
                first[i] = rate[i]
            elif stage == 1:
                middle[i] = rate[i]
            elif stage == 2:
                middle[i] += rate[i]
            else:
                rate[i] = first[i] + 2.0 * middle[i] + rate[i]
            rate[i] *= ahead
        for i in range(6):
            v[i] = state[7 + i] + rate[i]
        for k in range(len(rotors)):
            v[_SPIN + k] = rotors[k] + rate[_SPIN + k]
        v[_DEPTH] = state[2] + rate[_PLACE + 2]
    if water[3] != 0.0:  # along the heading at half the step
        _turn(state, rate, 0.5, q)
        _to_earth(q, rate[_WAY:], water, dt, rate[_PLACE:])
    _turn(state, rate, 1.0, q)
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(6):
        state[7 + i] = v[i]
    for i in range(4):
        state[3 + i] = q[i] / norm
    for i in range(3):
        state[i] += rate[_PLACE + i]
        work[TURNED, i] = rate[_ANGLE + i]
    for k in range(len(rotors)):
        rotors[k] = v[_SPIN + k]


@_entry
def fly(
    states: Array, rotors: Array, bodies: Array, propellers: Array, rudders: Array, commands: Array, wrenches: Array,
    work: Array, dt: float, steps: int, out: Array,
) -> None:  # fmt: skip
    """Fly each of c bodies through n intervals of *steps* steps of *dt* [s] each.

    states : (c, 13), rotors : (c, p), at the start, and at the end afterwards. bodies : (c, ROWS + t, 6). propellers :
    (c, p, PROPELLER). rudders : (c, r, RUDDER). commands : (n, p + r) and wrenches [N, N m] : (n, 6), the same for all
    bodies. out : (c, n, 13), filled with the state at the end of each interval, or (c, 0, 13).

    For the last body ``work[RATE]`` is then the acceleration at the end, and ``work[TURNED]`` the rotation of the last
    step.
    """
    for c in range(len(states)):
        state, rotor, body, propeller, rudder = states[c], rotors[c], bodies[c], propellers[c], rudders[c]
        _factor(body, work)
        for i in range(len(commands)):
            for j in range(6):
                work[WRENCH, j] = wrenches[i, j]
            for _ in range(steps):
                _step(state, rotor, body, propeller, rudder, commands[i], work, dt)
            for j in range(13 if out.shape[1] else 0):
                out[c, i, j] = state[j]
        _begin(state, rotor, work)
        _turn(state, work[RATE], 1.0, work[_Q])
        _accelerate(body, propeller, rudder, commands[-1], work)
