"""``tune all``: the loops of a vehicle in the order of ``TUNABLES``, with one announcement, one consent and one report.

Every step is a run of its own, in its own directory below that of the job. What it does and how it ends is that of
``tune NAME``; this module only decides which step is next. Between the steps a boat returns to its start.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import Struct

from gcs_autotune.axes import AXES, axis_kind, excitation_of
from gcs_autotune.documents import SETTING_OUT, conformed, load_json
from gcs_autotune.errors import (
    BadFile,
    DataError,
    DesignError,
    NotAchieved,
    OperatorStopped,
    ParameterMissing,
    PreconditionFailed,
    UsageError,
    WrongVehicle,
)
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.frames import flat
from gcs_autotune.link import Journal, MavlinkCraft, Transport, difference, fingerprint_of, same_float32
from gcs_autotune.manoeuvres import TO_COME_ABOUT, ComeBack
from gcs_autotune.observer import Intention, Intentions, ListedStep, Observer, SilentObserver, StepList
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import JobStep, JobStory, job_document, save_page, to_json
from gcs_autotune.tunables import TUNABLES, Tunable
from gcs_autotune.workflow.announcement import battery, exactly, in_modes, in_short, styled
from gcs_autotune.workflow.connection import arming
from gcs_autotune.workflow.excursion import overhead
from gcs_autotune.workflow.experiments import SHALLOW, WORKING_DEPTH, speed_for
from gcs_autotune.workflow.flight_plan import FlightPlan, FlySettings
from gcs_autotune.workflow.itinerary import Itinerary, Leg, MissionLog, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.recheck import AFTER, recheck
from gcs_autotune.workflow.record import JOURNAL, SAVED, SUMMARY, RunDirectory
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tune import job_of
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["JOB", "tune_all"]

JOB = "job.json"
"""File of a job's directory with its vehicle and steps."""
GOES_ON = (DataError, DesignError, NotAchieved, ParameterMissing, PreconditionFailed, UsageError, WrongVehicle)
"""Errors of a step after which the next step is flown. All others end the job: a stop, a lost link, a tripped limit, an
order of another station, and a vehicle that was not restored."""
BACK = "return to the start"
SETTING_OUT_TIME, AWAY = 15.0, 30.0
"""Time [s] of each step to connect, arm and disarm, and of a boat to come back to its start. Measured with simulated
vehicles."""


class _Begun(Struct, frozen=True):
    """The content of :data:`JOB`."""

    vehicle: dict[str, int | str | None]
    fingerprint: dict[str, float]
    style: str
    dry_run: bool
    home: tuple[float, float, float] | None
    steps: list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class _Plan:
    """What is done on one vehicle. ``parameters``: the values before the job. ``home``: latitude, longitude [deg] and
    heading [rad] of a boat at the start."""

    begun: _Begun
    steps: tuple[JobStep, ...]
    parameters: dict[str, float]
    announced: Intentions
    vehicle: str


def tune_all(settings: TuneSettings, operator: Operator, observer: Observer, moment: Callable[[], str]) -> JobStory:
    """Tune all loops of a vehicle and return the record. ``settings.resume``: directory of a job to continue.

    moment : returns the present date and time, ISO 8601, for the report of the job and of each step.

    Raises
    ------
    OperatorStopped, LinkError, GuardTripped, NotAsFound, ...
        The cause of an early end. By then the vehicle is restored and the report is written.
    UsageError, PreconditionFailed, WrongVehicle
        The job to resume is not one, was interrupted without a restore, or is of another vehicle.
    """
    link = settings.connection.open()
    settings = replace(settings, connection=replace(settings.connection, opened=link))
    link.stays_open = True
    try:
        return _Job(settings, operator, observer, moment, link).run()
    finally:
        link.stays_open = False


class _Job:
    """One job: its plan, and the steps as far as they are done."""

    def __init__(
        self,
        settings: TuneSettings,
        operator: Operator,
        observer: Observer,
        moment: Callable[[], str],
        link: Transport,
    ) -> None:
        self._settings, self._operator, self._observer = settings, operator, observer
        self._moment, self._when = moment, moment()
        self._link = link
        self._path = settings.directory if settings.resume is None else settings.resume
        self._earlier = None if settings.resume is None else _read(settings)
        self._steps: list[JobStep] = []

    def run(self) -> JobStory:
        plan = self._planned()
        options = f" --style {self._settings.style}" * (self._settings.style != "normal")
        options += " --dry-run" * self._settings.dry_run
        options += f" --loops {','.join(self._settings.loops)}" * bool(self._settings.loops)
        uri, directory = self._settings.connection.uri, str(self._path)
        story = JobStory(
            self._when,
            plan.vehicle,
            self._link.is_simulated,
            uri,
            directory,
            announced=plan.announced.texts,
            options=options,
        )
        stopped = ""
        try:
            self._save(plan)
            self._fly(plan)
        except BaseException as error:
            stopped = str(error) or type(error).__name__
            raise
        finally:
            story = replace(story, steps=tuple(self._steps), stopped=stopped)
            self._show()
            self._save(plan)
            self._report(story)
            if stopped and story.resume:
                self._observer.say(f"to continue: {story.resume}")
        return story

    # --- before anything moves ------------------------------------------------------------------------------------

    def _planned(self) -> _Plan:
        """Connect, check every step, announce all of them and ask.

        Raises
        ------
        OperatorStopped
            The answer was no.
        """
        settings, log = replace(self._of(TUNABLES["speed"]), agreed=False), MissionLog(self._observer)
        rows = [row for row in TUNABLES.values() if self._is_included(row)]
        axes = [f.axes[row.axis] for f in FIRMWARE.values() for row in rows if row.axis in f.axes]
        compiled = {"dofs": tuple({a.dof for a in axes}), "laws": tuple({a.law for a in axes})}
        record = RunDirectory(self._next("announcement"))
        with visiting(settings, self._operator, log, record, settings.axis, **compiled) as visit:
            plan = self._declared(visit, rows)
            self._steps = list(plan.steps)
            log.announce(plan.announced)
            self._show()
            if not any(step.ending == "open" for step in plan.steps):
                raise PreconditionFailed(
                    "no loop is to be tuned: " + "; ".join(f"{s.name}: {s.reason or s.ending}" for s in plan.steps)
                )
            if not visit.agrees("Go ahead with all steps?"):
                raise OperatorStopped("not started: the answer was no. Nothing was armed, moved or written")
        return plan

    def _is_included(self, row: Tunable) -> bool:
        named = self._settings.loops
        if self._earlier is not None and not named:
            named = tuple(step["name"] for step in self._earlier.steps)
        return row.after is not None and (row.name in named if named else not row.on_request)

    def _declared(self, visit: Visit[MissionLog], rows: Sequence[Tunable]) -> _Plan:
        craft, settings = visit.craft, self._settings
        vehicle = craft.session.vehicle
        assert vehicle is not None
        here, fingerprint = vehicle.to_dict(), fingerprint_of(craft.parameters)
        done = {} if self._earlier is None else self._done(craft)
        steps: list[JobStep] = []
        missions: dict[str, Mission] = {}
        parameters: dict[str, float] = {}
        for row in rows:
            if row.kind and row.kind != craft.firmware.kind:
                continue
            log = TuneLog(settings, self._when, SilentObserver(), row.name)
            if row.name in done:
                steps.append(done[row.name])
                continue
            at: Any = replace(visit, log=log)  # the same visit, with the log of a tune
            try:
                resume = self._interrupted(row.name)
                own = replace(self._of(row), directory=visit.record.path, untuned=True, resume=resume)
                missions[row.name] = job_of(row.name).declare(own, at)
            except GOES_ON as error:
                if isinstance(error, WrongVehicle) and row.name not in settings.loops:
                    continue  # it has no such loop
                steps.append(JobStep(row.name, ending="rejected", reason=str(error)))
            else:
                legs = missions[row.name].itinerary
                seconds = legs.seconds + overhead(len(legs.legs)) + self._between(craft, is_first=not steps)
                steps.append(JobStep(row.name, seconds=seconds))
            parameters = {**log.parameters_before, **parameters}
        steps += self._rechecks(steps, done, craft)
        fix, psi = craft.telemetry.fix, craft.observe().psi
        home = (*fix, psi) if fix is not None and craft.firmware.needs_way and math.isfinite(psi) else None
        if self._earlier is not None:
            home = self._earlier.home or home
        begun = _Begun(here, fingerprint, settings.style, settings.dry_run, home, [])
        left = {step.name: missions[step.name] for step in steps if step.ending == "open" and step.name in missions}
        announced = Intentions(tuple(self._announcement(visit, steps, left)))
        return _Plan(begun, tuple(steps), parameters, announced, str(vehicle))

    def _rechecks(self, steps: Sequence[JobStep], done: dict[str, JobStep], craft: MavlinkCraft) -> Iterator[JobStep]:
        """Yield the rechecks of the loops on which another one stands."""
        names = {step.name for step in steps if step.ending != "rejected"}
        under = [below for name in names for below in TUNABLES[name].after or () if below in names]
        pace = pace_of(craft.steered_by)
        for name in TUNABLES:
            if name in under and not self._settings.dry_run:
                again = f"recheck {name}"
                seconds = pace.check + 3.0 * pace.relay + self._between(craft)
                yield done.get(again) or JobStep(again, seconds=seconds)

    def _between(self, craft: MavlinkCraft, *, is_first: bool = False) -> float:
        """Return the time [s] before a step: connecting, and the return of a boat with two turns."""
        if is_first or not craft.firmware.needs_way:
            return SETTING_OUT_TIME
        return SETTING_OUT_TIME + AWAY + 2.0 * (TO_COME_ABOUT + pace_of(craft.steered_by).turn)

    def _announcement(
        self, visit: Visit[MissionLog], steps: Sequence[JobStep], left: dict[str, Mission]
    ) -> Iterator[Intention]:
        craft, settings = visit.craft, self._settings
        flown = [step for step in steps if step.ending == "open"]
        back = ", with a return to the start in between" if craft.firmware.needs_way else ""
        used = sorted({mode for mission in left.values() for mode in mission.modes})
        modes = in_modes(used, craft.mode, "after each step") if used else None  # None: only rechecks are left
        armed = arming(craft, "" if modes is None else modes.brief)
        yield replace(armed, text=f"{armed.text}, for each step")
        if modes is not None:
            yield modes
        order = ", ".join(step.name for step in flown)
        yield Intention(f"tune in this order: {order}{back}", "Order", order)
        for step in steps:
            if step.ending == "rejected":
                yield Intention(f"not tune {step.name}: {step.reason}", f"Not {step.name}", in_short(step.reason))
        for name, mission in left.items():
            brief = mission.moves_briefly or mission.movements
            yield Intention(f"move for {name}: {mission.movements}", name.capitalize(), brief)
            space = mission.needs[0]
            yield replace(space, text=f"{space.text} (for {name})")
        again = [step.name for step in flown if step.is_recheck]
        if again:
            limit = settings.envelope.distance_limit
            within = f", up to {limit:.0f} m from the start" if math.isfinite(limit) else ""
            brief = f"relays on the set-point, and the tune's step{within}"
            yield Intention(f"move for {' and '.join(again)}: {brief}", "Recheck", brief)
        deep = [name for name in left if excitation_of(axis_kind(TUNABLES[name].axis).dof).below_surface]
        if deep and not craft.firmware.floats:
            dive = f"to {WORKING_DEPTH:g} m before {' and '.join(deep)}, if it is shallower than {SHALLOW:g} m by then"
            yield Intention(f"dive {dive}", "Dive", dive)
        if deep and not craft.firmware.floats and len(left) > 1:
            sunk = "by as much as the vehicle sinks between the steps"
            yield Intention(f"go deeper {sunk}", "Deeper", sunk)
        seconds = sum(step.seconds for step in flown)
        each = ", ".join(f"{step.name} {exactly(step.seconds)}" for step in flown)
        brief = f"about {exactly(seconds)} of the vehicle's time"
        yield Intention(f"take {brief}: {each}", "Time", brief)
        yield battery(craft.observe(), settings.envelope, seconds)
        yield styled(settings.style)
        written = (
            "no parameter (dry run)"
            if settings.dry_run
            else "gains of these loops without asking again. Each step keeps new ones only if they prove better, and "
            "restores the old ones otherwise"
        )
        brief = written if settings.dry_run else "gains, without asking again; only better ones stay"
        yield Intention(f"write {written}", "Writes", brief)

    def _done(self, craft: MavlinkCraft) -> dict[str, JobStep]:
        """Return the finished steps of the job that is resumed; check that its vehicle has not changed since.

        Raises
        ------
        WrongVehicle, PreconditionFailed
            It is another vehicle, or has other parameters.
        """
        earlier = self._earlier
        assert earlier is not None and craft.session.vehicle is not None
        strange = difference(earlier.vehicle, earlier.fingerprint, craft.session.vehicle, craft.parameters)
        if strange:
            raise WrongVehicle(f"{self._path} is of another vehicle ({strange}). Start again without --resume")
        steps = [JobStep(**step) for step in earlier.steps]
        kept: dict[str, float] = {}
        for step in steps:
            if step.ending == "kept":
                after = load_json(self._path / step.directory / AFTER, "parameters")
                kept |= {name: float(after[name]) for name in step.gains or {} if name in after}
        now = craft.parameters.read_existing(list(kept), as_is=True)
        other = [f"{n} {v:g} then, {now.get(n, math.nan):g} now" for n, v in kept.items() if not _same(v, now.get(n))]
        if other:
            raise PreconditionFailed(
                f"the vehicle's parameters have changed since {self._path} ({', '.join(other)}). Restore them, or "
                "start again without --resume"
            )
        return {step.name: step for step in steps if step.is_done}

    # --- the steps ------------------------------------------------------------------------------------------------

    def _fly(self, plan: _Plan) -> None:
        is_first = self._earlier is None
        for k, step in enumerate(self._steps):
            if step.ending != "open":
                continue
            if self._operator.stop_requested():
                raise OperatorStopped("stopped between two steps. The vehicle is as the last step left it")
            why = self._why_not(step)
            if why:
                self._steps[k] = replace(step, ending="skipped", reason=why)
                self._observer.say(f"{step.name}: not flown, {why}")
                continue
            self._show(flying=step.name)
            begun = self._link.clock.now()
            if not is_first and plan.begun.home is not None:
                self._return(plan.begun.home)
            is_first = False
            self._observer.say(f"step {k + 1} of {len(self._steps)}: {step.name}")
            flown = self._flown(step)
            self._steps[k] = replace(flown, took=self._link.clock.now() - begun)
            self._save(plan)
            self._show()

    def _why_not(self, step: JobStep) -> str:
        """Return why *step* is not flown, or an empty string."""
        endings = {s.name: s.ending for s in self._steps}
        if step.is_recheck:
            name = step.name.removeprefix("recheck ")
            above = [row.name for row in TUNABLES.values() if name in (row.after or ())]
            if endings.get(name) != "kept":
                return f"because {name} has no new gains"
            if not any(endings.get(other) == "kept" for other in above):
                return "because nothing has changed since its own proof"
            return ""
        failed = ("aborted", "rejected", "skipped")
        below = [name for name in TUNABLES[step.name].after or () if endings.get(name) in failed]
        return f"because it stands on {' and '.join(below)}" if below else ""

    def _flown(self, step: JobStep) -> JobStep:
        """Fly *step* and return it with its result."""
        path = self._next(step.name.replace(" ", "-"))
        step = replace(step, directory=path.name)
        try:
            if step.is_recheck:
                return self._rechecked(step, path)
            row = TUNABLES[step.name]
            settings = replace(self._of(row), directory=path, resume=self._interrupted(step.name))
            job_of(row.name).run(settings, self._operator, self._observer, self._moment())
        except GOES_ON as error:
            self._observer.say(f"{step.name}: {error}")
            return replace(_summarised(step, path), ending="aborted", reason=str(error))
        except BaseException as error:
            self._steps[[s.name for s in self._steps].index(step.name)] = replace(
                _summarised(step, path), ending="aborted", reason=str(error)
            )
            raise
        return _summarised(step, path)

    def _rechecked(self, step: JobStep, path: Path) -> JobStep:
        axis = AXES[step.name.removeprefix("recheck ")]
        common = replace(self._of(TUNABLES[axis.name]), directory=path, resume=None)
        plan = FlightPlan.of(FlySettings("set-point-relay", common, {}, 1, None, None, axis.names.force))
        found = recheck(plan, axis_kind(axis.name), self._operator, self._observer, self._moment(), self._path)
        metrics = (
            None if n is None else {"overshoot": n.overshoot, "settling": n.settling} for n in (found.then, found.now)
        )
        before, after = metrics
        return replace(step, ending=found.kind, reason=found.text, before=before, after=after)

    def _return(self, home: tuple[float, float, float]) -> None:
        """Take a boat back to its start, where it arrives with nearly the heading of the start."""
        settings = self._of(TUNABLES["speed"])
        record, log = RunDirectory(self._next("return")), MissionLog(self._observer)
        visit = visiting(settings, self._operator, log, record, settings.axis)
        try:
            run_mission(visit, partial(_way_back, settings, home), log)
        except GOES_ON as error:  # the next step checks its space itself
            self._observer.say(f"{BACK}: {error}")

    def _show(self, flying: str = "") -> None:
        """Report the state of all steps; *flying* is the name of the present one."""
        self._observer.note(
            StepList(
                tuple(
                    ListedStep(s.name, "flying" if s.name == flying else s.ending, s.reason, s.seconds)
                    for s in self._steps
                )
            )
        )

    # --- files and settings ---------------------------------------------------------------------------------------

    def _of(self, row: Tunable) -> TuneSettings:
        """Return the settings of the step *row*: those of the job, on its link, with the consent given."""
        return replace(self._settings, axis=row.axis, resume=None, agreed=True)

    def _next(self, name: str) -> Path:
        """Return a new directory of the job, numbered in order. The first announcement has number 0, so that the first
        step has number 1.
        """
        taken = [int(path.name[:2]) for path in self._path.glob("[0-9][0-9]-*")] if self._path.exists() else []
        return self._path / f"{max(taken, default=-1) + 1:02d}-{name}"

    def _interrupted(self, name: str) -> Path | None:
        """Return the last run of the step *name* that was interrupted and can be gone on from."""
        if self._earlier is None or "resume" in TUNABLES[name].useless:
            return None
        runs = [path for path in sorted(self._path.glob(f"[0-9][0-9]-{name}")) if (path / SETTING_OUT).exists()]
        return runs[-1] if runs else None

    def _save(self, plan: _Plan) -> None:
        job = RunDirectory(self._path)
        if plan.parameters and not (self._path / SAVED).exists():
            job.save_parameters("before", plan.parameters)
        begun = {name: getattr(plan.begun, name) for name in plan.begun.__struct_fields__}
        job.save_json(JOB, {**begun, "steps": [step.to_dict() for step in self._steps]})

    def _report(self, story: JobStory) -> None:
        document = job_document(story)
        try:
            (self._path / SUMMARY).write_text(json_text(to_json(document)), encoding="utf-8")
            save_page(self._path, document)
        except (OSError, BadFile) as error:
            self._observer.say(f"the report could not be written to {self._path}: {error}")


def _read(settings: TuneSettings) -> _Begun:
    """Return the job to resume.

    Raises
    ------
    UsageError
        It is not a job, or was started with another style or dry run.
    PreconditionFailed
        One of its runs has not restored its vehicle.
    """
    path = settings.resume
    assert path is not None
    if not (path / JOB).exists():
        raise UsageError(f"{path} cannot be resumed by `tune all`: it contains no {JOB}. Start again without --resume")
    begun = conformed(load_json(path / JOB, "the state of a job"), _Begun, path / JOB)
    for name in ("style", "dry_run"):
        then, now = getattr(begun, name), getattr(settings, name)
        if then != now:
            raise UsageError(f"{path} was started with {name.replace('_', '-')} {then}, not {now}. Use the same")
    for journal in sorted(path.glob(f"*/{JOURNAL}")):
        if not Journal.read(journal).is_settled:
            raise PreconditionFailed(
                f"{journal.parent} has not restored everything. "
                f"First run `gcs-autotune restore {shlex.quote(str(path))}`"
            )
    return begun


def _summarised(step: JobStep, path: Path) -> JobStep:
    """Return *step* with the result in its run directory."""
    try:
        told = load_json(path / SUMMARY, "a summary")
    except BadFile:
        return step
    metrics = told.get("track") or told.get("metrics") or {}
    gains = {name: (float(old), float(new)) for name, (old, new) in (told.get("gains") or {}).items()}
    before, after = metrics.get("before"), metrics.get("after")
    return replace(step, ending=told["ending"], reason=told["reason"], gains=gains, before=before, after=after)


def _way_back(settings: TuneSettings, home: tuple[float, float, float], visit: Visit[MissionLog]) -> Mission:
    """Return the mission that takes a boat to its start: to a place astern of it first, so that it arrives ahead."""
    craft = visit.craft
    fix, now = craft.telemetry.fix, craft.observe()
    if fix is None:
        raise PreconditionFailed("the vehicle reports no latitude and longitude, so it does not return to the start")
    axis = craft.firmware.axes[settings.axis]
    throttle, speed = speed_for(settings, axis, axis.names.to_canonical(craft.parameters.read_existing(axis.context)))
    north, east = flat(home[0], home[1], fix)
    x, y, psi = now.x + float(north), now.y + float(east), home[2]
    run_up = TO_COME_ABOUT * speed
    places = ((x - run_up * math.cos(psi), y - run_up * math.sin(psi)), (x, y))
    seconds = (math.hypot(places[0][0] - now.x, places[0][1] - now.y) + run_up) / max(speed, 0.1)
    runner = visit.runner(replace(settings.envelope, cruise=speed, heading_excursion=math.inf), visit.keep)

    def fly(_: Any) -> None:
        for place in places:
            runner.fly(ComeBack(*place, throttle), BACK)

    return Mission(
        itinerary=Itinerary([Leg(BACK, seconds)]),
        modes=(craft.firmware.manual_mode,),
        movements=BACK,
        needs=(Intention(f"take about {exactly(seconds)}", "Time", f"about {exactly(seconds)}"),),
        fly=fly,
    )


def _same(a: float, b: float | None) -> bool:
    return b is not None and same_float32(a, b)
