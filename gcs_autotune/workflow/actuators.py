"""``tune actuators``: the autopilot's motor parameters from the measured thrust, so that thrust follows the command.

The sequence is that of every tune (``tunable_loop``). Throttle levels ahead and astern in MANUAL show the thrust at
each command; a pull test replaces them as the source of the parameters, but not as the proof. A speed step under the
autopilot's own loop shows that tracking is not worse. Both are flown with the present and with the new parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from types import TracebackType
from typing import Self

import numpy as np

from gcs_autotune.design import (
    SPEED_GAINS,
    STEERING_GAINS,
    Change,
    Linearity,
    MotorLaw,
    Verdict,
    fit_motor_law,
    is_more_linear,
    is_no_worse,
    linearity,
    motor_changes,
    rudder_trim,
    scatter_of,
)
from gcs_autotune.errors import AutotuneError, NotAchieved, ParameterMissing, PreconditionFailed, WrongVehicle
from gcs_autotune.identify.thrust import LevelForces, level_forces
from gcs_autotune.link import Journal, MavlinkCraft
from gcs_autotune.manoeuvres import (
    BOTH_WAYS,
    PlantState,
    Step,
    StepSettings,
    ThrottleSteps,
    ThrottleStepsSettings,
    common_windows,
)
from gcs_autotune.observer import Observer
from gcs_autotune.report import TuneStory, format_share
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.autopilot_loop import lend_parameters
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.excursion import NO_LIMITS, Ahead, Excursion, VisitPreview, too_small, worst_of
from gcs_autotune.workflow.experiment import learn
from gcs_autotune.workflow.experiments import measure, measure_halves, noise_in, resolution
from gcs_autotune.workflow.itinerary import Itinerary, Leg, Pace, pace_of
from gcs_autotune.workflow.mission import Mission, Visit
from gcs_autotune.workflow.nominal_plant import assumed_crafts, assumed_plant
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import STAGE, sign_check_for
from gcs_autotune.workflow.pull_map import PulledMap, pulled_map
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, tune_loop
from gcs_autotune.workflow.tune import TuneJob, fly_job, read_back
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["tune_actuators"]

MOTORS = ("MOT_THR_MIN", "MOT_THST_EXPO", "MOT_THST_ASYM")
OUTPUTS = tuple(f"SERVO{n}_{end}" for n in range(1, 17) for end in ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED"))
CONTEXT = ("MOT_THR_MAX", "CRUISE_SPEED", "CRUISE_THROTTLE", "WP_SPEED")
BEFORE, AFTER = "present parameters", "new parameters"
STEP_PART = 0.4
"""Size of the speed step as a fraction of the working speed: from 60 % of it to 100 %, as `tune speed` flies it."""
STEP_TIMES, LEAST_STEP, MOST_STEP = 3.5, 6.0, 25.0
"""Duration of a half step in time constants of the boat, and its limits [s]. Project choice."""
STEADY_BAND, ENOUGH, LEAST = 0.2, 5.0, 3.0
"""Deviation from the speed that counts as steady [fraction], and times on target [s], as `tune speed` flies it."""
NEAR_LIMIT = 0.85
"""Fraction of the speed limit at which a throttle level ends. Project choice."""
STRAIGHT = 0.5
"""Smallest command of a level whose mean steering counts as that of straight ahead [fraction]."""
HELD_STDS, LEAST_HELD, UNLIKE = 3.0, 0.01, 0.5
"""Standard errors and fraction of full steering that a trim needs, and the largest difference between the courses
relative to their mean. A wind acts to opposite sides on opposite courses. Project choice."""


def tune_actuators(settings: TuneSettings, operator: Operator, observer: Observer, when: str) -> TuneStory:
    """Tune the actuator parameters and return the story; the run directory holds everything on every ending.

    Raises
    ------
    WrongVehicle, ParameterMissing
        It is not a boat, or its firmware lacks the parameters.
    AutotuneError
        What ended it early. By then the vehicle is as before (or ``NotAsFound`` states what is not).
    """
    return fly_job(_declare, settings, operator, observer, when, name="actuators", dofs=("surge",))


def _declare(settings: TuneSettings, visit: Visit[TuneLog]) -> Mission:
    """Return what this tune will do on the vehicle of *visit*; nothing moves yet."""
    craft, log = visit.craft, visit.log
    firmware = craft.firmware
    present = _read(craft)
    context = replace(learn(settings, visit), present=present)
    if not context.throttle > 0.0:
        raise PreconditionFailed(
            "CRUISE_THROTTLE is 0. Set it, or use --throttle with the throttle of the cruise speed"
        )
    pulled = None if settings.pull_test is None else pulled_map(settings.pull_test, craft.servos, present)
    log.parameters_before = dict(present)
    craft.parameters.watch(present)
    log.say(f"present parameters saved to {visit.record.save_parameters('before', present)}")
    if craft.skid and "MOT_THST_ASYM" not in present:
        log.say("this firmware has no MOT_THST_ASYM, so weak thrust astern stays")
    now, pace, full = craft.observe(), pace_of(craft.steered_by), _full(present)
    share = format_share(full)
    itinerary = Itinerary(_legs(settings, pace), pace.turn)
    whole = _excursion(context, full, itinerary)
    names = [n for n in (*MOTORS, *CONTEXT[:1], CONTEXT[2], *SPEED_GAINS, *STEERING_GAINS) if n in present]
    loop = _Actuators(context, present, pulled)
    return Mission(
        itinerary=itinerary,
        modes=(firmware.hold_mode, firmware.manual_mode),
        movements=(
            f"throttle levels of up to {share} ahead and astern, and steps in speed up to {context.speed:.1f} m/s, "
            "straight ahead, turning around between them"
        ),
        needs=(
            room("surge", context.speed, settings, now, whole),
            how_long(itinerary),
            battery(now, settings.envelope, itinerary.seconds),
        ),
        fly=lambda journal: tune_loop(loop, log, visit.agrees, journal, dry_run=settings.dry_run),
        writes="write no parameter (dry run)"
        if settings.dry_run
        else f"write some of {', '.join(names)} and the servo limits SERVOn_MIN, TRIM and MAX, after asking again. The "
        "old values are restored unless thrust is more proportional to the command and tracking is no worse",
        moves_briefly=f"throttle up to {share} ahead and astern, speed steps up to {context.speed:.1f} m/s",
        writes_briefly=""
        if settings.dry_run
        else f"up to {len(names)} parameters, servo limits, after asking; only better ones stay",
        finish=partial(read_back, loop.read, visit),
    )


def _read(craft: MavlinkCraft) -> dict[str, float]:
    """Return the parameters that are changed or needed, as far as the vehicle has them.

    Raises
    ------
    WrongVehicle
        No boat. ParameterMissing: it has none of the motor parameters.
    """
    firmware = craft.firmware
    if not firmware.needs_way:
        raise WrongVehicle(
            f"{firmware.name} sends its motors pulses proportional to the output, and no parameter corrects a thrust "
            "curve, a dead zone or weak thrust astern. `tune actuators` is for ArduRover boats. Calibrate the ESCs"
        )
    gains = [*SPEED_GAINS, *(STEERING_GAINS if craft.skid else ())]
    found = craft.parameters.read_existing([*MOTORS, *CONTEXT, *gains, *OUTPUTS])
    missing = [name for name in MOTORS[:2] if name not in found]
    if missing:
        raise ParameterMissing(
            f"{craft.session.vehicle} has no parameter {', '.join(missing)}. `tune actuators` needs ArduRover 4.0 or "
            "later",
            name=missing[0],
        )
    used = {f"SERVO{output.channel}_" for force in ("X", "N") for output, _ in craft.servos.driving(force)}
    return {n: v for n, v in found.items() if not n.startswith("SERVO") or any(n.startswith(u) for u in used)}


def _full(present: Mapping[str, float]) -> float:
    return min(present.get("MOT_THR_MAX", 100.0), 100.0) / 100.0


def _legs(settings: TuneSettings, pace: Pace) -> list[Leg]:
    levels, step = pace.answered * len(BOTH_WAYS), pace.rests + 2.0 * pace.moving
    legs = [Leg(STAGE, 2.0 * pace.check)]
    for which in (BEFORE,) if settings.dry_run else (BEFORE, AFTER):
        before = pace.turn if which == AFTER else 0.0
        legs.append(Leg(f"throttle levels with {which}", levels, before, "levels"))
        legs.append(Leg(f"step with {which}", step, pace.turn, "step"))
    return legs


def _excursion(context: TuneContext, full: float, itinerary: Itinerary) -> Excursion:
    """Return the space needed, for the assumed craft that needs most.

    Raises
    ------
    PreconditionFailed
        It exceeds ``--max-distance``.
    """
    settings, craft, speed = context.settings, context.craft, context.speed
    limits = replace(NO_LIMITS, distance=replace(settings.envelope, cruise=speed).distance_limit, cruise=speed)
    seen = []
    for like in assumed_crafts(craft.steered_by):
        plant = assumed_plant(craft.firmware, context.present, context.throttle, speed, like)
        visit = VisitPreview(plant, limits, PlantState(), under_way=True)
        visit.fly(sign_check_for("surge", craft, context.throttle), STAGE)
        for leg in itinerary.legs[1:]:
            if leg.before:
                visit.turn_around(context.throttle, math.inf)
            if leg.kind == "levels":
                visit.fly(_levels(context, full, leg.stage), leg.stage)
            else:
                visit.fly(Ahead(speed, leg.seconds, leg.stage, leg.seconds), leg.stage)
        seen.append(visit.excursion())
    whole = worst_of(seen)
    limit = settings.envelope.distance
    if limit is not None and whole.needs > limit:
        raise PreconditionFailed(too_small("this run", "max-distance", limit, whole.needs, "m"))
    return replace(whole, usual=whole)


def _levels(context: TuneContext, full: float, name: str) -> ThrottleSteps:
    """Return the manoeuvre that shows the thrust at commands up to *full* [fraction] ahead and astern."""
    relative = [full * share / context.throttle for share in BOTH_WAYS]
    limit = NEAR_LIMIT * replace(context.settings.envelope, cruise=context.speed).speed_limit
    settings = ThrottleStepsSettings(context.throttle, relative, most_speed=limit, until_answered=True)
    return ThrottleSteps(settings, name)


@dataclass(frozen=True, slots=True)
class _Flown:
    """What was measured with one set of parameters."""

    levels: LevelForces
    linear: Linearity
    step: Trial
    held: float
    held_std: float


class _Loan:
    """The transaction on the vehicle's parameters. The relation of outputs to forces is read again after it."""

    def __init__(self, craft: MavlinkCraft, journal: Journal) -> None:
        self._craft, self._own = craft, lend_parameters(craft, journal)

    def set(self, values: Mapping[str, float]) -> None:
        """Write *values* (name -> value)."""
        self._own.set(values)
        self._craft.learn_outputs()

    def keep(self) -> object:
        """Keep the written values."""
        return self._own.keep()

    def __enter__(self) -> Self:
        """Begin."""
        self._own.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the previous values unless the new ones are kept."""
        self._own.__exit__(kind, error, trace)
        with suppress(AutotuneError):
            self._craft.learn_outputs()


class _Actuators:
    """The actuator parameters as a tunable loop."""

    name = "actuators"

    def __init__(self, context: TuneContext, present: Mapping[str, float], pulled: PulledMap | None) -> None:
        self._context, self._present, self._pulled = context, present, pulled
        self._craft, self._log = context.craft, context.log
        self._before: _Flown
        self._rudder: tuple[Change, ...] = ()

    def read(self) -> Mapping[str, float]:
        """Return the parameters in place now."""
        return self._craft.parameters.read_existing(self._present, as_is=True)

    def lend(self, journal: Journal) -> GainLoan:
        """Return the transaction on the vehicle's parameters."""
        return _Loan(self._craft, journal)

    def experiment(self) -> None:
        """Fly the throttle levels and the speed step with the present parameters."""
        self._context = self._context.begin()
        self._before = self._fly("before", BEFORE, self._present)
        self._log.thrust_before = self._before.linear

    def propose(self) -> Offer:
        """Choose the parameters by the thrust at the levels, or by the pull test."""
        skid, present, before = self._craft.skid, self._present, self._before
        curved = before.levels if self._pulled is None else self._pulled
        found = self._context.run_in_background(
            fit_motor_law, curved.outputs, curved.forces, curved.stds, skid=skid and "MOT_THST_ASYM" in present
        )
        predicted = self._predicted(found.law.stored, found.closest)
        changes = motor_changes(found, present, skid=skid)
        if not is_more_linear(before.linear, predicted):
            changes = []
        self._rudder = tuple(self._trim())
        self._log.given_changes = (*changes, *(() if self._pulled is None else self._pulled.changes), *self._rudder)
        if not self._log.given_changes:
            return Offer(
                (),
                f"thrust departs from the command by {before.linear.departure:.1%} of full, and no parameter makes it "
                "clearly more proportional",
            )
        promise = (
            f"thrust departs from the command by {before.linear.departure:.1%} of full; predicted with the new "
            f"parameters: {predicted.departure:.1%}"
        )
        return Offer(self._log.given_changes, promise=promise if changes else "")

    def fly_baseline(self) -> None:
        """Nothing else is compared."""

    def prove(self) -> ProofResult:
        """Fly the levels and the step with the new parameters."""
        before = self._before
        self._context.turn_around("levels-after", math.inf)
        after = self._fly("after", AFTER, {**self._present, **{c.parameter: c.new for c in self._log.given_changes}})
        self._log.thrust_after = after.linear
        tracking = self._tracking(before.step, after.step)
        moved = [c for c in self._log.given_changes if c not in self._rudder]
        criteria: list[tuple[bool, str]] = []
        if moved:
            linear = is_more_linear(before.linear, after.linear)
            thrust = (
                f"thrust departs from the command by {before.linear.departure:.1%} -> {after.linear.departure:.1%} of "
                f"full{'' if linear else ', which is not clearly less'}"
            )
            criteria.append((linear, thrust))
        if self._rudder:
            straighter = abs(after.held) < abs(before.held)
            criteria.append((straighter, f"steering held to go straight {before.held:+.1%} -> {after.held:+.1%}"))
        remark = "The loops now act on another thrust curve. Run `tune speed` and `tune heading` again"
        return ProofResult(Verdict((*criteria, *tracking.criteria)), (remark,) if moved else ())

    def _fly(self, name: str, which: str, present: Mapping[str, float]) -> _Flown:
        context, skid = self._context, self._craft.skid
        run = context.fly(_levels(context, _full(self._present), f"levels-{name}"), f"throttle levels with {which}")
        if run.ending != "completed":
            raise NotAchieved(f"throttle levels with {which}: {run.reason}. Use a larger --max-distance")
        levels = context.run_in_background(level_forces, run)
        linear = linearity(MotorLaw.of(present, skid=skid), levels.commands, levels.forces, levels.stds, skid=skid)
        context.turn_around(f"step-{name}", math.inf)
        step = context.fly(Step(self._step(levels), f"step-{name}"), f"step with {which}")
        return _Flown(levels, linear, step, *_held(run, step))

    def _step(self, levels: LevelForces) -> StepSettings:
        top = self._context.speed
        limit = self._present.get("WP_SPEED", 0.0)
        top = min(top, limit) if limit > 0.0 else top
        size = abs(self._context.settings.step or STEP_PART * top)
        drag = levels.drag[0] + 2.0 * levels.drag[1] * (top - size)
        seconds = min(max(STEP_TIMES / max(drag, 1e-3), LEAST_STEP), MOST_STEP)
        return StepSettings(
            "u",
            size,
            self._context.settings.step_duration or seconds,
            base=top - size,
            steady_band=STEADY_BAND,
            enough=ENOUGH,
            least_enough=LEAST,
        )

    def _predicted(self, law: MotorLaw, closest: MotorLaw) -> Linearity:
        """Return the linearity under *law* if *closest* describes the thrusters."""
        commands = self._before.levels.commands
        forces = closest.thrust(law.outputs(commands))
        return linearity(law, commands, forces, np.zeros(len(forces)), skid=self._craft.skid)

    def _trim(self) -> Sequence[Change]:
        """Return the change of the rudder's trim, if the boat clearly holds the same rudder on both courses."""
        held, std = self._before.held, self._before.held_std
        if self._craft.skid or not abs(held) > max(HELD_STDS * std, LEAST_HELD):
            return ()
        found = rudder_trim(self._present, held)
        if found is None:
            return ()
        name, pulse = found
        low, high = self._present[f"{name[:-5]}_MIN"], self._present[f"{name[:-5]}_MAX"]
        why = f"the rudder holds {held:+.1%} to go straight, on both courses"
        return (Change(name, self._present[name], float(pulse), low, high, why),)

    def _tracking(self, before: Trial, after: Trial) -> Verdict:
        """Return whether the speed step is followed no worse with the new parameters."""
        grain = resolution(before)
        noise = noise_in(before, "u")
        alike = common_windows(before, after)
        old, new = (measure(t, noise, grain, alike) for t in (before, after))
        self._log.metrics_before, self._log.metrics_after = old, new
        scatter = scatter_of(*(measure_halves(t, noise, grain, alike) for t in (before, after)))
        return is_no_worse(old, new, scatter)


def _held(run: Trial, step: Trial) -> tuple[float, float]:
    """Return the mean steering [fraction] that keeps a boat straight on two opposite courses, and its uncertainty."""
    orders = [(m.t, float(m.detail["X"])) for m in run.marks if m.kind == "level"]
    parts = []
    for (begin, command), end in zip(orders, [*(t for t, _ in orders[1:]), run.end], strict=True):
        values = run["N"].between(0.5 * (begin + end), end).values if command >= STRAIGHT else ()
        if len(values):
            parts.append(float(np.mean(values)))
    targets = [m.t for m in step.marks if m.kind == "target"]
    back = step["N"].between(targets[0], step.end).values if targets else step["N"].values
    if not parts or not len(back):
        return math.nan, math.inf
    there, here = float(np.mean(parts)), float(np.mean(back))
    mean = 0.5 * (there + here)
    alike = abs(there - here) <= UNLIKE * abs(mean)
    spread = float(np.std(parts)) / math.sqrt(len(parts))
    return mean, math.hypot(spread, 0.5 * abs(there - here)) if alike else math.inf


JOB = TuneJob(tune_actuators, _declare)
