"""``fly``: manoeuvres of the table on a vehicle, one or a plan of them, from the announcement to the records."""

from __future__ import annotations

import itertools
import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gcs_autotune.axes import axis_kind, excitation_of
from gcs_autotune.craft import Observation
from gcs_autotune.errors import AutotuneError, OperatorStopped, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import AxisFit
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    Area,
    CalmCheck,
    ComeBack,
    Dive,
    DiveSettings,
)
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Intentions, PredictedTrack, Watcher
from gcs_autotune.workflow.announcement import after_a_silence, battery, exactly, whole_of
from gcs_autotune.workflow.background import agreed, asked_now, beside, run_in_background
from gcs_autotune.workflow.connection import arming, connect_craft
from gcs_autotune.workflow.context import armed
from gcs_autotune.workflow.excursion import LATE, Excursion, worst_of
from gcs_autotune.workflow.experiments import dive_for
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.flight_plan import FlightLeg, FlightPlan, FlySettings, PlannedRun
from gcs_autotune.workflow.flight_result import FlightResult, FlownRun, read_flight, write_previews
from gcs_autotune.workflow.foresight import COMING_BACK, DEEPER, Foresight
from gcs_autotune.workflow.itinerary import DIVE, Itinerary, Leg, Paced, pace_of
from gcs_autotune.workflow.jit_warmup import await_warmup, jit_warmup
from gcs_autotune.workflow.onboard_log import log_of_run
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.precision import Precision
from gcs_autotune.workflow.preflight import (
    CHECKED,
    STAGE,
    checked_dof,
    see_depth_is_told,
    see_it_suits,
    see_it_tells,
    see_signs,
    sign_check_for,
)
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier, note_setting_out, same_options
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.self_planned import SelfPlanner, TrialStep, driven, see_it_can_be_told
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.worker import Worker

__all__ = ["PLAN_FILE", "fly", "fly_plan"]

PLAN_FILE = "plan.toml"
"""A flown plan's name in its run directory."""
BACK, LOOKING = 45.0, 6.0
"""Chosen [s]: coming back after a run that a trial plans itself, and looking whether it is calm."""
_FIGURES = ("CRUISE_THROTTLE", "CRUISE_SPEED", "ATC_STR_RAT_FF", "ATC_SPEED_P")
"""Parameters that tell how a boat moves."""
_POINTS = 400
"""Chosen: of a predicted track that are told; more no screen shows."""


def fly(
    settings: FlySettings, operator: Operator, watcher: Watcher, when: str, *, only_preview: bool = False
) -> FlightResult:
    """Fly one manoeuvre; see :func:`fly_plan`."""
    return fly_plan(FlightPlan.of(settings), settings.common, operator, watcher, when, only_preview=only_preview)


def fly_plan(
    plan: FlightPlan,
    common: TuneSettings,
    operator: Operator,
    watcher: Watcher,
    when: str,
    *,
    only_preview: bool = False,
) -> FlightResult:
    """Preview, announce, ask, fly, read: the run directory has ``trials/``, figures, models and ``report.html``.

    No parameter is written. The craft is left as found on every ending. Runs that ``common.resume`` has are not flown
    again.

    Raises
    ------
    WrongVehicle
        It has not what a manoeuvre drives, or is not the one of the earlier flight.
    PreconditionFailed
        A predicted track leaves the envelope.
    OperatorStopped, GuardTripped, NotAchieved, LinkError
        What ended it early; the records are on disk.
    """
    record = RunDirectory(common.directory)
    earlier = Earlier(common, plan.names if plan.until is None else (), alike=plan.until is None)
    warm = plan.until.dofs if plan.until is not None else ()
    what = plan.title if plan.until is None else f"until {plan.until.title}"
    with (
        record.summarised(f"{'preview of' if only_preview else 'fly'} {what}", when),
        jit_warmup(common.connection.uri, warm, []) as worker,
        connect_craft(
            common.connection, operator, watcher, record, common.control_rate, common.axis, common.patience
        ) as craft,
    ):
        flight = _Flight(plan, common, operator, watcher, record, craft, earlier, worker)
        flight.foresee(only_preview=only_preview)
        if only_preview:
            runs = [FlownRun(leg.run, leg.preview) for leg in flight.legs]
            return write_previews(runs, plan, common.directory, when)
        await_warmup(craft, worker, watcher)
        with log_of_run(common.fetch_log, craft, record, operator, watcher) as onboard:
            flight.announce()
            try:
                flight.fly()
            except AutotuneError as error:
                flight.say_how_to_go_on(error)
                raise
    runs = [FlownRun(leg.run, leg.preview, flight.flown[leg.run.name]) for leg in flight.legs]
    result = read_flight(plan, common, record, runs, when, flight.steps)
    onboard.identify([model.fit for model in result.models if isinstance(model.fit, AxisFit)], when)
    return result


class _Flight:
    """One flight on one vehicle: ``legs`` to fly, ``flown`` by name."""

    def __init__(
        self,
        plan: FlightPlan,
        common: TuneSettings,
        operator: Operator,
        watcher: Watcher,
        record: RunDirectory,
        craft: MavlinkCraft,
        earlier: Earlier,
        worker: Worker,
    ) -> None:
        self._plan, self._common, self._operator, self._worker = plan, common, operator, worker
        self._watcher, self._record, self._craft, self._earlier = watcher, record, craft, earlier
        self.legs: list[FlightLeg] = []
        self.flown: dict[str, Trial] = {}
        self.steps: list[TrialStep] = []
        self._held: dict[str, float] = {}
        self._area: Area | None = None
        self._planner: SelfPlanner | None = None

    def foresee(self, *, only_preview: bool) -> None:
        """See that the vehicle can fly all of it, and preview each run."""
        craft, firmware = self._craft, self._craft.firmware
        self._held = present = craft.parameters.read_existing(_FIGURES)
        self._earlier.see_that_it_is_the_same(craft, present)
        if self._plan.min_depth is not None and firmware.floats:
            raise WrongVehicle(f"the plan requires a depth of {self._plan.min_depth:g} m, but this vehicle floats")
        if self._plan.until is not None:
            see_it_can_be_told(self._plan.until, self._plan.runs[0].settings.kind, firmware)
        if self._plan.again is not None:
            self._plan.again.meet(craft)
        self._area = area_of_flight(craft, self._plan.area, self._watcher)
        checks, several = self._checks_of(self._plan.runs), len(self._plan.runs) > 1 or self._plan.until is not None
        least, watcher = self._plan.min_depth, self._watcher
        self._foresight = sees = Foresight(craft, present, self._area, least, watcher, checks, several)
        for run in self._plan.runs:
            see_it_suits(run.settings, craft)
            see_it_tells(run.settings.kind, craft)
            leg = sees.made_to_fit(sees.leg_of(run))
            if self._plan.until is not None:
                leg = self._planned_from(leg, self._plan.until)
            seen, assumed = leg.preview, leg.preview.craft.assumed
            self.legs.append(leg)
            of = f"preview of {run.name}" if len(self._plan.runs) > 1 else "preview"
            self._watcher.say(f"{of} (the manoeuvre alone): {seen.told()}")
            self._tell_track(leg)
            if seen.trouble and not assumed and not only_preview:
                raise PreconditionFailed(f"not flown, since the {of} ends early: {seen.trouble}. Nothing was armed")
            if leg.why_not and not only_preview:
                raise PreconditionFailed(leg.why_not)
            if leg.why_not:
                self._watcher.say(f"it would be rejected: {leg.why_not}")
            if seen.trouble:
                by = ", with assumed parameters" if assumed else ""
                self._watcher.say(f"the {of} ends early{by}: {seen.trouble}")
        if only_preview:
            for text in self._needs():
                self._watcher.say(f"it would {text}")
            self._watcher.say(f"it would {battery(craft.observe(), self._common.envelope, self._whole.seconds)}")

    def _tell_track(self, leg: FlightLeg) -> None:
        """Tell who watches where the run is expected to go from where the craft is now."""
        seen, now = leg.preview, self._craft.observe()
        ahead, abeam = (seen.trial[name].values for name in ("x", "y"))
        some = np.unique(np.linspace(0, len(ahead) - 1, _POINTS).astype(int))
        track = tuple(map(float, ahead[some])), tuple(map(float, abeam[some]))
        self._watcher.note(PredictedTrack(leg.run.name, now.x, now.y, now.psi, *track, seen.told(), seen.trouble))

    def _planned_from(self, first: FlightLeg, until: Precision) -> FlightLeg:
        """Set up what chooses the runs, and return the first: the usual one, or what helps after those known.

        Raises
        ------
        UsageError
            What was flown before tells what was asked for already, or nothing that may be flown helps.
        """
        craft, known = self._craft, self._plan.known
        overhead = BACK if craft.firmware.needs_way else 0.0
        self._planner = planner = SelfPlanner(
            until, first, craft.firmware, overhead, self._watcher.say, options=self._plan.options, known=len(known)
        )
        self.steps = planner.steps
        if not known:
            return first
        think = partial(run_in_background, craft, self._worker, lambda error: False)
        leg = planner.next_leg(known, think, self._foresight.leg_of)
        if leg is None:
            raise UsageError(f"nothing was flown: after the {len(known)} supplied runs, {planner.steps[-1].ended}")
        return leg

    @property
    def _to_fly(self) -> list[FlightLeg]:
        return [leg for leg in self.legs if not self._earlier.has(leg.run.name)]

    def _checks_of(self, runs: Sequence[PlannedRun]) -> list[str]:
        """Return the degrees of freedom whose actuators are checked before *runs*."""
        until = self._plan.until
        wanted = driven(until, self._craft.firmware) if until is not None else ()
        flown = [checked_dof(run.settings.kind) for run in runs if not self._earlier.has(run.name)]
        return [dof for dof in dict.fromkeys((*flown, *wanted)) if dof in CHECKED.values()]

    @property
    def _dofs(self) -> list[str]:
        """The degrees of freedom whose actuators are checked before."""
        return self._checks_of([leg.run for leg in self._to_fly])

    @property
    def _whole(self) -> Excursion:
        """All that is left to fly, from arming until the vehicle is restored."""
        each = [leg.excursion for leg in self._to_fly]
        check = sum(seconds for name, seconds in each[0].stages if name == STAGE) if each else 0.0
        looking = LOOKING * self._plan.calm * len(each)
        alone = [(name, seconds) for one in each for name, seconds in one.stages if name != STAGE]
        stages = ((STAGE, check), *alone) if check else tuple(alone)
        seconds = sum(one.seconds for one in each) - check * max(len(each) - 1, 0) + looking + self._diving
        return replace(worst_of(each), seconds=seconds, stages=stages) if each else Excursion(0.0, 0.0)

    @property
    def _diving(self) -> float:
        """Seconds of diving beforehand."""
        now, dofs = self._craft.observe(), (*self._dofs, *self._held_dofs)
        return DIVE * any(dive_for(dof, self._craft.firmware, now) is not None for dof in dofs)

    @property
    def _held_dofs(self) -> list[str]:
        """The degrees of freedom that the autopilot's own loops move."""
        axes = {leg.run.settings.kind.axis for leg in self._to_fly} - {""}
        return sorted(axis_kind(axis).dof for axis in axes)

    def announce(self) -> None:
        """Say what will be done, and ask.

        Raises
        ------
        OperatorStopped
            The answer was no.
        """
        craft, s, plan = self._craft, self._common, self._plan
        dofs, now = self._dofs, craft.observe()
        for dof in (*dofs, *self._held_dofs):
            see_depth_is_told(craft, dof)
        dive = any(dive_for(dof, craft.firmware, now) for dof in (*dofs, *self._held_dofs))
        whole = self._whole
        first = [Leg(name, seconds) for name, seconds in whole.stages if name == STAGE] + [Leg("diving", DIVE)] * dive
        pace = pace_of(under_way=craft.firmware.needs_way, skid=craft.skid)
        self._itinerary = Itinerary([*first, *self._planned_legs()], pace.turn)
        if not self._to_fly and plan.until is None:
            self._watcher.say("every run is complete: nothing is armed or moved; figures and models are computed again")
            return
        manual, hold = craft.firmware.manual_mode, craft.firmware.hold_mode
        in_manual = {leg.run.make(leg.throttle).in_manual for leg in self._to_fly}
        used = [hold] * (False in in_manual or dive or plan.min_depth is not None)
        used += [manual] * (True in in_manual or bool(dofs))
        modes = f"use mode{'s' * (len(used) > 1)} {' and '.join(used)}"
        intentions = (
            arming(craft, now),
            f"{modes}, and return to {now.mode} at the end",
            f"move: {_checks(dofs)}{self._movements()}",
            *self._needs(),
            *self._goes_on(),
            battery(now, s.envelope, whole.seconds),
            *after_a_silence(s, now),
            "write no parameter",
        )
        self._watcher.note(Intentions(intentions))
        for text in intentions:
            self._watcher.say(f"will {text}")
        if not agreed(craft, self._operator, self._watcher, "Go ahead?"):
            raise OperatorStopped("not started: the answer was no. Nothing was armed or moved")

    def _planned_legs(self) -> list[Leg]:
        """Return the stages of the runs and of what lies between them, as the worst craft takes them."""
        legs: list[Leg] = []
        for leg in self._to_fly:
            taken = dict(leg.excursion.stages)
            if legs and self._craft.firmware.needs_way:
                legs.append(Leg(COMING_BACK, taken.get(COMING_BACK, 0.0)))
            legs += [Leg(LOOKING_OUT, LOOKING)] * self._plan.calm
            legs.append(Leg(leg.run.name, taken.get(leg.run.name, leg.preview.seconds)))
        return legs

    def _goes_on(self) -> list[str]:
        until = self._plan.until
        if self._plan.again is not None:
            leg, whole = self._to_fly[0], self._whole
            back = whole.metres(leg.envelope) / leg.speed if leg.speed else 0.0
            words = "return and " * self._craft.firmware.needs_way + self._plan.again.words
            return [f"then {words}: up to {exactly(LATE * (2.0 * whole.seconds + back))} in all"]
        if until is None:
            return []
        return [
            f"then fly the most informative runs, each previewed and inside the same limits, until {until.title} "
            f"is known, for at most {until.seconds / 60.0:.0f} min of runs"
        ]

    def _movements(self) -> str:
        if len(self.legs) == 1:
            kind = self.legs[0].run.settings.kind
            return f"{kind.name} ({kind.help})"
        back = ", with a return to the start in between" if self._craft.firmware.needs_way else ""
        left = self._to_fly
        done = f" ({len(self.legs) - len(left)} already flown)" if len(left) < len(self.legs) else ""
        return f"{len(left)} run{'s' * (len(left) != 1)}{done}: {', '.join(leg.run.name for leg in left)}{back}"

    def _needs(self) -> list[str]:
        left = self._to_fly
        if not left:
            return []
        least = self._plan.min_depth
        craft = left[0].preview.craft
        source = craft.source + ", the worst case of several" * craft.assumed
        needs = [whole_of(self._whole, left[0].envelope, source)]
        return needs + ([f"dive to {least + DEEPER:g} m before each run"] if least is not None else [])

    def fly(self) -> None:
        """Fly what is left of the plan, from the sign check on, and put everything back."""
        craft, s, firmware = self._craft, self._common, self._craft.firmware
        watcher = Paced(self._watcher, self._itinerary)
        if self._plan.text:
            (self._record.path / PLAN_FILE).write_text(self._plan.text, encoding="utf-8")
        note_setting_out(self._record, s, craft, self._held)

        def keep(trial: Trial) -> None:
            beside(craft, partial(self._record.keep, trial))

        for leg in self.legs:
            trial = self._earlier.take(leg.run.name)
            if trial is not None:
                keep(trial)
                self.flown[leg.run.name] = trial
        left = [leg for leg in self.legs if leg.run.name not in self.flown]
        if not left:
            return
        ask = partial(asked_now, craft, self._operator, watcher)
        runner = ManoeuvreRunner(craft, replace(s.envelope, area=self._area), watcher, keep, s.patience, ask)
        dofs = self._dofs
        with armed(craft, watcher, self._record, s.connection):
            home = craft.observe()
            throttle = max(leg.throttle for leg in left)
            for dof in dofs:
                check = sign_check_for(dof, firmware, craft.servos, throttle, needs_speed=firmware.needs_way)
                see_signs(check, partial(runner.attempt, envelope=left[0].envelope))
                dive = dive_for(dof, firmware, home)
                if dive is not None:
                    runner.fly(dive, "diving")
            for dof in self._held_dofs:
                dive = dive_for(dof, firmware, craft.observe())
                if dive is not None:
                    runner.fly(dive, "diving")
            for k, leg in enumerate(itertools.chain(left, self._chosen(runner))):
                if k:
                    self._come_back(runner, leg, home)
                self._make_conditions(runner)
                manoeuvre = leg.run.make(leg.throttle, speed=leg.speed, keep_still=not firmware.needs_way)
                fly = runner.fly if k < len(left) else runner.attempt  # what it chose itself tells something anyhow
                self.flown[leg.run.name] = fly(manoeuvre, leg.run.name, leg.envelope).trial

    def _chosen(self, runner: ManoeuvreRunner) -> Iterator[FlightLeg]:
        """Yield the runs that a trial which plans itself goes on with, each chosen on what was flown before it."""
        planner = self._planner
        if planner is None:
            yield from self._flown_again(runner)
            return
        think = partial(run_in_background, self._craft, self._worker, runner.bear)
        while True:
            runs = [*self._plan.known, *(self.flown[leg.run.name] for leg in self.legs)]
            leg = planner.next_leg(runs, think, self._foresight.leg_of)
            if leg is None:
                return
            self.legs.append(leg)
            self._tell_track(leg)
            yield leg

    def _flown_again(self, runner: ManoeuvreRunner) -> Iterator[FlightLeg]:
        """Yield the runs that follow from the record of the last one."""
        again = self._plan.again
        think = partial(run_in_background, self._craft, self._worker, runner.bear)
        while again is not None:
            last = self.legs[-1].run
            run = again.another(last, self.flown[last.name], think)
            if run is None:
                return
            leg = self._foresight.leg_of(run)
            trouble = leg.why_not or ("" if leg.preview.craft.assumed else leg.preview.trouble)
            if trouble:
                self._watcher.say(f"not repeated: {trouble}")
                return
            self.legs.append(leg)
            self._tell_track(leg)
            yield leg

    def _come_back(self, runner: ManoeuvreRunner, leg: FlightLeg, home: Observation) -> None:
        """Bring a boat back to where it began, or say why not; other craft stay about where they are."""
        if not self._craft.firmware.needs_way or leg.run.settings.kind.tied:
            return
        free = replace(leg.envelope, heading_excursion=math.inf)
        flown = runner.attempt(ComeBack(home.x, home.y, leg.throttle), COMING_BACK, free)
        self._watcher.say(f"{COMING_BACK}: {flown.outcome.reason}")

    def _make_conditions(self, runner: ManoeuvreRunner) -> None:
        least = self._plan.min_depth
        if least is not None and not self._craft.observe().z >= least:
            runner.fly(Dive(DiveSettings(least + DEEPER, enough=least)), "diving")
        if self._plan.calm:
            runner.fly(CalmCheck(), LOOKING_OUT)

    def say_how_to_go_on(self, error: AutotuneError) -> None:
        """Tell, after a plan that an *error* ended early, what of it is flown, and the command that flies the rest."""
        if self._plan.text and len(self.flown) < len(self.legs):
            link, run = shlex.quote(self._common.connection.uri), shlex.quote(str(self._record.path))
            self._watcher.say(
                f"{len(self.flown)} of {len(self.legs)} runs of the plan are flown. To fly the rest, "
                f"{same_options(error)}: gcs-autotune fly --resume {run} --connect {link}"
            )


LOOKING_OUT = "checking for calm water"
"""A stage between two runs, beside :data:`COMING_BACK`."""


def _checks(dofs: Sequence[str]) -> str:
    """Return in words how the actuators of *dofs* are checked, those that are checked alike together."""
    alike: dict[str, list[str]] = {}
    for dof in dofs:
        alike.setdefault(excitation_of(dof).check, []).append(dof)
    return "".join(f"in {' and '.join(of)} {check}" if len(dofs) > 1 else check for check, of in alike.items())
