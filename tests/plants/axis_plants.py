"""Water of our own for these tests: a fixed-step integrator that shares nothing with the code under test."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

DEG = np.pi / 180.0
Plant = tuple[float, float, float, float]
"""alpha, beta, beta_quadratic, delta."""


def swim(plant: Plant, state: list[float], tau: float, h: float) -> None:
    """One classical Runge-Kutta step of length h."""
    alpha, beta, quadratic, delta = plant

    def push(nu: float) -> float:
        return (tau + delta - (beta + quadratic * abs(nu)) * nu) / alpha

    eta, nu = state
    k1 = push(nu)
    k2 = push(nu + 0.5 * h * k1)
    k3 = push(nu + 0.5 * h * k2)
    k4 = push(nu + h * k3)
    state[0] = eta + h * nu + h * h / 6.0 * (k1 + k2 + k3)
    state[1] = nu + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def fly(
    plant: Plant, command: Callable[[float, float], float], duration: float, *, dt: float, delay: float, h: float
) -> tuple[np.ndarray, ...]:
    """Return t, eta, nu, tau at every dt; command(t, eta) is held between samples and acts after the delay."""
    every, count = round(dt / h), round(duration / dt)
    pipe: deque[float] = deque([command(0.0, 0.0)] * round(delay / h))
    state, rows = [0.0, 0.0], []
    for k in range(count):
        tau = command(k * dt, state[0])
        rows.append((k * dt, state[0], state[1], tau))
        for _ in range(every):
            pipe.append(tau)
            swim(plant, state, pipe.popleft(), h)
    return tuple(np.array(rows).T)


class Relay:
    """Relay with hysteresis on the position error."""

    def __init__(self, C: float, x_a: float, reverse: bool = False) -> None:
        self.C, self.x_a, self.high, self.sign = C, x_a, True, -1.0 if reverse else 1.0

    def __call__(self, t: float, eta: float) -> float:
        if -eta > self.x_a:
            self.high = True
        elif -eta < -self.x_a:
            self.high = False
        return self.sign * (self.C if self.high else -self.C)


class Levels:
    """A random sequence of levels, each held for some seconds."""

    def __init__(self, rng: np.random.Generator, amplitude: float, hold: float) -> None:
        self.values, self.hold = rng.uniform(-amplitude, amplitude, 500), hold

    def __call__(self, t: float, eta: float) -> float:
        return float(self.values[int(t / self.hold)])
