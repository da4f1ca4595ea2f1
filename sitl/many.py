"""Turning circles of many craft like one vehicle, flown in one call of the kernel. A study can call this function.

There is no autopilot, sensor, effect or noise. Thrust is that of the vehicle, and constant.
"""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from sitl.catalogue import load_vehicle
from sitl.craft import Craft
from sitl.plants import RigidBody, Wrench, kernel

__all__ = ["circles"]

Array = NDArray[np.float64]

STEP, SAMPLE = 0.05, 1.0
"""Longest time step and interval of the record [s]."""
RUN_UP, TURN = 60.0, 120.0
"""Time [s] straight ahead from rest, and time of the turn."""
QUANTILES = (0.05, 0.5, 0.95)


def circles(
    seed: int, like: str, craft: int = 10_000, spread: float = 1.5, throttle: float = 0.5, steering: float = 0.3
) -> dict[str, float]:
    """Fly turning circles with *craft* bodies like the vehicle *like*, and return quantiles of their figures.

    Inertia, linear drag and quadratic drag of each degree of freedom are multiplied by random factors between
    1/*spread* and *spread*, evenly on a logarithmic scale.

    Parameters
    ----------
    seed : of the factors.
    like : name of a simulated vehicle, or path of a vehicle file.
    throttle, steering : normalised outputs (-1 to 1).

    Returns
    -------
    ``craft``; ``turned``: fraction that turned by 180 degrees within :data:`TURN`; and of these ``q05``, ``q50`` and
    ``q95`` of ``diameter`` (tactical diameter [m]), ``steady_diameter`` [m], ``advance`` at 90 degrees [m], ``rate``
    [rad/s] and ``speed_loss`` (fraction of the speed before the turn).

    Raises
    ------
    UnknownVehicle, BadVehicle
        There is no such vehicle, or its file is not valid.
    ValueError
        *craft* is below 1, *spread* is below 1, or the motion diverges.
    """
    if craft < 1 or not spread >= 1.0:
        raise ValueError("circles: craft and spread must be at least 1")
    own = Craft(load_vehicle(like))
    assert isinstance(own.plant, RigidBody)
    plant, commands, wrenches = own.plant, [], []
    straight, turning = round(RUN_UP / SAMPLE), round(TURN / SAMPLE)
    for share in (0.0, steering):
        wrench = Wrench()
        own.actuators.apply(defaultdict(float, X=throttle, N=share), plant.parameters, wrench)
        commands.append(plant.commands.copy())
        wrenches.append((wrench.X, wrench.Y, wrench.Z, wrench.K, wrench.M, wrench.N))
    part = np.repeat([0, 1], [straight, turning])
    bodies, steps = _drawn(plant.body, craft, spread, seed), _steps(plant.propellers)
    out = plant.fly_copies(bodies, np.array(commands)[part], np.array(wrenches)[part], dt=SAMPLE / steps, steps=steps)
    return _figures(out, straight)


def _steps(propellers: Array) -> int:
    """Return the number of time steps per :data:`SAMPLE`. A step is at most :data:`STEP` and at most the shortest time
    constant of a shaft without load, because a longer one diverges.
    """
    kind, first, constant, resistance = propellers[:, kernel.MOTOR : kernel.MOTOR + 4].T
    lag, motor = kind == 1.0, kind == 2.0
    times = np.concatenate([first[lag], first[motor] * resistance[motor] / constant[motor] ** 2])
    return math.ceil(SAMPLE / float(np.min(times, initial=STEP)) - 1e-9)


def _drawn(body: Array, craft: int, spread: float, seed: int) -> Array:
    """Return the numbers of the bodies (c, ROWS + t, 6)."""
    factors = np.exp(np.random.default_rng(seed).uniform(-math.log(spread), math.log(spread), (craft, 3, 6)))
    bodies = np.repeat(body[None], craft, axis=0)
    roots = np.sqrt(factors[:, 0])  # both sides, so that the inertia stays symmetric and positive
    for first in (kernel.MASS, kernel.MOMENTUM):
        bodies[:, first : first + 6] *= roots[:, :, None] * roots[:, None, :]
    bodies[:, kernel.DRAG : kernel.DRAG + 6] *= factors[:, 1, :, None]
    bodies[:, kernel.QUADRATIC] *= factors[:, 2]
    return np.ascontiguousarray(bodies)


def _figures(out: Array, straight: int) -> dict[str, float]:
    """Return the figures of the states (c, n, 13), of which the turn begins after *straight* samples."""
    w, x, y, z = (out[:, straight - 1 :, k] for k in range(3, 7))
    psi = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), axis=1)
    turned = np.abs(psi - psi[:, :1])
    course = psi[:, 0]
    north, east = (out[:, straight - 1 :, k] - out[:, straight - 1, k, None] for k in (0, 1))
    ahead = north * np.cos(course)[:, None] + east * np.sin(course)[:, None]
    aside = np.abs(east * np.cos(course)[:, None] - north * np.sin(course)[:, None])
    speed = np.hypot(out[:, :, 7], out[:, :, 8])
    rate = np.abs(out[:, -1, 12])
    whole = np.max(turned, axis=1) >= math.pi
    found = {
        "diameter": _at(turned, aside, math.pi),
        "steady_diameter": 2.0 * speed[:, -1] / np.maximum(rate, 1e-12),
        "advance": _at(turned, ahead, 0.5 * math.pi),
        "rate": rate,
        "speed_loss": 1.0 - speed[:, -1] / np.maximum(speed[:, straight - 1], 1e-12),
    }
    result = {"craft": float(len(out)), "turned": float(np.mean(whole))}
    if np.any(whole):
        for name, values in found.items():
            result |= {f"{name}.q{100 * q:02.0f}": float(np.quantile(values[whole], q)) for q in QUANTILES}
    return result


def _at(turned: Array, values: Array, angle: float) -> Array:
    """Return *values* (c,) where *turned* (c, n) first reaches *angle* [rad], interpolated linearly."""
    k = np.maximum(np.argmax(turned >= angle, axis=1), 1)
    rows = np.arange(len(turned))
    low, high = turned[rows, k - 1], turned[rows, k]
    part = (angle - low) / np.where(high > low, high - low, 1.0)
    found: Array = values[rows, k - 1] + part * (values[rows, k] - values[rows, k - 1])
    return found
