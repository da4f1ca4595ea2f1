"""The instants a zig-zag is integrated between: extreme headings, crossings of one heading, and the start.

At each, heading and yaw rate come from a local polynomial with their covariance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.record import Record
from gcs_autotune.identify.ship.executes import Execute
from gcs_autotune.identify.ship.log import ShipLog
from gcs_autotune.identify.ship.readings import local_fit

__all__ = ["Instant", "find_instants"]

Array = NDArray[np.float64]

WINDOW = 0.4
"""Width of the local fits as a fraction of the half period."""

DEGREE = 3
"""Of the local polynomials. A parabola takes the bend of the heading for a lower rate: K 4 % off at seven samples."""

LEAST = 8
"""Fewest samples of a local fit."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """State at one instant: heading and yaw rate with their covariance (2, 2); ``kind`` start, extreme, crossing."""

    t: float
    psi: float
    r: float
    covariance: Array
    kind: str


def find_instants(record: Record, log: ShipLog, executes: Sequence[Execute]) -> tuple[Instant, ...]:
    """Return start, extremes and crossings in order of time."""
    found: list[Instant] = []
    first = executes[0]
    if first.before == 0.0:
        start = _start(record, log, first)
        if start is not None:
            found.append(start)
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
            found.append(made)
        if i + 1 < len(extremes):
            t, psi = log.heading(at, extremes[i + 1])
            before = t < high
            crossing = _crossing(t[before], psi[before], middle)
            if crossing is None:
                continue
            made = _instant(record, crossing, (low, high), width, "crossing")
            if made is not None:
                found.append(made)
    return tuple(sorted(found, key=lambda i: i.t))


def _middle(log: ShipLog, extremes: Sequence[float]) -> float:
    """Return the heading midway between the extremes of both sides."""
    peaks = np.interp(extremes, log.t, log.psi)
    return 0.5 * float(np.mean(peaks[0::2]) + np.mean(peaks[1::2])) if len(peaks) > 1 else 0.0


def _crossing(t: Array, psi: Array, level: float) -> float | None:
    """Return when a heading passes *level*, on the straight line between two samples; None if it does not."""
    passed = np.flatnonzero((psi[:-1] - level) * (psi[1:] - level) <= 0.0)
    if len(passed) == 0:
        return None
    i = int(passed[len(passed) // 2])
    step = float(psi[i + 1] - psi[i])
    return float(t[i]) + (float((level - psi[i]) / step * (t[i + 1] - t[i])) if step else 0.0)


def _peak(record: Record, at: float, within: tuple[float, float], width: float) -> float:
    """Return when the yaw rate vanishes near *at*, from the local polynomial about it."""
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
    """Return +1 when the heading was growing just before *t*, else -1."""
    then = np.interp([t - 0.2 * (t - before), t], log.t, log.psi)
    return math.copysign(1.0, float(then[1] - then[0]))


def _start(record: Record, log: ShipLog, first: Execute) -> Instant | None:
    """Return the state when the first order was given, from a line through the approach."""
    assert record.position is not None
    t, psi = log.heading(-np.inf, first.t)
    if len(t) < LEAST:
        return None
    t, psi = t[-200:], psi[-200:]
    fit = local_fit(t, psi, first.t, 1, log.floor)
    c = fit.covariance
    return Instant(first.t, float(fit.coefficients[0]), float(fit.coefficients[1]), c[::-1, ::-1], "start")


def _instant(record: Record, at: float, within: tuple[float, float], width: float, kind: str) -> Instant | None:
    """Return heading and rate about *at* from a local cubic, the rate from its own sensor when that is surer."""
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
