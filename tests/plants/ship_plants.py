"""A ship of our own for these tests: yaw of any drag, speed, drift angle, current and a rudder that takes its time.

Plain Runge-Kutta on lists; shares nothing with the code under test.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gcs_autotune.trial import Channel, Trial

DEG = math.pi / 180.0


class ZigZag:
    """The helmsman of a zig-zag: approach, then helm to one side, reversed at a change of heading."""

    def __init__(self, helm: float, heading: float, approach: float = 10.0, sense: float = 1.0) -> None:
        self.helm, self.heading, self.approach, self.sense, self.side = helm, heading, approach, sense, 0.0

    def __call__(self, t: float, psi: float) -> float:
        if t < self.approach - 1e-9:
            return 0.0
        if self.side == 0.0:
            self.side = 1.0
        elif self.sense * self.side * psi >= self.heading:
            self.side = -self.side
        return self.side * self.helm


def plan(*orders: tuple[float, float]) -> Callable[[float, float], float]:
    """Helm orders as (from this second on, helm)."""

    def helm(t: float, psi: float) -> float:
        return [h for start, h in orders if t >= start - 1e-9][-1]

    return helm


def sail(
    yaw: Callable[[float, float], float],
    helm: Callable[[float, float], float],
    duration: float,
    *,
    dt: float = 0.1,
    h: float = 0.01,
    rudder_rate: float = math.inf,
    speed: float = 1.0,
    loss: float = 0.0,
    drift: float = 0.0,
    current: tuple[float, float] = (0.0, 0.0),
    noise: float = 0.0,
    position_noise: float = 0.0,
    psi_0: float = 0.0,
    seed: int = 0,
    name: str = "ship",
) -> Trial:
    """Sail and record t, psi (wrapped), delta, r, x, y.

    yaw(r, delta) gives the yaw acceleration. Speed falls by *loss* per rad/s of yaw rate; the track lags the bow by
    *drift* [rad per rad/s].
    """
    every, rows = round(dt / h), []
    psi, r, x, y, delta = 0.0, 0.0, 0.0, 0.0, 0.0

    def rates(s: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        p, q, _, _ = s
        u = speed - loss * abs(q)
        course = psi_0 + p - drift * q
        return q, yaw(q, delta), u * math.cos(course) + current[0], u * math.sin(course) + current[1]

    def moved(s: tuple[float, ...], k: tuple[float, ...], step: float) -> tuple[float, float, float, float]:
        a, b, c, d = (v + step * w for v, w in zip(s, k, strict=True))
        return a, b, c, d

    for i in range(round(duration / dt)):
        order = helm(i * dt, psi)
        if math.isinf(rudder_rate):
            delta = order
        rows.append((i * dt, psi + psi_0, delta, r, x, y))
        for _ in range(every):
            if not math.isinf(rudder_rate):
                delta += min(max(order - delta, -rudder_rate * h), rudder_rate * h)
            s = (psi, r, x, y)
            k1 = rates(s)
            k2 = rates(moved(s, k1, 0.5 * h))
            k3 = rates(moved(s, k2, 0.5 * h))
            k4 = rates(moved(s, k3, h))
            psi, r, x, y = (
                v + h / 6.0 * (a + 2.0 * b + 2.0 * c + d) for v, a, b, c, d in zip(s, k1, k2, k3, k4, strict=True)
            )
    t, heading, rudder, _, north, east = np.array(rows).T
    rng = np.random.default_rng(seed)
    heading = heading + rng.normal(0.0, noise, len(t)) if noise else heading
    if position_noise:
        north, east = north + rng.normal(0.0, position_noise, len(t)), east + rng.normal(0.0, position_noise, len(t))
    heading = np.arctan2(np.sin(heading), np.cos(heading))
    columns = {"psi": ("rad", heading), "delta": ("rad", rudder), "x": ("m", north), "y": ("m", east)}
    return Trial(name, {n: Channel(n, unit, t, v) for n, (unit, v) in columns.items()})


def nomoto(K: float, T: float, bias: float = 0.0) -> Callable[[float, float], float]:
    """T r' + r = K (delta + bias)."""
    return lambda r, delta: (K * (delta + bias) - r) / T


def loop(K: float, T: float, cubic: float) -> Callable[[float, float], float]:
    """T r' = r - cubic r^3 + K delta: turns by itself at r = 1/sqrt(cubic) with the rudder amidships."""
    return lambda r, delta: (r - cubic * r**3 + K * delta) / T
