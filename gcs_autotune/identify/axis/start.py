"""Find start values of the exact fit from IS-O or, for other inputs, from a scan over time constants.

With linear drag and a fixed time constant, the motion is linear in all other unknowns. These are the input gain, the
constant force and the initial state. A scan over the time constant with linear least squares at each point cannot end
in a local minimum. It needs no derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import Explicit
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.identify.result import IsoEstimate
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import simulate_explicit

__all__ = ["DELAYS", "Bounds", "bounds_of", "misfit", "start_from_cycles", "start_from_scan"]

Array = NDArray[np.float64]

POINTS = 14
"""Number of time constants that the scan tries, evenly spaced in their logarithm.

They are half an octave apart from 0.05 to 60 s, so that Gauss-Newton converges from the nearest one.
"""

SLOWEST = 60.0
"""Longest time constant that the scan tries [s]. Project choice.
"""

FASTEST = 50.0
"""Largest drag rate that is fitted [1/s]. No hull responds within 20 ms."""

DELAYS = (0.0, 0.3)
"""Delays that the scan tries [s]. Project choice.

If only zero were tried, a long delay could be mistaken for a long time constant.
"""

SAMPLES = 400
"""Maximum number of samples per stretch in the scan. Project choice: start values need no more accuracy."""

LONGEST_DELAY = 2.0
"""Longest delay that is fitted [s]. A telemetry link with a longer delay is faulty."""


LINEAR = [Explicit._fields.index(n) for n in ("b", "d")]
"""Indices in :class:`.form.Explicit` of the parameters in which the motion is linear at a fixed rate and delay."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Largest drag rates and the largest delay that the sampling can resolve.

    - ``rate`` [1/s]: largest drag rate. It applies to ``a``, and to ``c`` times the typical velocity.
    - ``delay`` [s]: largest delay.
    - ``speed`` [rad/s or m/s]: typical velocity.
    """

    rate: float
    delay: float
    speed: float

    @property
    def limits(self) -> Limits:
        """Lower and upper limits of the explicit parameters ``a``, ``c`` and ``delay``."""
        steep = self.rate / self.speed
        return Limits({"a": -self.rate, "c": -steep, "delay": 0.0}, {"a": self.rate, "c": steep, "delay": self.delay})


def bounds_of(records: Sequence[Segment]) -> Bounds:
    """Return the largest drag rate and delay that the sampling of *records* resolves.

    Time constants down to a fifth of a sampling step are allowed. Delays are limited to a tenth of the longest record
    and to :data:`LONGEST_DELAY`.
    """
    step = min(float(np.median(np.diff(r.main.t))) for r in records)
    length = max(float(r.main.t[-1] - r.main.t[0]) for r in records)
    speed = max(float(np.mean([_speed(r) for r in records])), 1e-9)
    return Bounds(rate=min(5.0 / step, FASTEST), delay=min(LONGEST_DELAY, 0.1 * length), speed=speed)


def _speed(record: Segment) -> float:
    """Return a typical amplitude of the velocity in a stretch."""
    if record.velocity is not None:
        return float(np.sqrt(2.0) * np.std(record.velocity.values))
    t, x = record.main.t, record.main.values
    reach = max(1, len(t) // 200)
    return float(np.sqrt(2.0) * np.std((x[reach:] - x[:-reach]) / (t[reach:] - t[:-reach])))


def start_from_cycles(estimates: Sequence[IsoEstimate]) -> Explicit | None:
    """Return start values with linear drag, from the mean of the valid IS-O *estimates*, or None if none is valid."""
    usable = [e for e in estimates if e.cycle.valid and e.alpha != 0.0] or [e for e in estimates if e.alpha != 0.0]
    if not usable:
        return None
    alpha, beta, delta, delay = (
        float(np.mean([getattr(e, n) for e in usable])) for n in ("alpha", "beta", "delta", "delay")
    )
    if alpha == 0.0:
        return None
    return Explicit(b=1.0 / alpha, a=beta / alpha, c=0.0, d=delta / alpha, delay=delay)


def start_from_scan(records: Sequence[Segment], bounds: Bounds, delays: Sequence[float] = DELAYS) -> Explicit:
    """Return start values with linear drag: the best of a scan over drag rates and *delays* [s].

    Raises
    ------
    NotInformative
        The input explains none of the motion at any time constant.
    """
    thinned = [_thinned(r.main) for r in records]
    best: tuple[float, Explicit] | None = None
    for lag in (d for d in delays if d <= bounds.delay or len(delays) == 1):
        for rate in np.geomspace(1.0 / SLOWEST, min(20.0, bounds.rate), POINTS):
            theta, cost = _linear_fit(records, thinned, float(rate), lag)
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = (cost, theta)
    if best is None or best[1].b == 0.0:
        raise NotInformative("the input does not explain the motion. Check that input and output belong together")
    return best[1]


def misfit(records: Sequence[Segment], numbers: Explicit) -> float:
    """Return the sum of squared residuals for the drag rate ``a`` and the ``delay`` of *numbers*.

    All other parameters are fitted by linear least squares.
    """
    return _linear_fit(records, [_thinned(r.main) for r in records], numbers.a, numbers.delay)[1]


def _thinned(signal: Signal) -> Signal:
    every = max(1, len(signal.t) // SAMPLES)
    return Signal(signal.name, signal.t[::every], signal.values[::every], signal.step)


def _linear_fit(
    records: Sequence[Segment], signals: Sequence[Signal], rate: float, delay: float
) -> tuple[Explicit, float]:
    """Fit ``b``, ``d`` and the initial states at a fixed rate ``a`` and delay."""
    count = len(records)
    rows, wanted = [], []
    for i, (record, signal) in enumerate(zip(records, signals, strict=True)):
        unit = Explicit(b=1.0, a=rate, c=0.0, d=0.0, delay=delay)
        motion = simulate_explicit((*unit, 0.0, 0.0), record.t_in, record.tau, signal.t)
        if not motion.finite:
            return unit, np.inf
        by = motion.eta_by if signal.name == record.dof.position else motion.nu_by
        states = np.zeros((len(signal.t), 2 * count))
        states[:, 2 * i : 2 * i + 2] = by[:, len(Explicit._fields) :]
        rows.append(np.hstack([by[:, LINEAR], states]))
        wanted.append(signal.values)
    table, values = np.vstack(rows), np.concatenate(wanted)
    scale = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    solution = np.linalg.lstsq(table / scale, values, rcond=1e-12)[0] / scale
    residual = values - table @ solution
    b, d = solution[: len(LINEAR)].tolist()
    return Explicit(b, rate, 0.0, d, delay), float(residual @ residual)
