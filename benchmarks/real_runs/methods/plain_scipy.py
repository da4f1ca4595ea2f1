"""SciPy in the straightforward way: the same equations by hand, ``solve_ivp`` in ``least_squares`` with differences.

Starts from the equations as a linear regression on differentiated signals. Stopped after ``LIMIT`` CPU seconds; the
best parameters until then are used.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.runs import FIRST, STEP, Run

__all__ = ["LIMIT", "train"]

Array = NDArray[np.float64]

LIMIT = 120.0
"""CPU seconds of training."""


def twin(nu: Array, U: Array) -> tuple[list[Array], ...]:
    """Regressors of u', v', r' for two thrusters."""
    u, v, r = nu
    L, R = U
    one = np.ones_like(u)
    return [L + R, u, abs(u) * u], [v, u * r, r], [L - R, r, abs(u) * r, u, one]


def rudder(nu: Array, U: Array) -> tuple[list[Array], ...]:
    """Regressors of u', v', r' for a ship under its rudder."""
    u, v, r = nu
    (d,) = U
    cross = [u * v, u * r, abs(v) * v, abs(r) * r, d]
    return [np.ones_like(u), abs(u) * u, v * r, r * r, d * d], cross, cross


FORMS: dict[str, Callable[[Array, Array], tuple[list[Array], ...]]] = {"twin-thruster": twin, "rudder": rudder}


class _OutOfTimeError(Exception):
    """The limit is reached."""


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit."""
    terms = FORMS[form]
    scale = np.vstack([r.Y for r in runs]).std(axis=0)
    scale = np.append(scale, float(np.std(np.concatenate([r.psi - r.psi.mean() for r in runs]))))
    start = _regression(runs, terms)
    sizes = [len(p) for p in start]
    begun, best = time.process_time(), (np.inf, np.concatenate(start))
    unit = np.maximum(np.abs(best[1]), 1e-3)

    def residual(x: Array) -> Array:
        nonlocal best
        if time.process_time() - begun > LIMIT:
            raise _OutOfTimeError
        theta = np.split(x * unit, np.cumsum(sizes)[:-1])
        errors = []
        for run in runs:
            state = _simulate(run, terms, theta, 0, np.append(run.Y[0], run.psi[0]))
            errors.append(((state - np.column_stack([run.Y, run.psi])) / scale).ravel())
        found = np.nan_to_num(np.concatenate(errors), nan=1e3, posinf=1e3, neginf=-1e3)
        if float(found @ found) < best[0]:
            best = (float(found @ found), x * unit)
        return found

    with contextlib.suppress(_OutOfTimeError):
        least_squares(residual, best[1] / unit, method="trf")
    theta = np.split(best[1], np.cumsum(sizes)[:-1])

    def predict(run: Run) -> tuple[Array, Array | None]:
        Y, psi = run.Y.copy(), run.psi.copy()
        state = _simulate(run, terms, theta, FIRST - 1, np.append(Y[FIRST - 1], psi[FIRST - 1]))
        Y[FIRST - 1 :], psi[FIRST - 1 :] = state[:, :3], state[:, 3]
        return Y, psi

    return predict


def _simulate(
    run: Run, terms: Callable[..., tuple[list[Array], ...]], theta: list[Array], at: int, x_0: Array
) -> Array:
    def slope(t: float, x: Array) -> list[float]:
        i = min(int((t - run.t[0]) / STEP + 1e-6), len(run.U) - 1)
        rows = terms(x[:3], run.U[i])
        return [*(float(np.dot(p, row)) for p, row in zip(theta, rows, strict=True)), x[2]]

    t = run.t[at:]
    found = solve_ivp(slope, (t[0], t[-1]), x_0, t_eval=t, max_step=2.0 * STEP)
    out = np.full((len(t), 4), np.nan)
    out[: found.y.shape[1]] = found.y.T
    return out


def _regression(runs: Sequence[Run], terms: Callable[..., tuple[list[Array], ...]]) -> list[Array]:
    found = []
    for k in range(3):
        A = np.vstack([np.column_stack(terms(r.Y.T, r.U.T)[k]) for r in runs])
        b = np.concatenate([np.gradient(r.Y[:, k], STEP) for r in runs])
        found.append(np.linalg.lstsq(A, b, rcond=None)[0])
    return found
