"""Loops of our own for a craft: each motion is identified or taken from a model, and its controller is designed.

The order is that of Miskovic2010, algorithm 8.4: sign check, two or three relays, the model with its thrust curve, the
gains by a model function. ``hold`` and the layered manoeuvres of ``fly`` both use it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gcs_autotune.axes import OWN_AXES, axis_kind
from gcs_autotune.control import AxisLoop, Uncertainty, design_own, uncertainty_of
from gcs_autotune.design import Actuator
from gcs_autotune.errors import BadFile
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import ModelFile, load_model, save_model
from gcs_autotune.identify.thrust import with_actuator
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.identification import identify
from gcs_autotune.workflow.preflight import STAGE, check_signs, sign_check_for
from gcs_autotune.workflow.proof import Known, known_of, reduction_with_curve
from gcs_autotune.workflow.supplied_model import SuppliedModel, supplied_for

__all__ = [
    "RANGE",
    "SUPPLIED",
    "OwnMotion",
    "identified",
    "load_models",
    "motion",
    "range_of",
    "supplied",
    "supplied_motion",
]

RANGE = 0.9
"""Largest output that our own loops use [fraction of full]; the relays' too."""
SUPPLIED = Uncertainty(0.1, 0.2)
"""Relative errors assumed of a model whose file has no covariance, Miskovic2010, section 8.1.2."""


@dataclass(frozen=True, slots=True)
class OwnMotion:
    """One motion from which its loop is designed: the craft, its uncertainty, and the delay of the link there and back
    [s]."""

    known: Known
    uncertainty: Uncertainty
    link: float

    def loop(self, step: float, kind: str = "bessel", omega_0: float | None = None) -> AxisLoop:
        """Return the loop whose *step* [rad or m] does not saturate the actuator, with the inverse of the actuator."""
        late = replace(self.known.model, delay=self.known.model.delay + self.link)
        actuator = self.known.actuator
        limits = range_of(actuator)
        design = design_own(late, self.uncertainty, step=step, limits=limits, kind=kind, omega_0=omega_0)
        return AxisLoop(design, actuator.output_for)


def motion(context: TuneContext, axis: str, models: Sequence[ModelFile], full_scale: float | None) -> OwnMotion:
    """Return one more motion of the craft, an axis of ``OWN_AXES``: from the first of *models* that contains it, else
    from its own sign check and relays.
    """
    dof, craft = axis_kind(axis).dof, context.craft
    given = supplied(models, axis, full_scale)
    if given is not None:
        context.log.say(f"{dof}: taken from model '{given.file.name}'")
        return supplied_motion(given, craft.link_times.loop)
    settings = replace(context.settings, axis=axis, step=None, relay_output=None, relay_hysteresis=None)
    if axis != "distance":  # a relay on the distance finds a reversed thruster itself, without a push at the wall
        context.log.say(f"{STAGE}: {dof}")
        check_signs(sign_check_for(dof, craft, 0.0), context.runner.attempt)
    return identified(replace(context, settings=settings, axis=_axis(axis)))


def supplied(models: Sequence[ModelFile], axis: str, full_scale: float | None) -> SuppliedModel | None:
    """Return the model of *axis* from the first of *models* that contains its motion; None if none does.

    Raises
    ------
    UsageError
        Its input is in newtons, and its value at full output is unknown.
    """
    dof = axis_kind(axis).dof
    file = next((m for m in models if dof in m.model.base.form.dofs), None)
    return None if file is None else supplied_for(file, _axis(axis), full_scale)


def supplied_motion(given: SuppliedModel, link: float = 0.0) -> OwnMotion:
    """Return the motion of a supplied model; *link*: delay of the link there and back [s]."""
    model, covariance = given.reduction.model, given.reduction.covariance
    uncertainty = uncertainty_of(model, covariance) if np.any(covariance) else SUPPLIED
    return OwnMotion(known_of(given, _axis("heading")), uncertainty, link)


def identified(context: TuneContext) -> OwnMotion:
    """Fly the relays of the axis of *context* and return its motion. The model goes into the run directory."""
    found, axis = identify(context, turns_first=False), context.axis
    fit, curved = found.fit, found.curved
    stem = f"-{axis.dof}" if axis.name in OWN_AXES else ""
    save_model(fit if curved is None else with_actuator(curved, fit), context.visit.record.path / f"model{stem}.json")
    if curved is None:
        uncertainty = uncertainty_of(fit.model, fit.craft_covariance)
    else:
        reduction = reduction_with_curve(curved, axis)
        uncertainty = uncertainty_of(reduction.model, reduction.covariance)
    return OwnMotion(known_of(found, axis), uncertainty, context.craft.link_times.loop)


def load_models(path: Path) -> tuple[ModelFile, ...]:
    """Return the models in a file, or in all model files of a run directory.

    Raises
    ------
    BadFile
        A file is not a model, or the directory contains none.
    """
    if not path.is_dir():
        return (load_model(path),)
    files = sorted(path.glob("model*.json"))
    if not files:
        raise BadFile(f"{path} contains no model file (model.json). Use the directory of hold, fly or experiment")
    return tuple(replace(load_model(file), name=f"{path.name}/{file.name}") for file in files)


def _axis(name: str) -> Axis:
    return Axis(name, "", (), ())


def range_of(actuator: Actuator) -> tuple[float, float]:
    """Return the smallest and the largest force of our own loops: those of :data:`RANGE` of full output."""
    low, high = actuator.static(np.array([-RANGE, RANGE]))
    return float(low), float(high)
