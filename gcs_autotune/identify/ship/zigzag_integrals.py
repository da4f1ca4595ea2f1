"""K and T of a zig-zag by integration, Miskovic2010, eq. (4.51)-(4.53).

Between any two instants the model of yaw integrates to
``alpha*(r_2 - r_1) + beta*(psi_2 - psi_1) + beta_nn*integral(|r|*r) = integral(N) + Delta*(t_2 - t_1)``; without the
last terms that is (4.51). Between two extreme headings the yaw rates vanish and (4.52) gives the drag; between two
crossings of one heading the headings cancel and (4.53) gives the inertia. Each of those is the sum of neighbouring
rows here, which go from extreme to crossing to extreme: solved together they give also ``Delta`` (rudder bias, wind)
and the nonlinear drag, which the Miskovic2010, eq. (4.4) names as what the plain procedure cannot do.

The rows are weighted by the noise of what is read at their ends (neighbours share an end). What they disagree by
beyond that is put into every row as an error of the model (Paule1982).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.record import Record
from gcs_autotune.identify.ship.executes import find_executes
from gcs_autotune.identify.ship.log import ShipLog
from gcs_autotune.identify.ship.readings import rate_of
from gcs_autotune.identify.ship.zigzag_instants import Instant, find_instants
from gcs_autotune.trial import Channel

__all__ = ["HalfPeriodValues", "Rows", "half_periods", "rows_of", "solve_rows"]

Array = NDArray[np.float64]

RATE_WINDOW = 0.3
"""Width of the slopes under the integral of |r| r, as a fraction of the time from extreme to crossing. Wider ones
flatten the corners of r: with 0.6 the nonlinear drag comes out a sixth too small."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The integrated equations of one run.

    ``table`` (m, 4) holds the differences of r and psi, the integral of |r| r, and minus the time; ``impulse`` (m,)
    the integral of the input; ``ends`` (m + 1, 2, 2) the covariance of (r, psi) at the instants; ``instants`` those.
    """

    table: Array
    impulse: Array
    ends: Array
    instants: tuple[Instant, ...]


@dataclass(frozen=True, slots=True)
class HalfPeriodValues:
    """Drag by (4.52) from one pair of extremes and inertia by (4.53) from one pair of crossings; NaN if neither."""

    t: float
    alpha: float
    beta: float


def rows_of(record: Record, delay: float = 0.0) -> Rows | None:
    """Return the integrated equations of a record; None when it holds no zig-zag with a heading."""
    if record.position is None:
        return None
    t, psi = record.position.t, record.position.values
    end = float(t[-1])
    log = ShipLog(
        record.run,
        Channel(record.input_name, record.input_unit, record.t_in + delay, record.tau),
        t,
        psi,
        record.position.step,
        {},
        (),
    )
    executes = tuple(e for e in find_executes(log) if e.t < end)
    if len(executes) < 3:
        return None
    instants = find_instants(record, log, executes)
    if len(instants) < 4:
        return None
    when = np.array([i.t for i in instants])
    table = np.column_stack(
        [
            np.diff([i.r for i in instants]),
            np.diff([i.psi for i in instants]),
            np.diff(_rate_power(record, when)),
            -np.diff(when),
        ]
    )
    impulse = np.diff(_impulse(record.t_in + delay, record.tau, when))
    return Rows(table, impulse, np.array([i.covariance for i in instants]), instants)


def _impulse(t_in: Array, tau: Array, when: Array) -> Array:
    """Return the integral of the held input from its first stamp to each instant."""
    total = np.concatenate([[0.0], np.cumsum(np.diff(t_in) * tau[:-1])])
    i = np.maximum(np.searchsorted(t_in, when, side="right") - 1, 0)
    result: Array = total[i] + (when - t_in[i]) * tau[i]
    return result


def _rate_power(record: Record, when: Array) -> Array:
    """Return the integral of |r| r to each instant, r from its sensor or from the heading's local slope."""
    if record.velocity is not None:
        t, r = record.velocity.t, record.velocity.values
    else:
        assert record.position is not None
        t = record.position.t
        r = rate_of(t, record.position.values, RATE_WINDOW * float(np.median(np.diff(when))))
    power = np.abs(r) * r
    total = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    result: Array = np.interp(when, t, total)
    return result


def half_periods(rows: Rows) -> tuple[HalfPeriodValues, ...]:
    """Return (4.52) and (4.53) as printed: linear, no bias, one value each per half period."""
    found = []
    whole = np.concatenate([[0.0], np.cumsum(rows.impulse)])
    for kind in ("extreme", "crossing"):
        chosen = [i for i, e in enumerate(rows.instants) if e.kind == kind]
        for a, b in itertools.pairwise(chosen):
            one, other, impulse = rows.instants[a], rows.instants[b], float(whole[b] - whole[a])
            alpha = impulse / (other.r - one.r) if kind == "crossing" else math.nan
            beta = impulse / (other.psi - one.psi) if kind == "extreme" else math.nan
            found.append(HalfPeriodValues(0.5 * (one.t + other.t), alpha, beta))
    return tuple(sorted(found, key=lambda h: h.t))


def solve_rows(every: Sequence[Rows], free: Sequence[bool]) -> tuple[Array, Array, float, float]:
    """Solve the rows of all runs for (alpha, beta, beta_quadratic, Delta).

    Returns
    -------
    theta (4,), covariance (4, 4), the model's error per row [impulse] that the rows ask for, and the sum of squared
    weighted residuals without it.
    """
    columns = np.flatnonzero(free)
    A = np.vstack([rows.table for rows in every])[:, columns]
    b = np.concatenate([rows.impulse for rows in every])
    theta = np.zeros(4)
    theta[columns] = np.linalg.lstsq(A, b, rcond=None)[0]
    extra, misfit = 0.0, 0.0
    for _ in range(4):
        noise = _noise(every, theta)
        misfit = _solved(A, b, noise, 0.0)[2]
        extra = _model_error(A, b, noise, len(columns))
        x, covariance, _ = _solved(A, b, noise, extra)
        theta[columns] = x
    full = np.zeros((4, 4))
    full[np.ix_(columns, columns)] = covariance
    return theta, full, math.sqrt(extra), misfit


def _noise(every: Sequence[Rows], theta: Array) -> Array:
    """Return the covariance of the rows' errors (block per run): noise of the readings at shared ends."""
    sizes = [len(rows.impulse) for rows in every]
    noise = np.zeros((sum(sizes), sum(sizes)))
    first = 0
    for rows, m in zip(every, sizes, strict=True):
        steps = np.diff(np.eye(m + 1), axis=0)
        ends = np.einsum("i,kij,j->k", theta[:2], rows.ends, theta[:2])
        noise[first : first + m, first : first + m] = steps @ np.diag(ends) @ steps.T
        first += m
    floor = 1e-20 * max(float(np.max(np.abs(np.concatenate([r.impulse for r in every])))), 1e-300) ** 2
    result: Array = noise + floor * np.eye(len(noise))
    return result


def _solved(A: Array, b: Array, noise: Array, extra: float) -> tuple[Array, Array, float]:
    root = np.linalg.cholesky(noise + extra * np.eye(len(b)))
    white, target = np.linalg.solve(root, A), np.linalg.solve(root, b)
    covariance = np.linalg.pinv(white.T @ white)
    x = covariance @ (white.T @ target)
    left = target - white @ x
    return x, covariance, float(left @ left)


def _model_error(A: Array, b: Array, noise: Array, parameters: int) -> float:
    """Return the variance that makes the weighted misfit what chance would make it, 0 when it is already less."""
    spare = len(b) - parameters
    if spare <= 0 or _solved(A, b, noise, 0.0)[2] <= spare:
        return 0.0
    high = float(np.mean(b**2))
    low = 1e-18 * high
    for _ in range(80):
        middle = math.sqrt(low * high)
        if _solved(A, b, noise, middle)[2] > spare:
            low = middle
        else:
            high = middle
    return high
