"""Linear state space: what nfoursid, sippy_unipi and jax-sysid predict with, and how its state is found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.runs import FIRST, Run

__all__ = ["free_run"]

Array = NDArray[np.float64]


def free_run(A: Array, B: Array, C: Array, D: Array, run: Run, scale_u: Array, scale_y: Array) -> tuple[Array, None]:
    """Simulate from the state that explains the first samples best (least squares)."""
    U, Y = run.U / scale_u, run.Y / scale_y
    forced, powers, x = [], [], np.zeros(len(A))
    P = np.eye(len(A))
    for i in range(FIRST):
        forced.append(Y[i] - C @ x - D @ U[i])
        powers.append(C @ P)
        x, P = A @ x + B @ U[i], A @ P
    x_0 = np.linalg.lstsq(np.vstack(powers), np.concatenate(forced), rcond=1e-6)[0]
    out, x = np.full_like(Y, np.nan), x_0
    for i in range(len(Y)):
        out[i] = C @ x + D @ U[i]
        x = A @ x + B @ U[i]
        if not np.all(np.abs(x) < 1e6):
            break
    out[:FIRST] = Y[:FIRST]
    return out * scale_y, None
