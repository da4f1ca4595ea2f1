"""Size of a parameter with a noticeable effect, with which its standard error is compared.

The size of a derivative is the larger of two: its value, and the change that alters its equation by :data:`FELT` of the
largest force, at the motion in the runs. A coefficient near zero without effect should not determine the next
manoeuvre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.problems import FittedModel
from gcs_autotune.models import SPECIAL, balance_of, program_of, states_of

__all__ = ["FELT", "Scales", "scales_of"]

Array = NDArray[np.float64]

FELT = 0.05
"""Fraction of an equation's largest force that is noticeable to pilots and controllers."""


@dataclass(frozen=True, slots=True, eq=False)
class Scales:
    """Scales of the fitted parameters, in the parameter's unit.

    - ``size`` (p,): with which its error is compared.
    - ``felt`` (p,): change with a noticeable effect in the motion of the runs; infinite if nothing excites it.
    """

    size: Array
    felt: Array


def scales_of(subject: FittedModel) -> Scales:
    """Return the size and the noticeable change of each fitted parameter.

    Raises
    ------
    NotInformative
        The model diverges on its runs.
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
    """Return the largest force (k,) of each equation, and the largest effect (k,) of one unit of each parameter."""
    form = subject.form
    motions = [subject.recorded_motion(i) for i in range(len(subject.records))]
    zero = np.where([n in SPECIAL for n in form.parameters], subject.theta, 0.0)
    balances = [balance_of(program_of(form), zero, m.X, m.nu_dot, m.inputs) for m in motions]
    strongest = np.max([np.abs(b.values).max(axis=0) for b in balances], axis=0)
    effects = {}
    for place, name in enumerate(form.parameters):
        if name in SPECIAL:
            continue
        effects[name] = np.max([np.abs(b.by[:, :, place]).max(axis=0) for b in balances], axis=0)
        strongest = np.maximum(strongest, effects[name] * abs(subject.theta[place]))
    return strongest, effects


def _felt_special(subject: FittedModel, name: str) -> float:
    if name in ("delay", "lag"):
        return max(float(np.median(np.diff(r.stamps))) for r in subject.records)
    speeds = [np.abs(subject.motion(i)[1][:, _surge(subject)]).max() for i in range(len(subject.records))]
    return FELT * float(max(speeds)) or FELT


def _surge(subject: FittedModel) -> int:
    states = states_of(subject.form)
    return states.index("u") if "u" in states else len(subject.form.dofs)
