"""``hold``: our own controller holds heading or depth, from the surface computer: identify, design, fly, report.

The order is that of Miskovic2010, algorithm 8.4: one or two relays, the model, the gains by a model function, the loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from gcs_autotune.control import OwnDesign, SetPointLoop, Uncertainty, design_own, uncertainty_of
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import save_model
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import KeepSetPoint, Manoeuvre, Step, StepSettings, UnderOwnLoop
from gcs_autotune.models import SingleDof
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
SETTLED_TIMES = 6.0
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
    model, uncertainty, full_scale = _model(context, given)
    step = tune.step if tune.step is not None else kind.step
    most = RANGE * full_scale
    design = context.run_in_background(
        design_own,
        model,
        uncertainty,
        step=step,
        limits=(-most, most),
        kind=tune.model,
        omega_0=tune.omega_0,
    )
    context.log.say(_told(design))
    duration = tune.step_duration or max(SETTLED_TIMES / design.wanted.omega_0, 0.5 * kind.step_duration)
    proof = StepSettings(kind.stepped, step, duration, speed=context.speed, settle=2.0 * SETTLE, hold=SETTLE)
    context.turn_around("own-step", SWING_AHEAD)
    trial = context.fly(_own(Step(proof, "own-step"), design, context, full_scale), "step with our own loop")
    if settings.seconds > 0.0:
        keep = KeepSetPoint(kind.stepped, settings.seconds, context.speed, "own-hold")
        context.fly(_own(keep, design, context, full_scale), "holding")
    metrics = measure(trial, noise_in(trial, kind.stepped), resolution(trial))
    return HeldLoop(tune.axis, design, trial, metrics, full_scale)


def _model(context: TuneContext, given: SuppliedModel | None) -> tuple[SingleDof, Uncertainty, float]:
    """Return the model to design from, its uncertainty, and its input at full output."""
    if given is not None:
        covariance = given.reduction.covariance
        uncertainty = SUPPLIED if covariance is None else uncertainty_of(given.reduction.model, np.asarray(covariance))
        return given.reduction.model, uncertainty, given.full_scale or 1.0
    identified = identify(context, turns_first=False)
    save_model(identified.fit, context.visit.record.path / "model.json")
    return identified.fit.model, uncertainty_of(identified.fit.model, identified.fit.covariance), 1.0


def _own(manoeuvre: Manoeuvre, design: OwnDesign, context: TuneContext, full_scale: float) -> UnderOwnLoop:
    """Return *manoeuvre* under our own loop of *design*."""
    law, names = design.law, context.axis.kind.names
    loop = SetPointLoop(law, names, throttle=context.throttle, full_scale=full_scale)
    gains = {"structure": law.structure.name, "K_P": law.K_P, "K_I": law.K_I, "K_D": law.K_D, "drag": law.drag}
    return UnderOwnLoop(manoeuvre, loop, gains, keeps_still=not context.craft.firmware.needs_way)


def _told(design: OwnDesign) -> str:
    law, wanted = design.law, design.wanted
    return (
        f"controller {law.structure.name}: K_P {law.K_P:.3g}, K_I {law.K_I:.3g}, K_D {law.K_D:.3g} for a "
        f"{wanted.kind} loop of {wanted.omega_0:.2g} rad/s"
    )
