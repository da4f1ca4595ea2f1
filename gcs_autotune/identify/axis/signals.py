"""Which measured signals to fit: position, velocity, or both.

Position is trusted first where it is a sensor's own (heading, depth). A velocity joins it only when it agrees with
the motion fitted to the position: same scale, no lag, errors of its own that are white. A gyro does; a filtered,
delayed or differentiated velocity does not, and would bias the fit. Surge and sway are fitted to velocity when
there is one, because ``x`` and ``y`` are north and east, not ahead and starboard.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_autotune.errors import MissingChannel, UsageError
from gcs_autotune.identify.axis.agreement import agreement
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import Solution
from gcs_autotune.identify.whiteness import autocorrelation

__all__ = ["KINDS", "first_names", "objection", "wanted_names"]

KINDS = ("position", "velocity")
"""What ``use`` may hold."""

GAIN, LAG, BIAS, COLOUR = 0.02, 0.1, 0.02, 0.2
"""Largest gain error, lag [sampling steps], bias [fraction of rms] and autocorrelation of a joining velocity.
Chosen so that what slips through shifts a parameter by less than about 2 %."""

SURELY = 3.0
"""Standard errors beyond which scale, lag or bias are not chance."""


def wanted_names(records: Sequence[Segment], use: Sequence[str]) -> tuple[str, ...]:
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
        if not set(names) & set(record.signals):
            raise MissingChannel(f"run '{record.run}' has no {' or '.join(names)}; leave out use=, or the run")
    return names


def first_names(records: Sequence[Segment]) -> tuple[str, ...]:
    """Return the signals of the first fit; both kinds only when different runs have different ones."""
    axis = records[0].dof
    prefer = (axis.velocity, axis.position) if axis.name in ("surge", "sway") else (axis.position, axis.velocity)
    for name in prefer:
        if all(name in r.signals for r in records):
            return (name,)
    return (axis.position, axis.velocity)


def objection(records: Sequence[Segment], solution: Solution) -> str:
    """Return why the velocities must not join the fit, empty when nothing speaks against them.

    A scale, lag or bias counts when it is too large to be borne and three standard errors from none, those of the
    position's fit included (:func:`gcs_autotune.identify.axis.agreement.agreement`).
    """
    for record in records:
        if record.velocity is None:
            return f"run '{record.run}' has none"
    found = agreement(records, solution)
    if found is None:
        return "the motion fitted without it runs away, which leaves nothing to compare it with"
    std = found.std
    if abs(found.gain) > max(GAIN, SURELY * std[0]):
        return f"its scale differs by {100.0 * found.gain:+.1f} %"
    if abs(found.lag) > max(LAG * found.step, SURELY * std[1]):
        return f"it lags by {1000.0 * found.lag:.0f} ms"
    if abs(found.bias) > max(BIAS * found.rms, SURELY * std[2]):
        return f"it is biased by {found.bias:.3g}"
    colour = max(float(np.max(np.abs(autocorrelation(e, 3)))) for e in found.errors)
    if colour > max(COLOUR, 4.0 / np.sqrt(min(len(e) for e in found.errors))):
        return f"its errors are correlated ({colour:.2f}): it is filtered, derived, or the model misses something"
    return ""
