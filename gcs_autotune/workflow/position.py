"""``tune position``: how an ROV that thrusts sideways, or a boat with two side thrusters, holds a position.

The order is that of every tune (``tunable_loop``). The proof is a step ahead and to starboard in GUIDED, and pushes by
the sticks in POSHOLD. Surge and sway are identified from the step with the present gains and a
relay each. The relay shows the delay, which a step does not separate from inertia.

A boat steps ahead and back in GUIDED. ArduRover stays at a position by the rules of LOITER: it drifts within
LOIT_RADIUS and drives back from outside. What pushes it there is the current and the wind.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import (
    LOITER_CONTEXT,
    LOITER_GAINS,
    POSITION_CONTEXT,
    POSITION_GAINS,
    UNSTABLE,
    PositionMetrics,
    Stay,
    design_position,
    holds_better,
    loiter_change,
    position_metrics,
)
from gcs_autotune.errors import NotInformative, PreconditionFailed, WrongVehicle
from gcs_autotune.firmware import Gain, Names, read_named
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.link import Journal, MavlinkCraft
from gcs_autotune.manoeuvres import Manoeuvre, PushPosition, StepPosition
from gcs_autotune.observer import Intention, Observer
from gcs_autotune.report import TuneStory, format_factor
from gcs_autotune.sensor import noise_of
from gcs_autotune.trial import Mark, Trial
from gcs_autotune.workflow.announcement import ROV_ROOM, battery, how_long, some_of
from gcs_autotune.workflow.autopilot_loop import lend_parameters
from gcs_autotune.workflow.background import run_in_background
from gcs_autotune.workflow.experiments import Relays
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.identification import delay_of
from gcs_autotune.workflow.itinerary import Itinerary, Leg, pace_of
from gcs_autotune.workflow.mission import Mission, Visit
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import STAGE, await_position, check_signs, sign_check_for
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, tune_loop
from gcs_autotune.workflow.tune import TuneJob, fly_job, read_back
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["tune_position"]

T = TypeVar("T")
P = ParamSpec("P")
DOFS = {"surge": "ahead", "sway": "sideways"}
"""Motion -> its axis in ``OWN_AXES``, whose relay is flown."""
STEP, DURATION = 1.0, 12.0
"""Step ahead and to starboard [m], and time at each position [s]. Project choice: twice the water around an ROV is
enough, and a BlueROV2 is there after 4 s."""
SETTLE, PUSH_SETTLE, PUSHING = 10.0, 15.0, 8.0
"""Holding before the step and before the pushes, and length of a push and of the rest after it [s]. Project choice: the
integral starts at zero in each mode, and removes a constant force in 6 to 12 s."""
BOAT_STEP, BOAT_SETTLE, BOAT_DURATION, BOAT_HELD = 10.0, 20.0, 60.0, 25.0
"""Step ahead of a boat [m], time before it and at each position, and the end of that time in which it holds [s].
Project choice: a BlueBoat is there after 6 to 15 s."""
BOAT_ROOM = 15.0
"""Free water around a boat beyond the step [m]: to turn around."""
HELD = 5.0
"""End of the hold before the step in which the craft should be still [s]."""
CURRENT = 0.9
"""Largest drift at rest, relative to the greatest commanded speed. Project choice."""
LOOKS = 20
"""Number of observations over which the drift is averaged: its noise becomes 5 mm/s."""
EXPLAINED = 50.0
"""Smallest part of the step's motion that the model must explain [%]. Project choice: thrusters with a dead band leave
a quarter unexplained."""
FELT, AT_ONCE = 0.5, 0.5
"""Share of the push that the output must show, and time within which it does [s], before the hold answers."""
WIDER = 5.0
"""Factor by which ``--beyond-ranges`` widens the documented ranges."""
PROMPT = 5.0
"""Time [s] within which an ROV with a position sensor reports a position, before ``tune all`` announces its steps."""
STAGES: Mapping[str, str] = {"before": "present", "after": "new"}


def tune_position(tune: TuneSettings, operator: Operator, observer: Observer, when: str) -> TuneStory:
    """Tune the position loop and return its story; the run directory holds everything on every ending.

    Raises
    ------
    WrongVehicle
        It does not thrust sideways, or its firmware lacks the parameters.
    PreconditionFailed
        It has no position, or the current is stronger than it.
    AutotuneError
        What ended it early. By then the vehicle is as before (or ``NotAsFound`` states what is not).
    """
    return fly_job(_declare, tune, operator, observer, when, name="position", dofs=tuple(DOFS))


def _declare(tune: TuneSettings, visit: Visit[TuneLog]) -> Mission:
    """Return what this tune will do on the vehicle of *visit*; nothing moves yet."""
    craft, log = visit.craft, visit.log
    firmware = craft.firmware
    _check_suits(craft)
    boat = firmware.needs_way
    log.meet(craft)
    table, context = (LOITER_GAINS, LOITER_CONTEXT) if boat else (POSITION_GAINS, POSITION_CONTEXT)
    loop = _Gains.of(craft, table, context, beyond=tune.beyond_ranges)
    log.parameters_before = loop.read(craft)
    craft.parameters.watch(log.parameters_before)
    log.say(f"present parameters saved to {visit.record.save_parameters('before', log.parameters_before)}")
    await_position(craft, log, firmware.position_mode, *([PROMPT] if tune.untuned else []))
    drift = _drift(craft, loop.present)
    envelope = replace(tune.envelope, area=area_of_flight(craft, tune.envelope.area, log))
    envelope = replace(envelope, heading_excursion=math.inf) if boat else envelope
    size = abs(tune.step) if tune.step is not None else BOAT_STEP if boat else STEP
    duration = tune.step_duration or (BOAT_DURATION if boat else DURATION)
    relays = [Leg(f"first {dof} self-oscillation", pace_of("rov").relay, kind="relay") for dof in DOFS]
    checks = [] if boat else [Leg(STAGE, pace_of("rov").check)]
    relays = [] if boat else relays
    before, after = (_legs(gains, duration, boat=boat) for gains in STAGES.values())
    itinerary = Itinerary([*checks, *before, *relays, *([] if tune.dry_run else after)])

    def keep(trial: Trial) -> None:
        visit.keep(trial)
        log.flown(trial)
        log.say_ending(trial)

    flights = _Flights(visit, visit.runner(envelope, keep, gains=True), tune, size, duration)
    sentence, briefly = some_of([gain.parameter for gain in loop.gains], asks=not tune.agreed)
    times = "once" if tune.dry_run else "twice"
    place = _Loiter(flights, tune, loop) if boat else _Position(flights, tune, loop)
    drifts = sum(leg.seconds for leg in relays) * drift
    metres = size + BOAT_ROOM if boat else math.sqrt(2.0) * size + ROV_ROOM + drifts
    free = f"about {math.ceil(metres)} m of free water around the vehicle"
    movements = (
        f"{size:g} m ahead in {firmware.position_mode}, stay there, and back, {times}"
        if boat
        else f"a short push to each side in {firmware.manual_mode}, to check that the vehicle moves sideways. Then a "
        f"step of {size:g} m ahead and to starboard in {firmware.position_mode}, and back. Pushes by the "
        f"thrusters in {firmware.push_mode}. Step and pushes are flown {times}. After the first ones a relay ahead "
        f"and one sideways in {firmware.manual_mode}"
    )
    return Mission(
        itinerary=itinerary,
        modes=tuple(mode for mode in (firmware.position_mode, firmware.push_mode, firmware.manual_mode) if mode),
        movements=movements,
        needs=(
            Intention(f"need {free}, which drifts at {drift:.2f} m/s now", "Space", free),
            how_long(itinerary),
            battery(craft.observe(), envelope, itinerary.seconds),
        ),
        fly=lambda journal: tune_loop(place, log, visit.agrees, journal, dry_run=tune.dry_run),
        writes="write no parameter (dry run)" if tune.dry_run else sentence,
        moves_briefly="" if boat else f"{size:g} m steps, pushes and relays ahead and to starboard",
        writes_briefly="" if tune.dry_run else briefly,
        finish=partial(read_back, partial(loop.read, craft), visit),
    )


def _check_suits(craft: MavlinkCraft) -> None:
    """Raise ``WrongVehicle`` for a craft that cannot stay in one place."""
    firmware = craft.firmware
    if firmware.needs_way and not craft.skid:
        raise WrongVehicle(
            "this boat turns by a rudder or a steered thruster, so only under way. It cannot stay in one place. In "
            "LOITER it drifts within LOIT_RADIUS and drives back: set LOIT_RADIUS to the radius of its turns, which "
            "`gcs-autotune authority` computes"
        )
    if not firmware.needs_way and "Y" not in craft.forces:
        raise WrongVehicle(
            f"this vehicle ({firmware.name}) has no thrusters that push sideways, so it cannot hold a position"
        )


def _legs(gains: str, duration: float, *, boat: bool) -> list[Leg]:
    settle = BOAT_SETTLE if boat else SETTLE
    step = Leg(f"step with {gains} gains", settle + 2.0 * duration, kind="step")
    push = Leg(f"push with {gains} gains", PUSH_SETTLE + 4.0 * PUSHING, kind="push")
    return [step] if boat else [step, push]


def _drift(craft: MavlinkCraft, present: Mapping[str, float]) -> float:
    """Return the drift at rest [m/s]: the current, for a craft that is not held.

    Raises
    ------
    PreconditionFailed
        There is no position, or the current is stronger than the position loop; with the numbers.
    """
    seen = [craft.observe() for _ in range(LOOKS)]
    now = seen[-1]
    if not (math.isfinite(now.x + now.y) and craft.telemetry.has_local_position):
        raise PreconditionFailed(
            "the vehicle reports no position (LOCAL_POSITION_NED). Check the DVL or other position source"
        )
    drift = math.hypot(*(float(np.mean([getattr(o, name) for o in seen])) for name in ("u", "v")))
    boat = craft.firmware.needs_way
    name, unit = ("WP_SPEED", 1.0) if boat else ("WPNAV_SPEED", 0.01)
    most = unit * present.get(name, math.inf)
    if drift > CURRENT * most:
        raise PreconditionFailed(
            f"the vehicle reports a drift of {drift:.2f} m/s, and its position loop commands {most:.2f} m/s at most "
            f"({name}): the current is too strong for it, or GPS or DVL are lost. Check them, or wait for slack "
            "water"
        )
    return drift


@dataclass(frozen=True, slots=True)
class _Gains:
    """The tuned ``gains`` under the vehicle's names, and the ``present`` values under the canonical ones."""

    gains: tuple[Gain, ...]
    names: Names
    present: Mapping[str, float]

    @classmethod
    def of(cls, craft: MavlinkCraft, table: Sequence[Gain], context: Sequence[str], *, beyond: bool) -> _Gains:
        """Return those of *craft* in *table*, and what the rule reads. *beyond*: outside the documented ranges too.

        Raises
        ------
        WrongVehicle
            The firmware lacks them.
        """
        wanted = [*(gain.parameter for gain in table), *context]
        names, found = read_named(craft.parameters, wanted)
        missing = [gain.parameter for gain in table if names.own(gain.parameter) not in found]
        if missing:
            raise WrongVehicle(
                f"{craft.session.vehicle} has no parameter {', '.join(missing)}, also not under a newer name. "
                "`tune position` needs ArduPilot 4.1 or later"
            )
        wider = WIDER if beyond else 1.0
        gains = []
        for gain in table:
            low, high = names.limits(gain.parameter, gain.low, gain.high)
            gains.append(replace(gain, low=low / wider, high=high * wider))
        return cls(tuple(gains), names, names.to_canonical(found))

    def read(self, craft: MavlinkCraft) -> dict[str, float]:
        """Return the values in place now, under the vehicle's own names."""
        return craft.parameters.read_existing([self.names.own(name) for name in self.present], as_is=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Flights:
    """Flies step and push on the vehicle of *visit*."""

    visit: Visit[TuneLog]
    runner: ManoeuvreRunner
    settings: TuneSettings
    size: float
    duration: float

    def fly_ahead(self, when: str) -> Trial:
        """Return a boat's step ahead and back, flown ``before`` or ``after``."""
        settings = self.size, BOAT_SETTLE, self.duration, f"position-{when}"
        return self._fly(StepPosition(*settings, once=True, abeam=0.0), when, "step")

    def fly(self, when: str) -> tuple[Trial, Trial | None]:
        """Return the step and the push, flown ``before`` or ``after``; no push after an unstable step."""
        step = self._fly(StepPosition(self.size, SETTLE, self.duration, f"position-{when}"), when, "step")
        if step.ending == "stopped":
            return step, None
        return step, self._fly(PushPosition(PUSH_SETTLE, PUSHING, f"push-{when}"), when, "push")

    def check_sideways(self) -> None:
        """Check by a short push to each side that the craft moves sideways. Its frame shows only what it should do.

        Raises
        ------
        PreconditionFailed
            It does not, or moves to the wrong side.
        """
        self.visit.log.say(f"{STAGE}: sway")
        check_signs(sign_check_for("sway", self.visit.craft, 0.0), self.runner.attempt)

    def relay(self, dof: str) -> Trial:
        """Return a relay oscillation of *dof* at rest, as ``hold position`` flies it."""
        relays = Relays.of(replace(self.settings, axis=DOFS[dof]), dof, self.visit.craft, 0.0)
        stage = relays.stage("first")
        self.visit.log.say(stage)
        return self.runner.fly(relays.relay(1, None), stage)

    def _fly(self, manoeuvre: Manoeuvre, when: str, what: str) -> Trial:
        stage = f"{what} with {STAGES[when]} gains"
        self.visit.log.say(stage)
        return self.runner.fly(manoeuvre, stage)


class _Position:
    """The position as a tunable loop."""

    name = "position"

    def __init__(self, flights: _Flights, tune: TuneSettings, gains: _Gains) -> None:
        self._flights, self._tune, self._gains = flights, tune, gains
        self._log = flights.visit.log
        self._craft = flights.visit.craft
        self._before: Trial

    def read(self) -> Mapping[str, float]:
        """Return the parameters in place now."""
        return self._gains.read(self._craft)

    def lend(self, journal: Journal) -> GainLoan:
        """Return the transaction on the vehicle's parameters."""
        return lend_parameters(self._craft, journal)

    def experiment(self) -> None:
        """Check that the craft moves sideways, then fly step and push with the present gains."""
        self._flights.check_sideways()
        self._before, push = self._flights.fly("before")
        self._log.position_before = _measured(self._before, push)
        if math.isnan(self._log.position_before.push):
            self._log.say(
                f"the sticks do not push in {self._craft.firmware.push_mode} of this firmware: the step alone counts"
            )

    def propose(self) -> Offer:
        """Identify surge and sway from the step and a relay each, and choose the gains by the rule."""
        relays = [(dof, self._flights.relay(dof)) for dof in DOFS]
        self._log.say("identifying")
        fits = [self._identified(dof, relay) for dof, relay in relays]
        self._log.fit, self._log.second_fit = fits
        for fit in fits:
            m = fit.model
            self._log.say(
                f"{fit.dof}: inertia {m.alpha:.3g} s^2/m, drag {m.beta:.3g} s/m relative to full thrust, delay "
                f"{m.delay:.2f} s; explains {fit.fit_percent:.0f} % of the motion"
            )
        self._log.say("designing")
        canonical = [replace(g, parameter=name) for g, name in zip(self._gains.gains, _NAMES, strict=True)]
        design = self._in_background(
            design_position, [(fit.model, fit.craft_covariance) for fit in fits], self._gains.present, canonical
        )
        own = self._gains.names
        self._log.given_changes = tuple(
            replace(c, parameter=own.own(c.parameter)) for c in design.changes(self._gains.present, canonical)
        )
        now, new = design.present, design.margins
        return Offer(
            self._log.given_changes,
            promise=f"predicted margins: {_told(now.stable, now.gain, now.phase)} -> "
            f"{_told(new.stable, new.gain, new.phase)}",
        )

    def fly_baseline(self) -> None:
        """Nothing else is compared."""

    def prove(self) -> ProofResult:
        """Fly step and push with the new gains."""
        before = self._log.position_before
        assert before is not None
        after = self._log.position_after = _measured(*self._flights.fly("after"))
        return ProofResult(holds_better(before, after))

    def _identified(self, dof: str, relay: Trial) -> AxisFit:
        s, trials = self._tune, [relay, self._before]
        fit = self._in_background(fit_axis, trials, dof=dof, structure=s.structure, delay=delay_of(s))
        if not fit.fit_percent >= EXPLAINED:
            raise NotInformative(
                f"the {dof} model explains {fit.fit_percent:.0f} % of the motion, and {EXPLAINED:.0f} % are needed. "
                "Check GPS or DVL, wait for calmer water, or use a larger --step"
            )
        return fit

    def _in_background(self, work: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
        visit = self._flights.visit
        return run_in_background(visit.craft, visit.worker, self._flights.runner.bear, work, *args, **named)


class _Loiter(_Position):
    """A boat's position as a tunable loop."""

    def experiment(self) -> None:
        """Fly the step with the present radius."""
        self._before = self._flights.fly_ahead("before")
        self._log.position_before = _measured_of_boat(self._before)

    def propose(self) -> Offer:
        """Choose the radius by the rule."""
        marks = [mark.t for mark in self._before.marks if mark.kind == "target"]
        still = [self._before[axis].between(marks[0], marks[1]).values for axis in "xy"]
        change = loiter_change(max(noise_of(values) for values in still), self._gains.present, self._gains.gains[0])
        self._log.given_changes = () if change is None else (change,)
        return Offer(self._log.given_changes)

    def prove(self) -> ProofResult:
        """Fly the step with the new radius."""
        before = self._log.position_before
        assert before is not None
        after = self._log.position_after = _measured_of_boat(self._flights.fly_ahead("after"))
        return ProofResult(holds_better(before, after, pushed=False))


_NAMES = tuple(gain.parameter for gain in POSITION_GAINS)


def _told(stable: bool, gain: float, phase: float) -> str:
    words = f"a factor of {format_factor(gain, 2)} in gain and {math.degrees(phase):.0f} deg in phase"
    return words if stable else "unstable"


def _measured_of_boat(step: Trial) -> PositionMetrics:
    """Return the figures of a boat's step; the ends of its phases show how it holds against current and wind.

    Nothing pushes it.
    """
    if step.ending == "stopped":
        return UNSTABLE
    targets, track = _phases(step, "target"), _track(step)
    steps = [
        Stay(begin, end, _place(mark), _place(last)) for (last, *_), (mark, begin, end) in itertools.pairwise(targets)
    ]
    ends = [Stay(stay.end - BOAT_HELD, stay.end, stay.place, stay.place) for stay in steps]
    return position_metrics(track, steps, None, (), ends, _travel(step))


def _travel(step: Trial) -> float:
    """Return the motion of the busiest thrust [full strokes per second]."""
    moved = [float(np.sum(np.abs(np.diff(step[force].values)))) for force in "XY" if force in step.channels]
    return 0.5 * max(moved) / max(step.end - step.start, 1.0)


def _measured(step: Trial, push: Trial | None) -> PositionMetrics:
    """Return the figures of a step and a push, from their records."""
    if push is None or push.ending == "stopped":
        return UNSTABLE
    targets = _phases(step, "target")
    steps = [
        Stay(begin, end, _place(mark), _place(last)) for (last, *_), (mark, begin, end) in itertools.pairwise(targets)
    ]
    first, _, hold_end = targets[0]
    held = [Stay(hold_end - HELD, hold_end, _place(first), _place(first))]
    pushes = _phases(push, "push")
    t, track = _track(push)
    hold_end = pushes[0][2]
    # POSHOLD holds where the craft comes to rest, so the place is where it is before the first push
    where = complex(np.mean(track[(t >= hold_end - HELD) & (t < hold_end)]))
    felt = _is_felt(push, pushes)
    stays = [Stay(begin, end, where, where) for _, begin, end in pushes[1:]] if felt else []
    return position_metrics(_track(step), steps, (t, track) if felt else None, stays, held, _travel(step))


def _phases(trial: Trial, kind: str) -> list[tuple[Mark, float, float]]:
    """Return each mark of *kind* with the begin and end of its phase [s]."""
    marks = [mark for mark in trial.marks if mark.kind == kind]
    ends = [*(mark.t for mark in marks[1:]), trial.end]
    return [(mark, mark.t, end) for mark, end in zip(marks, ends, strict=True)]


def _place(mark: Mark) -> complex:
    return complex(float(mark.detail["x"]), float(mark.detail["y"]))


def _track(trial: Trial) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    x, y = trial["x"], trial["y"]
    return x.t, x.values + 1j * np.interp(x.t, y.t, y.values)


def _is_felt(push: Trial, pushes: Sequence[tuple[Mark, float, float]]) -> bool:
    """Return whether the outputs show the push as soon as it begins. Firmware may take the sticks otherwise."""
    _, begin, _ = next(phase for phase in pushes if phase[0].detail["phase"] == "push ahead")
    output = push["X"]
    before, after = output.between(begin - 1.0, begin).values, output.between(begin, begin + AT_ONCE).values
    return (
        len(before) > 0 and len(after) > 0 and float(after.max() - np.median(before)) > FELT * float(push.meta["push"])
    )


JOB = TuneJob(tune_position, _declare)
