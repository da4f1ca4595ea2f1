"""How much of a parameter would be felt: the measure against which a standard error is large or small.

A derivative is as large as its value, or as what would change the balance of its equation by :data:`FELT` of the
largest force in it at the motion the runs have seen, whichever is larger: a coefficient that is nearly zero and acts on
nothing should not rule what is flown next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.coupled.smoothing import Motion
from gcs_autotune.identify.information import FittedModel, model_delay
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import SPECIAL
from gcs_autotune.models.coupled.kernel import imbalances
from gcs_autotune.models.coupled.program import inertia_matrix, program_of, states_of

__all__ = ["FELT", "Scales", "scales_of"]

Array = NDArray[np.float64]

FELT = 0.05
"""Share of an equation's largest force that counts as felt. Chosen: what pilots and controllers would not notice."""


@dataclass(frozen=True, slots=True, eq=False)
class Scales:
    """Per fitted parameter: ``size`` (p,) what its error is measured against, ``felt`` (p,) the amount that would be
    felt in the motion seen (infinite where nothing excites it), both in the parameter's unit.
    """

    size: Array
    felt: Array


def scales_of(subject: FittedModel) -> Scales:
    """Return the scales of the subject's fitted parameters.

    Raises
    ------
    NotInformative
        The model runs away on its runs.
    """
    strongest, effects = _forces(subject)
    values, felt = np.abs(subject.values), np.full(len(subject.free), np.inf)
    for i, name in enumerate(subject.free):
        if name in SPECIAL:
            felt[i] = _felt_special(subject, name)
            continue
        effect = effects[name]
        shares = np.where(strongest > 0.0, effect / np.where(strongest > 0.0, strongest, 1.0), 0.0)
        if shares.max() > 0.0:
            felt[i] = FELT / float(shares.max())
    size = np.where(np.isfinite(felt), np.maximum(values, felt), np.where(values > 0.0, values, 1.0))
    return Scales(size, felt)


def _forces(subject: FittedModel) -> tuple[Array, Mapping[str, Array]]:
    """Return the largest force (k,) per equation, and per parameter the largest effect (k,) of one unit of it."""
    form, k = subject.form, len(subject.form.dofs)
    motions = [_moving(subject, i) for i in range(len(subject.records))]
    zero = np.where([n in SPECIAL for n in form.parameters], subject.theta, 0.0)
    inputs = [_imbalance(form, zero, m) for m in motions]
    strongest = np.max([np.abs(e).max(axis=0) for e in inputs], axis=0)
    effects = {}
    for place, name in enumerate(form.parameters):
        if name in SPECIAL:
            continue
        one = zero.copy()
        one[place] += 1.0
        unit = np.zeros(k)
        for motion, base in zip(motions, inputs, strict=True):
            unit = np.maximum(unit, np.abs(_imbalance(form, one, motion) - base).max(axis=0))
        effects[name] = unit
        strongest = np.maximum(strongest, unit * abs(subject.theta[place]))
    return strongest, effects


def _imbalance(form: Form, theta: Array, motion: Motion) -> Array:
    """Return ``F - C nu - M nu_dot`` (s, k)."""
    out = np.empty_like(motion.nu_dot)
    imbalances(program_of(form), theta, inertia_matrix(form, theta), motion.X, motion.nu_dot, motion.inputs, out)
    return out


def _moving(subject: FittedModel, i: int) -> Motion:
    form, record = subject.form, subject.records[i]
    t, X = subject.motion(i)
    t, at = np.unique(t, return_index=True)
    k = len(form.dofs)
    nu_dot = np.gradient(X[at, k : 2 * k], t, axis=0) if len(t) > 1 else np.zeros((len(t), k))
    row = np.searchsorted(record.t_in, t - model_delay(form, subject.theta), side="right") - 1
    inputs = np.ascontiguousarray(record.inputs[np.maximum(row, 0)])
    return Motion(t, np.ascontiguousarray(X[at]), nu_dot, inputs, np.ones(k, dtype=bool))


def _felt_special(subject: FittedModel, name: str) -> float:
    if name in ("delay", "lag"):
        return max(float(np.median(np.diff(r.stamps))) for r in subject.records)
    speeds = [np.abs(subject.motion(i)[1][:, _surge(subject)]).max() for i in range(len(subject.records))]
    return FELT * float(max(speeds)) or FELT


def _surge(subject: FittedModel) -> int:
    states = states_of(subject.form)
    return states.index("u") if "u" in states else len(subject.form.dofs)
