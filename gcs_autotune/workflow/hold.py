"""``hold``: a controller of our own on the surface computer: identify, design, fly, report.

The order is that of Miskovic2010, algorithm 8.4: one or two relays, the model, the gains by a model function, the loop.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from gcs_autotune.axes import axis_kind
from gcs_autotune.control import (
    LINE_LAWS,
    POSITION_LAWS,
    AxisLoop,
    DirectLine,
    LineQuestion,
    SetPointLoop,
    WallReading,
    design_distance,
)
from gcs_autotune.errors import PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import ModelFile
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    FaceWall,
    FollowLine,
    KeepDistance,
    KeepPosition,
    KeepSetPoint,
    Manoeuvre,
    Step,
    StepSettings,
    UnderOwnLoop,
    how_far,
    seen_from,
)
from gcs_autotune.observer import Observer
from gcs_autotune.registry import lookup
from gcs_autotune.report import (
    Held,
    HeldDistance,
    HeldLine,
    HeldLoop,
    HeldPosition,
    distance_figures,
    figures_on,
    hold_document,
    position_figures,
    save_page,
)
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiment import learn
from gcs_autotune.workflow.experiments import SWING_AHEAD, dive_for, dive_words, measure, noise_in, resolution
from gcs_autotune.workflow.flight_area import area_of_flight
from gcs_autotune.workflow.itinerary import WALL_RELAY, Itinerary, Leg, legs_beside, legs_of_experiment, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.own_loops import OwnMotion, identified, motion, supplied, supplied_motion, told
from gcs_autotune.workflow.preflight import check_signals
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.tune_preview import excursion_of

__all__ = ["HoldSettings", "hold"]

SETTLE = 10.0
"""Holding before the step [s]: until the integral has found the constant disturbance."""
SETTLED_TIMES = 8.0
"""Duration of the step each way, in reciprocals of the characteristic frequency: a third-order Bessel loop settles in
four. Chosen."""


@dataclass(frozen=True, slots=True)
class HoldSettings:
    """One run of ``hold``.

    Attributes
    ----------
    what : a name in :data:`TASKS`. tune : settings of the experiments and of the step.
    models : models that replace the experiments of their motions.
    seconds : how long it holds after a step [s].
    offset, length : of a line: metres to starboard of the craft, and metres along it.
    guidance : the law that follows a line, a name in ``LINE_LAWS``. approach : largest angle to it [rad].
    apart : distance between the two rangefinders ahead [m].
    distance_step : step away from a wall, or of a position [m].
    law : the law that holds a position, a name in ``POSITION_LAWS``.
    """

    what: str
    tune: TuneSettings
    models: tuple[ModelFile, ...] = ()
    seconds: float = 0.0
    offset: float = 8.0
    length: float = 60.0
    guidance: str = "direct"
    approach: float = math.radians(45.0)
    apart: float = 0.2
    distance_step: float = 0.3
    law: str = "sliding"


def hold(settings: HoldSettings, operator: Operator, observer: Observer, when: str = "") -> Held:
    """Identify, design a controller of our own, and fly what it is for.

    No parameter is written. The vehicle is left as before on every ending. The run directory gets ``trials/``,
    ``model.json`` and ``report.html``.

    Raises
    ------
    UsageError
        There is no controller for this.
    WrongVehicle
        The craft cannot do this.
    NoGainsMeetSpec
        No loop keeps its limits on this craft.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        What ended it early; the records are on disk.
    """
    tune = settings.tune
    task = lookup(TASKS, settings.what, "thing to hold")(settings)
    record, log = RunDirectory(tune.directory), TuneLog(tune, when, observer)
    flown: list[Held] = []
    visit = visiting(tune, operator, log, record, tune.axis)
    with record.summarised(f"hold {settings.what}", when, log):
        run_mission(visit, partial(_declare, task, flown), log)
    (held,) = flown
    save_page(record.path, hold_document(held, f"Hold {settings.what}", when))
    return held


def _declare(task: Task, flown: list[Held], visit: Visit[TuneLog]) -> Mission:
    """Return what this run will do on the vehicle of *visit*; it puts its result into *flown*."""
    tune = task.settings.tune
    area = area_of_flight(visit.craft, None, visit.log)
    context, craft = learn(replace(tune, envelope=replace(tune.envelope, area=area)), visit), visit.craft
    kind = context.axis.kind
    task.check(context)
    given = supplied(task.settings.models, context.axis.name, tune.full_scale)
    if given is None and task.settings.models:
        raise UsageError(
            f"the model contains no {context.axis.dof}, which hold {task.settings.what} needs. Identify it first"
        )
    now, firmware = craft.observe(), craft.firmware
    down, briefly = dive_words(context.axis.dof, firmware, now)
    pace = pace_of(craft.steered_by)
    legs = list(legs_of_experiment(context.axis.dof, pace, dives=dive_for(context.axis.dof, firmware, now) is not None))
    if given is not None:
        legs = [leg for leg in legs if not leg.kind]
    flown_too = [a for a in task.axes if supplied(task.settings.models, a, tune.full_scale) is None]
    for axis in flown_too:
        legs += legs_beside(axis_kind(axis).dof, pace, wall=WALL_RELAY * (axis == "distance"))
    legs += [replace(leg, before=pace.turn) if not k else leg for k, leg in enumerate(task.legs(context))]
    itinerary = Itinerary(legs, pace.turn)
    whole = excursion_of(context, now, (itinerary,))

    def fly(_: Journal) -> None:
        started = context.begin()
        link = started.craft.link_times.loop
        flown.append(task.fly(started, identified(started) if given is None else supplied_motion(given, link)))

    titles = [kind.excitation.title] * (given is None) + [MOTIONS[axis] for axis in flown_too]
    relays = f"relay oscillations about the present {' and '.join(titles)}, then " if titles else ""
    return Mission(
        itinerary=itinerary,
        modes=(*([firmware.hold_mode] if down else []), firmware.manual_mode),
        movements=f"{kind.excitation.check}{down}{relays}{task.movements(context)} with our own controller",
        needs=(
            room(context.axis.dof, context.speed, tune, now, whole),
            how_long(itinerary),
            battery(now, tune.envelope, itinerary.seconds),
        ),
        fly=fly,
        moves_briefly=f"{briefly}pulses, {'relays, ' * bool(titles)}{task.briefly(context)}",
    )


class Task(ABC):
    """One thing that a controller of our own does; ``axes``: motions of ``OWN_AXES`` that it needs beside its own."""

    axes: tuple[str, ...] = ()

    def __init__(self, settings: HoldSettings) -> None:
        self.settings = settings

    @abstractmethod
    def check(self, context: TuneContext) -> None:
        """Raise where the craft cannot do it; nothing has moved."""

    @abstractmethod
    def movements(self, context: TuneContext) -> str:
        """Return in words what moves."""

    def briefly(self, context: TuneContext) -> str:
        """Return what moves in one line of a terminal."""
        return self.movements(context)

    @abstractmethod
    def legs(self, context: TuneContext) -> list[Leg]:
        """Return its stages with their times."""

    @abstractmethod
    def fly(self, context: TuneContext, found: OwnMotion) -> Held:
        """Design the controller and fly."""

    def step(self, context: TuneContext) -> float:
        """Return the step [rad or m] that must not saturate the actuator."""
        kind, step = context.axis.kind, self.settings.tune.step
        return kind.step if step is None else step


class HoldSetPoint(Task):
    """Step in heading or depth and back, then hold."""

    def check(self, context: TuneContext) -> None:
        """Raise for a velocity, which has no loop of ours."""
        if context.axis.kind.controls_velocity:
            raise UsageError(f"hold has no loop of {context.axis.name} of its own. Use {' or '.join(TASKS)}")

    def movements(self, context: TuneContext) -> str:
        """Return the step, and the holding after it, in words."""
        step, kind, seconds = self.step(context), context.axis.kind, self.settings.seconds
        shown = f"{math.degrees(step):.0f} deg" if kind.angular else f"{step:g} m"
        after = f" and back, {seconds:g} s of holding" if seconds > 0.0 else " and back"
        return f"a {shown} step in {context.axis.name}{after}"

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the step, and the holding after it."""
        step = Leg("step with our own loop", SETTLE + 2.0 * context.axis.kind.step_duration)
        return [step] + [Leg("holding", self.settings.seconds)] * (self.settings.seconds > 0.0)

    def fly(self, context: TuneContext, found: OwnMotion) -> HeldLoop:
        """Fly the step and hold."""
        tune, kind, step = self.settings.tune, context.axis.kind, self.step(context)
        loop = _loop(context, found, step, tune.omega_0)
        design = loop.design
        duration = tune.step_duration or max(SETTLED_TIMES / design.wanted.omega_0, 0.5 * kind.step_duration)
        proof = StepSettings(kind.stepped, step, duration, speed=context.speed, settle=2.0 * SETTLE, hold=SETTLE)
        context.turn_around("own-step", SWING_AHEAD)
        trial = context.fly(_own(Step(proof, "own-step"), loop, context), "step with our own loop")
        if self.settings.seconds > 0.0:
            keep = KeepSetPoint(kind.stepped, self.settings.seconds, context.speed, "own-hold")
            context.fly(_own(keep, loop, context), "holding")
        metrics = measure(trial, noise_in(trial, kind.stepped), resolution(trial))
        return HeldLoop(context.axis.name, design, trial, metrics)


class HoldLine(Task):
    """Approach a line parallel to the course and follow it."""

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that does not go ahead, or a line that is out of bounds."""
        lookup(LINE_LAWS, self.settings.guidance, "line law")
        area, s, now = context.settings.envelope.area, self.settings, context.craft.observe()
        if area is not None:
            ends = (seen_from(now, 0.0, s.offset), seen_from(now, s.length, s.offset))
            beyond = max(area.beyond(*end) for end in ends)
            if beyond > 0.0:
                raise PreconditionFailed(
                    f"the line goes {how_far(beyond)} outside {area.source}. Use another --line-offset or "
                    "--line-length. Nothing was armed"
                )
        if not context.craft.firmware.needs_way:
            raise WrongVehicle("a line is followed under way; this vehicle is steered at rest. Use heading or depth")

    def movements(self, context: TuneContext) -> str:
        """Return the line in words."""
        s = self.settings
        side = "starboard" if s.offset >= 0.0 else "port"
        return f"{s.length:g} m along a line that is {abs(s.offset):g} m to {side} ({s.guidance} control)"

    def briefly(self, context: TuneContext) -> str:
        """Return the line without the law that follows it."""
        return self.movements(context).partition(" (")[0]

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the line."""
        return [Leg("following the line", (self.settings.length + abs(self.settings.offset)) / context.speed)]

    def fly(self, context: TuneContext, found: OwnMotion) -> HeldLine:
        """Follow the line."""
        s = self.settings
        loop = _loop(context, found, self.step(context), s.tune.omega_0)
        design = loop.design
        question = LineQuestion(
            design.model,
            design.law.closed_loop(design.model),
            design.wanted.kind,
            design.wanted.omega_0,
            context.speed,
            s.approach,
        )
        law = LINE_LAWS[s.guidance](question)
        if isinstance(law, DirectLine):
            law = replace(law, rate=law.rate.with_limits(*design.law.limits))
        context.turn_around("own-line", math.inf)
        line = FollowLine(law, s.offset, s.length, context.speed, context.throttle, "own-line", output=loop.output)
        manoeuvre = line if line.in_manual else _own(line, loop, context)
        trial = context.fly(manoeuvre, "following the line")
        return HeldLine(s.guidance, design, trial, figures_on(trial))


FACING, FACING_TIME = "facing the wall", 10.0
"""Stage that turns the craft back to the wall after the relays in heading, and its usual time [s]. Project choice."""


class HoldDistance(Task):
    """Face a wall and keep a distance to it: Miskovic2010, algorithm 8.5."""

    axes = ("distance",)
    facing = math.nan
    """Heading at a right angle to the wall [rad], from before the relays."""

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that has no two rangefinders ahead, or does not thrust both ways."""
        craft = context.craft
        if craft.firmware.needs_way:
            raise WrongVehicle("a distance is kept at rest; a boat does not. Use heading or line")
        check_signals(MANOEUVRES["wall-relay"], craft)
        now = craft.observe()
        if not (math.isfinite(now.d_starboard) or math.isfinite(now.wall_angle)):
            raise PreconditionFailed(
                "hold distance needs two rangefinders ahead, but the vehicle reports one (DISTANCE_SENSOR). The second "
                "one needs an id of its own and orientation 0. Or let one look to port (7) and one to starboard (1)"
            )
        angle = now.wall_angle
        if not math.isfinite(angle):
            angle = WallReading.of_two(now.psi, now.d, now.d_starboard, self.settings.apart).phi
        self.facing = now.psi - angle

    def movements(self, context: TuneContext) -> str:
        """Return the step in words."""
        return f"a step of {self.settings.distance_step:g} m away from the wall and back"

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the step."""
        return [Leg(FACING, FACING_TIME), Leg("keeping the distance", 3.0 * DISTANCE_LEG)]

    def fly(self, context: TuneContext, found: OwnMotion) -> HeldDistance:
        """Identify surge by the distance, and keep it."""
        s = self.settings
        turn = _loop(context, found, self.step(context), s.tune.omega_0)
        context.log.say(FACING)
        context.runner.fly(FaceWall(self.facing), FACING)
        ahead = _loop(context, motion(context, "distance", s.models, s.tune.full_scale), s.distance_step)
        surge, yaw = ahead.design, turn.design
        law = design_distance(surge.model, yaw.model, surge.wanted, yaw.wanted)
        law = law.with_limits(X=surge.law.limits, N=yaw.law.limits)
        outputs = (ahead.output, turn.output)
        duration = max(SETTLED_TIMES / surge.wanted.omega_0, DISTANCE_LEG)
        keep = KeepDistance(law, s.apart, s.distance_step, duration, DISTANCE_LEG, outputs, "own-distance")
        trial = context.fly(keep, "keeping the distance")
        return HeldDistance(surge, yaw, trial, distance_figures(trial))


class HoldPosition(Task):
    """Hold a position and a heading, and step away from both and back."""

    axes = ("ahead", "sideways")

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that does not thrust sideways, or reports no position."""
        lookup(POSITION_LAWS, self.settings.law, "position law")
        craft = context.craft
        if "Y" not in craft.forces:
            raise WrongVehicle("holding a position needs thrusters that push sideways. Use heading or depth")
        now = craft.observe()
        if not (math.isfinite(now.x) and math.isfinite(now.y)):
            raise PreconditionFailed("hold position needs a position (DVL, USBL or GPS), but the vehicle reports none")

    def movements(self, context: TuneContext) -> str:
        """Return the step in words."""
        s = self.settings
        return (
            f"a step of {s.distance_step:g} m ahead and to starboard with a turn of "
            f"{math.degrees(self.step(context)):.0f} deg, and back ({s.law} control)"
        )

    def briefly(self, context: TuneContext) -> str:
        """Return the step without the law that holds the position."""
        turn = math.degrees(self.step(context))
        return f"{self.settings.distance_step:g} m ahead and to starboard, {turn:.0f} deg turn, and back"

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the step."""
        return [Leg("holding the position", 3.0 * DISTANCE_LEG)]

    def fly(self, context: TuneContext, found: OwnMotion) -> HeldPosition:
        """Identify surge and sway, and hold the position."""
        s = self.settings
        turning = _loop(context, found, self.step(context), s.tune.omega_0)
        ahead, sideways = (
            _loop(context, motion(context, axis, s.models, s.tune.full_scale), s.distance_step) for axis in self.axes
        )
        surge, sway, yaw = ahead.design, sideways.design, turning.design
        make = POSITION_LAWS[s.law](surge, sway, yaw)
        slowest = min(d.wanted.omega_0 for d in (surge, sway, yaw))
        duration = max(2.0 * SETTLED_TIMES / slowest, DISTANCE_LEG)
        outputs = (ahead.output, sideways.output, turning.output)
        turn = self.step(context)
        keep = KeepPosition(make, s.distance_step, turn, duration, DISTANCE_LEG, outputs, "own-position")
        trial = context.fly(keep, "holding the position")
        return HeldPosition(s.law, (surge, sway, yaw), trial, position_figures(trial))


MOTIONS: Mapping[str, str] = {"ahead": "place ahead", "sideways": "place sideways", "distance": "distance to the wall"}
"""Axis -> what its relays oscillate about."""
DISTANCE_LEG = 30.0
"""Shortest time at one distance [s]. Chosen."""
TASKS: Mapping[str, Callable[[HoldSettings], Task]] = {
    "heading": HoldSetPoint,
    "depth": HoldSetPoint,
    "line": HoldLine,
    "distance": HoldDistance,
    "position": HoldPosition,
}
"""What can be held -> its task; one class and one line add another."""


def _loop(context: TuneContext, found: OwnMotion, step: float, omega_0: float | None = None) -> AxisLoop:
    """Return the loop of one motion, designed while the link is served, and report it."""
    loop = context.run_in_background(found.loop, step, context.settings.model, omega_0)
    context.log.say(told(loop.design))
    return loop


def _own(manoeuvre: Manoeuvre, loop: AxisLoop, context: TuneContext) -> UnderOwnLoop:
    """Return *manoeuvre* under our own *loop*."""
    law, names = loop.design.law, context.axis.kind.names
    own = SetPointLoop(law, names, throttle=context.throttle, output=loop.output)
    gains = {"structure": law.structure.name, "K_P": law.K_P, "K_I": law.K_I, "K_D": law.K_D, "drag": law.drag}
    return UnderOwnLoop(manoeuvre, own, gains, keeps_still=not context.craft.firmware.needs_way)
