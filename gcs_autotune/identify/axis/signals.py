"""Which measured signals to fit: position, velocity, or both.

Position is trusted first where it is a sensor's own (heading, depth). A velocity joins it only when it agrees with
the motion fitted to the position: same scale, no lag, errors of its own that are white. A gyro does; a filtered,
delayed or differentiated velocity does not, and would bias the fit. Surge and sway are fitted to velocity when
there is one, because ``x`` and ``y`` are north and east, not ahead and starboard.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, UsageError
from gcs_autotune.identify.axis.output_error import Solution
from gcs_autotune.identify.axis.record import Record
from gcs_autotune.identify.axis.uncertainty import autocorrelation
from gcs_autotune.models.simulation import simulate_explicit

__all__ = ["KINDS", "first_names", "objection", "wanted_names"]

Array = NDArray[np.float64]

KINDS = ("position", "velocity")
"""What ``use`` may hold."""

GAIN, LAG, BIAS, COLOUR = 0.02, 0.1, 0.02, 0.2
"""Largest gain error, lag [sampling steps], bias [fraction of rms] and autocorrelation of a joining velocity.
Chosen so that what slips through shifts a parameter by less than about 2 %."""


def wanted_names(records: Sequence[Record], use: Sequence[str]) -> tuple[str, ...]:
    """Return the signal names for an explicit choice like ``("position", "velocity")``.

    Raises
    ------
    UsageError
        When *use* is empty or holds anything else.
    MissingChannel
        When a run has none of the signals asked for.
    """
    unknown = [u for u in use if u not in KINDS]
    if unknown or not use:
        raise UsageError(f"use={tuple(use)!r}: only 'position' and 'velocity' (or both) can be used")
    axis = records[0].dof
    names = tuple(getattr(axis, kind) for kind in KINDS if kind in use)
    for record in records:
        if not any(s.name in names for s in record.signals):
            raise MissingChannel(f"run '{record.run}' has no {' or '.join(names)}; leave out use=, or the run")
    return names


def first_names(records: Sequence[Record]) -> tuple[str, ...]:
    """Return the signals of the first fit; both kinds only when different runs have different ones."""
    axis = records[0].dof
    prefer = (axis.velocity, axis.position) if axis.name in ("surge", "sway") else (axis.position, axis.velocity)
    for name in prefer:
        if all(any(s.name == name for s in r.signals) for r in records):
            return (name,)
    return (axis.position, axis.velocity)


def objection(records: Sequence[Record], solution: Solution) -> str:
    """Return why the velocities must not join the fit, empty when nothing speaks against them."""
    errors, motion, slope, steps = [], [], [], []
    for i, record in enumerate(records):
        if record.velocity is None:
            return f"run '{record.run}' has none"
        t = record.velocity.t
        anchored = max(float(t[0]), float(record.main.t[0]))
        keep = t >= anchored
        stamps = np.union1d(record.main.t[:1], t[keep])
        p = np.concatenate([solution.theta, solution.initial[i]])
        nu = simulate_explicit(p, record.t_in, record.tau, stamps).nu[np.searchsorted(stamps, t[keep])]
        errors.append(record.velocity.values[keep] - nu)
        motion.append(nu)
        slope.append(_acceleration(solution.theta, record, t[keep], nu))
        steps.append(float(np.median(np.diff(t))))
    return _verdict(errors, np.concatenate(motion), np.concatenate(slope), min(steps))


def _acceleration(theta: Array, record: Record, t: Array, nu: Array) -> Array:
    b, a, c, d, delay = theta
    held = np.maximum(np.searchsorted(record.t_in, t - delay, side="right") - 1, 0)
    acceleration: Array = b * record.tau[held] - a * nu - c * np.abs(nu) * nu + d
    return acceleration


def _verdict(errors: Sequence[Array], nu: Array, slope: Array, step: float) -> str:
    """Regress the errors on the fitted motion: what scale, lag and bias would explain them?"""
    error = np.concatenate(errors)
    table = np.column_stack([nu, -slope, np.ones_like(nu)])
    rms = float(np.sqrt(np.mean(nu**2)))
    found = np.linalg.lstsq(table, error, rcond=None)[0]
    left = error - table @ found
    spread = np.sqrt(np.diag(np.linalg.pinv(table.T @ table)) * float(left @ left) / max(len(left) - 3, 1))
    limits = np.maximum((GAIN, LAG * step, BIAS * rms), 3.0 * spread)
    gain, lag, bias = (float(v) for v in found)
    if abs(gain) > limits[0]:
        return f"its scale differs by {100.0 * gain:+.1f} %"
    if abs(lag) > limits[1]:
        return f"it lags by {1000.0 * lag:.0f} ms"
    if abs(bias) > limits[2]:
        return f"it is biased by {bias:.3g}"
    colour = max(float(np.max(np.abs(autocorrelation(e, 3)))) for e in errors)
    if colour > max(COLOUR, 4.0 / np.sqrt(min(len(e) for e in errors))):
        return f"its errors are correlated ({colour:.2f}): it is filtered, derived, or the model misses something"
    return ""
