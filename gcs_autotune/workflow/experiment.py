"""``experiment``: the first half of a tune: fly the experiments of an axis, identify it, and change nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from gcs_autotune.axes import axis_kind
from gcs_autotune.craft import Observation
from gcs_autotune.errors import OperatorStopped, WrongVehicle
from gcs_autotune.firmware import Axis, Firmware
from gcs_autotune.identify import AxisFit, save_model
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.report import study_document, to_html
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.announcement import after_a_silence, battery, excursion_of, how_long, room
from gcs_autotune.workflow.background import asked_now
from gcs_autotune.workflow.connection import arming, connect_craft
from gcs_autotune.workflow.context import TuneContext, armed, recorder
from gcs_autotune.workflow.experiments import dive_for, speed_for
from gcs_autotune.workflow.identification import identify
from gcs_autotune.workflow.itinerary import Itinerary, legs_of_experiment, pace_of
from gcs_autotune.workflow.jit_warmup import await_warmup, jit_warmup
from gcs_autotune.workflow.onboard_log import log_of_run
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import see_depth_is_told
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.study import study_of
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.worker import Worker

__all__ = ["experiment"]


def experiment(settings: TuneSettings, operator: Operator, watcher: Watcher, when: str = "") -> AxisFit:
    """Fly, record and identify; the run directory gets ``trials/``, ``telemetry.tlog``, ``fit.json``, ``report.html``.

    No parameter is written. The craft is left as found on every ending.

    Raises
    ------
    WrongVehicle
        A boat has no heave.
    OperatorStopped, GuardTripped, NotAchieved, LinkError, NotInformative
        What ended it early; the record is on disk.
    """
    record, log = RunDirectory(settings.directory), TuneLog(settings, when, watcher)
    uri, dof = settings.connection.uri, axis_kind(settings.axis).dof
    with (
        record.summarised(f"experiment {settings.axis}", when),
        jit_warmup(uri, [dof], []) as worker,
        connect_craft(
            settings.connection, operator, log, record, settings.control_rate, settings.axis, settings.patience
        ) as craft,
    ):
        context = _set_out(settings, operator, log, record, craft, worker)
        await_warmup(craft, worker, log)
        with log_of_run(settings.fetch_log, craft, record, operator, log) as onboard:
            _announce(context, craft.observe())
            with armed(craft, log, record, settings.connection):
                context = context.begin()
                found = identify(context, turns_first=False)
    fit = log.fit or found.fit
    onboard.identify([fit], when)
    record.save_json("fit.json", fit.to_dict())
    save_model(fit, record.path / "model.json")
    study = study_of(fit, [run.proper for run in found.runs], f"Experiment: {settings.axis}", when)
    (record.path / "report.html").write_text(to_html(study_document(study)), encoding="utf-8")
    return fit


def _set_out(
    settings: TuneSettings,
    operator: Operator,
    log: TuneLog,
    record: RunDirectory,
    craft: MavlinkCraft,
    worker: Worker,
) -> TuneContext:
    """Learn what is flown and how fast; nothing moves yet."""
    axis = _axis(settings.axis, craft.firmware)
    log.meet(craft)
    see_depth_is_told(craft, axis.dof)
    present = craft.parameters.read_existing(["CRUISE_THROTTLE", "CRUISE_SPEED"])
    throttle, speed = speed_for(settings, axis, present)
    settings = replace(settings, speed=speed)
    envelope = replace(settings.envelope, cruise=speed)
    ask = partial(asked_now, craft, operator, log)
    runner = ManoeuvreRunner(craft, envelope, log, recorder(craft, record, log), settings.patience, ask, gains=True)
    about = axis, None, present, throttle, speed
    return TuneContext(settings, operator, log, record, craft, runner, worker, Earlier(settings), *about)


def _axis(name: str, firmware: Firmware) -> Axis:
    """Return the firmware's loop of that name, or, where it has none, the motion alone, which is identified all the
    same.
    """
    kind = axis_kind(name)
    if kind.excitation.below_surface and firmware.floats:
        raise WrongVehicle(f"this vehicle ({firmware.name}, a boat) has no depth. Use heading or speed")
    return Axis(name, kind.dof, "", (), (), needs_speed=firmware.needs_way)


def _announce(context: TuneContext, now: Observation) -> None:
    settings, craft, dof = context.settings, context.craft, context.axis.dof
    firmware, kind = craft.firmware, axis_kind(context.axis.name)
    dive = dive_for(dof, firmware, now)
    pace = pace_of(under_way=firmware.needs_way, skid=craft.skid)
    legs = legs_of_experiment(dof, pace, under_way=firmware.needs_way, dives=dive is not None)
    itinerary = context.log.itinerary = Itinerary(legs, pace.turn)
    modes, down = f"mode {firmware.manual_mode}", ""
    if dive is not None:
        modes = f"modes {firmware.hold_mode} and {firmware.manual_mode}"
        down = f"dive to {dive.settings['depth']:g} m, then "
    by_throttle = kind.excitation.by_throttle and firmware.needs_way
    flown = "throttle-step" if by_throttle else "self-oscillation"
    more = ", and a third of the same length if these do not separate a dead zone from a thrust curve"
    maybe = "" if by_throttle or settings.most_relays < 3 else more
    context.log.announce(
        (
            arming(craft, now),
            f"use the {modes}, and return to {now.mode} at the end",
            f"move: {kind.excitation.check}{down}two {flown} experiments in {context.axis.name}{maybe}",
            room(dof, context.speed, settings, now, excursion_of(context, now, (itinerary,))),
            how_long(itinerary),
            battery(now, settings.envelope, itinerary.seconds),
            *after_a_silence(settings, now),
            "write no parameter",
        )
    )
    if not context.agrees("Go ahead?"):
        raise OperatorStopped("not started: the answer was no. Nothing was armed or moved")
