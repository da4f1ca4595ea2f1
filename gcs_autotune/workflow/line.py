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
    OnLeg,
    TrackMetrics,
    current_on,
    follows_better,
    line_changes,
    pivots_wide,
    style_of,
    too_short,
    track_metrics,
)
from gcs_autotune.errors import AutotuneError, NotInformative, PreconditionFailed, WrongVehicle
from gcs_autotune.frames import from_flat
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.limits import limit_of
from gcs_autotune.link import (
    Journal,
    MavlinkCraft,
    MissionLoan,
    StoredMission,
    set_current,
    waypoint,
)
from gcs_autotune.manoeuvres import NEARLY, TO_COME_ABOUT, Envelope, FlyMission, ProofCourse, how_far
from gcs_autotune.observer import Intention, Observer
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.announcement import battery, how_long, some_of
from gcs_autotune.workflow.autopilot_loop import lend_parameters
from gcs_autotune.workflow.background import run_in_background
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.identification import delay_of
from gcs_autotune.workflow.itinerary import Itinerary, Leg
from gcs_autotune.workflow.mission import Mission, Visit
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, tune_loop
from gcs_autotune.workflow.tune import TuneJob, fly_job, read_back
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["JOB", "tune_line"]

SECONDS, LEAST_LEG, MOST_LEG = 25.0, 30.0, 120.0
"""Length of a leg at the working speed [s], and its limits [m]. Project choice: a slow boat is on its line by then."""
Place = tuple[float, float]
SWING = 8.0
"""How far a boat goes beyond a corner before the flight ends early [s at the working speed]. Project choice."""
BEYOND = 20.0
"""Free water around the course [s at the working speed]. Project choice: Charlie goes 19 m beyond a corner."""
LATE, SLOWEST = 1.4, 0.33
"""Expected duration of a flight, relative to its way at the working speed; slowest speed to a waypoint, relative to the
working speed. Project choice."""
DRIFT = 0.8
"""Largest drift at rest, relative to the working speed, against which a mission is flown. Project choice, as for
``authority``."""
SHORTEST = limit_of("leg-length").least
"""Shortest possible leg [m]."""
FULL = 0.9
"""Largest steering output that corners may need [fraction of full]."""
NEEDED = ("PSC_POS_P", "PSC_VEL_P", "WP_RADIUS", "WP_SPEED")
CONTEXT = ("MOT_THR_MIN", "MOT_THST_EXPO")
BEFORE, AFTER = "mission with present parameters", "mission with new parameters"
"""The stages."""
UNTUNED: Mapping[str, Mapping[str, float]] = {
    "speed": {"ATC_SPEED_P": 0.2, "ATC_SPEED_I": 0.2},
    "heading": {"ATC_STR_RAT_FF": 0.2, "ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": 0.2},
}
"""Axis -> ArduRover's own gains. A boat that has all of them was not tuned."""


def tune_line(settings: TuneSettings, operator: Operator, observer: Observer, when: str) -> TuneStory:
    """Tune the line and return its story; the run directory holds everything on every ending.

    Raises
    ------
    WrongVehicle
        It is not a boat, or its firmware lacks the parameters.
    PreconditionFailed
        Speed or heading are not tuned, or there is not enough space.
    AutotuneError
        What ended it early. By then vehicle and mission are as before (or ``NotAsFound`` states what is not).
    """
    return fly_job(_declare, settings, operator, observer, when, name="line", dofs=("yaw",))


def _declare(settings: TuneSettings, visit: Visit[TuneLog]) -> Mission:
    """Return what this tune will do on the vehicle of *visit*; nothing moves yet."""
    craft, log = visit.craft, visit.log
    firmware = craft.firmware
    if not (firmware.needs_way and firmware.mission_mode):
        raise WrongVehicle(
            f"this vehicle ({firmware.name}) follows no route that can be tuned. `tune line` is for ArduRover boats"
        )
    log.meet(craft)
    present, untuned = _learn(craft)
    if untuned and not settings.untuned:
        raise PreconditionFailed(f"{untuned}. To fly all the same, add --untuned")
    if untuned:
        log.say(f"{untuned} (--untuned: flown all the same)")
    log.parameters_before = present
    craft.parameters.watch(present)
    log.say(f"present parameters saved to {visit.record.save_parameters('before', present)}")
    speed = present.get("WP_SPEED", 0.0) or present.get("CRUISE_SPEED", 0.0)
    if not speed > 0.0:
        raise PreconditionFailed("WP_SPEED and CRUISE_SPEED are both 0, so AUTO does not drive. Set WP_SPEED first")
    envelope = replace(settings.envelope, cruise=speed, heading_excursion=math.inf)
    envelope = replace(envelope, area=area_of_flight(craft, envelope.area, log))
    length = settings.leg_length or min(max(SECONDS * speed, LEAST_LEG), MOST_LEG)
    now = craft.observe()
    course = ProofCourse(now.x, now.y, now.psi, length)
    _check_drift(craft, speed, now)
    _check_space(course, speed, envelope, now)
    seconds = LATE * course.way / speed
    legs = [Leg(BEFORE, seconds, kind="mission")] + [Leg(AFTER, seconds, kind="mission")] * (not settings.dry_run)
    itinerary = Itinerary(legs)

    def keep(trial: Trial) -> None:
        visit.keep(trial)
        log.flown(trial)
        log.say_ending(trial)

    def fly(journal: Journal) -> None:
        with MissionLoan(craft.session, journal, partial(_busy, craft)) as mission:
            mission.set(_mission(course, craft, now))
            flown.append(mission)
            log.say("the proof mission is uploaded. The vehicle's own mission is stored and will be restored")
            tune_loop(_Line(flights, settings, present), log, visit.agrees, journal, dry_run=settings.dry_run)

    def finish() -> None:
        read_back(lambda: _learn(craft)[0], visit)
        for mission in flown:
            _set_item(craft, mission, log)

    flown: list[MissionLoan] = []
    runner = visit.runner(envelope, keep, gains=True)
    flights = _Flights(visit, runner, course, speed)
    names = [name for name in LINE_PARAMETERS if name in present]
    corners = f"{100.0 * style_of(settings.style).bandwidth:.0f} % of the turn rate that the hull has in corners"
    sentence, briefly = some_of(names, asks=not settings.agreed)
    ahead, back = course.reach + BEYOND * speed, BEYOND * speed
    free = f"{ahead:.0f} m of free water ahead and to starboard, and {back:.0f} m to port and astern"
    return Mission(
        itinerary=itinerary,
        modes=(firmware.mission_mode, firmware.manual_mode, firmware.rest_mode),
        movements=(
            f"a mission with legs of {length:.0f} m and corners of 90, 150 and 180 deg, flown "
            f"{'once' if settings.dry_run else 'twice'} at {speed:.1f} m/s. The mission replaces the vehicle's own one "
            "during the run"
        ),
        needs=(
            Intention(f"need {free}. A smaller --leg-length needs less", "Space", free),
            how_long(itinerary),
            battery(now, envelope, itinerary.seconds),
            Intention(
                f"choose parameters for style {settings.style}: {corners}", "Style", f"{settings.style}: {corners}"
            ),
        ),
        fly=fly,
        writes="write no parameter (dry run)" if settings.dry_run else sentence,
        moves_briefly=f"a mission of {length:.0f} m legs at {speed:.1f} m/s, in place of the vehicle's own",
        writes_briefly="" if settings.dry_run else briefly,
        finish=finish,
    )


def _learn(craft: MavlinkCraft) -> tuple[dict[str, float], str]:
    """Return the parameters that are changed or needed, as far as the vehicle has them, and why they are not tuned.

    Raises
    ------
    WrongVehicle
        It lacks those that every ArduRover of 4.2 and later has.
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
    told = ""
    if untuned:
        has = "; ".join(", ".join(f"{n} {found[n]:g}" for n in UNTUNED[axis]) for axis in untuned)
        commands = ", then ".join(f"`gcs-autotune tune {axis}`" for axis in untuned)
        told = f"{' and '.join(untuned)} not tuned: the vehicle has ArduRover's own gains ({has}). Run {commands} first"
    return {name: value for name, value in found.items() if name not in gains}, told


def _check_drift(craft: MavlinkCraft, speed: float, now: Observation) -> None:
    """Check that a boat at rest does not drift nearly as fast as AUTO drives.

    Raises
    ------
    PreconditionFailed
        It does.
    """
    if not craft.armed and now.speed > DRIFT * speed:
        raise PreconditionFailed(
            f"the boat drifts at {now.speed:.1f} m/s at rest, and AUTO drives at {speed:.1f} m/s. A current or wind of "
            f"up to {DRIFT * speed:.1f} m/s is accepted. Wait for less, or raise WP_SPEED if the boat is fast enough"
        )


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
    seconds = LATE * course.way / speed
    if seconds > envelope.time:
        raise PreconditionFailed(
            f"one flight takes about {seconds:.0f} s, and --max-time is {envelope.time:.0f} s. Use a smaller "
            f"--leg-length or --max-time {math.ceil(seconds)}"
        )
    out = _beyond(course, speed, envelope)
    if envelope.area is not None and out > 0.0:
        raise PreconditionFailed(
            f"the course leaves {envelope.area.source} by {how_far(out)}. {_what_fits(course, speed, envelope)}"
        )


def _beyond(course: ProofCourse, speed: float, envelope: Envelope) -> float:
    """Return how far [m] the course leaves the area, with the distance in which the boat turns around; 0 inside."""
    if envelope.area is None:
        return 0.0
    ahead = [place for leg in itertools.pairwise(course.waypoints) for place in _ends(*leg, TO_COME_ABOUT * speed)]
    return max(envelope.area.beyond(*place) for place in ahead)


def _what_fits(course: ProofCourse, speed: float, envelope: Envelope) -> str:
    """Return which heading, or else which length of the legs, fits into the area."""
    turns = sorted((math.radians(10.0 * k) for k in range(-17, 19)), key=abs)
    lengths = [
        course.length,
        *(0.1 * k * course.length for k in range(9, 0, -1) if k * course.length >= 10.0 * SHORTEST),
    ]
    for length, turn in itertools.product(lengths, turns):
        tried = replace(course, length=length, psi=course.psi + turn)
        if not _beyond(tried, speed, envelope):
            shorter = f"with --leg-length {length:.0f} and " if length < course.length else "with "
            return f"It fits {shorter}the bow at {math.degrees(tried.psi) % 360.0:.0f} deg"
    return "No course fits here. Take the boat to more open water, or use a larger area"


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
        return self.runner.fly(FlyMission(self.course.waypoints, SLOWEST * self.speed, name), stage)


def _route(trial: Trial) -> tuple[list[complex], list[float]]:
    """Return the ends of the legs [m, north + i east] and when the autopilot turned there [s]; the run-in is left out.

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
    return [places[k - 1] for k in legs], [marks[k + 1] for k in legs]


def _measured(trial: Trial) -> TrackMetrics:
    """Return the metrics of a flight, from its record; errors as for :func:`_route`."""
    x, y = trial["x"], trial["y"]
    return track_metrics(x.t, x.values + 1j * np.interp(x.t, y.t, y.values), *_route(trial))


def _on_legs(trial: Trial) -> tuple[OnLeg, ...]:
    """Return how the boat drove the third quarter of each leg; errors as for :func:`_route`."""
    x, found = trial["x"], []
    place, psi, ahead = (
        x.values + 1j * np.interp(x.t, trial["y"].t, trial["y"].values),
        np.interp(x.t, trial["psi"].t, trial["psi"].values),
        np.interp(x.t, trial["X"].t, trial["X"].values),
    )
    places, turned = _route(trial)
    for k in range(1, len(places)):
        along = ((place - places[k - 1]) / (places[k] - places[k - 1])).real
        on = (x.t >= turned[k - 1]) & (x.t < turned[k]) & (along > 0.5) & (along < 0.75)
        if np.count_nonzero(on) > 1:
            velocity = (place[on][-1] - place[on][0]) / (x.t[on][-1] - x.t[on][0])
            found.append(OnLeg(float(np.mean(psi[on])), complex(velocity), float(np.mean(ahead[on]))))
    return tuple(found)


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
        return _learn(self._craft)[0]

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
            f"the hull turns at up to {math.degrees(hull.rate):.0f} deg/s at {hull.speed:.1f} m/s, with a radius of "
            f"{hull.radius:.1f} m and a lag of {hull.lag:.1f} s"
        )
        current = abs(current_on(hull.legs))
        self._log.say(f"estimated current on the legs, with the leeway by wind: {current:.2f} m/s")
        self._log.given_changes = tuple(line_changes(hull, self._present))
        return Offer(self._log.given_changes, too_short(hull, self._flights.course.length))

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
        wide = pivots and before is not None and pivots_wide(before, speed / rate)
        return HullTurn(speed, rate, lag, pivots, wide, _on_legs(self._before), style_of(self._tune.style).bandwidth)


JOB = TuneJob(tune_line, _declare)
