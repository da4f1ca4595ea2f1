"""Linear model and Kalman filter of the heading deviations due to known disturbance statistics (Harvey1989, chapter 3).

The times of bursts are known to a sample, and their sizes are not. The model is thus Gaussian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from benchmarks.blind.flight_plan import FlownRuns
from benchmarks.blind.process_noise import BURSTS

__all__ = ["DisturbanceModel", "disturbance_model", "whitened"]

Array = NDArray[np.float64]

BURST = 3
"""Index of the state that is the moment of the present burst."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceModel:
    """Linear model of the heading deviations: ``x' = F x + w``, ``w`` of covariance ``Q``.

    It is measured as ``H x`` plus noise.
    ``F``, ``Q`` (steps or 1, runs, m, m); ``H`` (m,); ``P`` (runs, m, m) of the first sample; ``noise`` [rad].
    States: turn rate, heading, drifting moment and burst over inertia, and two states for each kind of waves.
    """

    F: Array
    Q: Array
    H: Array
    P: Array
    noise: float


def disturbance_model(flown: FlownRuns, thrust: Array, damping: Array, noise: float) -> DisturbanceModel:
    """Return the model for the disturbances of *flown*, with *thrust* (runs,) and *damping* (steps or 1, runs) [1/s].

    As in the simulator, the thrust factor of a run also scales the drifting moment.
    """
    craft, values_of = flown.plan.craft, {h.slug: h.values for h in flown.hidden}
    inertia, runs = craft.inertia["yaw"], len(thrust)
    moment = values_of.get(
        "drifting-moment", {"spread": 0.0, "memory": craft.pace, "burst": 0.0, "every": craft.duration}
    )
    waves, late = values_of.get("waves"), values_of.get("lag", {}).get("delay", 0.0)
    m = 4 if waves is None else 8 if late else 6
    memory = moment["memory"]
    steady, burst = moment["spread"] * thrust / inertia, moment["burst"] * thrust / inertia
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
        H[5], A[..., 0, m - 1] = waves["heading"], waves["moment"] / inertia
    both = np.zeros((*damping.shape, 2 * m, 2 * m))  # transition and noise of a step at once
    both[..., :m, :m], both[..., :m, m:], both[..., m:, m:] = -A, N, np.swapaxes(A, -1, -2)
    grown = expm(craft.interval * both)
    F = np.swapaxes(grown[..., m:, m:], -1, -2)
    Q = F @ grown[..., :m, m:]
    Q = 0.5 * (Q + np.swapaxes(Q, -1, -2))
    if moment["burst"]:
        stamps = flown.files[0]["t"]
        shown = np.searchsorted(stamps, stamps - late + 1e-9, side="right") - 1
        which = np.stack([f[BURSTS] for f in flown.files], axis=1)[np.maximum(shown, 0)]
        P[:, BURST, BURST] = np.where(which[0] > 0, burst**2, 0.0)
        F, Q = _with_bursts(F, Q, which, burst, craft.interval, late > 0.0)
    return DisturbanceModel(F, Q, H, P, noise)


def _with_bursts(F: Array, Q: Array, which: Array, burst: Array, interval: float, between: bool) -> tuple[Array, Array]:
    """Return ``F`` and ``Q`` of every step; a burst ends and another starts where *which* (n, runs) changes.

    *burst* (runs,): their standard deviation over inertia; *between*: measurements lie between the samples.
    """
    changes = which[1:] != which[:-1]
    if between:
        changes[:-1] |= changes[1:]
    F, Q = (np.broadcast_to(a, (*changes.shape, *a.shape[2:])).copy() for a in (F, Q))
    at, run = np.nonzero(changes)
    F[at, run, :, BURST] = 0.0
    Q[at, run, BURST, BURST] = np.where(which[at + 1, run] > 0, burst[run] ** 2, 0.0)
    push = np.zeros(F.shape[-1])  # for a random part of the step
    push[:2] = 1.0, 0.5 * interval
    Q[at, run] += (burst[run, None, None] * interval) ** 2 / 3.0 * np.outer(push, push)
    return F, Q


def whitened(model: DisturbanceModel, deviations: Array) -> tuple[Array, float]:
    """Return the normalised innovations of *deviations* (n, runs, columns), and the sum of the logarithms of variances.

    The log-likelihood of a column is minus half the sum of their squares and of the logarithms, plus a constant.
    """
    H, P = model.H, model.P
    z, x, logs = np.empty_like(deviations), np.zeros((*P.shape[:2], deviations.shape[2])), 0.0
    for k, y in enumerate(deviations):
        if k > 0:
            step = min(k, len(model.F)) - 1
            F = model.F[step]
            x, P = F @ x, F @ P @ np.swapaxes(F, -1, -2) + model.Q[step]
        seen = P @ H
        spread = seen @ H + model.noise**2
        off = y - H @ x
        x = x + (seen / spread[:, None])[:, :, None] * off[:, None, :]
        P = P - seen[:, :, None] * (seen / spread[:, None])[:, None, :]
        P = 0.5 * (P + np.swapaxes(P, -1, -2))
        z[k] = off / np.sqrt(spread)[:, None]
        logs += float(np.sum(np.log(spread)))
    return z, logs
