"""Where the exact fit starts: from IS-O, or, for any other input, from a scan over time constants.

For constant drag and a given time constant the motion is linear in everything else (input gain, constant force,
initial state), so a scan over the time constant with a linear least squares at each point cannot get lost in a
local minimum, and nothing has to be differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import Explicit
from gcs_autotune.identify.limits import Limits
from gcs_autotune.identify.result import IsoEstimate
from gcs_autotune.identify.segment import Segment, Signal
from gcs_autotune.models import simulate_explicit

__all__ = ["DELAYS", "Bounds", "bounds_of", "misfit", "start_from_cycles", "start_from_scan"]

Array = NDArray[np.float64]

POINTS = 14
"""Time constants tried. Chosen: half an octave apart over 0.05..60 s, inside the basin of Gauss-Newton."""

SLOWEST = 60.0
"""Longest time constant tried [s]."""

FASTEST = 50.0
"""Largest rate fitted [1/s]: no hull answers within 20 ms."""

DELAYS = (0.0, 0.3)
"""Delays tried [s]; a long delay that is not looked for can hide the time constant."""

SAMPLES = 400
"""Samples per stretch the scan looks at; it needs no more to find the neighbourhood."""

LONGEST_DELAY = 2.0
"""Longest delay fitted [s]. Chosen: beyond it a telemetry link is broken, not slow."""


LINEAR = [Explicit._fields.index(n) for n in ("b", "d")]
"""Where the numbers stand in which the motion is linear at a given rate and delay."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the data can resolve at all.

    Largest drag rate [1/s] (``a``, and ``c`` at the typical *speed* [rad/s or m/s]), largest delay [s].
    """

    rate: float
    delay: float
    speed: float

    @property
    def limits(self) -> Limits:
        """The limits of the explicit parameters."""
        steep = self.rate / self.speed
        return Limits({"a": -self.rate, "c": -steep, "delay": 0.0}, {"a": self.rate, "c": steep, "delay": self.delay})


def bounds_of(records: Sequence[Segment]) -> Bounds:
    """Return what the sampling can resolve: time constants down to a fifth of a step, delays within the run."""
    step = min(float(np.median(np.diff(r.main.t))) for r in records)
    length = max(float(r.main.t[-1] - r.main.t[0]) for r in records)
    speed = max(float(np.mean([_speed(r) for r in records])), 1e-9)
    return Bounds(rate=min(5.0 / step, FASTEST), delay=min(LONGEST_DELAY, 0.1 * length), speed=speed)


def _speed(record: Segment) -> float:
    """Return a typical velocity amplitude of a stretch."""
    if record.velocity is not None:
        return float(np.sqrt(2.0) * np.std(record.velocity.values))
    t, x = record.main.t, record.main.values
    reach = max(1, len(t) // 200)
    return float(np.sqrt(2.0) * np.std((x[reach:] - x[:-reach]) / (t[reach:] - t[:-reach])))


def start_from_cycles(estimates: Sequence[IsoEstimate]) -> Explicit | None:
    """Return numbers with constant drag from the mean of the valid IS-O estimates, or None."""
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
    """Return numbers with constant drag from a scan over rates and *delays* [s].

    Raises
    ------
    NotInformative
        When the input explains nothing of the motion at any time constant.
    """
    thinned = [_thinned(r.main) for r in records]
    best: tuple[float, Explicit] | None = None
    for lag in (d for d in delays if d <= bounds.delay or len(delays) == 1):
        for rate in np.geomspace(1.0 / SLOWEST, min(20.0, bounds.rate), POINTS):
            theta, cost = _linear_fit(records, thinned, float(rate), lag)
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = (cost, theta)
    if best is None or best[1].b == 0.0:
        raise NotInformative("the input explains nothing of the motion: check that input and output belong together")
    return best[1]


def misfit(records: Sequence[Segment], numbers: Explicit) -> float:
    """Return the sum of squares left by ``a`` and ``delay`` of *numbers* with everything else fitted linearly."""
    return _linear_fit(records, [_thinned(r.main) for r in records], numbers.a, numbers.delay)[1]


def _thinned(signal: Signal) -> Signal:
    every = max(1, len(signal.t) // SAMPLES)
    return Signal(signal.name, signal.t[::every], signal.values[::every], signal.step)


def _linear_fit(
    records: Sequence[Segment], signals: Sequence[Signal], rate: float, delay: float
) -> tuple[Explicit, float]:
    """Fit ``b``, ``d`` and the initial states for a given rate ``a`` and delay."""
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
