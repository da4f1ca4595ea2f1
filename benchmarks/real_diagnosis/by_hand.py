"""A plain least-squares fit of the heading, to compare with the diagnosis.

The model is ``r_dot = a tau + N_r r + N_0`` plus a few terms, per unit of inertia. It is integrated from the measured
heading and turn rate over some seconds, and fitted by SciPy. Each run is held out in turn, or each part of a single
run. There is no filter, no process noise and no search.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gcs_autotune.trial import Trial

__all__ = ["ALL", "STRUCTURES", "HandFit", "by_hand", "lines_by_hand"]

Array = NDArray[np.float64]

INTERVAL, STEPS = 0.1, 50
"""Smallest step [s] of the integration (Euler), and largest number of steps of a piece."""

PARTS = 4
"""Parts of a single run, held out in turn."""

STEP, FITTED_EVERY = 10, 5
"""Steps between the starts of pieces, and between the fitted samples of a piece."""

LIMIT = 1e3
"""Turn rate [rad/s] at which a simulation is clipped."""

Term = Callable[[Array, Array, Array], Array]

TERMS: Mapping[str, Term] = {
    "N_|u|r": lambda u, v, r: np.abs(u) * r,
    "N_ur": lambda u, v, r: u * r,
    "N_v": lambda u, v, r: v,
    "N_|r|r": lambda u, v, r: np.abs(r) * r,
}
"""Derivative -> its factor, from measured ``u`` and ``v`` and simulated ``r``."""

STRUCTURES: Mapping[str, tuple[str, ...]] = {
    "linear": (),
    "N_|u|r": ("N_|u|r",),
    "N_v": ("N_v",),
    "N_v, N_|r|r": ("N_v", "N_|r|r"),
    "N_|u|r, N_v": ("N_|u|r", "N_v"),
    "N_|u|r, N_ur": ("N_|u|r", "N_ur"),
    "N_ur, N_v, N_|r|r": ("N_ur", "N_v", "N_|r|r"),
}
"""Name -> terms in addition to the linear ones."""


@dataclass(frozen=True, slots=True, eq=False)
class HandFit:
    """Rms error [deg] of the heading ``seconds`` ahead on each held-out run: structure -> run -> error.

    The last run, :data:`ALL`, has the error of all samples.
    """

    seconds: float
    errors: Mapping[str, Mapping[str, float]]


ALL = "all"
"""Name of the row for all samples."""


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """A run on one grid of ``dt`` [s], (n,) each: command, measured heading, turn rate and speeds."""

    dt: float
    command: Array
    psi: Array
    r: Array
    u: Array
    v: Array

    def starts(self, ahead: int) -> NDArray[np.int64]:
        """Return the first samples of the pieces of *ahead* steps."""
        return np.arange(0, len(self.psi) - ahead - 1, STEP)

    def parts(self, count: int) -> list[_Record]:
        """Return *count* equal parts."""
        columns = [np.array_split(c, count) for c in (self.command, self.psi, self.r, self.u, self.v)]
        return [_Record(self.dt, *own) for own in zip(*columns, strict=True)]


def _record(run: Trial, dt: float) -> _Record | None:
    """Return a run on a grid, with the integrated turn rate if no heading was measured; None without either."""
    if "psi" not in run and "r" not in run:
        return None
    own = run["psi"] if "psi" in run else run["r"]
    grid = np.arange(float(own.t[0]), float(own.t[-1]), dt)

    def on_grid(name: str) -> Array:
        if name not in run:
            return np.zeros(len(grid))
        channel = run[name]
        known = np.isfinite(channel.values)
        values = channel.values[known]
        return np.interp(grid, channel.t[known], np.unwrap(values) if name == "psi" else values)

    heading = on_grid("psi") if "psi" in run else np.cumsum(on_grid("r")) * dt
    command = on_grid("force_left") - on_grid("force_right") if "force_left" in run else on_grid("N") + on_grid("delta")
    rate = on_grid("r") if "r" in run else np.gradient(heading, dt)
    return _Record(dt, command, heading, rate, on_grid("u"), on_grid("v"))


def _errors(record: _Record, theta: Array, terms: Sequence[Term], ahead: int) -> Array:
    """Return the errors (ahead, pieces) of the heading [deg] of all pieces."""
    at = record.starts(ahead)
    r, psi = record.r[at].copy(), np.zeros(len(at))
    found = np.zeros((ahead, len(at)))
    for k in range(ahead):
        now = at + k
        push = theta[0] * record.command[now] + theta[1] * r + theta[2]
        for value, term in zip(theta[3:], terms, strict=True):
            push = push + value * term(record.u[now], record.v[now], r)
        psi = psi + record.dt * r
        r = np.clip(r + record.dt * push, -LIMIT, LIMIT)
        found[k] = psi - (record.psi[now + 1] - record.psi[at])
    return np.degrees(found)


def by_hand(runs: Sequence[Trial], seconds: float = 5.0) -> HandFit:
    """Fit every structure with each run held out in turn, and return the errors on the held-out runs."""
    dt = max(INTERVAL, seconds / STEPS)
    ahead = round(seconds / dt)
    records = {run.name: record for run in runs if (record := _record(run, dt)) is not None}
    if len(records) == 1:
        name, whole = next(iter(records.items()))
        records = {f"{name}, part {k}": part for k, part in enumerate(whole.parts(PARTS), start=1)}
    records = {name: r for name, r in records.items() if len(r.starts(ahead)) > 1}
    found: dict[str, dict[str, float]] = {}
    for structure, names in STRUCTURES.items():
        terms, squares = [TERMS[n] for n in names], []
        for left_out in records:
            others = [r for n, r in records.items() if n != left_out]
            if not others:
                continue
            theta = _fitted(others, terms, ahead)
            squares.append(_errors(records[left_out], theta, terms, ahead)[-1] ** 2)
            found.setdefault(structure, {})[left_out] = float(np.sqrt(np.mean(squares[-1])))
        if squares:
            found[structure][ALL] = float(np.sqrt(np.mean(np.concatenate(squares))))
    return HandFit(seconds, found)


def _fitted(records: Sequence[_Record], terms: Sequence[Term], ahead: int) -> Array:
    def residual(theta: Array) -> Array:
        each = [_errors(r, theta, terms, ahead)[FITTED_EVERY - 1 :: FITTED_EVERY].ravel() for r in records]
        return np.concatenate(each)

    scale = max(float(np.std(np.concatenate([r.command for r in records]))), 1e-12)
    rate = float(np.std(np.concatenate([r.r for r in records])))
    starts = [np.array([sign * rate / scale, -1.0, 0.0, *[0.0] * len(terms)]) for sign in (1.0, -1.0)]
    fits = [least_squares(residual, start, x_scale="jac", max_nfev=60) for start in starts]
    best: Array = min(fits, key=lambda f: f.cost).x
    return best


def lines_by_hand(fit: HandFit, ours: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return a table: the error on each run by hand with each structure, by our plain model, and with causes.

    ours : run -> rms error [deg] without and with the causes.
    """
    runs = list(next(iter(fit.errors.values()), {}))
    width = max([len("run"), *map(len, runs)])
    head = "  ".join(f"{s:>12}" for s in fit.errors)
    lines = [f"error of the heading {fit.seconds:g} s ahead on held-out runs [deg], fitted by hand (SciPy), and ours"]
    lines.append(f"{'run':{width}}  {head}  {'ours: plain':>12}  {'with causes':>12}")
    for run in runs:
        cells = "  ".join(f"{fit.errors[s][run]:12.1f}" for s in fit.errors)
        own = "  ".join(f"{e:12.1f}" for e in ours[run]) if run in ours else f"{'-':>12}  {'-':>12}"
        lines.append(f"{run:{width}}  {cells}  {own}")
    return lines
