"""How far each parameter may go: what the record can resolve, what is physical, what the user says."""

from __future__ import annotations

import math

import numpy as np

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.models import FORCES, RIGID_BODY, STATES, Form, inertia_of

__all__ = ["LONGEST_DELAY", "OPTIONS", "horizon_of", "limits_of", "physical"]

OPTIONS = (
    ("bounds", "limits per parameter, e.g. {'X_u': (-inf, 0)}"),
    ("physical", "True: inertia stays positive and drag damps"),
    ("horizon", "seconds a simulation runs freely before it restarts from the measurement; inf: whole runs"),
)
"""Options of ``fit`` read here."""

LONGEST_DELAY = 3.0
"""Longest delay and lag [s] searched. Chosen: a craft slower to answer than this is mended first."""

SHORTEST_LAG = 0.1
"""Shortest lag, in sampling steps: below it nothing of it is left in the samples."""


def limits_of(form: Form, case: Case) -> Limits:
    """Return the limits for *form*.

    Raises
    ------
    UsageError
        Bounds for what is not a free parameter, or the wrong way round.
    """
    step = min(float(np.median(np.diff(s.t))) for r in case.records for s in r.signals.values())
    limits = Limits({"delay": 0.0, "lag": SHORTEST_LAG * step}, {"delay": LONGEST_DELAY, "lag": LONGEST_DELAY})
    if case.options.get("physical", False):
        limits = limits.within(physical(form))
    low, high = dict(limits.low), dict(limits.high)
    bounds = case.options.get("bounds") or {}
    for name, (least, most) in bounds.items():
        if name not in (*form.free, "delay"):
            raise UsageError(f"bounds name '{name}', which is not free in '{form.name}': {', '.join(form.free)}")
        if not float(least) < float(most):
            raise UsageError(f"the bounds of {name} are the wrong way round: {least}, {most}")
        low[name], high[name] = max(float(least), low.get(name, -math.inf)), min(float(most), high.get(name, math.inf))
    return Limits(low, high)


def physical(form: Form) -> Limits:
    """Return the limits that keep inertia positive and let every drag damp."""
    sides = {n: _physical_side(n) for n in form.free}
    return Limits({n: 0.0 for n, s in sides.items() if s > 0}, {n: 0.0 for n, s in sides.items() if s < 0})


def _physical_side(name: str) -> int:
    """Return -1 for what is negative by nature, 1 for what is positive, 0 for what may be either."""
    if name in ("m", "I_x", "I_y", "I_z"):
        return 1
    if name in RIGID_BODY or "_" not in name or name[0] not in FORCES:
        return 0
    inertia = inertia_of(name)
    if inertia is not None:
        return -1 if inertia.row == inertia.column else 0
    own = STATES[FORCES.index(name[0])]
    return -1 if name[2:] in (own, own * 2, f"|{own}|{own}", own * 3) else 0


def horizon_of(case: Case) -> float | None:
    """Return how long [s] a simulation is to run freely; None: as long as it can follow the runs.

    Raises
    ------
    UsageError
        Not a time.
    """
    horizon = case.options.get("horizon")
    if horizon is None:
        return None
    if not float(horizon) > 0.0:
        raise UsageError(f"a horizon of {horizon} s is not possible: give seconds above 0, or inf for whole runs")
    return float(horizon)
