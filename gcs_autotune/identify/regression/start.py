"""Cheap, robust start values for methods that search: they never fail and their signs are sane."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.regression.barrier import feasible_start
from gcs_autotune.identify.regression.physical import velocities_visited
from gcs_autotune.identify.regression.recipe import recipe_of
from gcs_autotune.identify.special_start import SPECIAL_START
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import FORCES, SPECIAL, STATES, inertia_of
from gcs_autotune.models.coupled.program import program_of

__all__ = ["start_values"]

Array = NDArray[np.float64]

TIME_CONSTANT = 2.0
"""Time constant [s] of every degree of freedom when the runs tell nothing."""


def start_values(case: CoupledCase) -> dict[str, float]:
    """Return a value for every free parameter of ``case.form``, by least squares, else by rule of thumb.

    Inertia comes out positive definite and drag damps; ``form.start`` wins over both. Never raises on poor data.
    """
    form = case.form
    special = {n: SPECIAL_START[n].value for n in form.free if n in SPECIAL}
    if case.delay is not None and "delay" in special:
        special["delay"] = case.delay
    plain = form.fixing({n: form.start.get(n, v) for n, v in special.items()})
    values = {**dict.fromkeys(form.free, 0.0), **special}
    values.update(_regressed(replace(case, form=plain, delay=None, options={})) or _thumb(plain, case))
    values.update({n: v for n, v in form.start.items() if n in form.free})
    return {n: values[n] for n in form.free}


def _regressed(case: CoupledCase) -> dict[str, float] | None:
    try:
        recipe, motions, estimate, _ = recipe_of(case)
        theta = feasible_start(recipe.form, estimate.theta, velocities_visited(motions))
    except (AutotuneError, np.linalg.LinAlgError, ValueError, FloatingPointError):
        return None
    if not np.all(np.isfinite(theta)):
        return None
    return dict(zip(recipe.form.free, theta[: len(recipe.form.free)].tolist(), strict=True))


def _thumb(form: Form, case: CoupledCase) -> dict[str, float]:
    """Inertia and drag from the size of the inputs and of the velocities, with one time constant for all."""
    values = {}
    for row in (int(a) for a in program_of(form).active):
        force = _typical_force(form, case, FORCES[row])
        speed = _typical_speed(case, STATES[row])
        drag = force / speed
        for name in form.free:
            inertia = inertia_of(name) if name[:2] == f"{FORCES[row]}_" else None
            if inertia is not None and inertia.row == inertia.column == row:
                values[name] = -drag * TIME_CONSTANT
            elif name == f"{FORCES[row]}_{STATES[row]}":
                values[name] = -drag
            elif name == f"{FORCES[row]}_{STATES[row] * 2}":
                values[name] = -0.1 * drag / speed
    return values


def _typical_force(form: Form, case: CoupledCase, letter: str) -> float:
    total = 0.0
    for i, pairs in enumerate(form.inputs.values()):
        gain = sum(abs(g) for force, g in pairs if force == letter and not isinstance(g, str))
        total += gain * max((float(np.std(r.inputs[:, i])) for r in case.records if len(r.inputs)), default=0.0)
    return total if total > 0.0 and math.isfinite(total) else 1.0


def _typical_speed(case: CoupledCase, velocity: str) -> float:
    stds = [float(np.std(r.signals[velocity].values)) for r in case.records if velocity in r.signals]
    speed = max(stds, default=0.0)
    return speed if speed > 0.0 and math.isfinite(speed) else 1.0
