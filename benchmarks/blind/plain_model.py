"""Fit of the plain model (uncoupled, linear drag), to measure the error due to a hidden effect.

Steps with held commands are exact, initial states come from linear least squares, and inertia and drag from SciPy.
It uses nothing of the package under test, so the choice of cases does not depend on the diagnosis.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

from benchmarks.blind.craft import POSITION, SPEED, Craft

__all__ = ["errors_of", "misfit", "whitened"]

Array = NDArray[np.float64]
File = Mapping[str, Array]

MEMORY = 20
"""Order of the autoregression of an error."""

_WIDEST = 5.0
"""Logarithm of the largest factor between a fitted and the true inertia or drag."""


class _Axis:
    """One degree of freedom with its input and its measured signals."""

    def __init__(self, craft: Craft, dof: str, sizes: Mapping[str, float], *, drag: bool) -> None:
        self.channel = next((c for c, d in craft.drives.items() if d == dof), None)
        measured = [SPEED[dof]] if len(craft.dofs) > 1 and dof != "yaw" else [SPEED[dof], POSITION[dof]]
        self.signals = [name for name in measured if name in craft.signals]
        self.speed = SPEED[dof]
        self.sizes, self.drag = sizes, drag
        self.start = np.log([craft.inertia[dof], craft.linear[dof]])

    def paths(self, theta: Array, file: File) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return speed and position from rest (n,), and the response to initial speed and position (n, 2)."""
        t = file["t"]
        n, dt = len(t), float(t[-1] - t[0]) / (len(t) - 1)
        u = file[self.channel] if self.channel else np.zeros(n)
        m, k = np.arange(n) * dt, np.exp(theta)
        if self.drag:
            pace = k[0] / k[1]
            keep = np.exp(-dt / pace)
            gain, lost = 1.0 / k[1], pace * (1.0 - keep)
            speed = lfilter([0.0, (1.0 - keep) * gain], [1.0, -keep], u)
            moved = lost * speed + gain * (dt - lost) * u
            coast, reach = np.exp(-m / pace), pace * -np.expm1(-m / pace)
        else:
            speed = lfilter([0.0, dt / k[0]], [1.0, -1.0], u)
            moved = dt * speed + 0.5 * dt * dt / k[0] * u
            coast, reach = np.ones(n), m
        place = np.concatenate([[0.0], np.cumsum(moved)[:-1]])
        free = {"v": np.column_stack([coast, 0.0 * m]), "s": np.column_stack([reach, 0.0 * m + 1.0])}
        return {"v": speed, "s": place}, free

    def errors(self, theta: Array, file: File) -> dict[str, Array]:
        """Return measured minus fitted values of each signal over its size, with the best initial state."""
        paths, free = self.paths(theta, file)
        sort = {name: "v" if name == self.speed else "s" for name in self.signals}
        left = np.concatenate([(file[n] - paths[s]) / self.sizes[n] for n, s in sort.items()])
        table = np.concatenate([free[s] / self.sizes[n] for n, s in sort.items()])
        used = table[:, np.any(table != 0.0, axis=0)]
        left = left - used @ np.linalg.lstsq(used, left, rcond=None)[0]
        return dict(zip(self.signals, np.split(left, len(self.signals)), strict=True))

    def fit(self, files: Sequence[File]) -> Array:
        """Return the logarithms of the best inertia and drag."""

        def residual(theta: Array) -> Array:
            full = np.array([theta[0], theta[1] if self.drag else 0.0])
            return np.concatenate([e for file in files for e in self.errors(full, file).values()])

        best = None
        if not self.channel:
            return self.start
        size = 2 if self.drag else 1
        for shift in ((0.0, 0.0), (1.0, 1.0), (-1.0, -1.0), (0.0, 2.0)):
            begin = (self.start + np.array(shift))[:size]
            low, high = self.start[:size] - _WIDEST, self.start[:size] + _WIDEST
            found = least_squares(residual, begin, bounds=(low, high), xtol=1e-6, ftol=1e-6, max_nfev=40)
            if best is None or found.cost < best.cost:
                best = found
        return np.array([best.x[0], best.x[1] if self.drag else 0.0])


def misfit(errors: Sequence[Array]) -> float:
    """Return the rms of all *errors*, which :func:`errors_of` returns."""
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def whitened(errors: Sequence[Array], noise: float = 0.0) -> float:
    """Return the rms of *errors* with white *noise* added, over the rms of their one-step prediction errors.

    This is the largest reduction of the error that a model of the disturbance's spectrum can reach. The prediction is
    an autoregression over the last :data:`MEMORY` samples, by least squares.
    """
    rng = np.random.default_rng(0)
    noisy = [e + noise * rng.standard_normal(len(e)) for e in errors]
    left = []
    for e in noisy:
        past = np.column_stack([e[MEMORY - k - 1 : len(e) - k - 1] for k in range(MEMORY)])
        left.append(e[MEMORY:] - past @ np.linalg.lstsq(past, e[MEMORY:], rcond=None)[0])
    return misfit(noisy) / max(misfit(left), 1e-300)


def errors_of(
    craft: Craft,
    train: Sequence[File],
    unseen: Sequence[File],
    sizes: Mapping[str, float],
    *,
    drag: bool = True,
    of: Collection[str] | None = None,
) -> list[Array]:
    """Return the errors (n,) of every signal of every held-out file, over its size.

    The model is fitted to *train* and simulated on *unseen* with fitted initial states. Positions on the plane are
    dead-reckoned from the simulated speeds and heading, with a fitted initial position. *of*: only these signals.
    """
    axes = {dof: _Axis(craft, dof, sizes, drag=drag) for dof in craft.dofs}
    axes = {dof: axis for dof, axis in axes.items() if axis.signals}
    fitted = {dof: axis.fit(train) for dof, axis in axes.items()}
    found: list[Array] = []
    for file in unseen:
        errors = {}
        for dof, axis in axes.items():
            errors.update(axis.errors(fitted[dof], file))
        track = {n: e / sizes[n] for n, e in _reckoned(craft, file, errors, sizes, adrift=of is not None).items()}
        found += [e for n, e in (*errors.items(), *track.items()) if of is None or n in of]
    return found


def _reckoned(
    craft: Craft, file: File, errors: Mapping[str, Array], sizes: Mapping[str, float], *, adrift: bool
) -> dict[str, Array]:
    """Return the errors of dead-reckoned x and y, if the craft moves on the plane.

    *adrift*: no speed is measured. A constant sideways drift and a small heading error are then fitted too.
    """
    if len(craft.dofs) == 1 or "x" not in craft.signals or not {"u", "psi"} <= errors.keys():
        return {}
    u, psi = (file[n] - errors[n] * sizes[n] for n in ("u", "psi"))
    v = file["v"] - errors["v"] * sizes["v"] if "v" in errors else 0.0 * u
    steps = np.diff(file["t"])
    found, paths = {}, {}
    for name, rate in (("x", u * np.cos(psi) - v * np.sin(psi)), ("y", u * np.sin(psi) + v * np.cos(psi))):
        path = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)])
        paths[name], found[name] = path, file[name] - path
    slide = {"x": -np.sin(psi), "y": np.cos(psi)}
    for name, left in found.items():
        free = [np.ones_like(left)]
        if adrift:
            free += [np.cumsum(slide[name]), paths["y" if name == "x" else "x"]]
        table = np.column_stack(free)
        found[name] = left - table @ np.linalg.lstsq(table, left, rcond=None)[0]
    return found
