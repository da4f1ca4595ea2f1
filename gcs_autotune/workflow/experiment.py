"""``experiment``: fly the experiments of an axis and identify the craft, as in the first half of a tune. No parameter
is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from gcs_autotune.axes import axis_kind
from gcs_autotune.documents import MODEL
from gcs_autotune.errors import WrongVehicle
from gcs_autotune.firmware import Axis, Firmware
from gcs_autotune.identify import AxisFit, save_model
from gcs_autotune.link import Journal
from gcs_autotune.observer import Observer
from gcs_autotune.report import save_page, study_document
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.announcement import battery, how_long, room
from gcs_autotune.workflow.context import TuneContext, tune_runner
from gcs_autotune.workflow.experiments import dive_for, dive_words, speed_for
from gcs_autotune.workflow.identification import Identified, identify
from gcs_autotune.workflow.itinerary import Itinerary, legs_of_experiment, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import check_depth_is_reported
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.study import study_of
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.tune_preview import excursion_of

__all__ = ["experiment", "learn", "leave_experiment"]


def experiment(settings: TuneSettings, operator: Operator, observer: Observer, when: str = "") -> AxisFit:
    """Fly and record the experiments, identify the craft and return the record. The run directory receives ``trials/``,
    ``telemetry.tlog``, ``fit.json``, ``report.html``.

    No parameter is written. However the run ends, the vehicle is restored to its previous state.

    Raises
    ------
    WrongVehicle
        A boat has no heave.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        The cause of an early end; the record is on disk.
    """
    record, log = RunDirectory(settings.directory), TuneLog(settings, when, observer)
    found: list[Identified] = []
    visit = visiting(settings, operator, log, record, settings.axis, dofs=(axis_kind(settings.axis).dof,))
    with record.summarised(f"experiment {settings.axis}", when, log):
        onboard = run_mission(visit, partial(_declare, settings, found), log)
    (identified,) = found
    fit = log.fit or identified.fit
    onboard.identify([fit], when)
    leave_experiment(record, fit, identified.runs, f"Experiment: {settings.axis}", when)
    return fit


def leave_experiment(record: RunDirectory, fit: AxisFit, runs: Sequence[Trial], title: str, when: str) -> None:
    """Write the *fit* of *runs*, its model and its report to the run directory."""
    record.save_json("fit.json", fit.to_dict())
    save_model(fit, record.path / MODEL)
    study = study_of(fit, [run.proper for run in runs], title, when)
    save_page(record.path, study_document(study))


def _declare(settings: TuneSettings, found: list[Identified], visit: Visit[TuneLog]) -> Mission:
    """Return what this experiment will do on the vehicle of *visit*, which puts its model into *found*."""
    context, craft = learn(settings, visit), visit.craft
    now, firmware, axis = craft.observe(), craft.firmware, context.axis
    down = dive_words(axis.dof, firmware, now)
    pace = pace_of(craft.steered_by)
    legs = legs_of_experiment(axis.dof, pace, dives=dive_for(axis.dof, firmware, now) is not None)
    itinerary = Itinerary(legs, pace.turn)
    whole = excursion_of(context, now, (itinerary,))

    def fly(_: Journal) -> None:
        found.append(identify(context.begin(), turns_first=False))

    movements, briefly = _movements(context, *down)
    return Mission(
        itinerary=itinerary,
        modes=(*([firmware.hold_mode] if any(down) else []), firmware.manual_mode),
        movements=movements,
        needs=(
            room(axis.dof, context.speed, settings, now, whole),
            how_long(itinerary),
            battery(now, settings.envelope, itinerary.seconds),
        ),
        fly=fly,
        moves_briefly=briefly,
    )


def _movements(context: TuneContext, down: str, dive: str) -> tuple[str, str]:
    """Return what moves as a sentence and in one line of a terminal. *down*, *dive*: of :func:`.dive_words`."""
    kind, firmware = context.axis.kind, context.craft.firmware
    by_throttle = kind.excitation.by_throttle and firmware.needs_way
    flown = f"two {'throttle-step' if by_throttle else 'self-oscillation'} experiments in {context.axis.name}"
    briefly = f"two {'series of throttle steps' if by_throttle else 'oscillations'}"
    more, perhaps = (
        ", and a third one if these two do not distinguish a dead zone from a thrust curve",
        ", perhaps a third",
    )
    if by_throttle or context.settings.most_relays < 3:
        more = perhaps = ""
    return f"{kind.excitation.check}{down}{flown}{more}", f"{dive}pulses, {briefly}{perhaps}"


def learn(settings: TuneSettings, visit: Visit[TuneLog]) -> TuneContext:
    """Learn what is flown and how fast; nothing moves yet."""
    craft = visit.craft
    axis = _axis(settings.axis, craft.firmware)
    if settings.pull_test is not None and not craft.firmware.needs_way:
        raise WrongVehicle(
            f"--pull-test is for the throttle of a boat. An {craft.firmware.kind} is identified by relays"
        )
    visit.log.meet(craft)
    check_depth_is_reported(craft, axis.dof)
    present = craft.parameters.read_existing(["CRUISE_THROTTLE", "CRUISE_SPEED"])
    throttle, speed = speed_for(settings, axis, present)
    settings = replace(settings, speed=speed)
    runner = tune_runner(settings, visit, speed)
    return TuneContext(settings, visit, runner, Earlier(settings), axis, None, present, throttle, speed)


def _axis(name: str, firmware: Firmware) -> Axis:
    """Return the motion to identify. The firmware does not need a control loop for it."""
    kind = axis_kind(name)
    if kind.excitation.below_surface and firmware.floats:
        raise WrongVehicle(f"this vehicle ({firmware.name}, a boat) has no depth loop. Use heading or speed")
    return Axis(name, "", (), (), needs_speed=firmware.needs_way)
