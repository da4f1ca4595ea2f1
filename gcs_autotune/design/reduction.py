"""Reduce a model with effects to the plant of one axis, with remarks about each effect.

The plant has the inertia, the drag and the constant force of its axis in the base model, and delays and actuator
effects. Every effect gets a :class:`Remark` with its treatment in the design and advice on parameters or repairs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.effect_reduction import Draft, Remark, take
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS, Dof

__all__ = ["Reduction", "Remark", "reduce"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reduction(Displayed):
    """A model reduced to one axis.

    - ``model``, ``actuator``: model and actuator of the axis, in the unit of the input ``channel``.

    - ``covariance`` (5, 5): covariance of (alpha, beta, beta_quadratic, delta, delay), zero where unknown.
    - ``heavier``: largest factor by which the inertia increases in use.
    - ``quantum``: resolution of the position's sensor.
    """

    model: SingleDof
    channel: str
    covariance: Array
    actuator: Actuator = PERFECT
    heavier: float = 1.0
    quantum: float = 0.0
    remarks: tuple[Remark, ...] = ()


def reduce(
    model: ExtendedModel,
    dof: str,
    inputs: Mapping[str, str],
    *,
    law: str = "",
    speed: float | None = None,
    names: Sequence[str] = (),
    covariance: Array | None = None,
) -> Reduction:
    """Return the plant for the design of a loop of *dof*.

    inputs : name of the input -> unit. A missing unit is SI, or a fraction in a normalised form.
    law : control law of the autopilot, for advice that names its parameters.
    speed : speed [m/s] of the design.
    names, covariance : names of the fitted parameters and their covariance (p, p), as in a model file.

    Raises
    ------
    UsageError
        The model does not have the degree of freedom, or no input drives it.
    """
    form = model.base.form
    if dof not in form.dofs:
        raise UsageError(f"the model contains {', '.join(form.dofs)}, but not {dof}. Identify {dof} first")
    axis = DOFS[dof]
    channel, gain, words = _drive(model, axis)
    at = form.dofs.index(dof)
    force, nu = axis.force, axis.velocity
    numbers = {
        "alpha": float(model.base.inertia[at, at]),
        "beta": -model.base[f"{force}_{nu}"],
        "beta_quadratic": -model.base[f"{force}_{nu}{nu}"],
        "delta": model.base[f"{force}_0"],
        "delay": model.base["delay"],
    }
    draft = Draft(axis, channel, gain, law, speed, numbers, replace(PERFECT, lag=model.base["lag"]))
    if words:
        draft.remarks.append(Remark("coupling", dof, words))
    for own in model.effects:
        take(draft, own)
    n, gain = draft.numbers, draft.gain
    usual = "1" if form.normalised else "rad" if channel == "delta" else "N m" if axis.angular else "N"
    unit = inputs.get(channel, usual)
    linear = f"{force}_{axis.position}"  # of a form with the angle instead of its sine
    restoring = -model.base[axis.restoring_derivative] - model.base[linear] if axis.restored else 0.0
    single = SingleDof(
        dof,
        unit,
        n["alpha"] / gain,
        n["beta"] / gain,
        n["beta_quadratic"] / gain,
        n["delta"] / gain,
        n["delay"],
        restoring / gain,
    )
    spread = _covariance(axis, channel, gain, names, covariance)
    return Reduction(single, channel, spread, draft.actuator, draft.heavier, draft.quantum, tuple(draft.remarks))


def _drive(model: ExtendedModel, axis: Dof) -> tuple[str, float, str]:
    """Return the channel that drives the axis, its force per unit, and a remark on what is omitted."""
    form = model.base.form
    drives: dict[str, float] = {}
    for channel, pairs in form.inputs.items():
        for force, gain in pairs:
            if force == axis.force:
                value = gain if isinstance(gain, float | int) else _named(model, gain)
                drives[channel] = drives.get(channel, 0.0) + float(value)
    if not drives:
        raise UsageError(f"no input of the model drives {axis.name}. The model's inputs are {', '.join(form.inputs)}")
    words = ""
    if len(form.dofs) > 1:
        words = "the loop is designed for this axis alone, without its coupling to the other axes"
    if len(drives) == 1:
        (channel, gain), *_ = drives.items()
        return channel, gain, words
    together = sum(abs(g) for g in drives.values())
    channel = "+".join(drives)
    return channel, together, f"full output is the sum of {', '.join(drives)}; {words}"


def _named(model: ExtendedModel, name: str) -> float:
    return -model.base[name[1:]] if name.startswith("-") else model.base[name]


def _covariance(axis: Dof, channel: str, gain: float, names: Sequence[str], covariance: Array | None) -> Array:
    """Return the covariance of the five numbers of the reduced model, from that of the model's own numbers."""
    found = np.zeros((5, 5))
    if covariance is None or not len(covariance):
        return found
    force, nu = axis.force, axis.velocity
    rows = np.zeros((5, len(names)))
    share = {
        f"{force}_{nu}dot": (0, -1.0 / gain),
        f"I_{'xyz'[('roll', 'pitch', 'yaw').index(axis.name)]}" if axis.angular else "m": (0, 1.0 / gain),
        f"{force}_{nu}": (1, -1.0 / gain),
        f"linear-drag@{axis.name}.coefficient": (1, 1.0 / gain),
        f"{force}_{nu}{nu}": (2, -1.0 / gain),
        f"quadratic-drag@{axis.name}.coefficient": (2, 1.0 / gain),
        f"{force}_0": (3, 1.0 / gain),
        f"input-bias@{axis.name}.bias": (3, 1.0 / gain),
        "net-buoyancy@heave.force": (3, 1.0 / gain),
        "delay": (4, 1.0),
        f"input-delay@{channel}.delay": (4, 1.0),
        "alpha": (0, 1.0),
        "beta": (1, 1.0),
        "beta_quadratic": (2, 1.0),
        "delta": (3, 1.0),
    }
    for j, name in enumerate(names):
        if name in share:
            row, factor = share[name]
            rows[row, j] = factor
    spread: Array = rows @ covariance @ rows.T
    return spread
