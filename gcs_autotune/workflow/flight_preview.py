"""Preview of a flight before anything moves: each run is simulated, and reduced if necessary to fit the limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.axes import axis_kind
from gcs_autotune.craft import Observation
from gcs_autotune.errors import PreconditionFailed, UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    DEEP,
    DOF_OF,
    Area,
    Envelope,
    FollowWall,
    Layered,
    Manoeuvre,
    NominalPlant,
    PlantState,
    Preview,
    how_far,
    preview,
)
from gcs_autotune.observer import Observer
from gcs_autotune.workflow.excursion import NO_LIMITS, Ahead, Excursion, VisitPreview, worst_of
from gcs_autotune.workflow.experiments import SWING_AHEAD, WORKING_DEPTH, dive_for
from gcs_autotune.workflow.flight_plan import FlightPlan, FlightRun, FlySettings
from gcs_autotune.workflow.flight_result import FlightResult, write_previews
from gcs_autotune.workflow.itinerary import Leg
from gcs_autotune.workflow.nominal_plant import assumed_crafts, nominal_plant
from gcs_autotune.workflow.own_loops import assumed_loop, own_loops
from gcs_autotune.workflow.preflight import STAGE, checked_dof, sign_check_for
from gcs_autotune.workflow.settings import CommonSettings

__all__ = ["COMING_BACK", "DEEPER", "FlightPreviewer", "preview_of_model"]

DEEPER = 0.5
"""Additional depth [m] of an ROV below a plan's minimum depth, because the depth varies during a run. Project
choice.
"""
_LEFT = 0.7
"""Fraction of its speed that a boat still has after the previous stage (the sign check, the return). Project choice."""
SATURATED, OFTEN = 0.98, 0.05
"""Output that counts as saturated, and the fraction of time in saturation above which the loop no longer acts as
designed. Project choice."""
COMING_BACK = "coming back"
"""Name of the stage between two runs."""
_BOTTOMLESS = 1e3
"""Depth [m] from which no craft reaches the surface during a run."""


def preview_of_model(plan: FlightPlan, common: CommonSettings, when: str) -> FlightResult:
    """Preview a plan with its model, without a vehicle, and plot it in the run directory.

    Raises
    ------
    UsageError
        The model does not contain a motion that the plan needs, or no speed is known for a throttle.
    """
    if plan.area is not None:
        raise UsageError("the area check needs the vehicle's position. Preview with --connect")
    runs = []
    for settings in plan.runs:
        s = settings.common
        assert settings.model is not None  # asked by the command
        if settings.kind.layered:
            raise UsageError(f"{settings.name} depends on the vehicle. Preview it with --connect")
        throttle = s.throttle or 0.0
        if throttle and s.speed is None:
            raise UsageError("no speed given. Use --speed with the craft's speed at the throttle flown")
        speed = s.speed or 0.0
        plant = nominal_plant(settings, None, {}, throttle, speed)
        if plant.assumed:
            wanted = " and ".join(sorted(DOF_OF[force] for force in settings.kind.drives))
            have = ", ".join(settings.model.model.base.form.dofs)
            raise UsageError(
                f"model '{settings.model.name}' is of {have}, but {settings.name} moves {wanted}. Use a model of "
                f"{wanted}"
            )
        envelope = settings.envelope(speed)
        seen = preview(settings.make(throttle, speed=speed), plant, envelope)
        runs.append(FlightRun(settings, throttle, speed, envelope, seen, Excursion(seen.seconds, seen.away)))
    return write_previews(runs, plan, common.directory, when)


@dataclass(frozen=True, slots=True)
class FlightPreviewer:
    """Simulates runs from the present position of *craft*.

    Attributes
    ----------
    held : the vehicle's parameters that describe its motion. area : the permitted area.
    least_depth : depth [m] to which an ROV dives before each run.
    checks : degrees of freedom whose actuators are checked before the first run.
    several : whether there are several runs; then a boat returns to the start after each.
    relays : name of a run, and the relays that are flown before it to identify the craft.
    """

    craft: MavlinkCraft
    held: Mapping[str, float]
    area: Area | None
    least_depth: float | None
    observer: Observer
    checks: Sequence[str] = ()
    several: bool = False
    relays: tuple[str, Sequence[Leg]] = ("", ())

    def run_of(self, settings: FlySettings) -> FlightRun:
        """Return the run of *settings* with its preview from the present position of the craft."""
        throttle, speed = settings.cruise(self.craft.firmware, self.held)
        envelope = replace(settings.envelope(speed), area=self.area)
        now = self.craft.observe()
        here = None if self.area is None else self.area.seen_from(now.x, now.y, now.psi)
        seen = self._foreseen(settings, replace(envelope, area=here), now)
        if here is not None:
            _check_inside(here, seen, settings.name)
        return FlightRun(settings, throttle, speed, envelope, seen, self._whole(settings, seen, now))

    def made_to_fit(self, run: FlightRun) -> FlightRun:
        """Return *run* with smaller values of the options that the user did not set, if this keeps it inside the
        limits. Otherwise return it unchanged, with the preview of the full run.
        """
        settings, troubled, why = run.settings, run.preview, run.why_not
        limited = "" if troubled.refusal or why else self._limited(troubled, settings)
        if not troubled.refusal and not why and not limited:
            return run
        for smaller in settings.smaller():
            fits = self.run_of(smaller)
            if not fits.preview.trouble and not fits.why_not and not self._limited(fits.preview, smaller):
                large = troubled.refusal or limited or f"it needs {run.excursion.needs:g} m"
                self.observer.say(f"{run.name} is reduced to {_sizes(settings, smaller)}. At its usual size {large}")
                return fits
        if not troubled.craft.assumed:
            return run
        whole = self._foreseen(settings, NO_LIMITS, self.craft.observe())
        return replace(run, preview=replace(whole, refusal=troubled.refusal))

    def _limited(self, seen: Preview, settings: FlySettings) -> str:
        """Return a warning if an actuator saturates too often for a test of the autopilot's own loop."""
        axis = settings.kind.axis
        force = axis_kind(axis).names.force if axis else ""
        if not axis or force not in seen.trial or settings.kind.drives:
            return ""
        share = float(np.mean(np.abs(seen.trial[force].values) >= SATURATED))
        actuator = {"N": "steering", "X": "throttle"}.get(force, "thrust")
        return f"the {actuator} would be at its limit for {share:.0%} of the time" if share > OFTEN else ""

    def _whole(self, settings: FlySettings, seen: Preview, now: Observation) -> Excursion:
        """Return the excursion of a run with all that comes before and after it, for the assumed craft that needs
        most."""
        firmware = self.craft.firmware
        throttle, speed = settings.cruise(firmware, self.held)
        plants = [seen.craft]
        if seen.craft.assumed:
            kinds = assumed_crafts(self.craft.steered_by)
            plants = [nominal_plant(settings, firmware, self.held, throttle, speed, like) for like in kinds]
        visits = [self._visit(plant, self._made(settings, plant), settings, now) for plant in plants]
        at_most = settings.make(throttle, speed=speed, keep_still=not firmware.needs_way).at_most
        whole = worst_of(visits)
        if not math.isfinite(at_most):
            return whole
        longest = self._visit(plants[0], Ahead(speed, at_most, settings.name), settings, now)
        return replace(worst_of([whole, longest]), usual=whole)

    def _visit(self, plant: NominalPlant, manoeuvre: Manoeuvre, settings: FlySettings, now: Observation) -> Excursion:
        firmware, tied = self.craft.firmware, settings.kind.tied
        throttle, speed = settings.cruise(firmware, self.held)
        z = math.nan if firmware.floats else self._depth_before(settings, now)
        visit = VisitPreview(plant, NO_LIMITS, PlantState(z=z), under_way=firmware.needs_way and not tied)
        for dof in () if tied else self.checks:
            check = sign_check_for(dof, self.craft, throttle)
            visit.fly(check, STAGE)
        for leg in self.relays[1] if settings.name == self.relays[0] else ():
            if firmware.needs_way:
                visit.turn_around(throttle, SWING_AHEAD)
            visit.fly(Ahead(speed, leg.seconds, leg.stage), leg.stage)
        visit.fly(manoeuvre, manoeuvre.name)
        if self.several and not tied:
            visit.come_back(throttle, COMING_BACK)
        return visit.excursion()

    def _foreseen(self, settings: FlySettings, envelope: Envelope, now: Observation) -> Preview:
        """Return the preview from *now*. If heave is driven, it is the worse of a sinking and a rising craft."""
        firmware = self.craft.firmware
        throttle, speed = settings.cruise(firmware, self.held)
        way = _LEFT * speed if firmware.needs_way and throttle and not settings.kind.tied else 0.0
        depth = _BOTTOMLESS if envelope is NO_LIMITS else self._depth_before(settings, now)
        seen = []
        usual = assumed_crafts(self.craft.steered_by)[0]
        for sinks in (True, False) if "Z" in settings.kind.drives else (True,):
            plant = nominal_plant(settings, firmware, self.held, throttle, speed, replace(usual, sinks=sinks))
            manoeuvre = self._made(settings, plant)
            seen.append(preview(manoeuvre, plant, envelope, floats=firmware.needs_way, way=way, depth=depth))
        return next((one for one in seen if one.trouble), max(seen, key=lambda one: one.deep))

    def _made(self, settings: FlySettings, plant: NominalPlant) -> Manoeuvre:
        """Return the manoeuvre of *settings*, a layered one over loops that are designed for *plant*."""
        throttle, speed = settings.cruise(self.craft.firmware, self.held)
        manoeuvre = settings.make(throttle, speed=speed, keep_still=not self.craft.firmware.needs_way)
        if not isinstance(manoeuvre, Layered | FollowWall):
            return manoeuvre
        loop_of = partial(
            assumed_loop, plant=plant, models=settings.models, full_scale=settings.full_scale, craft=self.craft
        )
        return manoeuvre.over(own_loops(settings.kind, self.craft, loop_of, throttle, settings.apart))

    def _depth_before(self, settings: FlySettings, now: Observation) -> float:
        """Return the depth [m] at the start of the run: the one in *now*, or the depth to which it dives first."""
        dof = checked_dof(settings.kind)
        if self.least_depth is not None and not now.z >= self.least_depth:
            return self.least_depth + DEEPER
        if dof and dive_for(dof, self.craft.firmware, now) is not None:
            return WORKING_DEPTH
        return now.z if math.isfinite(now.z) else DEEP


def _check_inside(area: Area, seen: Preview, name: str) -> None:
    """Check that a planned path is inside *area*.

    Raises
    ------
    PreconditionFailed
        It leaves the area; the message has the distance.
    """
    beyond = max((area.beyond(x, y) for x, y, *_ in seen.trial.meta.get("path", ())), default=0.0)
    if beyond > 0.0:
        raise PreconditionFailed(
            f"{name}: its path goes {how_far(beyond)} outside {area.source}. Use points inside it. Nothing was armed"
        )


def _sizes(usual: FlySettings, smaller: FlySettings) -> str:
    """Return a sentence on what was reduced."""
    changed = [name for name in smaller.options if name not in usual.options]
    return ", ".join(
        f"--{name} {smaller.options[name] / limit_of(name, usual.kind.axis).factor:g}" for name in sorted(changed)
    )
