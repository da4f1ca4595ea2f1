"""Use a model from a file instead of an identified one. Check that it has the right axis and explains the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.design import LAWS, Reduction, reduce
from gcs_autotune.errors import AutotuneError, UsageError
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import ModelFile, validate
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial

__all__ = ["STRANGE", "SuppliedModel", "explained", "supplied_for"]

STRANGE = 50.0
"""Smallest part of a flown step [percent] that a model of this craft must explain."""


@dataclass(frozen=True, slots=True, eq=False)
class SuppliedModel:
    """A model file as used for one axis.

    ``full_scale``: input at full output [in its unit]. ``noise_std``: noise of the stepped signal (SI).
    """

    file: ModelFile
    reduction: Reduction
    full_scale: float | None
    noise_std: float


def supplied_for(file: ModelFile, axis: Axis, full_scale: float | None) -> SuppliedModel:
    """Return *file* as the model of *axis*, checked before anything moves.

    Raises
    ------
    UsageError
        The model does not contain this axis, or its input is in newtons and its value at full output is unknown.
    """
    reduction = reduce(file.model, axis.dof, file.inputs, law=axis.law, names=file.names, covariance=file.covariance)
    unit = reduction.model.input_unit
    if unit != "1" and full_scale is None:
        raise UsageError(
            f"the input {reduction.channel} of '{file.name}' is in {unit}. Use --full-scale with its value in {unit} "
            f"at full output{_hint(file, reduction.channel)}, or identify from runs with normalised input"
        )
    if full_scale is not None and not (math.isfinite(full_scale) and full_scale != 0.0):
        raise UsageError(f"--full-scale {full_scale:g}: the input at full output must not be zero")
    moving = lookup(LAWS, axis.law, "control law").controls_velocity
    noise = file.noise.get(reduction.model.axis.velocity if moving else reduction.model.axis.position, 0.0)
    return SuppliedModel(file, reduction, None if unit == "1" and full_scale is None else full_scale, noise)


def _hint(file: ModelFile, channel: str) -> str:
    largest = file.model.amplitude.get(channel, 0.0)
    return f" (largest in its runs: {largest:.3g})" if largest else ""


def explained(given: SuppliedModel, step: Trial) -> float:
    """Return how much [%] of a flown step the model explains if only its initial state is fitted.

    NaN if it cannot be computed. *step*: with the output as a fraction of full output, as ``tune`` records it.
    """
    r = given.reduction
    flown = r.model.axis.force
    if flown not in step or "+" in r.channel:
        return math.nan
    output = step[flown]
    scale = 1.0 if given.full_scale is None else given.full_scale
    channel = replace(output, name=r.channel, unit=r.model.input_unit, values=scale * output.values)
    own = {n: c for n, c in step.channels.items() if n in (r.model.axis.position, r.model.axis.velocity)}
    others = [c for c in given.file.model.base.form.inputs if c != r.channel]
    missing = [c for c in others if c not in step]
    if missing:
        return math.nan
    channels = {**own, **{c: step[c] for c in others}, r.channel: channel}
    try:
        return validate(given.file.model, replace(step, channels=channels)).fit_percent
    except AutotuneError:
        return math.nan
