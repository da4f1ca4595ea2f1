"""Loops of our own for a craft: each motion is identified or taken from a model, and its controller is designed.

The order is that of Miskovic2010, algorithm 8.4: sign check, two or three relays, the model with its thrust curve, the
gains by a model function. ``hold`` and the layered manoeuvres of ``fly`` both use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from gcs_autotune.axes import OWN_AXES, axis_kind
from gcs_autotune.control import AxisLoop, OwnDesign, Uncertainty, design_own, uncertainty_of
from gcs_autotune.design import Actuator
from gcs_autotune.documents import model_file
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import ModelFile, load_model, save_model
from gcs_autotune.identify.thrust import with_actuator
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Envelope, ManoeuvreKind, NominalPlant, OwnLoops
from gcs_autotune.workflow.context import TuneContext, tune_runner
from gcs_autotune.workflow.experiments import speed_for
from gcs_autotune.workflow.flight_plan import FlySettings
from gcs_autotune.workflow.identification import identify
from gcs_autotune.workflow.itinerary import MissionLog
from gcs_autotune.workflow.mission import Visit
from gcs_autotune.workflow.preflight import STAGE, check_signs, sign_check_for
from gcs_autotune.workflow.proof import Known, known_of, reduction_of_extended
from gcs_autotune.workflow.resuming import Earlier
from gcs_autotune.workflow.settings import CommonSettings, TuneSettings
from gcs_autotune.workflow.supplied_model import SuppliedModel, supplied_for
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = [
    "RANGE",
    "SUPPLIED",
    "CraftLoops",
    "OwnMotion",
    "assumed_loop",
    "identified",
    "load_models",
    "motion",
    "own_axes",
    "own_loops",
    "range_of",
    "relays_before",
    "step_of",
    "supplied",
    "supplied_motion",
    "told",
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


def own_axes(kind: ManoeuvreKind, craft: MavlinkCraft) -> tuple[str, ...]:
    """Return the axes whose loops a layered manoeuvre of this *kind* uses on *craft*, the heading first.

    Thrust sideways is used if the craft has it; along a wall a craft without it moves vertically.
    """
    moves, sideways = "X" in kind.drives, "Y" in craft.forces
    return (
        "heading",
        *(["distance" if kind.needs else "ahead"] if moves else []),
        *(["sideways"] if moves and sideways else []),
        *(["down"] if "Z" in kind.drives or (kind.needs and not sideways) else []),
    )


def relays_before(runs: Sequence[FlySettings], craft: MavlinkCraft) -> list[str]:
    """Return the axes that no model of the layered *runs* contains, in their order: their relays are flown first."""
    found: dict[str, bool] = {}
    for run in runs:
        for axis in own_axes(run.kind, craft) if run.kind.layered else ():
            by_cruise = craft.firmware.needs_way and axis == "ahead"
            found[axis] = not by_cruise and supplied(run.models, axis, run.full_scale) is None
    return [axis for axis, flown in found.items() if flown]


def own_loops(
    kind: ManoeuvreKind,
    craft: MavlinkCraft,
    loop_of: Callable[[str], AxisLoop],
    throttle: float,
    apart: float,
) -> OwnLoops:
    """Return the loops that fly a layered manoeuvre; *loop_of* returns the loop of an axis."""
    way = craft.firmware.needs_way
    loops = {axis_kind(axis).dof: loop_of(axis) for axis in own_axes(kind, craft)}
    return OwnLoops(loops, throttle * way, way, not way or craft.servos.skid, apart)


def assumed_loop(
    axis: str, plant: NominalPlant, models: Sequence[ModelFile], full_scale: float | None, craft: MavlinkCraft
) -> AxisLoop:
    """Return the loop of *axis* from the first of *models* that contains it, else from the *plant* of the preview."""
    given, measured = supplied(models, axis, full_scale), craft.link_times.loop
    link = measured if math.isfinite(measured) else 0.0  # unknown until the craft is armed
    force = axis_kind(axis).names.force
    if given is not None:
        found = supplied_motion(given, link)
    else:
        model = plant.yaw if force == "N" else plant.others[force]
        found = OwnMotion(Known(model, Actuator(), 0.0), SUPPLIED, link)
    return found.loop(step_of(axis, craft))


class CraftLoops:
    """The loops of one craft during a flight: each is identified, or taken from a model, when it is first needed.

    Parameters
    ----------
    envelope : limits of the relays. present : the vehicle's cruise parameters.
    """

    def __init__(
        self,
        visit: Visit[MissionLog],
        envelope: Envelope,
        models: Sequence[ModelFile],
        full_scale: float | None,
        present: Mapping[str, float],
    ) -> None:
        common = {field.name: getattr(visit.common, field.name) for field in fields(CommonSettings)}
        settings = TuneSettings(**{**common, "axis": "heading", "resume": None, "envelope": envelope})
        at = Visit(settings, visit.operator, TuneLog(settings, "", visit.log), visit.record, visit.craft, visit.worker)
        axis = Axis("heading", "", (), (), needs_speed=visit.craft.firmware.needs_way)
        throttle, speed = speed_for(settings, axis, present)
        settings = replace(settings, speed=speed)
        runner = tune_runner(settings, at, speed)
        self._context = TuneContext(settings, at, runner, Earlier(settings), axis, None, present, throttle, speed)
        self._models, self._full_scale = models, full_scale
        self._found: dict[str, AxisLoop] = {}

    def loop(self, axis: str, plant: NominalPlant) -> AxisLoop:
        """Return the loop of *axis*; a boat's thrust ahead without a model is that of *plant*, its cruise."""
        if axis not in self._found:
            self._found[axis] = self._designed(axis, plant)
        return self._found[axis]

    def _designed(self, axis: str, plant: NominalPlant) -> AxisLoop:
        context, craft = self._context, self._context.craft
        given = supplied(self._models, axis, self._full_scale)
        if given is None and axis == "ahead" and craft.firmware.needs_way:
            return context.run_in_background(assumed_loop, axis, plant, (), None, craft)
        if given is not None:
            found = supplied_motion(given, craft.link_times.loop)
        else:
            found = identified(context) if axis == "heading" else motion(context, axis, (), None, checks=False)
        loop = context.run_in_background(found.loop, step_of(axis, craft))
        context.log.say(told(loop.design))
        return loop


def told(design: OwnDesign) -> str:
    """Return the gains of a loop in one sentence."""
    law, wanted = design.law, design.wanted
    return (
        f"controller {law.structure.name}: K_P {law.K_P:.3g}, K_I {law.K_I:.3g}, K_D {law.K_D:.3g} for a "
        f"{wanted.kind.capitalize()} loop of {wanted.omega_0:.2g} rad/s"
    )


def step_of(axis: str, craft: MavlinkCraft) -> float:
    """Return the step [rad or m] of *axis* that must not saturate the actuator."""
    return LEAD if axis == "ahead" and craft.firmware.needs_way else axis_kind(axis).step


LEAD = 2.0
"""Step of a boat's distance along its path that must not saturate the throttle [m]. Project choice."""


def motion(
    context: TuneContext, axis: str, models: Sequence[ModelFile], full_scale: float | None, *, checks: bool = True
) -> OwnMotion:
    """Return one more motion of the craft, an axis of ``OWN_AXES``: from the first of *models* that contains it, else
    from its sign check (unless *checks* is False) and relays.
    """
    dof, craft = axis_kind(axis).dof, context.craft
    given = supplied(models, axis, full_scale)
    if given is not None:
        context.log.say(f"{dof}: taken from model '{given.file.name}'")
        return supplied_motion(given, craft.link_times.loop)
    settings = replace(context.settings, axis=axis, step=None, relay_output=None, relay_hysteresis=None)
    if (
        checks and axis != "distance"
    ):  # a relay on the distance finds a reversed thruster itself, without a push at the wall
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
    fit, extended = found.fit, found.extended
    stem = f"-{axis.dof}" if axis.name in OWN_AXES else ""
    save_model(
        fit if extended is None else with_actuator(extended, fit), context.visit.record.path / f"model{stem}.json"
    )
    if extended is None:
        uncertainty = uncertainty_of(fit.model, fit.craft_covariance)
    else:
        reduction = reduction_of_extended(extended, axis)
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
    files = sorted(path.glob("model*.json")) or [model_file(path)]
    return tuple(replace(load_model(file), name=f"{path.name}/{file.name}") for file in files)


def _axis(name: str) -> Axis:
    return Axis(name, "", (), ())


def range_of(actuator: Actuator) -> tuple[float, float]:
    """Return the smallest and the largest force of our own loops: those of :data:`RANGE` of full output."""
    low, high = actuator.static(np.array([-RANGE, RANGE]))
    return float(low), float(high)
