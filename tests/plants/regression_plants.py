"""Water of our own for these tests: plain Runge-Kutta, equations by hand; shares nothing with the code under test."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

Array = np.ndarray

M = (8.2372, 8.2372, 0.0372)
D = (4.4283, 14.9571, 0.0997)
"""VideoRay in the horizontal plane: the final matrices of Miskovic2007, errata mended."""

HORIZONTAL_INPUTS = {"X": (("X", 1.0),), "N": (("N", 1.0),)}
DOFS = ("surge", "sway", "yaw")

UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s", "X": "N", "N": "N m"}


def rk4(rates: Callable[[Array, Array], Array], s: Array, tau: Array, h: float) -> Array:
    k_1 = rates(s, tau)
    k_2 = rates(s + 0.5 * h * k_1, tau)
    k_3 = rates(s + 0.5 * h * k_2, tau)
    k_4 = rates(s + h * k_3, tau)
    return s + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


def videoray(s: Array, tau: Array) -> Array:
    """Rates of (x, y, psi, u, v, r): Miskovic2007, final model."""
    _, _, psi, u, v, r = s
    c, n = np.cos(psi), np.sin(psi)
    u_dot = (tau[0] - D[0] * u + M[1] * v * r) / M[0]
    v_dot = (-D[1] * v - M[0] * u * r) / M[1]
    r_dot = (tau[1] - D[2] * r + (M[0] - M[1]) * u * v) / M[2]
    return np.array([u * c - v * n, u * n + v * c, r, u_dot, v_dot, r_dot])


@cache
def s_manoeuvre(X: float, N: float, duration: float = 40.0) -> tuple[Array, Array, Array]:
    """Stamps at 10 Hz, states (n, 6), inputs (n, 2): the moment to and fro, then the same going backwards."""
    t = np.arange(round(duration * 10)) / 10.0
    tau = np.column_stack([np.where(t < duration / 2, X, -X), np.where((t / 4.0).astype(int) % 2 == 0, N, -N)])
    s, states = np.zeros(6), []
    for held in tau:
        states.append(s)
        for _ in range(10):
            s = rk4(videoray, s, held, 0.01)
    return t, np.array(states), tau


def camera_run(seed: int, X: float, N: float, noise: float = 1.0, duration: float = 40.0) -> Trial:
    """One S-manoeuvre seen from above: 3 mm and 0.01 rad of noise, times *noise*."""
    t, S, tau = s_manoeuvre(X, N, duration)
    rng = np.random.default_rng(seed)
    channels = {"X": tau[:, 0], "N": tau[:, 1]}
    for name, j, std in (("x", 0, 0.003), ("y", 1, 0.003), ("psi", 2, 0.01)):
        channels[name] = S[:, j] + noise * rng.normal(0.0, std, len(t))
    return Trial(f"S{seed}", {n: Channel(n, UNITS[n], t, v) for n, v in channels.items()})


def velocity_run(seed: int, X: float, N: float, noise: float, duration: float = 40.0) -> Trial:
    """One S-manoeuvre with heading and velocities measured, all with the same noise."""
    t, S, tau = s_manoeuvre(X, N, duration)
    rng = np.random.default_rng(seed)
    channels = {"X": tau[:, 0], "N": tau[:, 1]}
    for name, j in (("psi", 2), ("u", 3), ("v", 4), ("r", 5)):
        channels[name] = S[:, j] + rng.normal(0.0, noise, len(t))
    return Trial(f"S{seed}", {n: Channel(n, UNITS[n], t, v) for n, v in channels.items()})


def coupled(*extra: str) -> Form:
    """Surge, sway and yaw with linear drag; Coriolis forces from the inertia."""
    free = ("X_udot", "Y_vdot", "N_rdot", "X_u", "Y_v", "N_r", *extra)
    return Form("horizontal, linear", "", DOFS, free, {}, HORIZONTAL_INPUTS)


TRUTH = {
    "X_udot": -M[0], "Y_vdot": -M[1], "N_rdot": -M[2], "X_u": -D[0], "Y_v": -D[1], "N_r": -D[2],
}  # fmt: skip


@cache
def oscillation(
    plant: tuple[float, float, float], relay: tuple[float, float], step: float, duration: float
) -> tuple[Array, Array, Array]:
    """Stamps, (heading, rate) and moment of ``alpha r_dot + (beta + beta_rr |r|) r = N`` under a relay (C, x_a)."""
    alpha, beta, quadratic = plant
    C, x_a = relay
    h, every = 0.02, round(step / 0.02)

    def push(rate: float, tau: float) -> float:
        return (tau - (beta + quadratic * abs(rate)) * rate) / alpha

    t = np.arange(round(duration / step)) * step
    psi, r, high, states, moments = 0.0, 0.0, True, [], []
    for _ in t:
        high = True if -psi > x_a else False if psi > x_a else high
        tau = C if high else -C
        states.append((psi, r))
        moments.append(tau)
        for _ in range(every):
            k_1 = push(r, tau)
            k_2 = push(r + 0.5 * h * k_1, tau)
            k_3 = push(r + 0.5 * h * k_2, tau)
            k_4 = push(r + h * k_3, tau)
            psi += h * r + h * h / 6.0 * (k_1 + k_2 + k_3)
            r += h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
    return t, np.array(states), np.array(moments)


def yaw_run(
    plant: tuple[float, float, float],
    relay: tuple[float, float],
    *,
    step: float,
    noise: float,
    rate_noise: float | None = None,
    duration: float = 200.0,
    seed: int = 0,
) -> Trial:
    """One self-oscillation, heading with *noise* [rad], rate of turn with *rate_noise* [rad/s] if it is measured."""
    t, S, moment = oscillation(plant, relay, step, duration)
    rng = np.random.default_rng(seed)
    channels = {"psi": S[:, 0] + rng.normal(0.0, noise, len(t)), "N": moment}
    if rate_noise is not None:
        channels["r"] = S[:, 1] + rng.normal(0.0, rate_noise, len(t))
    return Trial(f"C = {relay[0]}", {n: Channel(n, UNITS[n], t, v) for n, v in channels.items()})
