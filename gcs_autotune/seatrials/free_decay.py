"""Free decay of roll or pitch: period and damping from successive extremes (ITTC 7.5-02-07-04.5).

The method is Froude's. The loss of amplitude per half cycle, divided by the mean amplitude, determines the linear
damping. Its increase with amplitude determines the quadratic damping.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.seatrials.criteria import Particulars, Sheet, judged, known
from gcs_autotune.trial import Trial

__all__ = ["free_decay_sheet"]

Array = NDArray[np.float64]

LEAST = 0.05
"""Size of an extreme, relative to the largest one, below which it is discarded as noise. Project choice."""
FEWEST = 4
"""Minimum number of extremes of a decay. Project choice."""


def free_decay_sheet(run: Trial, ship: Particulars) -> Sheet:
    """Return the sheet of figures with period, natural frequency and damping ratio of the oscillation in *run*.

    Raises
    ------
    MissingChannel
        The run has neither phi nor theta.
    NotInformative
        The run contains fewer than four extremes after the push.
    """
    signal = str(run.meta.get("signal", "phi"))
    if signal not in run or len(run[signal]) < 10:
        raise MissingChannel(f"run '{run.name}' has no {signal}. A free decay needs phi or theta")
    begun = next((m.t for m in run.marks if m.kind in ("push", "release")), run.start)
    channel = run[signal].between(begun, run.end)
    t, a = _extremes(channel.t, channel.values - float(run.meta.get("rest", np.median(channel.values[-10:]))))
    if len(t) < FEWEST:
        raise NotInformative(f"run '{run.name}' has only {len(t)} extremes of {signal}. A free decay needs {FEWEST}")
    halves = np.diff(t)
    period = Reading(2.0 * float(halves.mean()), 2.0 * float(halves.std(ddof=1)) / math.sqrt(len(halves)), "s")
    size = 0.5 * (a[1:] + a[:-1])
    loss = np.log(a[:-1] / a[1:])
    (linear, slope), covariance = _line(size, loss)
    zeta = linear / math.hypot(math.pi, linear)
    std = math.sqrt(covariance[0, 0]) * math.pi**2 / math.hypot(math.pi, linear) ** 3
    omega = 2.0 * math.pi / period.value / math.sqrt(1.0 - zeta**2)
    notes = []
    if slope > 2.0 * math.sqrt(covariance[1, 1]):
        share = slope * float(size.max()) / (linear + slope * float(size.max()))
        notes.append(
            Doubt(
                "quadratic-damping",
                f"damping depends on amplitude, which adds {100.0 * share:.0f} % of it at the largest angle. A single "
                "damping ratio does not describe this decay",
                "compare only decays of the same amplitude",
            )
        )
    figures = known(
        judged("period", "period", period),
        judged("natural-frequency", "natural frequency", Reading(omega, omega * period.std / period.value, "1/s")),
        judged("damping", "damping ratio at small amplitude", Reading(zeta, std)),
        judged(
            "quadratic", "amplitude-dependent loss per half cycle", Reading(slope, math.sqrt(covariance[1, 1]), "1/rad")
        ),
        judged("largest", "largest angle", Reading(float(a.max()), math.nan, "rad")),
        judged("swings", "half cycles evaluated", Reading(float(len(halves)), math.nan)),
    )
    what = {"phi": "roll", "theta": "pitch"}.get(signal, signal)
    return Sheet(run.name, "hand-release", f"free decay in {what}", figures, "", tuple(notes))


def _extremes(t: Array, x: Array) -> tuple[Array, Array]:
    """Return times and sizes (n,) of the extremes between zero crossings, starting with the largest."""
    sides = np.flatnonzero(np.diff(np.sign(x)) != 0.0) + 1
    parts = np.split(np.arange(len(x)), sides)
    at, size = [], []
    for part in parts:
        peak = int(part[np.argmax(np.abs(x[part]))])
        where, height = _peak(t, np.abs(x), peak)
        at.append(where)
        size.append(height)
    times, sizes = np.array(at), np.array(size)
    first = int(np.argmax(sizes))
    keep = sizes[first:] > LEAST * sizes[first]
    last = int(np.argmin(keep)) if not keep.all() else len(keep)
    return times[first : first + last], sizes[first : first + last]


def _peak(t: Array, x: Array, peak: int) -> tuple[float, float]:
    """Return time and height of an extreme, from a parabola through the samples near it."""
    near = slice(max(peak - 2, 0), peak + 3)
    if len(t[near]) < 3:
        return float(t[peak]), float(x[peak])
    c, b, a = np.polynomial.polynomial.polyfit(t[near] - t[peak], x[near], 2)
    if not a < 0.0 or abs(b / (2.0 * a)) > t[near][-1] - t[near][0]:
        return float(t[peak]), float(x[peak])
    return float(t[peak] - b / (2.0 * a)), float(c - b**2 / (4.0 * a))


def _line(size: Array, loss: Array) -> tuple[tuple[float, float], Array]:
    """Return (value at size 0, slope) and their covariance (2, 2), by weighted least squares."""
    A = np.column_stack([np.ones_like(size), size]) * size[:, None]
    theta, *_ = np.linalg.lstsq(A, loss * size, rcond=None)
    left = A @ theta - loss * size
    covariance = np.asarray(float(left @ left) / max(len(size) - 2, 1) * np.linalg.pinv(A.T @ A), dtype=np.float64)
    return (float(theta[0]), float(theta[1])), covariance
