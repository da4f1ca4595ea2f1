"""``hold``: a controller of our own on the surface computer: identify, design, fly, report.

The order is that of Miskovic2010, algorithm 8.4: one or two relays, the model, the gains by a model function, the loop.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.control import (
    LINE_LAWS,
    POSITION_LAWS,
    DirectLine,
    LineQuestion,
    OwnDesign,
    SetPointLoop,
    Uncertainty,
    design_distance,
    design_own,
    uncertainty_of,
)
from gcs_autotune.design import Actuator
from gcs_autotune.errors import PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import fit_axis, save_model
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    FollowLine,
    KeepDistance,
    KeepPosition,
    KeepSetPoint,
    Manoeuvre,
    Step,
    StepSettings,
    UnderOwnLoop,
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
    to_html,
)
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiment import learn
from gcs_autotune.workflow.experiments import SWING_AHEAD, dive_for, measure, noise_in, resolution
from gcs_autotune.workflow.identification import identify
from gcs_autotune.workflow.itinerary import Itinerary, Leg, legs_of_experiment, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import check_signals
from gcs_autotune.workflow.proof import Known, known_of, reduction_with_curve
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.supplied_model import SuppliedModel, supplied_for
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.tune_preview import excursion_of

__all__ = ["HoldSettings", "hold"]

RANGE = 0.9
"""Largest output that our own loops use [fraction of full]; the relays' too."""
SETTLE = 10.0
"""Holding before the step [s]: until the integral has found the constant disturbance."""
SETTLED_TIMES = 8.0
"""Duration of the step each way, in reciprocals of the characteristic frequency: a third-order Bessel loop settles in
four. Chosen."""
SUPPLIED = Uncertainty(0.1, 0.2)
"""Relative errors assumed of a model whose file has no covariance, Miskovic2010, section 8.1.2."""


@dataclass(frozen=True, slots=True)
class HoldSettings:
    """One run of ``hold``.

    Attributes
    ----------
    what : a name in :data:`TASKS`. tune : settings of the experiments and of the step.
    seconds : how long it holds after a step [s].
    offset, length : of a line: metres to starboard of the craft, and metres along it.
    guidance : the law that follows a line, a name in ``LINE_LAWS``. approach : largest angle to it [rad].
    apart : distance between the two rangefinders ahead [m].
    distance_step : step away from a wall, or of a position [m].
    law : the law that holds a position, a name in ``POSITION_LAWS``.
    """

    what: str
    tune: TuneSettings
    seconds: float = 0.0
    offset: float = 8.0
    length: float = 60.0
    guidance: str = "indirect"
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
    with record.summarised(f"hold {settings.what}", when):
        run_mission(visit, partial(_declare, task, flown), log)
    (held,) = flown
    page = to_html(hold_document(held, f"Hold: {settings.what}", when))
    (record.path / "report.html").write_text(page, encoding="utf-8")
    return held


def _declare(task: Task, flown: list[Held], visit: Visit[TuneLog]) -> Mission:
    """Return what this run will do on the vehicle of *visit*; it puts its result into *flown*."""
    tune = task.settings.tune
    context, craft = learn(tune, visit), visit.craft
    kind = context.axis.kind
    task.check(context)
    given = None if tune.given is None else supplied_for(tune.given, context.axis, tune.full_scale)
    now, firmware = craft.observe(), craft.firmware
    dive = dive_for(context.axis.dof, firmware, now)
    pace = pace_of(craft.steered_by)
    legs = list(legs_of_experiment(context.axis.dof, pace, dives=dive is not None))
    if given is not None:
        legs = [leg for leg in legs if not leg.kind]
    legs += [replace(leg, before=pace.turn) if not k else leg for k, leg in enumerate(task.legs(context))]
    itinerary = Itinerary(legs, pace.turn)
    whole = excursion_of(context, now, (itinerary,))

    def fly(_: Journal) -> None:
        started = context.begin()
        flown.append(task.fly(started, _prepared(started, given)))

    relays = "" if given is not None else f"relay oscillations about the present {kind.excitation.title}, then "
    down = "" if dive is None else f"dive to {float(dive.settings['depth']):g} m, then "
    return Mission(
        itinerary=itinerary,
        modes=(*([firmware.hold_mode] if dive is not None else []), firmware.manual_mode),
        movements=f"{kind.excitation.check}{down}{relays}{task.movements(context)} with our own controller",
        needs=(
            room(context.axis.dof, context.speed, tune, now, whole),
            how_long(itinerary),
            battery(now, tune.envelope, itinerary.seconds),
        ),
        fly=fly,
    )


@dataclass(frozen=True, slots=True)
class Prepared:
    """What a controller is designed from: the craft, its uncertainty, and the delay of the link there and back [s]."""

    known: Known
    uncertainty: Uncertainty
    link: float

    def design(self, context: TuneContext, step: float) -> OwnDesign:
        """Return the loop whose *step* [rad or m] does not saturate the actuator, computed while the link is served."""
        tune = context.settings
        design = context.run_in_background(
            design_own,
            replace(self.known.model, delay=self.known.model.delay + self.link),
            self.uncertainty,
            step=step,
            limits=_range_of(self.known.actuator),
            kind=tune.model,
            omega_0=tune.omega_0,
        )
        context.log.say(_told(design))
        return design


class Task(ABC):
    """One thing that a controller of our own does."""

    def __init__(self, settings: HoldSettings) -> None:
        self.settings = settings

    @abstractmethod
    def check(self, context: TuneContext) -> None:
        """Raise where the craft cannot do it; nothing has moved."""

    @abstractmethod
    def movements(self, context: TuneContext) -> str:
        """Return in words what moves."""

    @abstractmethod
    def legs(self, context: TuneContext) -> list[Leg]:
        """Return its stages with their times."""

    @abstractmethod
    def fly(self, context: TuneContext, prepared: Prepared) -> Held:
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
        """Return the step in words."""
        step, kind = self.step(context), context.axis.kind
        shown = f"{math.degrees(step):.0f} deg" if kind.angular else f"{step:g} m"
        return f"a {shown} step in {context.axis.name}"

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the step, and the holding after it."""
        step = Leg("step with our own loop", SETTLE + 2.0 * context.axis.kind.step_duration)
        return [step] + [Leg("holding", self.settings.seconds)] * (self.settings.seconds > 0.0)

    def fly(self, context: TuneContext, prepared: Prepared) -> HeldLoop:
        """Fly the step and hold."""
        tune, kind, step = self.settings.tune, context.axis.kind, self.step(context)
        design = prepared.design(context, step)
        duration = tune.step_duration or max(SETTLED_TIMES / design.wanted.omega_0, 0.5 * kind.step_duration)
        proof = StepSettings(kind.stepped, step, duration, speed=context.speed, settle=2.0 * SETTLE, hold=SETTLE)
        context.turn_around("own-step", SWING_AHEAD)
        actuator = prepared.known.actuator
        trial = context.fly(_own(Step(proof, "own-step"), design, actuator, context), "step with our own loop")
        if self.settings.seconds > 0.0:
            keep = KeepSetPoint(kind.stepped, self.settings.seconds, context.speed, "own-hold")
            context.fly(_own(keep, design, actuator, context), "holding")
        metrics = measure(trial, noise_in(trial, kind.stepped), resolution(trial))
        return HeldLoop(context.axis.name, design, trial, metrics)


class HoldLine(Task):
    """Approach a line parallel to the course and follow it."""

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that does not go ahead, or a line that is out of bounds."""
        lookup(LINE_LAWS, self.settings.guidance, "line law")
        if not context.craft.firmware.needs_way:
            raise WrongVehicle("a line is followed under way; this vehicle is steered at rest. Use heading or depth")

    def movements(self, context: TuneContext) -> str:
        """Return the line in words."""
        s = self.settings
        side = "starboard" if s.offset >= 0.0 else "port"
        return f"{s.length:g} m along a line that is {abs(s.offset):g} m to {side} ({s.guidance} control)"

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the line."""
        return [Leg("following the line", (self.settings.length + abs(self.settings.offset)) / context.speed)]

    def fly(self, context: TuneContext, prepared: Prepared) -> HeldLine:
        """Follow the line."""
        s = self.settings
        design = prepared.design(context, self.step(context))
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
        line = FollowLine(law, s.offset, s.length, context.speed, context.throttle, "own-line")
        manoeuvre = line if line.in_manual else _own(line, design, prepared.known.actuator, context)
        trial = context.fly(manoeuvre, "following the line")
        return HeldLine(s.guidance, design, trial, figures_on(trial))


class HoldDistance(Task):
    """Face a wall and keep a distance to it: Miskovic2010, algorithm 8.5."""

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that has no two rangefinders ahead, or does not thrust both ways."""
        craft = context.craft
        if craft.firmware.needs_way:
            raise WrongVehicle("a distance is kept at rest; a boat does not. Use heading or line")
        check_signals(MANOEUVRES["wall-relay"], craft)
        if not math.isfinite(craft.observe().d_starboard):
            raise PreconditionFailed(
                "hold distance needs two rangefinders ahead, but the vehicle reports one (DISTANCE_SENSOR). The second "
                "one needs an id of its own and orientation 0"
            )

    def movements(self, context: TuneContext) -> str:
        """Return the relay and the step in words."""
        return (
            "a relay ahead and astern on the distance to the wall, then "
            f"a step of {self.settings.distance_step:g} m away from it and back"
        )

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the relay and the step."""
        return [Leg("relay on the distance", DISTANCE_RELAY), Leg("keeping the distance", 3.0 * DISTANCE_LEG)]

    def fly(self, context: TuneContext, prepared: Prepared) -> HeldDistance:
        """Identify surge by the distance, and keep it."""
        s = self.settings
        yaw = prepared.design(context, self.step(context))
        options = {"wall-hysteresis": DISTANCE_HYSTERESIS, "least-distance": 0.3, "keep-still": 1.0}
        make = MANOEUVRES["wall-relay"].make
        assert make is not None
        relay = context.fly(make(options), "relay on the distance")
        fit = context.run_in_background(fit_axis, [relay], dof="surge")
        model = replace(fit.model, delay=fit.model.delay + prepared.link)
        surge = context.run_in_background(
            design_own,
            model,
            uncertainty_of(fit.model, fit.craft_covariance),
            step=s.distance_step,
            limits=(-RANGE, RANGE),
            kind=s.tune.model,
        )
        context.log.say(_told(surge))
        law = design_distance(surge.model, yaw.model, surge.wanted, yaw.wanted)
        law = law.with_limits(X=surge.law.limits, N=yaw.law.limits)
        outputs = (_plain, prepared.known.actuator.output_for)
        duration = max(SETTLED_TIMES / surge.wanted.omega_0, DISTANCE_LEG)
        keep = KeepDistance(law, s.apart, s.distance_step, duration, DISTANCE_LEG, outputs, "own-distance")
        trial = context.fly(keep, "keeping the distance")
        return HeldDistance(surge, yaw, trial, distance_figures(trial))


class HoldPosition(Task):
    """Hold a position and a heading, and step away from both and back."""

    def check(self, context: TuneContext) -> None:
        """Raise for a craft that does not thrust sideways, or reports no position."""
        lookup(POSITION_LAWS, self.settings.law, "position law")
        craft = context.craft
        if "Y" not in craft.firmware.channels or not craft.servos.driving("Y"):
            raise WrongVehicle("holding a position needs thrusters that push sideways. Use heading or depth")
        now = craft.observe()
        if not (math.isfinite(now.x) and math.isfinite(now.y)):
            raise PreconditionFailed("hold position needs a position (DVL, USBL or GPS), but the vehicle reports none")

    def movements(self, context: TuneContext) -> str:
        """Return the relays and the step in words."""
        s = self.settings
        return (
            f"relays ahead and sideways, then a step of {s.distance_step:g} m ahead and to starboard with a turn of "
            f"{math.degrees(self.step(context)):.0f} deg, and back ({s.law} control)"
        )

    def legs(self, context: TuneContext) -> list[Leg]:
        """Return the relays and the step."""
        relay = pace_of("rov").relay
        return [
            Leg("relay ahead", relay),
            Leg("relay sideways", relay),
            Leg("holding the position", 3.0 * DISTANCE_LEG),
        ]

    def fly(self, context: TuneContext, prepared: Prepared) -> HeldPosition:
        """Identify surge and sway, and hold the position."""
        s = self.settings
        yaw = prepared.design(context, self.step(context))
        surge, sway = (
            self._along(context, prepared, force, dof, where)
            for force, dof, where in (("X", "surge", "ahead"), ("Y", "sway", "sideways"))
        )
        make = POSITION_LAWS[s.law](surge, sway, yaw)
        slowest = min(d.wanted.omega_0 for d in (surge, sway, yaw))
        duration = max(2.0 * SETTLED_TIMES / slowest, DISTANCE_LEG)
        outputs = (_plain, _plain, prepared.known.actuator.output_for)
        turn = self.step(context)
        keep = KeepPosition(make, s.distance_step, turn, duration, DISTANCE_LEG, outputs, "own-position")
        trial = context.fly(keep, "holding the position")
        return HeldPosition(s.law, (surge, sway, yaw), trial, position_figures(trial))

    def _along(self, context: TuneContext, prepared: Prepared, force: str, dof: str, where: str) -> OwnDesign:
        """Fly a relay of one *force*, identify *dof* and return the design of its loop."""
        make = MANOEUVRES["relay"].of(force).make
        assert make is not None
        relay = make({"throttle": 0.0, "keep-still": 1.0})
        relay.name = f"relay-{dof}"
        trial = context.fly(relay, f"relay {where}")
        fit = context.run_in_background(fit_axis, [trial], dof=dof)
        design = context.run_in_background(
            design_own,
            replace(fit.model, delay=fit.model.delay + prepared.link),
            uncertainty_of(fit.model, fit.craft_covariance),
            step=self.settings.distance_step,
            limits=(-RANGE, RANGE),
            kind=self.settings.tune.model,
        )
        context.log.say(_told(design))
        return design


DISTANCE_RELAY = 130.0
"""Expected time of the relay on the distance [s]: a VideoRay of 16 s period (Miskovic2010, section 7.6)."""
DISTANCE_LEG = 30.0
"""Shortest time at one distance [s]. Chosen."""
DISTANCE_HYSTERESIS = 0.1
"""Hysteresis of the relay on the distance [m]: Miskovic2010, section 7.6."""


def _plain(force: float) -> float:
    return force


TASKS: Mapping[str, Callable[[HoldSettings], Task]] = {
    "heading": HoldSetPoint,
    "depth": HoldSetPoint,
    "line": HoldLine,
    "distance": HoldDistance,
    "position": HoldPosition,
}
"""What can be held -> its task; one class and one line add another."""


def _prepared(context: TuneContext, given: SuppliedModel | None) -> Prepared:
    return Prepared(*_model(context, given))


def _model(context: TuneContext, given: SuppliedModel | None) -> tuple[Known, Uncertainty, float]:
    """Return what to design from, its uncertainty, and the delay of the link, there and back [s]."""
    link = context.craft.link_times.loop
    if given is not None:
        covariance = given.reduction.covariance
        sure = bool(np.any(covariance))
        uncertainty = uncertainty_of(given.reduction.model, covariance) if sure else SUPPLIED
        return known_of(given, context.axis), uncertainty, link
    identified = identify(context, turns_first=False)
    fit, curved = identified.fit, identified.curved
    save_model(fit, context.visit.record.path / "model.json")
    reduction = None if curved is None else reduction_with_curve(curved, context.axis)
    if reduction is None:
        uncertainty = uncertainty_of(fit.model, fit.craft_covariance)
    else:
        uncertainty = uncertainty_of(reduction.model, reduction.covariance)
    return known_of(identified, context.axis), uncertainty, link


def _range_of(actuator: Actuator) -> tuple[float, float]:
    """Return the smallest and the largest force of our own loops: those of :data:`RANGE` of full output."""
    low, high = actuator.static(np.array([-RANGE, RANGE]))
    return float(low), float(high)


def _own(manoeuvre: Manoeuvre, design: OwnDesign, actuator: Actuator, context: TuneContext) -> UnderOwnLoop:
    """Return *manoeuvre* under our own loop of *design*."""
    law, names = design.law, context.axis.kind.names
    loop = SetPointLoop(law, names, throttle=context.throttle, output=actuator.output_for)
    gains = {"structure": law.structure.name, "K_P": law.K_P, "K_I": law.K_I, "K_D": law.K_D, "drag": law.drag}
    return UnderOwnLoop(manoeuvre, loop, gains, keeps_still=not context.craft.firmware.needs_way)


def _told(design: OwnDesign) -> str:
    law, wanted = design.law, design.wanted
    return (
        f"controller {law.structure.name}: K_P {law.K_P:.3g}, K_I {law.K_I:.3g}, K_D {law.K_D:.3g} for a "
        f"{wanted.kind} loop of {wanted.omega_0:.2g} rad/s"
    )
