"""Turning circles and zig-zags of many craft like one vehicle, flown by the simulator's kernel. A study can call these
functions.

There is no autopilot, sensor, effect or noise. Thrust is that of the vehicle, and constant. The rudder moves at once.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sitl.catalogue import load_vehicle
from sitl.craft import Craft
from sitl.plants import RigidBody, Wrench, kernel

__all__ = ["circles", "zig_zags"]

Array = NDArray[np.float64]

STEP, SAMPLE = 0.05, 1.0
"""Longest time step and interval of the record [s]."""
RUN_UP, TURN = 60.0, 120.0
"""Time [s] straight ahead from rest, and time of the turn or zig-zag."""
TICK = 0.1
"""Time [s] between two looks at the heading in a zig-zag."""
EXECUTES = 4
"""Number of rudder executes of a zig-zag: the first, and three at the heading."""
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
    plant, commands, wrenches, bodies = _many(seed, like, craft, spread, throttle, (0.0, steering))
    straight, turning = round(RUN_UP / SAMPLE), round(TURN / SAMPLE)
    part, steps = np.repeat([0, 1], [straight, turning]), _steps(plant.propellers, SAMPLE)
    out = plant.fly_copies(bodies, commands[part], wrenches[part], dt=SAMPLE / steps, steps=steps)
    return _figures(out, straight)


def zig_zags(
    seed: int,
    like: str,
    craft: int = 10_000,
    spread: float = 1.5,
    throttle: float = 0.5,
    steering: float = 0.3,
    heading: float = math.radians(20.0),
) -> dict[str, float]:
    """Fly zig-zags (IMO MSC.137(76), 5.2.2) with bodies as in :func:`circles`, and return quantiles of their figures.

    heading : change of heading [rad] at which the rudder is put over to the other side. The heading is looked at every
        :data:`TICK`.

    Returns
    -------
    ``craft``; ``executed``: fraction that reached the heading for the third time within :data:`TURN`; and of these
    ``q05``, ``q50`` and ``q95`` of ``overshoot_1`` and ``overshoot_2`` [rad], ``initial_turning`` [s]: time from the
    first execute to the heading, and ``period`` [s]: time from the second to the fourth execute.

    Raises
    ------
    UnknownVehicle, BadVehicle, ValueError
        As :func:`circles`.
    """
    plant, commands, wrenches, bodies = _many(seed, like, craft, spread, throttle, (0.0, steering, -steering))
    steps, pilot = _steps(plant.propellers, TICK), _Pilot(craft, math.copysign(heading, steering))
    plant.steer_copies(bodies, commands, wrenches, pilot, dt=TICK / steps, steps=steps)
    whole = pilot.executes >= EXECUTES
    figures = {
        "overshoot_1": pilot.extremes[1] - heading,
        "overshoot_2": pilot.extremes[2] - heading,
        "initial_turning": pilot.times[1] - pilot.times[0],
        "period": pilot.times[3] - pilot.times[1],
    }
    return {"craft": float(craft), "executed": float(np.mean(whole)), **_quantiles(figures, whole)}


class _Pilot:
    """Puts the rudder over at the heading: row 0 of the commands ahead, then 1 and 2 in turn.

    ``executes`` (c,): number of executes. ``times`` (EXECUTES, c) [s]: of each. ``extremes`` (EXECUTES, c) [rad]:
    largest change of heading, to the side of the rudder before, between an execute and the next.
    """

    def __init__(self, craft: int, heading: float) -> None:
        self._ticks, self._heading = 0, heading
        self._began, self._last = np.zeros(craft), np.zeros(craft)
        self.executes = np.zeros(craft, dtype=np.int64)
        self.times, self.extremes = np.zeros((EXECUTES, craft)), np.zeros((EXECUTES, craft))

    def __call__(self, states: Array) -> NDArray[np.int64] | None:
        psi = _heading_of(*states[:, 3:7].T)
        self._last = psi = self._last + np.angle(np.exp(1j * (psi - self._last)))
        t = self._ticks * TICK
        if t > RUN_UP + TURN or np.all(self.executes >= EXECUTES):
            return None
        if t < RUN_UP + 0.5 * TICK:
            self._began = psi
        if t > RUN_UP - 0.5 * TICK:
            side = np.where(self.executes % 2 == 1, 1.0, -1.0)  # of the rudder now
            changed = (psi - self._began) * math.copysign(1.0, self._heading)
            every = np.arange(len(psi))
            before = np.clip(self.executes - 1, 0, EXECUTES - 1)
            beyond = np.where(self.executes > 1, -side * changed, -np.inf)
            self.extremes[before, every] = np.maximum(self.extremes[before, every], beyond)
            due = (side * changed >= abs(self._heading)) | (self.executes == 0)
            due &= self.executes < EXECUTES
            self.times[self.executes[due], every[due]] = t
            self.executes[due] += 1
        self._ticks += 1
        return np.where(self.executes == 0, 0, 2 - self.executes % 2)


def _many(
    seed: int, like: str, craft: int, spread: float, throttle: float, steering: Sequence[float]
) -> tuple[RigidBody, Array, Array, Array]:
    """Return the vehicle's plant, commands (n, p + r) and wrenches (n, 6) of each *steering*, and the bodies."""
    if craft < 1 or not spread >= 1.0:
        raise ValueError("craft and spread must be at least 1")
    own = Craft(load_vehicle(like))
    assert isinstance(own.plant, RigidBody)
    plant, commands, wrenches = own.plant, [], []
    for share in steering:
        wrench = Wrench()
        own.actuators.apply(defaultdict(float, X=throttle, N=share), plant.parameters, wrench)
        commands.append(plant.commands.copy())
        wrenches.append((wrench.X, wrench.Y, wrench.Z, wrench.K, wrench.M, wrench.N))
    return plant, np.array(commands), np.array(wrenches), _drawn(plant.body, craft, spread, seed)


def _steps(propellers: Array, interval: float) -> int:
    """Return the number of time steps per *interval* [s]. A step is at most :data:`STEP` and at most the shortest time
    constant of a shaft without load, because a longer one diverges.
    """
    kind, first, constant, resistance = propellers[:, kernel.MOTOR : kernel.MOTOR + 4].T
    lag, motor = kind == 1.0, kind == 2.0
    times = np.concatenate([first[lag], first[motor] * resistance[motor] / constant[motor] ** 2])
    return math.ceil(interval / float(np.min(times, initial=STEP)) - 1e-9)


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
    psi = np.unwrap(_heading_of(*(out[:, straight - 1 :, k] for k in range(3, 7))), axis=1)
    turned = np.abs(psi - psi[:, :1])
    course = psi[:, 0]
    north, east = (out[:, straight - 1 :, k] - out[:, straight - 1, k, None] for k in (0, 1))
    ahead = north * np.cos(course)[:, None] + east * np.sin(course)[:, None]
    aside = np.abs(east * np.cos(course)[:, None] - north * np.sin(course)[:, None])
    speed = np.hypot(out[:, :, 7], out[:, :, 8])
    rate = np.abs(out[:, -1, 12])
    whole = np.max(turned, axis=1) >= math.pi
    figures = {
        "diameter": _at(turned, aside, math.pi),
        "steady_diameter": 2.0 * speed[:, -1] / np.maximum(rate, 1e-12),
        "advance": _at(turned, ahead, 0.5 * math.pi),
        "rate": rate,
        "speed_loss": 1.0 - speed[:, -1] / np.maximum(speed[:, straight - 1], 1e-12),
    }
    return {"craft": float(len(out)), "turned": float(np.mean(whole)), **_quantiles(figures, whole)}


def _quantiles(found: Mapping[str, Array], whole: NDArray[np.bool_]) -> dict[str, float]:
    """Return ``q05``, ``q50`` and ``q95`` of each figure (c,), of the craft that flew the *whole* manoeuvre."""
    return {
        f"{name}.q{100 * q:02.0f}": float(np.quantile(values[whole], q))
        for name, values in found.items()
        for q in QUANTILES
        if np.any(whole)
    }


def _heading_of(w: Array, x: Array, y: Array, z: Array) -> Array:
    """Return the heading [rad] of attitudes, in one turn."""
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _at(turned: Array, values: Array, angle: float) -> Array:
    """Return *values* (c,) where *turned* (c, n) first reaches *angle* [rad], interpolated linearly."""
    k = np.maximum(np.argmax(turned >= angle, axis=1), 1)
    rows = np.arange(len(turned))
    low, high = turned[rows, k - 1], turned[rows, k]
    part = (angle - low) / np.where(high > low, high - low, 1.0)
    crossing: Array = values[rows, k - 1] + part * (values[rows, k] - values[rows, k - 1])
    return crossing
