"""Velocities and accelerations read off measured signals by local polynomials, each signal at its own stamps.

Rough on purpose: only start values come from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.segment import Segment, Signal
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.program import states_of
from gcs_autotune.sname import DOFS

__all__ = ["Motion", "smoothed_motion"]

Array = NDArray[np.float64]

HALF_WIDTHS = (2, 5, 12, 30)
"""Neighbours to each side a local polynomial may use."""

MOST = 400
"""Stamps per record at which the equations are looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A record's states at some stamps.

    t (s,); X (s, n) in the order of ``states_of(form)``, 0 where nothing was measured; nu_dot (s, k); inputs (s, m);
    known (k,): whether a velocity could be had.
    """

    t: Array
    X: Array
    nu_dot: Array
    inputs: Array
    known: NDArray[np.bool_]


def smoothed_motion(form: Form, record: Segment, delay: float = 0.0) -> Motion:
    """Return the smoothed states of *record*, its inputs held and late by *delay* [s]."""
    begin = max(float(s.t[0]) for s in record.signals.values())
    end = min(float(s.t[-1]) for s in record.signals.values())
    stamps = record.stamps
    t = stamps[(stamps >= begin) & (stamps <= end)]
    t = t if len(t) > 3 else stamps
    t = t[:: max(1, len(t) // MOST)]
    states, k = states_of(form), len(form.dofs)
    X, nu_dot, known = np.zeros((len(t), len(states))), np.zeros((len(t), k)), np.zeros(k, dtype=bool)
    fits = {name: _local(signal, t, 2 if name in "uvwpqr" else 3) for name, signal in record.signals.items()}
    psi = fits["psi"][0] if "psi" in fits else np.zeros(len(t))
    for place, dof in enumerate(DOFS[d] for d in form.dofs):
        if dof.position in fits:
            X[:, states.index(dof.position)] = fits[dof.position][0]
        if dof.velocity in fits:
            value, rate, _ = fits[dof.velocity]
        elif dof.name in ("surge", "sway") and {"x", "y"} & set(fits):
            value, rate = _through_the_body(fits, psi, dof.name)
        elif dof.position in fits:
            _, value, rate = fits[dof.position]
        else:
            continue
        X[:, states.index(dof.velocity)], nu_dot[:, place], known[place] = value, rate, True
    row = np.maximum(np.searchsorted(record.t_in, t - delay, side="right") - 1, 0)
    inputs = np.ascontiguousarray(record.inputs[row])
    if "lag" in form.parameters:
        X[:, 2 * k :] = inputs
    return Motion(t, X, nu_dot, inputs, known)


def _through_the_body(fits: dict[str, tuple[Array, Array, Array]], psi: Array, dof: str) -> tuple[Array, Array]:
    """Return surge or sway velocity and its rate of change from north and east positions."""
    zero = (np.zeros_like(psi),) * 3
    _, x_1, x_2 = fits.get("x", zero)
    _, y_1, y_2 = fits.get("y", zero)
    r = fits["r"][0] if "r" in fits else fits["psi"][1] if "psi" in fits else np.zeros_like(psi)
    c, s = np.cos(psi), np.sin(psi)
    u, v = c * x_1 + s * y_1, c * y_1 - s * x_1
    if dof == "surge":
        return u, c * x_2 + s * y_2 + r * v
    return v, c * y_2 - s * x_2 - r * u


def _local(signal: Signal, t: Array, order: int) -> tuple[Array, Array, Array]:
    """Return value, first and second derivative at *t*, the width chosen by leave-one-out prediction."""
    best: tuple[float, list[Array]] | None = None
    for half in HALF_WIDTHS:
        if 2 * half + 1 > len(signal.t) or 2 * half < order + 1:
            continue
        coefficients, missed = _polynomials(signal, half, order)
        if best is None or missed < best[0]:
            best = (missed, coefficients)
    if best is None:
        return np.interp(t, signal.t, signal.values), np.zeros_like(t), np.zeros_like(t)
    value, first, second = (np.interp(t, signal.t, c) for c in best[1])
    return value, first, second


def _polynomials(signal: Signal, half: int, order: int) -> tuple[list[Array], float]:
    """Return value and two derivatives (n,) at every stamp, and the mean squared leave-one-out error."""
    n, width = len(signal.t), 2 * half + 1
    first = np.clip(np.arange(n) - half, 0, n - width)
    at = first[:, None] + np.arange(width)
    span = signal.t[at[:, -1]] - signal.t[at[:, 0]]
    z = (signal.t[at] - signal.t[:, None]) / span[:, None]
    V = np.ones((n, width, order + 1))
    for i in range(1, order + 1):
        V[:, :, i] = V[:, :, i - 1] * z
    transposed = V.transpose(0, 2, 1)
    inverse = np.linalg.inv(transposed @ V + 1e-12 * np.eye(order + 1))
    c = (inverse @ (transposed @ signal.values[at][:, :, None]))[:, :, 0]
    left = (signal.values - c[:, 0]) / np.maximum(1.0 - inverse[:, 0, 0], 1e-6)
    return [c[:, 0], c[:, 1] / span, 2.0 * c[:, 2] / span**2], float(np.mean(left**2))
