"""What a flight will take, seen before anything moves: each run flown on paper, and made to fit the limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.axes import axis_kind
from gcs_autotune.craft import Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.limits import limit_of
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import DEEP, DOF_OF, Area, Envelope, Manoeuvre, PaperCraft, PaperState, Preview, preview
from gcs_autotune.sname import DOFS
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.excursion import NO_LIMITS, Ahead, Excursion, PaperVisit, worst_of
from gcs_autotune.workflow.experiments import WORKING_DEPTH, dive_for
from gcs_autotune.workflow.flight_plan import FlightLeg, FlightPlan, FlySettings, PlannedRun
from gcs_autotune.workflow.flight_result import FlightResult, FlownRun, write_previews
from gcs_autotune.workflow.paper_craft import kin_of, paper_craft
from gcs_autotune.workflow.preflight import STAGE, checked_dof, sign_check_for
from gcs_autotune.workflow.settings import TuneSettings

__all__ = ["COMING_BACK", "DEEPER", "Foresight", "preview_of_model"]

DEEPER = 0.5
"""Chosen [m]: so much deeper than a plan's least depth an ROV is taken, for it swings."""
_LEFT = 0.7
"""Chosen: share of its speed that a boat has left from what was flown before (the sign check, coming back)."""
SATURATED, OFTEN = 0.98, 0.05
"""Chosen: an output that counts as full, and the share of the time that makes a loop another one."""
COMING_BACK = "coming back"
"""The stage between two runs."""
_BOTTOMLESS = 1e3
"""Depth [m] from which nothing comes up to the surface meanwhile."""


def preview_of_model(plan: FlightPlan, common: TuneSettings, when: str) -> FlightResult:
    """Preview a plan with the model given, no vehicle at hand, and draw it where the settings say.

    Raises
    ------
    UsageError
        The model is not about what moves, or there is no speed for a throttle.
    """
    if plan.area is not None:
        raise UsageError("the area check needs the vehicle's position. Preview with --connect")
    runs = []
    for run in plan.runs:
        settings, s = run.settings, run.settings.common
        assert settings.model is not None  # asked by the command
        throttle = s.throttle or 0.0
        if throttle and s.speed is None:
            raise UsageError("no speed given. Use --speed with the craft's speed at that throttle")
        paper = paper_craft(settings, None, {}, throttle, s.speed or 0.0)
        if paper.assumed:
            wanted = " and ".join(sorted(DOF_OF[force] for force in settings.kind.drives))
            have = ", ".join(settings.model.model.base.form.dofs)
            raise UsageError(f"model '{settings.model.name}' is of {have}, but {run.name} moves {wanted}")
        runs.append(
            FlownRun(
                run, preview(settings.make(throttle, speed=s.speed or 0.0), paper, settings.envelope(s.speed or 0.0))
            )
        )
    return write_previews(runs, plan, common.directory, when)


@dataclass(frozen=True, slots=True)
class Foresight:
    """Sees runs on paper from where *craft* is, with the parameters *held* aboard, inside *area*.

    ``least_depth`` [m]: to which an ROV dives before each run. ``checks``: degrees of freedom whose actuators are
    checked before the first run; ``several``: there are more, and a boat comes back after each.
    """

    craft: MavlinkCraft
    held: Mapping[str, float]
    area: Area | None
    least_depth: float | None
    watcher: Watcher
    checks: Sequence[str] = ()
    several: bool = False

    def leg_of(self, run: PlannedRun) -> FlightLeg:
        """Return *run* with its preview from where the craft is now."""
        settings = run.settings
        throttle, speed = settings.cruise(self.craft.firmware, self.held)
        envelope = replace(settings.envelope(speed), area=self.area)
        now = self.craft.observe()
        here = None if self.area is None else self.area.seen_from(now.x, now.y, now.psi)
        seen = self._foreseen(settings, replace(envelope, area=here), now)
        return FlightLeg(run, throttle, speed, envelope, seen, self._whole(run, seen, now))

    def made_to_fit(self, leg: FlightLeg) -> FlightLeg:
        """Return a run that stays inside the limits: smaller and shorter than usual in what nobody gave, if need be.

        One that does not fit whatever is tried is returned as it is, with what all of it takes.
        """
        settings, troubled, why = leg.run.settings, leg.preview, leg.why_not
        limited = "" if troubled.refusal or why else self._limited(troubled, settings)
        if not troubled.refusal and not why and not limited:
            return leg
        for smaller in settings.smaller():
            fits = self.leg_of(replace(leg.run, settings=smaller))
            if not fits.preview.trouble and not fits.why_not and not self._limited(fits.preview, smaller):
                large = troubled.refusal or limited or f"it needs {leg.excursion.needs:g} m"
                self.watcher.say(
                    f"{leg.run.name} is reduced to {_sizes(settings, smaller)}, since at its usual size {large}"
                )
                return fits
        if not troubled.craft.assumed:
            return leg
        whole = self._foreseen(settings, NO_LIMITS, self.craft.observe())
        return replace(leg, preview=replace(whole, refusal=troubled.refusal))

    def _limited(self, seen: Preview, settings: FlySettings) -> str:
        """Return that an actuator stands at its limit too often, where the autopilot's own loop is to be looked at."""
        axis = settings.kind.axis
        force = DOFS[axis_kind(axis).dof].force if axis else ""
        if not axis or force not in seen.trial or settings.kind.drives:
            return ""
        share = float(np.mean(np.abs(seen.trial[force].values) >= SATURATED))
        actuator = {"N": "steering", "X": "throttle"}.get(force, "thrust")
        return f"the {actuator} would be at its limit for {share:.0%} of the time" if share > OFTEN else ""

    def _whole(self, run: PlannedRun, seen: Preview, now: Observation) -> Excursion:
        """Return what *run* takes with all that comes before and after it, of the worst craft where it is assumed."""
        settings, firmware = run.settings, self.craft.firmware
        throttle, speed = settings.cruise(firmware, self.held)
        papers = [seen.craft]
        if seen.craft.assumed:
            kinds = kin_of(under_way=firmware.needs_way, skid=self.craft.skid)
            papers = [paper_craft(settings, firmware, self.held, throttle, speed, kin) for kin in kinds]
        make = partial(run.make, throttle, speed=speed, keep_still=not firmware.needs_way)
        visits = [self._visit(paper, make(), settings, now) for paper in papers]
        at_most = make().at_most
        whole = worst_of(visits)
        if not math.isfinite(at_most):
            return whole
        longest = self._visit(papers[0], Ahead(speed, at_most, run.name), settings, now)
        return replace(worst_of([whole, longest]), usual=whole)

    def _visit(self, paper: PaperCraft, manoeuvre: Manoeuvre, settings: FlySettings, now: Observation) -> Excursion:
        firmware, tied = self.craft.firmware, settings.kind.tied
        throttle, _ = settings.cruise(firmware, self.held)
        z = math.nan if firmware.floats else self._depth_before(settings, now)
        visit = PaperVisit(paper, NO_LIMITS, PaperState(z=z), under_way=firmware.needs_way and not tied)
        for dof in () if tied else self.checks:
            check = sign_check_for(dof, firmware, self.craft.servos, throttle, needs_speed=firmware.needs_way)
            visit.fly(check, STAGE)
        visit.fly(manoeuvre, manoeuvre.name)
        if self.several and not tied:
            visit.come_back(throttle, COMING_BACK)
        return visit.excursion()

    def _foreseen(self, settings: FlySettings, envelope: Envelope, now: Observation) -> Preview:
        """Return the preview from *now*; where it is of assumed numbers, of the craft of which it comes out worse."""
        firmware = self.craft.firmware
        throttle, speed = settings.cruise(firmware, self.held)
        way = _LEFT * speed if firmware.needs_way and throttle and not settings.kind.tied else 0.0
        manoeuvre = partial(settings.make, throttle, speed=speed, keep_still=not firmware.needs_way)
        depth = _BOTTOMLESS if envelope is NO_LIMITS else self._depth_before(settings, now)
        seen = []
        usual = kin_of(under_way=firmware.needs_way, skid=self.craft.skid)[0]
        for sinks in (True, False) if "Z" in settings.kind.drives else (True,):
            paper = paper_craft(settings, firmware, self.held, throttle, speed, replace(usual, sinks=sinks))
            seen.append(preview(manoeuvre(), paper, envelope, floats=firmware.needs_way, way=way, depth=depth))
        return next((one for one in seen if one.trouble), max(seen, key=lambda one: one.deep))

    def _depth_before(self, settings: FlySettings, now: Observation) -> float:
        """Return how deep [m] the craft is when it begins: where it is *now*, or where it dives to before."""
        dof = checked_dof(settings.kind)
        if self.least_depth is not None and not now.z >= self.least_depth:
            return self.least_depth + DEEPER
        if dof and dive_for(dof, self.craft.firmware, now) is not None:
            return WORKING_DEPTH
        return now.z if math.isfinite(now.z) else DEEP


def _sizes(usual: FlySettings, smaller: FlySettings) -> str:
    """Return in words what was made smaller."""
    changed = [name for name in smaller.options if name not in usual.options]
    return ", ".join(
        f"--{name} {smaller.options[name] / limit_of(name, usual.kind.axis).factor:g}" for name in sorted(changed)
    )
