"""Calculate K and T of a zig-zag by integration between its instants, Miskovic2010, eq. (4.51)-(4.53).

The instants are extreme headings, crossings of one heading, and the start. Heading and yaw rate at each instant, with
their covariance, come from a local polynomial. Between any two instants the yaw model integrates to ``alpha*(r_2 - r_1)
+ beta*(psi_2 - psi_1) + beta_nn*integral(|r|*r) = integral(N) + Delta*(t_2 - t_1)``. Without ``beta_nn`` and ``Delta``
this is (4.51).

Between two extreme headings the yaw rates vanish, and (4.52) yields the drag. Between two crossings of one heading the
headings cancel, and (4.53) yields the inertia. Here the rows go from extreme to crossing to extreme, so (4.52) and
(4.53) are sums of neighbouring rows. Solving all rows together also yields ``Delta`` (rudder bias, wind) and the
nonlinear drag. According to Miskovic2010 (4.4), the original procedure cannot yield them.

The rows are weighted by the noise of the readings at their ends. Neighbouring rows share an end. Any further
disagreement is added to every row as a model error (Paule1982).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.open_loop.readings import local_fit, rate_of
from gcs_autotune.identify.open_loop.ship_log import Execute, ShipLog, find_executes
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.trial import Channel

__all__ = ["HalfPeriodValues", "Instant", "IntegralRows", "find_instants", "half_periods", "rows_of", "solve_rows"]

Array = NDArray[np.float64]

WINDOW = 0.4
"""Width of the windows for local polynomials, as a fraction of the half period. Project choice."""

DEGREE = 3
"""Degree of the local polynomials.

With a parabola, curvature of the heading would appear as a lower rate. With seven samples the error of K would be 4 %.
"""

LEAST = 8
"""Smallest number of samples to which a local polynomial is fitted. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """State at one instant.

    - ``t`` [s]: the time.
    - ``kind``: ``start``, ``extreme`` or ``crossing``.
    - ``psi``, ``r``: heading [rad] and yaw rate [rad/s].
    - ``covariance`` (2, 2): covariance of yaw rate and heading.
    """

    t: float
    psi: float
    r: float
    covariance: Array
    kind: str


def find_instants(record: Segment, log: ShipLog, executes: Sequence[Execute]) -> tuple[Instant, ...]:
    """Return the start, the extreme headings and the crossings of one heading, in order of time."""
    instants: list[Instant] = []
    first = executes[0]
    if first.before == 0.0:
        start = _start(record, log, first)
        if start is not None:
            instants.append(start)
    borders = [*(e.t for e in executes), log.end]
    extremes: list[float] = []
    spans: list[tuple[float, float]] = []
    for k, e in enumerate(executes):
        if k == 0 and e.before == 0.0:
            continue
        t, psi = log.heading(e.t, borders[k + 1])
        if len(t) < LEAST:
            continue
        side = _turning(log, executes[k - 1].t if k else float(log.t[0]), e.t)
        top = int(np.argmax(side * psi))
        if 1 < top < len(t) - 2:
            extremes.append(float(t[top]))
            spans.append((min(e.done, float(t[top])), borders[k + 1]))
    middle = _middle(log, extremes)
    for i, (at, (low, high)) in enumerate(zip(extremes, spans, strict=True)):
        width = WINDOW * (high - low)
        made = _instant(record, _peak(record, at, (low, high), width), (low, high), width, "extreme")
        if made is not None:
            instants.append(made)
        if i + 1 < len(extremes):
            t, psi = log.heading(at, extremes[i + 1])
            before = t < high
            crossing = _crossing(t[before], psi[before], middle)
            if crossing is None:
                continue
            made = _instant(record, crossing, (low, high), width, "crossing")
            if made is not None:
                instants.append(made)
    return tuple(sorted(instants, key=lambda i: i.t))


def _middle(log: ShipLog, extremes: Sequence[float]) -> float:
    """Return the heading midway between the mean extremes of both sides."""
    peaks = np.interp(extremes, log.t, log.psi)
    return 0.5 * float(np.mean(peaks[0::2]) + np.mean(peaks[1::2])) if len(peaks) > 1 else 0.0


def _crossing(t: Array, psi: Array, level: float) -> float | None:
    """Return the time at which a heading passes *level*, by linear interpolation; None if it does not."""
    passed = np.flatnonzero((psi[:-1] - level) * (psi[1:] - level) <= 0.0)
    if len(passed) == 0:
        return None
    i = int(passed[len(passed) // 2])
    step = float(psi[i + 1] - psi[i])
    return float(t[i]) + (float((level - psi[i]) / step * (t[i + 1] - t[i])) if step else 0.0)


def _peak(record: Segment, at: float, within: tuple[float, float], width: float) -> float:
    """Return the time near *at* at which the yaw rate is zero, from a local polynomial."""
    assert record.position is not None
    t, psi = record.position.t, record.position.values
    keep = (t >= max(within[0], at - 0.5 * width)) & (t <= min(within[1], at + 0.5 * width))
    if int(keep.sum()) < LEAST:
        return at
    c = local_fit(t[keep], psi[keep], at, DEGREE).coefficients
    roots = np.roots(np.polynomial.polynomial.polyder(c)[::-1])
    near = [float(x.real) for x in np.atleast_1d(roots) if abs(x.imag) < 1e-9 and abs(x) < 0.5 * width]
    return at + min(near, key=abs) if near else at


def _turning(log: ShipLog, before: float, t: float) -> float:
    """Return +1 if the heading increased just before *t*, else -1."""
    then = np.interp([t - 0.2 * (t - before), t], log.t, log.psi)
    return math.copysign(1.0, float(then[1] - then[0]))


def _start(record: Segment, log: ShipLog, first: Execute) -> Instant | None:
    """Return the state at the first order, from a line through the approach."""
    assert record.position is not None
    t, psi = log.heading(-np.inf, first.t)
    if len(t) < LEAST:
        return None
    t, psi = t[-200:], psi[-200:]
    fit = local_fit(t, psi, first.t, 1, log.floor)
    c = fit.covariance
    return Instant(first.t, float(fit.coefficients[0]), float(fit.coefficients[1]), c[::-1, ::-1], "start")


def _instant(record: Segment, at: float, within: tuple[float, float], width: float, kind: str) -> Instant | None:
    """Return heading and rate at the time *at*, from a local cubic.

    The rate comes from its own sensor if that is more accurate.
    """
    assert record.position is not None
    low, high = max(within[0], at - 0.5 * width), min(within[1], at + 0.5 * width)
    s = record.position
    keep = (s.t >= low) & (s.t <= high)
    if int(keep.sum()) < LEAST:
        return None
    floor = s.step / math.sqrt(12.0)
    fit = local_fit(s.t[keep], s.values[keep], at, DEGREE, floor)
    psi, r = float(fit.coefficients[0]), float(fit.coefficients[1])
    covariance = fit.covariance[1::-1, 1::-1].copy()
    rate = record.velocity
    if rate is not None:
        near = (rate.t >= low) & (rate.t <= high)
        if int(near.sum()) >= LEAST:
            own = local_fit(rate.t[near], rate.values[near], at, 2, rate.step / math.sqrt(12.0))
            if own.covariance[0, 0] < covariance[0, 0]:
                r = float(own.coefficients[0])
                covariance = np.diag([own.covariance[0, 0], covariance[1, 1]])
    return Instant(at, psi, r, covariance, kind)


RATE_WINDOW = 0.3
"""Width of the windows for the slopes in the integral of |r| r, as a fraction of the time from extreme to crossing.

Wider windows smooth the corners of r. With 0.6 the nonlinear drag is a sixth too small. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class IntegralRows:
    """Integrated equations of one run.

    - ``table`` (m, 4): differences of r and of psi, integral of |r| r, and minus the duration.
    - ``impulse`` (m,): integral of the input.
    - ``ends`` (m + 1, 2, 2): covariance of (r, psi) at the ``instants``.
    """

    table: Array
    impulse: Array
    ends: Array
    instants: tuple[Instant, ...]


@dataclass(frozen=True, slots=True)
class HalfPeriodValues:
    """Result of one half period.

    - ``t`` [s]: middle of the half period.
    - ``alpha``: inertia by (4.53) from two crossings, else NaN.
    - ``beta``: drag by (4.52) from two extremes, else NaN.
    """

    t: float
    alpha: float
    beta: float


def rows_of(record: Segment, delay: float = 0.0) -> IntegralRows | None:
    """Return the integrated equations of *record* with the input delayed by *delay* [s].

    Return None if the record contains no zig-zag with a heading.
    """
    if record.position is None:
        return None
    t, psi = record.position.t, record.position.values
    end = float(t[-1])
    log = ShipLog(
        record.run,
        Channel(record.input_names[0], record.input_units[0], record.t_in + delay, record.tau),
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
    return IntegralRows(table, impulse, np.array([i.covariance for i in instants]), instants)


def _impulse(t_in: Array, tau: Array, when: Array) -> Array:
    """Return the integral of the held input from its first stamp to each time in *when*."""
    total = np.concatenate([[0.0], np.cumsum(np.diff(t_in) * tau[:-1])])
    i = np.maximum(np.searchsorted(t_in, when, side="right") - 1, 0)
    result: Array = total[i] + (when - t_in[i]) * tau[i]
    return result


def _rate_power(record: Segment, when: Array) -> Array:
    """Return the integral of |r| r up to each time in *when*.

    r comes from its sensor, or from the local slope of the heading.
    """
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


def half_periods(rows: IntegralRows) -> tuple[HalfPeriodValues, ...]:
    """Return the results of Miskovic2010 (4.52) and (4.53) as printed, one per half period.

    The equations assume linear drag and no bias.
    """
    periods = []
    whole = np.concatenate([[0.0], np.cumsum(rows.impulse)])
    for kind in ("extreme", "crossing"):
        chosen = [i for i, e in enumerate(rows.instants) if e.kind == kind]
        for a, b in itertools.pairwise(chosen):
            one, other, impulse = rows.instants[a], rows.instants[b], float(whole[b] - whole[a])
            alpha = impulse / (other.r - one.r) if kind == "crossing" else math.nan
            beta = impulse / (other.psi - one.psi) if kind == "extreme" else math.nan
            periods.append(HalfPeriodValues(0.5 * (one.t + other.t), alpha, beta))
    return tuple(sorted(periods, key=lambda h: h.t))


def solve_rows(every: Sequence[IntegralRows], free: Sequence[bool]) -> tuple[Array, Array, float, float]:
    """Solve the rows of all runs for (alpha, beta, beta_quadratic, Delta).

    free (4,) : whether each of these parameters is fitted.

    Returns
    -------
    theta (4,), its covariance (4, 4), the model error per row [impulse] that explains the residuals, and the sum of
    squared weighted residuals without that error.
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


def _noise(every: Sequence[IntegralRows], theta: Array) -> Array:
    """Return the covariance of the errors of the rows, one block per run.

    It follows from the noise of the readings, which neighbouring rows share.
    """
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
    residual = target - white @ x
    return x, covariance, float(residual @ residual)


def _model_error(A: Array, b: Array, noise: Array, parameters: int) -> float:
    """Return the variance of the model error at which the weighted misfit has its expected value.

    It is 0 if the misfit is smaller already.
    """
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
