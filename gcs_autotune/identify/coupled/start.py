"""Start values of a coupled model: the equations of motion as a linear regression on smoothed motion.

The equations are linear in the parameters (seed 000 (10)-(12)), so ``F - C nu - M nu_dot`` at one unit value after the
other gives the regressors of every form without writing any of them out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.coupled.objective import Limits, first_input
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.coupled.smoothing import Motion, smoothed_motion
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import SPECIAL
from gcs_autotune.models.coupled.kernel import imbalances
from gcs_autotune.models.coupled.model import inertia_matrix, program_of, states_of

__all__ = ["equation_error", "first_states", "known_theta", "motions_of", "regression_start"]

Array = NDArray[np.float64]

RIDGE = 1e-6
"""Share of each regressor's power added to its own, so that what is not excited stays small."""

ROUNDS = 3
"""Rounds of weighing each driven equation by what it leaves. An equation without inputs keeps its weight: it would
be satisfied best by parameters that are all zero."""

LEAST = 1e-3
"""Smallest remainder of an equation, in shares of the largest known force, that its weight is taken from."""


def known_theta(form: Form) -> Array:
    """Return all parameters (p,): known ones as they are, free ones from ``form.start`` or 0."""
    values = {"lag": 0.2, **form.start, **form.known}
    return np.array([values.get(n, 0.0) for n in form.parameters])


def regression_start(form: Form, motions: Sequence[Motion], limits: Limits) -> Array:
    """Return start values (p,): least squares of the equations, each row weighed by what it leaves."""
    theta = known_theta(form)
    free = [n for n in form.free if n not in SPECIAL and n not in form.start]
    if not free:
        return theta
    places = [form.parameters.index(n) for n in free]
    base = np.vstack([equation_error(form, theta, m) for m in motions])
    columns = []
    for place in places:
        one = theta.copy()
        one[place] += 1.0
        columns.append(np.vstack([equation_error(form, one, m) for m in motions]) - base)
    J = np.stack(columns, axis=2)
    usable = np.all([m.known for m in motions], axis=0)
    if not usable.any():
        usable[:] = True
    low, high = limits.of(free)
    rms = np.sqrt(np.mean(base**2, axis=0))
    driven = usable & (rms > 1e-9 * max(float(rms.max()), 1e-300))
    weight = np.where(usable, 1.0 / np.where(driven, rms, max(float(rms.max()), 1e-12)), 0.0)
    found = np.zeros(len(free))
    for _ in range(ROUNDS):
        A = (J * weight[None, :, None]).reshape(-1, len(free))
        b = -(base * weight).ravel()
        G = A.T @ A
        found = np.clip(np.linalg.lstsq(G + RIDGE * np.diag(np.diag(G)), A.T @ b, rcond=None)[0], low, high)
        left = np.sqrt(np.mean((base + J @ found) ** 2, axis=0))
        weight = np.where(driven, 1.0 / np.maximum(left, LEAST * rms.max()), weight)
    theta[places] = found
    return theta


def equation_error(form: Form, theta: Array, motion: Motion) -> Array:
    """Return ``F - C nu - M nu_dot`` (s, k) on a smoothed motion."""
    out = np.empty_like(motion.nu_dot)
    imbalances(program_of(form), theta, inertia_matrix(form, theta), motion.X, motion.nu_dot, motion.inputs, out)
    return out


def first_states(form: Form, records: Sequence[CoupledRecord], motions: Sequence[Motion]) -> tuple[Array, ...]:
    """Return the states (n,) at every record's start, off the smoothed motion."""
    k, found = 2 * len(form.dofs), []
    for record, motion in zip(records, motions, strict=True):
        x_0 = motion.X[0].copy()
        if len(x_0) > k:
            x_0[k:] = first_input(record)
        assert len(x_0) == len(states_of(form))
        found.append(x_0)
    return tuple(found)


def motions_of(form: Form, records: Sequence[CoupledRecord], delay: float) -> tuple[Motion, ...]:
    """Return the smoothed motion of every record."""
    return tuple(smoothed_motion(form, record, delay) for record in records)
