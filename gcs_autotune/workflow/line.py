"""``tune line``: how a boat in AUTO follows the legs of a mission and rounds their corners.

The order is that of every tune (``tunable_loop``). The proof is a mission that is uploaded for the run; the vehicle's
own mission is restored on every ending. The hull's turning is identified from the flight with the present parameters.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.craft import Observation
from gcs_autotune.design import (
    LINE_PARAMETERS,
    HullTurn,
    TrackMetrics,
    follows_better,
    line_changes,
    track_metrics,
)
from gcs_autotune.errors import AutotuneError, NotInformative, PreconditionFailed, WrongVehicle
from gcs_autotune.frames import from_flat
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.link import (
    Journal,
    MavlinkCraft,
    MissionLoan,
    StoredMission,
    set_current,
    waypoint,
)
from gcs_autotune.manoeuvres import NEARLY, TO_COME_ABOUT, Envelope, FlyMission, ProofCourse
from gcs_autotune.observer import Observer
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.announcement import battery, how_long
from gcs_autotune.workflow.autopilot_loop import lend_parameters
from gcs_autotune.workflow.background import run_in_background
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.identification import delay_of
from gcs_autotune.workflow.itinerary import Itinerary, Leg
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, tune_loop
from gcs_autotune.workflow.tune import TuneJob, leave_report, read_back
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["LineSettings", "tune_line"]

SECONDS, LEAST_LEG, MOST_LEG = 25.0, 30.0, 120.0
"""Length of a leg at the working speed [s], and its limits [m]. Project choice: a slow boat is on its line by then."""
Place = tuple[float, float]
SWING = 8.0
"""How far a boat goes beyond a corner before the flight ends early [s at the working speed]. Project choice."""
BEYOND = 20.0
"""Free water around the course [s at the working speed]. Project choice: Charlie goes 19 m beyond a corner."""
LATE, LATEST = 1.4, 3.0
"""Expected and longest duration of a flight, relative to its way at the working speed. Project choice."""
FULL = 0.9
"""Largest steering output that corners may need [fraction of full]."""
NEEDED = ("PSC_POS_P", "PSC_VEL_P", "WP_RADIUS", "WP_SPEED")
CONTEXT = ("CRUISE_SPEED", "CRUISE_THROTTLE", "WP_SPEED")
BEFORE, AFTER = "mission with present parameters", "mission with new parameters"
"""The stages."""
UNTUNED: Mapping[str, Mapping[str, float]] = {
    "speed": {"ATC_SPEED_P": 0.2, "ATC_SPEED_I": 0.2},
    "heading": {"ATC_STR_RAT_FF": 0.2, "ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": 0.2},
}
"""Axis -> ArduRover's own gains. A boat that has all of them was not tuned."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """One tune of the line: the settings that every tune has, and the length of a ``leg`` [m] (None: by its speed)."""

    tune: TuneSettings
    leg: float | None = None


def tune_line(settings: LineSettings, operator: Operator, observer: Observer, when: str) -> TuneStory:
    """Tune the line and return its story; the run directory holds everything on every ending.

    Raises
    ------
    WrongVehicle
        It is no boat, or its firmware lacks the parameters.
    PreconditionFailed
        Speed or heading are not tuned, or there is not enough space.
    AutotuneError
        What ended it early. By then vehicle and mission are as before (or ``NotAsFound`` states what is not).
    """
    tune = settings.tune
    record, log = RunDirectory(tune.directory), TuneLog(tune, when, observer, "line")
    visit = visiting(tune, operator, log, record, tune.axis, dofs=("yaw",))
    try:
        run_mission(visit, partial(_declare, settings), log)
    finally:
        leave_report(log, record)
    return log.story()


def _declare(settings: LineSettings, visit: Visit[TuneLog]) -> Mission:
    """Return what this tune will do on the vehicle of *visit*; nothing moves yet."""
    craft, log, tune = visit.craft, visit.log, settings.tune
    firmware = craft.firmware
    if not (firmware.needs_way and firmware.mission_mode):
        raise WrongVehicle(f"{firmware.name} has no mission of a boat to tune. `tune line` is for ArduRover boats")
    log.meet(craft)
    present = _learn(craft)
    log.parameters_before = present
    craft.parameters.watch(present)
    log.say(f"present parameters saved to {visit.record.save_parameters('before', present)}")
    speed = present.get("WP_SPEED", 0.0) or present.get("CRUISE_SPEED", 0.0)
    if not speed > 0.0:
        raise PreconditionFailed("WP_SPEED and CRUISE_SPEED are both 0, so AUTO does not drive. Set WP_SPEED first")
    envelope = replace(tune.envelope, cruise=speed, heading_excursion=math.inf)
    envelope = replace(envelope, area=area_of_flight(craft, envelope.area, log))
    length = settings.leg or min(max(SECONDS * speed, LEAST_LEG), MOST_LEG)
    now = craft.observe()
    course = ProofCourse(now.x, now.y, now.psi, length)
    _check_space(course, speed, envelope, now)
    seconds = LATE * course.way / speed
    legs = [Leg(BEFORE, seconds, kind="mission")] + [Leg(AFTER, seconds, kind="mission")] * (not tune.dry_run)
    itinerary = Itinerary(legs)

    def keep(trial: Trial) -> None:
        visit.keep(trial)
        log.flown(trial)
        log.say(f"{trial.name}: {trial.ending}, {trial.reason}")

    def fly(journal: Journal) -> None:
        with MissionLoan(craft.session, journal, partial(_busy, craft)) as mission:
            mission.set(_mission(course, craft, now))
            flown.append(mission)
            log.say("the proof mission is uploaded; the vehicle's own one is in the journal")
            tune_loop(_Line(flights, tune, present), log, visit.agrees, journal, dry_run=tune.dry_run)

    def finish() -> None:
        read_back(partial(_learn, craft), visit)
        for mission in flown:
            _set_item(craft, mission, log)

    flown: list[MissionLoan] = []
    runner = visit.runner(envelope, keep, gains=True)
    flights = _Flights(visit, runner, course, speed)
    names = ", ".join(name for name in LINE_PARAMETERS if name in present)
    changes = f"write some of {names}, after asking again, and restore the old values unless the new ones prove better"
    return Mission(
        itinerary=itinerary,
        modes=(firmware.mission_mode, firmware.manual_mode, firmware.rest_mode),
        movements=(
            f"a mission with legs of {length:.0f} m and corners of 90, 150 and 180 deg, flown "
            f"{'once' if tune.dry_run else 'twice'} at {speed:.1f} m/s. The mission replaces the vehicle's own one "
            "during the run"
        ),
        needs=(
            f"need {course.reach + BEYOND * speed:.0f} m of free water ahead and to starboard, and "
            f"{BEYOND * speed:.0f} m to port and astern. A smaller --leg-length needs less",
            how_long(itinerary),
            battery(now, envelope, itinerary.seconds),
        ),
        fly=fly,
        writes="write no parameter (dry run)" if tune.dry_run else changes,
        finish=finish,
    )


def _learn(craft: MavlinkCraft) -> dict[str, float]:
    """Return the parameters that are changed or needed, as far as the vehicle has them.

    Raises
    ------
    WrongVehicle
        It lacks those that every ArduRover of 4.2 and later has.
    PreconditionFailed
        Speed or heading are not tuned.
    """
    gains = [name for axis in UNTUNED.values() for name in axis]
    found = craft.parameters.read_existing([*LINE_PARAMETERS, *CONTEXT, *gains])
    missing = [name for name in NEEDED if name not in found]
    if missing:
        raise WrongVehicle(
            f"{craft.session.vehicle} has no parameter {', '.join(missing)}. `tune line` needs ArduRover 4.2 or later"
        )
    untuned = [
        axis
        for axis, own in UNTUNED.items()
        if all(math.isclose(found.get(name, math.nan), value, rel_tol=1e-3) for name, value in own.items())
    ]
    if untuned:
        has = "; ".join(", ".join(f"{n} {found[n]:g}" for n in UNTUNED[axis]) for axis in untuned)
        commands = ", then ".join(f"`gcs-autotune tune {axis}`" for axis in untuned)
        raise PreconditionFailed(
            f"{' and '.join(untuned)} not tuned: the vehicle has ArduRover's own gains ({has}). Run {commands} first"
        )
    return {name: value for name, value in found.items() if name not in gains}


def _check_space(course: ProofCourse, speed: float, envelope: Envelope, now: Observation) -> None:
    """Check that there is a position, and space for the course.

    Raises
    ------
    PreconditionFailed
        There is not; with the nearest number that is possible.
    """
    if not math.isfinite(now.x + now.y + now.psi):
        raise PreconditionFailed("the vehicle reports no position, so no mission can be flown. Check its GPS")
    limit = envelope.distance_limit
    needs = max(course.reach + BEYOND * speed, (course.reach + SWING * speed) / NEARLY)
    if needs > limit:
        leg = course.length * (limit - BEYOND * speed) / course.reach
        smaller = f"--leg-length {leg:.0f} or " if leg >= 2.0 * BEYOND else ""
        raise PreconditionFailed(
            f"the mission goes up to {needs:.0f} m from the start, and --max-distance is {limit:.0f} m. Use {smaller}"
            f"--max-distance {math.ceil(needs)}"
        )
    ahead = [place for leg in itertools.pairwise(course.waypoints) for place in _ends(*leg, TO_COME_ABOUT * speed)]
    if LATE * course.way / speed > envelope.time:
        raise PreconditionFailed(
            f"one flight takes about {LATE * course.way / speed:.0f} s, and --max-time is {envelope.time:.0f} s. Use a "
            "smaller --leg-length or a larger --max-time"
        )
    if envelope.area is not None and any(envelope.area.beyond(*place) > 0.0 for place in ahead):
        raise PreconditionFailed(
            f"the course does not fit into {envelope.area.source}. Turn the boat so that the free water is ahead "
            "and to starboard, or use a smaller --leg-length"
        )


def _ends(begin: Place, end: Place, metres: float) -> tuple[Place, Place]:
    """Return the end of a leg, and the place *metres* beyond it."""
    share = 1.0 + metres / max(math.dist(begin, end), 1.0)
    return end, (begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1]))


def _busy(craft: MavlinkCraft) -> str:
    mode = craft.firmware.mission_mode
    return f"the vehicle is in {mode} by order of another operator" if craft.mode == mode else ""


def _set_item(craft: MavlinkCraft, mission: MissionLoan, log: TuneLog) -> None:
    """Set the item of the restored mission once more: ArduRover resets it when it disarms."""
    try:
        with craft.shielded():
            if not craft.armed:
                mission.rewind()
    except AutotuneError as error:
        log.say(f"the current item of the mission could not be restored: {error}")


def _mission(course: ProofCourse, craft: MavlinkCraft, now: Observation) -> StoredMission:
    """Return *course* as a mission, with home as item 0.

    Raises
    ------
    PreconditionFailed
        The vehicle reports no latitude and longitude.
    """
    fix = craft.telemetry.fix
    if fix is None:
        raise PreconditionFailed("the vehicle reports no latitude and longitude (GLOBAL_POSITION_INT). Check its GPS")
    here = craft.telemetry.value("x"), craft.telemetry.value("y")
    places = [from_flat(x - here[0], y - here[1], fix) for x, y in ((now.x, now.y), *course.waypoints)]
    return StoredMission(tuple(waypoint(*place) for place in places), 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Flights:
    """Flies the mission on the vehicle of *visit*."""

    visit: Visit[TuneLog]
    runner: ManoeuvreRunner
    course: ProofCourse
    speed: float

    def fly(self, name: str, stage: str) -> Trial:
        """Fly it from its first item on."""
        self.visit.log.say(stage)
        set_current(self.visit.craft.session, 1)
        patience = LATEST * self.course.way / self.speed
        return self.runner.fly(FlyMission(self.course.waypoints, patience, name), stage)


def _measured(trial: Trial) -> TrackMetrics:
    """Return the metrics of a flight, from its record; the run-in does not count.

    Raises
    ------
    PreconditionFailed
        The record lacks a waypoint: messages were lost.
    """
    places = [complex(x, y) for x, y in zip(trial.meta["waypoints_x"], trial.meta["waypoints_y"], strict=True)]
    marks = {int(m.detail["item"]): m.t for m in trial.marks if m.kind == "waypoint"}
    legs = range(2, len(places))  # items of the legs' ends; the autopilot turned from item k to k + 1 there
    missing = [k for k in legs if k + 1 not in marks]
    if missing:
        raise PreconditionFailed(
            f"{trial.name}: the vehicle did not report waypoint {missing[0]} as reached (MISSION_CURRENT). Use a "
            "better link"
        )
    x, y = trial["x"], trial["y"]
    track = x.values + 1j * np.interp(x.t, y.t, y.values)
    return track_metrics(x.t, track, [places[k - 1] for k in legs], [marks[k + 1] for k in legs])


class _Line:
    """The line as a tunable loop."""

    name = "line"

    def __init__(self, flights: _Flights, tune: TuneSettings, present: Mapping[str, float]) -> None:
        self._flights, self._tune = flights, tune
        self._present = present
        self._log = flights.visit.log
        self._craft = flights.visit.craft
        self._before: Trial

    def read(self) -> Mapping[str, float]:
        """Return the parameters in place now."""
        return _learn(self._craft)

    def lend(self, journal: Journal) -> GainLoan:
        """Return the transaction on the vehicle's parameters."""
        return lend_parameters(self._craft, journal)

    def experiment(self) -> None:
        """Fly the mission with the present parameters."""
        self._before = self._flights.fly("mission-before", BEFORE)
        self._log.track_before = _measured(self._before)

    def propose(self) -> Offer:
        """Identify how the hull turns, and choose the parameters by the rules."""
        self._log.say("identifying")
        try:
            fit = self._in_background(self._before)
        except NotInformative as error:
            raise NotInformative(f"{self._before.name} does not show how the boat turns: {error}") from error
        self._log.fit = fit
        hull = self._hull(fit)
        self._log.say(
            f"the hull turns with {math.degrees(hull.rate):.0f} deg/s at most at {hull.speed:.1f} m/s, in a radius of "
            f"{hull.radius:.1f} m, with a lag of {hull.lag:.1f} s"
        )
        self._log.given_changes = tuple(line_changes(hull, self._present))
        return Offer(self._log.given_changes)

    def fly_baseline(self) -> None:
        """Nothing else is compared."""

    def prove(self) -> ProofResult:
        """Fly the mission with the new parameters."""
        before = self._log.track_before
        assert before is not None
        after = self._log.track_after = _measured(self._flights.fly("mission-after", AFTER))
        return ProofResult(follows_better(before, after))

    def _in_background(self, trial: Trial) -> AxisFit:
        visit, tune = self._flights.visit, self._tune
        found: AxisFit = run_in_background(
            visit.craft,
            visit.worker,
            self._flights.runner.bear,
            fit_axis,
            [trial],
            dof="yaw",
            structure=tune.structure,
            delay=delay_of(tune),
        )
        return found

    def _hull(self, fit: AxisFit) -> HullTurn:
        """Return what the hull can turn by the model *fit*: the smaller rate of both sides."""
        model, speed = fit.model, self._flights.speed
        rate = min(abs(model.steady_velocity(side * FULL)) for side in (-1.0, 1.0))
        if not (math.isfinite(rate) and rate > 0.0):
            raise NotInformative("the model has no steady turn rate. Fly `tune heading` again")
        lag = abs(model.alpha) / max(abs(model.beta) + abs(model.beta_quadratic) * rate, 1e-6) + model.delay
        pivots = self._craft.skid and self._present.get("WP_PIVOT_ANGLE", 0.0) > 5.0
        before = self._log.track_before
        wide = pivots and before is not None and before.corners[-1] > 0.5 * speed / rate
        return HullTurn(speed, rate, lag, pivots, wide)


JOB = TuneJob(
    lambda settings, operator, observer, when: tune_line(
        LineSettings(settings, settings.leg_length), operator, observer, when
    ),
    lambda settings, visit: _declare(LineSettings(settings, settings.leg_length), visit),
)
