"""``fly``: fly one manoeuvre or a plan of several on a vehicle, from the announcement to the records."""

from __future__ import annotations

import itertools
import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gcs_autotune.axes import axis_kind, excitation_of
from gcs_autotune.craft import Observation
from gcs_autotune.errors import PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import is_of_one_axis
from gcs_autotune.manoeuvres import CalmCheck, ComeBack, Dive, DiveSettings, FollowWall, Layered, Manoeuvre
from gcs_autotune.observer import Intention, Observer, PredictedTrack
from gcs_autotune.workflow.announcement import battery, exactly, whole_of
from gcs_autotune.workflow.background import run_in_background
from gcs_autotune.workflow.excursion import LATE, Excursion, worst_of
from gcs_autotune.workflow.experiments import dive_for
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.flight_plan import FlightPlan, FlightRun, FlySettings
from gcs_autotune.workflow.flight_preview import COMING_BACK, DEEPER, FlightPreviewer
from gcs_autotune.workflow.flight_result import FlightResult, read_flight, write_previews
from gcs_autotune.workflow.itinerary import DIVE, WALL_RELAY, Itinerary, Leg, MissionLog, legs_beside, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.own_loops import CraftLoops, own_loops, relays_before
from gcs_autotune.workflow.precision import Precision
from gcs_autotune.workflow.preflight import (
    CHECKED,
    STAGE,
    check_depth_is_reported,
    check_signals,
    check_signs,
    check_vehicle_suits,
    checked_dofs,
    sign_check_for,
    steered_meanwhile,
)
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier, same_options
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.self_planned import SelfPlanner, TrialStep, check_identifiable, driven
from gcs_autotune.workflow.settings import CommonSettings

__all__ = ["PLAN_FILE", "fly", "fly_plan"]

PLAN_FILE = "plan.toml"
"""File name of the plan in the run directory."""
BACK, LOOKING = 45.0, 6.0
"""Seconds for the return after a self-planned run, and for the check for calm water. Project choice."""
_FIGURES = ("CRUISE_THROTTLE", "CRUISE_SPEED", "ATC_STR_RAT_FF", "ATC_SPEED_P")
"""Parameters that describe how a boat moves."""
SHOWN_FIRST = "heading"
"""Name of the axis whose telemetry has priority on a slow link: the heading, because most manoeuvres steer."""
_POINTS = 400
"""Most points of a predicted track passed on to the observer; a screen cannot show more. Project choice."""


def fly(
    settings: FlySettings, operator: Operator, observer: Observer, when: str, *, only_preview: bool = False
) -> FlightResult:
    """Fly one manoeuvre; arguments and errors as for :func:`fly_plan`."""
    return fly_plan(FlightPlan.of(settings), settings.common, operator, observer, when, only_preview=only_preview)


def fly_plan(
    plan: FlightPlan,
    common: CommonSettings,
    operator: Operator,
    observer: Observer,
    when: str,
    *,
    only_preview: bool = False,
) -> FlightResult:
    """Preview and announce the plan, ask the operator, fly it, and return the evaluated result. The run directory
    receives ``trials/``, figures, models and ``report.html``.

    No parameter is written. However the flight ends, the vehicle is restored. Runs already contained in
    ``common.resume`` are not flown again.

    Raises
    ------
    WrongVehicle
        The vehicle lacks an actuator that a manoeuvre needs, or it is not the vehicle of the earlier flight.
    PreconditionFailed
        A predicted track leaves the envelope.
    OperatorStopped, GuardTripped, NotAchieved, LinkError
        The cause of an early end; the records are on disk.
    """
    record, log = RunDirectory(common.directory), MissionLog(observer)
    earlier = Earlier(common, plan.names if plan.until is None else (), alike=plan.until is None)
    warm = plan.until.dofs if plan.until is not None else ()
    what = plan.title if plan.until is None else f"until {plan.until.title}"
    visit = visiting(common, operator, log, record, SHOWN_FIRST, dofs=warm)
    flight = _Flight(plan, earlier)
    with record.summarised(f"{'preview of' if only_preview else 'fly'} {what}", when, log):
        if only_preview:
            with visit as at:
                flight.show_preview(at)
            return write_previews(flight.runs, plan, common.directory, when)
        onboard = run_mission(visit, flight.declare, log)
    log.say("computing figures and models")
    result = read_flight(plan, common, record, flight.runs, when, flight.steps)
    onboard.identify([model.fit for model in result.models if is_of_one_axis(model.fit)], when)
    return result


class _Flight:
    """One flight on one vehicle; ``runs`` in their order, with their records once flown.

    ``steps``: the steps of a self-planned trial.
    """

    def __init__(self, plan: FlightPlan, earlier: Earlier) -> None:
        self._plan, self._earlier = plan, earlier
        self.runs: list[FlightRun] = []
        self.steps: list[TrialStep] = []
        self._planner: SelfPlanner | None = None
        self._has_begun = False
        self._own: CraftLoops | None = None
        self._further: FlightRun | None = None
        self._visit: Visit[MissionLog]
        self._previewer: FlightPreviewer

    def declare(self, visit: Visit[MissionLog]) -> Mission:
        """Return the mission: what this flight will do on the vehicle of *visit*. Nothing moves yet."""
        return self._declared(visit, only_preview=False)

    def show_preview(self, visit: Visit[MissionLog]) -> None:
        """Report what this flight would do on the vehicle of *visit*."""
        mission = self._declared(visit, only_preview=True)
        for text in mission.needs:
            visit.log.say(f"the flight would {text.text}")

    def _declared(self, visit: Visit[MissionLog], *, only_preview: bool) -> Mission:
        self._visit = visit
        held = self._preview_runs(only_preview=only_preview)
        craft, firmware = visit.craft, visit.craft.firmware
        now, checked, looped = craft.observe(), self._checked, self._looped
        if not only_preview:
            for dof in (*checked, *looped):
                check_depth_is_reported(craft, dof)
        dives = any(dive_for(dof, firmware, now) is not None for dof in (*checked, *looped))
        whole = self._whole(DIVE * dives)
        first = [Leg(name, seconds) for name, seconds in whole.stages if name == STAGE] + [Leg("diving", DIVE)] * dives
        pace = pace_of(craft.steered_by)
        idle = not self._left and self._plan.until is None
        in_manual = {run.settings.make(run.throttle).in_manual for run in self._left}
        modes = [firmware.hold_mode] * (False in in_manual or dives or self._plan.min_depth is not None)
        modes += [firmware.manual_mode] * (True in in_manual or bool(checked))
        return Mission(
            itinerary=Itinerary([*first, *self._stages()], pace.turn),
            modes=() if idle else tuple(modes),
            movements=COMPLETE if idle else f"{_checks([*checked, *self._steered(checked)])}{self._movements()}",
            needs=(
                *self._needs(whole),
                *self._continues(whole),
                battery(now, visit.common.envelope, (whole.usual or whole).seconds, self._in_all(whole)),
            ),
            fly=lambda journal: self._fly(),
            moves_briefly="" if idle else self._movements_in_brief(checks=bool(checked or self._steered(checked))),
            held=held,
            prepare=self._prepare,
            way_on=self._way_on,
        )

    def _preview_runs(self, *, only_preview: bool) -> Mapping[str, float]:
        """Check that the vehicle can fly every run, and preview each. Return the parameters used."""
        plan, log, craft = self._plan, self._visit.log, self._visit.craft
        held = craft.parameters.read_existing(_FIGURES)
        self._earlier.verify_same_vehicle(craft, held)
        if plan.min_depth is not None and craft.firmware.floats:
            raise WrongVehicle(
                f"the plan requires a depth of {plan.min_depth:g} m, but this vehicle floats. Remove min-depth from "
                "the plan"
            )
        if plan.until is not None:
            check_identifiable(plan.until, plan.runs[0].kind, craft.forces)
        if plan.again is not None:
            plan.again.meet(craft)
        area = area_of_flight(craft, plan.area, log)
        checks, several = self._checks_of(plan.runs), len(plan.runs) > 1 or plan.until is not None
        checks += self._steered(checks)
        runs = [run for run in plan.runs if not self._earlier.has(run.name)]
        first = next((run.name for run in runs if run.kind.layered), "")
        relays = first, self._relay_legs(runs)
        self._previewer = previewer = FlightPreviewer(craft, held, area, plan.min_depth, log, checks, several, relays)
        log.say("computing the preview")
        for settings in plan.runs:
            check_vehicle_suits(settings, craft)
            check_signals(settings.kind, craft)
            run = previewer.made_to_fit(previewer.run_of(settings))
            if plan.until is not None:
                run = self._planned_from(run, plan.until)
            self.runs.append(run)
            self._report_preview(run, f"preview of {settings.name}" if len(plan.runs) > 1 else "preview", only_preview)
        if plan.again is not None:
            further = previewer.run_of(plan.again.further(plan.runs[0])[0])
            if further.rejection:
                log.say(f"a {further.name} after these runs is not possible: {further.rejection}")
            else:
                self._further = further
        return held

    def _report_preview(self, run: FlightRun, of: str, only_preview: bool) -> None:
        """Report the preview *of* a run. Reject a run that must not be flown, unless *only_preview* is set.

        Raises
        ------
        PreconditionFailed
            It ends early, or cannot keep a limit that the user set.
        """
        seen, log, assumed = run.preview, self._visit.log, run.preview.craft.assumed
        if not only_preview:  # its report has the same sentence
            log.say(f"{of} (the manoeuvre alone): {seen.summary()}")
        self._report_track(run)
        if seen.trouble and not assumed and not only_preview:
            raise PreconditionFailed(f"not flown: in the {of} the run ends early: {seen.trouble}. Nothing was armed")
        if run.why_not and not only_preview:
            raise PreconditionFailed(run.why_not)
        if run.why_not:
            log.say(f"this run would be rejected: {run.why_not}")
        elif seen.trouble:
            log.say(f"in the {of} {run.caution or f'the run ends early: {seen.trouble}'}")

    def _report_track(self, run: FlightRun) -> None:
        """Send the observer the predicted track of the run, from the vehicle's present position."""
        seen, now = run.preview, self._visit.craft.observe()
        ahead, abeam = (seen.trial[name].values for name in ("x", "y"))
        some = np.unique(np.linspace(0, len(ahead) - 1, _POINTS).astype(int))
        track = tuple(map(float, ahead[some])), tuple(map(float, abeam[some]))
        self._visit.log.note(PredictedTrack(run.name, now.x, now.y, now.psi, *track, seen.summary(), seen.trouble))

    def _planned_from(self, first: FlightRun, until: Precision) -> FlightRun:
        """Set up the planner and return its first run: the default one, or the most informative one given earlier
        runs.

        Raises
        ------
        UsageError
            The earlier runs already reach the required precision, or no permitted manoeuvre improves it.
        """
        craft, known = self._visit.craft, self._plan.known
        overhead = BACK if craft.firmware.needs_way else 0.0
        self._planner = planner = SelfPlanner(
            until,
            first,
            craft.firmware,
            craft.forces,
            overhead,
            self._visit.log.say,
            options=self._plan.options,
            known=len(known),
        )
        self.steps = planner.steps
        if not known:
            return first
        think = partial(run_in_background, craft, self._visit.worker, lambda error: False)
        run = planner.next_run(known, think, self._previewer.run_of)
        if run is None:
            raise UsageError(f"nothing was flown: after the {len(known)} supplied runs, {planner.steps[-1].ended}")
        return run

    @property
    def _left(self) -> list[FlightRun]:
        """Runs that are still to be flown."""
        return [run for run in self.runs if run.trial is None and not self._earlier.has(run.name)]

    def _checks_of(self, runs: Sequence[FlySettings]) -> list[str]:
        """Return the degrees of freedom whose actuators are checked before *runs*."""
        until = self._plan.until
        wanted = driven(until, self._visit.craft.forces) if until is not None else ()
        left = [run for run in runs if not self._earlier.has(run.name)]
        flown = [dof for run in left for dof in checked_dofs(run.kind, self._visit.craft)]
        return [dof for dof in dict.fromkeys((*flown, *wanted)) if dof in CHECKED.values()]

    @property
    def _checked(self) -> list[str]:
        """Degrees of freedom whose actuators are checked before the runs."""
        return self._checks_of([run.settings for run in self._left])

    def _steered(self, checked: Sequence[str]) -> list[str]:
        """Return ``yaw`` if it is not *checked* itself but is steered while the others are driven."""
        firmware, servos = self._visit.craft.firmware, self._visit.craft.servos
        meanwhile = any(steered_meanwhile(dof, firmware, servos) for dof in checked)
        return ["yaw"] if meanwhile and "yaw" not in checked else []

    @property
    def _looped(self) -> list[str]:
        """Degrees of freedom that the autopilot's own loops control."""
        axes = {run.settings.kind.axis for run in self._left} - {""}
        return sorted(axis_kind(axis).dof for axis in axes)

    def _whole(self, diving: float) -> Excursion:
        """Return the excursion of the remaining runs, from arming to restoring, including *diving* [s]."""
        each = [run.excursion for run in self._left]
        space = [*each, self._further.excursion] if each and self._further is not None else each
        check = sum(seconds for name, seconds in each[0].stages if name == STAGE) if each else 0.0
        looking = LOOKING * self._plan.calm * len(each)
        alone = [(name, seconds) for one in each for name, seconds in one.stages if name != STAGE]
        stages = ((STAGE, check), *alone) if check else tuple(alone)
        seconds = sum(one.seconds for one in each) - check * max(len(each) - 1, 0) + looking + diving
        return replace(worst_of(space), seconds=seconds, stages=stages) if each else Excursion(0.0, 0.0)

    def _stages(self) -> list[Leg]:
        """Return the stages of the runs and those between the runs, with their usual times."""
        legs: list[Leg] = []
        legs += self._relay_legs([run.settings for run in self._left])
        for run in self._left:
            legs += self._legs_of(run, is_first=not legs)
        return legs

    def _legs_of(self, run: FlightRun, *, is_first: bool) -> Iterator[Leg]:
        """Yield the return before a run, unless it is the first one, and its stages."""
        taken = dict((run.excursion.usual or run.excursion).stages)
        if not is_first and self._visit.craft.firmware.needs_way:
            yield Leg(COMING_BACK, taken.get(COMING_BACK, 0.0))
        if self._plan.calm:
            yield Leg(LOOKING_OUT, LOOKING)
        yield Leg(run.name, taken.get(run.name, run.preview.seconds))

    def _in_all(self, whole: Excursion) -> float:
        """Return the longest time [s] of the runs, including one that may follow them, and the return before it."""
        if self._further is None or not self._left:
            return whole.seconds
        run = self._further
        back = whole.metres(run.envelope) / run.speed if run.speed else 0.0
        return whole.seconds + back + run.excursion.seconds

    def _continues(self, whole: Excursion) -> list[Intention]:
        """Return a sentence on what may follow the runs of the plan, which take the *whole* excursion."""
        until = self._plan.until
        if self._plan.again is not None and self._further is not None and self._left:
            _, words, brief = self._plan.again.further(self._plan.runs[0])
            back = "return and " * self._visit.craft.firmware.needs_way
            longest = f"up to {exactly(LATE * self._in_all(whole))} in all"
            return [Intention(f"then {back}{words}: {longest}", "Also", f"{brief}, {longest}")]
        if until is None:
            return []
        minutes = f"at most {exactly(until.seconds)}"
        return [
            Intention(
                f"then fly the most informative runs, each previewed and within the same limits, until {until.title} "
                f"is reached, for {minutes} of runs",
                "Also",
                f"more runs until the precision is reached, {minutes}",
            )
        ]

    def _movements(self) -> str:
        if len(self.runs) == 1:
            return f"{self._relays_told()}{self._meaning()}"
        back = ", with a return to the start in between" if self._visit.craft.firmware.needs_way else ""
        left = self._left
        done = f" ({len(self.runs) - len(left)} already flown)" if len(left) < len(self.runs) else ""
        names = ", ".join(run.name for run in left)
        return f"{self._relays_told()}{len(left)} run{'s' * (len(left) != 1)}{done}: {names}{back}"

    def _movements_in_brief(self, *, checks: bool) -> str:
        """Return the manoeuvre by its name, and the first sentence of its meaning if the line has room for it.

        Several runs are listed by their names, or counted.
        """
        relays = "relays, " * bool(relays_before([run.settings for run in self._left], self._visit.craft))
        first = f"{'pulses, ' * checks}{relays}"
        if len(self.runs) > 1:
            names = f"{first}{', '.join(run.name for run in self._left)}"
            return names if len(names) <= LINE else f"{first}{len(self._left)} runs"
        brief = f"{first}{self._meaning().partition('. ')[0]}"
        return brief if len(brief) <= LINE else f"{first}{self.runs[0].settings.kind.name}"

    def _meaning(self) -> str:
        """Return the name of the only manoeuvre with its meaning."""
        kind = self.runs[0].settings.kind
        title, _, rest = kind.help.partition(": ")
        return f"{kind.name}: {rest if title.replace(' ', '-') == kind.name else kind.help}"

    def _relay_legs(self, runs: Sequence[FlySettings]) -> list[Leg]:
        """Return the stages that identify the craft before its first layered manoeuvre."""
        pace = pace_of(self._visit.craft.steered_by)
        legs = [
            legs_beside(axis_kind(axis).dof, pace, wall=WALL_RELAY * (axis == "distance"))
            for axis in relays_before(runs, self._visit.craft)
        ]
        return [leg for each in legs for leg in each if leg.stage != STAGE]

    def _relays_told(self) -> str:
        axes = relays_before([run.settings for run in self._left], self._visit.craft)
        dofs = " and ".join(axis_kind(axis).dof for axis in axes)
        return f"relay oscillations in {dofs} to identify the craft, then " if axes else ""

    def _needs(self, whole: Excursion) -> list[Intention]:
        """Return a sentence on the space, time and depth that the *whole* excursion needs."""
        if not self._left:
            return []
        first, least = self._left[0], self._plan.min_depth
        plant = first.preview.craft
        needs: list[Intention] = [
            whole_of(whole, first.envelope, "the worst of several assumed craft" if plant.assumed else plant.source)
        ]
        return needs + ([_dive_first(least + DEEPER)] if least is not None else [])

    def _prepare(self) -> None:
        """Store the plan, and what an earlier flight completed of it, in the run directory."""
        self._has_begun = True
        if self._plan.text:
            (self._visit.record.path / PLAN_FILE).write_text(self._plan.text, encoding="utf-8")
        for i, run in enumerate(self.runs):
            trial = self._earlier.take(run.name)
            if trial is not None:
                self._visit.keep(trial)
                self.runs[i] = replace(run, trial=trial)

    def _fly(self) -> None:
        """Fly what is left of the plan, starting with the sign check."""
        visit, left, checked = self._visit, self._left, self._checked
        craft, firmware = visit.craft, visit.craft.firmware
        runner = visit.runner(replace(visit.common.envelope, area=self._previewer.area), visit.keep)
        home = craft.observe()
        throttle = max(run.throttle for run in left)
        looped = self._looped
        for dof in checked:
            check = sign_check_for(dof, craft, throttle)
            check_signs(check, partial(runner.attempt, envelope=left[0].envelope))
            _dive(runner, dive_for(dof, firmware, home))
        for dof in self._steered(checked):
            check = sign_check_for(dof, craft, throttle)
            runner.check_steering(check, left[0].envelope)
        for dof in looped:
            _dive(runner, dive_for(dof, firmware, craft.observe()))
        for k, run in enumerate(itertools.chain(left, self._chosen(runner))):
            if k:
                self._come_back(runner, run, home)
            self._make_conditions(runner)
            manoeuvre = run.settings.make(run.throttle, speed=run.speed, keep_still=not firmware.needs_way)
            if isinstance(manoeuvre, Layered | FollowWall):
                manoeuvre = self._over_own_loops(run, manoeuvre)
            fly = (
                runner.fly if k < len(left) else runner.attempt
            )  # a manoeuvre that it chose itself is informative even if it ends early
            flown = replace(run, trial=fly(manoeuvre, run.name, run.envelope))
            self.runs[self.runs.index(run)] = flown

    def _over_own_loops(self, run: FlightRun, manoeuvre: Layered | FollowWall) -> Manoeuvre:
        """Return the *manoeuvre* of *run* over our own loops. Motions that no model contains are identified first."""
        visit, settings = self._visit, run.settings
        if self._own is None:
            self._own = CraftLoops(
                visit,
                replace(visit.common.envelope, area=self._previewer.area),
                settings.models,
                settings.full_scale,
                self._previewer.held,
            )
        loop_of = partial(self._own.loop, plant=run.preview.craft)
        return manoeuvre.over(own_loops(settings.kind, visit.craft, loop_of, run.throttle, settings.apart))

    def _chosen(self, runner: ManoeuvreRunner) -> Iterator[FlightRun]:
        """Yield the further runs that are chosen from the records of earlier ones, if the plan requests this."""
        think = partial(run_in_background, self._visit.craft, self._visit.worker, runner.bear)
        next_run = self._next_planned if self._planner is not None else self._next_again
        while (run := next_run(think)) is not None:
            self.runs.append(run)
            self._report_track(run)
            if (itinerary := self._visit.log.itinerary) is not None:
                itinerary.legs += self._legs_of(run, is_first=False)
            yield run

    def _next_planned(self, think: Callable[..., Any]) -> FlightRun | None:
        """Return the next run of a self-planned trial, chosen from all earlier runs."""
        assert self._planner is not None
        flown = [run.trial for run in self.runs if run.trial is not None]
        return self._planner.next_run([*self._plan.known, *flown], think, self._previewer.run_of)

    def _next_again(self, think: Callable[..., Any]) -> FlightRun | None:
        """Return the run that follows from the record of the last one; None if there is none."""
        last = self.runs[-1]
        if self._plan.again is None or last.trial is None:
            return None
        settings = self._plan.again.another(last.settings, last.trial, think)
        if settings is None or self._further is None:
            return None
        run = self._previewer.run_of(settings)
        if run.rejection:
            self._visit.log.say(f"the {run.name} is not flown: {run.rejection}")
            return None
        return run

    def _come_back(self, runner: ManoeuvreRunner, run: FlightRun, home: Observation) -> None:
        """Return a boat to its start, or report why not. Other craft stay near theirs."""
        if not self._visit.craft.firmware.needs_way or run.settings.kind.tied:
            return
        free = replace(run.envelope, heading_excursion=math.inf)
        flown = runner.attempt(ComeBack(home.x, home.y, run.throttle), COMING_BACK, free)
        self._visit.log.say(f"{COMING_BACK}: {flown.reason}")

    def _make_conditions(self, runner: ManoeuvreRunner) -> None:
        """Dive and check for calm water if the plan requires it."""
        least = self._plan.min_depth
        if least is not None and not self._visit.craft.observe().z >= least:
            _dive(runner, Dive(DiveSettings(least + DEEPER, enough=least)))
        if self._plan.calm:
            runner.fly(CalmCheck(), LOOKING_OUT)

    def _way_on(self, error: BaseException) -> str:
        """Return how much of a plan was flown before an *error* ended it, and the command that flies the rest."""
        flown = sum(run.trial is not None for run in self.runs)
        if not self._has_begun or not self._plan.text or flown == len(self.runs):
            return ""
        link, run = shlex.quote(self._visit.common.connection.uri), shlex.quote(str(self._visit.record.path))
        return (
            f"{flown} of {len(self.runs)} runs of the plan are flown. To fly the rest, "
            f"{same_options(error)}: gcs-autotune fly --resume {run} --connect {link}"
        )


COMPLETE = "every run is complete. Nothing is armed or moved; figures and models are computed again"
LINE = 66
"""Characters beside "Space, time" in a line of the announcement, on a terminal of 80 columns."""
LOOKING_OUT = "checking for calm water"
"""Name of the stage between two runs in which the craft waits for calm water."""


def _dive_first(depth: float) -> Intention:
    where = f"to {depth:g} m before each run"
    return Intention(f"dive {where}", "Dive", where)


def _dive(runner: ManoeuvreRunner, dive: Dive | None) -> None:
    if dive is not None:
        runner.fly(dive, "diving")


def _checks(dofs: Sequence[str]) -> str:
    """Return a sentence on how the actuators of *dofs* are checked, grouped by check."""
    alike: dict[str, list[str]] = {}
    for dof in dofs:
        alike.setdefault(excitation_of(dof).check, []).append(dof)
    return "".join(f"in {' and '.join(of)} {check}" if len(dofs) > 1 else check for check, of in alike.items())
