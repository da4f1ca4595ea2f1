"""``hold``: our own controller holds heading or depth, from the surface computer: identify, design, fly, report.

The order is that of Miskovic2010, algorithm 8.4: one or two relays, the model, the gains by a model function, the loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcs_autotune.control import OwnDesign, SetPointLoop, Uncertainty, design_own, uncertainty_of
from gcs_autotune.design.actuator import Actuator
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import save_model
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import KeepSetPoint, Manoeuvre, Step, StepSettings, UnderOwnLoop
from gcs_autotune.observer import Observer
from gcs_autotune.report import HeldLoop, hold_document, to_html
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiment import learn
from gcs_autotune.workflow.experiments import SWING_AHEAD, dive_for, measure, noise_in, resolution
from gcs_autotune.workflow.identification import identify
from gcs_autotune.workflow.itinerary import Itinerary, Leg, legs_of_experiment, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
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
    """One run of ``hold``: the settings of its experiments and step, and how long it then holds [s]."""

    tune: TuneSettings
    seconds: float = 0.0


def hold(settings: HoldSettings, operator: Operator, observer: Observer, when: str = "") -> HeldLoop:
    """Identify, design a controller of our own, fly a step and hold with it.

    No parameter is written. The vehicle is left as before on every ending. The run directory gets ``trials/``,
    ``model.json`` and ``report.html``.

    Raises
    ------
    UsageError
        The axis has no loop of this kind.
    NoGainsMeetSpec
        No loop keeps its limits on this craft.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        What ended it early; the records are on disk.
    """
    tune = settings.tune
    record, log = RunDirectory(tune.directory), TuneLog(tune, when, observer)
    flown: list[HeldLoop] = []
    visit = visiting(tune, operator, log, record, tune.axis)
    with record.summarised(f"hold {tune.axis}", when):
        run_mission(visit, partial(_declare, settings, flown), log)
    (held,) = flown
    page = to_html(hold_document(held, f"Hold: {tune.axis}", when))
    (record.path / "report.html").write_text(page, encoding="utf-8")
    return held


def _declare(settings: HoldSettings, flown: list[HeldLoop], visit: Visit[TuneLog]) -> Mission:
    """Return what this run will do on the vehicle of *visit*; it puts its result into *flown*."""
    tune = settings.tune
    context, craft = learn(tune, visit), visit.craft
    kind = context.axis.kind
    if kind.controls_velocity:
        raise UsageError(f"hold has no loop of {tune.axis} of its own. Use heading or depth")
    given = None if tune.given is None else supplied_for(tune.given, context.axis, tune.full_scale)
    now, firmware = craft.observe(), craft.firmware
    dive = dive_for(context.axis.dof, firmware, now)
    pace = pace_of(craft.steered_by)
    legs = list(legs_of_experiment(context.axis.dof, pace, dives=dive is not None))
    if given is not None:
        legs = [leg for leg in legs if not leg.kind]
    legs.append(Leg("step with our own loop", SETTLE + 2.0 * kind.step_duration, pace.turn))
    legs += [Leg("holding", settings.seconds)] * (settings.seconds > 0.0)
    itinerary = Itinerary(legs, pace.turn)
    whole = excursion_of(context, now, (itinerary,))

    def fly(_: Journal) -> None:
        flown.append(_fly(settings, context.begin(), given))

    step = tune.step if tune.step is not None else kind.step
    shown = f"{math.degrees(step):.0f} deg" if kind.angular else f"{step:g} m"
    relays = "" if given is not None else f"relay oscillations about the present {kind.excitation.title}, then "
    down = "" if dive is None else f"dive to {float(dive.settings['depth']):g} m, then "
    return Mission(
        itinerary=itinerary,
        modes=(*([firmware.hold_mode] if dive is not None else []), firmware.manual_mode),
        movements=f"{kind.excitation.check}{down}{relays}a {shown} step in {tune.axis} with our own controller",
        needs=(
            room(context.axis.dof, context.speed, tune, now, whole),
            how_long(itinerary),
            battery(now, tune.envelope, itinerary.seconds),
        ),
        fly=fly,
    )


def _fly(settings: HoldSettings, context: TuneContext, given: SuppliedModel | None) -> HeldLoop:
    tune, kind = settings.tune, context.axis.kind
    known, uncertainty, link = _model(context, given)
    step = tune.step if tune.step is not None else kind.step
    design = context.run_in_background(
        design_own,
        replace(known.model, delay=known.model.delay + link),
        uncertainty,
        step=step,
        limits=_range_of(known.actuator),
        kind=tune.model,
        omega_0=tune.omega_0,
    )
    context.log.say(_told(design))
    duration = tune.step_duration or max(SETTLED_TIMES / design.wanted.omega_0, 0.5 * kind.step_duration)
    proof = StepSettings(kind.stepped, step, duration, speed=context.speed, settle=2.0 * SETTLE, hold=SETTLE)
    context.turn_around("own-step", SWING_AHEAD)
    trial = context.fly(_own(Step(proof, "own-step"), design, known.actuator, context), "step with our own loop")
    if settings.seconds > 0.0:
        keep = KeepSetPoint(kind.stepped, settings.seconds, context.speed, "own-hold")
        context.fly(_own(keep, design, known.actuator, context), "holding")
    metrics = measure(trial, noise_in(trial, kind.stepped), resolution(trial))
    return HeldLoop(tune.axis, design, trial, metrics)


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
