"""How weather makes a heading stray, to who knows its size and how long it lasts: a linear model, and a Kalman filter.

Harvey1989, chapter 3. Of bursts it is known when they come and go, to a sample, and not how strong they are: with that
all of it is Gaussian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from benchmarks.blind.process_noise import BURSTS
from benchmarks.blind.voyage import Flown

__all__ = ["Water", "water_of", "whitened"]

Array = NDArray[np.float64]

BURST = 3
"""Which of the states is the moment of the burst that there is."""


@dataclass(frozen=True, slots=True, eq=False)
class Water:
    """A linear model of how the heading strays: ``x' = F x + w``, ``w`` of covariance ``Q``, seen as ``H x`` and noise.

    ``F``, ``Q`` (steps or 1, runs, m, m); ``H`` (m,); ``P`` (runs, m, m) of the first sample; ``noise`` [rad].
    States: turn rate, heading, moments of the weather and of a burst per inertia, and two for each kind of waves.
    """

    F: Array
    Q: Array
    H: Array
    P: Array
    noise: float


def water_of(flown: Flown, thrust: Array, damping: Array, noise: float) -> Water:
    """Return how the weather of a voyage makes the heading stray, *thrust* (runs,), *damping* (steps or 1, runs) [1/s].

    Thrust of the day is more or less of what the weather does as well: so the tank has it.
    """
    craft, around = flown.voyage.craft, {h.slug: h.values for h in flown.hidden}
    inertia, runs = craft.inertia["yaw"], len(thrust)
    weather = around.get("weather", {"spread": 0.0, "memory": craft.pace, "burst": 0.0, "every": craft.duration})
    waves, late = around.get("waves"), around.get("lag", {}).get("delay", 0.0)
    m = 4 if waves is None else 8 if late else 6
    memory = weather["memory"]
    steady, burst = weather["spread"] * thrust / inertia, weather["burst"] * thrust / inertia
    A, N = np.zeros((*damping.shape, m, m)), np.zeros((runs, m, m))
    H, P = np.zeros(m), np.zeros((runs, m, m))
    A[..., 0, 0], A[..., 0, 2], A[..., 1, 0], A[..., 2, 2] = -damping, 1.0, 1.0, -1.0 / memory
    A[..., 0, BURST], H[1] = 1.0, 1.0
    N[:, 2, 2], P[:, 2, 2] = 2.0 / memory * steady**2, steady**2
    if waves is not None:
        omega, zeta = waves["frequency"], waves["damping"]
        for at in range(4, m, 2):
            A[..., at, at + 1], A[..., at + 1, at], A[..., at + 1, at + 1] = omega, -omega, -2.0 * zeta * omega
            N[:, at + 1, at + 1] = 4.0 * zeta * omega
            P[:, at, at] = P[:, at + 1, at + 1] = 1.0
        H[5], A[..., 0, m - 1] = waves["swing"], waves["moment"] / inertia
    both = np.zeros((*damping.shape, 2 * m, 2 * m))  # transition and noise of a step at once
    both[..., :m, :m], both[..., :m, m:], both[..., m:, m:] = -A, N, np.swapaxes(A, -1, -2)
    grown = expm(craft.interval * both)
    F = np.swapaxes(grown[..., m:, m:], -1, -2)
    Q = F @ grown[..., :m, m:]
    Q = 0.5 * (Q + np.swapaxes(Q, -1, -2))
    if weather["burst"]:
        stamps = flown.files[0]["t"]
        shown = np.searchsorted(stamps, stamps - late + 1e-9, side="right") - 1
        which = np.stack([f[BURSTS] for f in flown.files], axis=1)[np.maximum(shown, 0)]
        P[:, BURST, BURST] = np.where(which[0] > 0, burst**2, 0.0)
        F, Q = _with_bursts(F, Q, which, burst, craft.interval, late > 0.0)
    return Water(F, Q, H, P, noise)


def _with_bursts(F: Array, Q: Array, which: Array, burst: Array, interval: float, between: bool) -> tuple[Array, Array]:
    """Return both for every step: with one burst forgotten and another begun where *which* (n, runs) changes.

    *burst* (runs,) their spread per inertia; *between*: what is seen lies between samples, so either step may have it.
    """
    changes = which[1:] != which[:-1]
    if between:
        changes[:-1] |= changes[1:]
    F, Q = (np.broadcast_to(a, (*changes.shape, *a.shape[2:])).copy() for a in (F, Q))
    at, run = np.nonzero(changes)
    F[at, run, :, BURST] = 0.0
    Q[at, run, BURST, BURST] = np.where(which[at + 1, run] > 0, burst[run] ** 2, 0.0)
    push = np.zeros(F.shape[-1])  # for a part of the step that is as likely short as long
    push[:2] = 1.0, 0.5 * interval
    Q[at, run] += (burst[run, None, None] * interval) ** 2 / 3.0 * np.outer(push, push)
    return F, Q


def whitened(water: Water, strayed: Array) -> tuple[Array, float]:
    """Return innovations of columns *strayed* (n, runs, columns) over their spread, and the logarithms of its square.

    The log-likelihood of one column is minus half their squares' sum with the logarithms', but for a constant.
    """
    H, P = water.H, water.P
    z, x, logs = np.empty_like(strayed), np.zeros((*P.shape[:2], strayed.shape[2])), 0.0
    for k, y in enumerate(strayed):
        if k > 0:
            step = min(k, len(water.F)) - 1
            F = water.F[step]
            x, P = F @ x, F @ P @ np.swapaxes(F, -1, -2) + water.Q[step]
        seen = P @ H
        spread = seen @ H + water.noise**2
        off = y - H @ x
        x = x + (seen / spread[:, None])[:, :, None] * off[:, None, :]
        P = P - seen[:, :, None] * (seen / spread[:, None])[:, None, :]
        P = 0.5 * (P + np.swapaxes(P, -1, -2))
        z[k] = off / np.sqrt(spread)[:, None]
        logs += float(np.sum(np.log(spread)))
    return z, logs
