"""Limits of each parameter from the sampling, from physics, and from the user's bounds."""

from __future__ import annotations

import math

import numpy as np

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.problems.limits import Limits
from gcs_autotune.models import Form

__all__ = ["LONGEST_DELAY", "OPTIONS", "horizon_of", "limits_of"]

OPTIONS = (
    ("bounds", "limits per parameter, e.g. {'X_u': (-inf, 0)}"),
    ("physical", "True: inertia stays positive and drag always damps"),
    ("horizon", "longest time [s] that a simulation runs before it restarts from the measurement (inf: whole runs)"),
)
"""Options of ``fit`` that set limits, with a line of help each."""

LONGEST_DELAY = 3.0
"""Longest delay and longest lag that are searched [s]. A craft with a longer one should be repaired first."""

SHORTEST_LAG = 0.1
"""Shortest lag that is fitted [sampling steps]. The samples do not show a shorter one. Project choice."""


def limits_of(form: Form, case: Case) -> Limits:
    """Return the lower and upper limits of the free parameters of *form*.

    Raises
    ------ UsageError The user's bounds are for a parameter that is not free, or are in the wrong order.
    """
    step = min(float(np.median(np.diff(s.t))) for r in case.records for s in r.signals.values())
    limits = Limits({"delay": 0.0, "lag": SHORTEST_LAG * step}, {"delay": LONGEST_DELAY, "lag": LONGEST_DELAY})
    if case.options.get("physical", False):
        limits = limits.within(Limits.physical(form))
    low, high = dict(limits.low), dict(limits.high)
    bounds = case.options.get("bounds") or {}
    for name, (least, most) in bounds.items():
        if name not in (*form.free, "delay"):
            raise UsageError(
                f"bounds are given for '{name}', which is not free in '{form.name}'. Free parameters: "
                f"{', '.join(form.free)}"
            )
        if not float(least) < float(most):
            raise UsageError(f"the bounds of {name} are in the wrong order: {least}, {most}. Put the smaller one first")
        low[name], high[name] = max(float(least), low.get(name, -math.inf)), min(float(most), high.get(name, math.inf))
    return Limits(low, high)


def horizon_of(case: Case) -> float | None:
    """Return the user's limit for the length of a free simulation [s], or None.

    Without a limit, whole runs are simulated. They are cut into short pieces only if the fit to whole runs fails.

    Raises
    ------
    UsageError
        The horizon is not above zero.
    """
    horizon = case.options.get("horizon")
    if horizon is None:
        return None
    if not float(horizon) > 0.0:
        raise UsageError(f"a horizon of {horizon} s is not valid. Use more than 0 s, or inf for whole runs")
    return float(horizon)
