"""``tune``: from the link to proved gains, and back to where it started on every other ending.

Order: connect, say what will happen (``announcement``), read and save the present parameters, then what every tune does
(``tunable_loop``) with a loop of the autopilot (``autopilot_loop``): fly the step with the present gains, identify,
design, ask, write, read back, fly the same step, keep or restore. Last the report. The legs share a
:class:`TuneContext`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from gcs_autotune.design import LAWS
from gcs_autotune.errors import AutotuneError, BadFile, ParameterMissing, UsageError
from gcs_autotune.firmware import FIRMWARE, Axis, read_named
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.registry import lookup
from gcs_autotune.report import TuneStory, proof_command, write_story
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.announcement import announce
from gcs_autotune.workflow.autopilot_loop import autopilot_loop
from gcs_autotune.workflow.background import asked_now
from gcs_autotune.workflow.connection import axis_of, connect_craft
from gcs_autotune.workflow.context import TuneContext, armed, recorder
from gcs_autotune.workflow.experiments import speed_for
from gcs_autotune.workflow.jit_warmup import await_warmup, jit_warmup
from gcs_autotune.workflow.onboard_log import log_of_run
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import (
    check_depth_is_reported,
    check_throttle_is_free,
    remarks_on,
)
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier, note_setting_out, way_on
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.supplied_gains import changes_of
from gcs_autotune.workflow.supplied_model import supplied_for
from gcs_autotune.workflow.tunable_loop import tune_loop
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.worker import Worker

__all__ = ["tune"]


def tune(settings: TuneSettings, operator: Operator, watcher: Watcher, when: str) -> TuneStory:
    """Tune one axis and return its story; the run directory holds everything on every ending.

    Raises
    ------
    AutotuneError
        Whatever ended it early. By then the craft is as found (or ``NotAsFound`` says what is not), and the
        report of the aborted run is written.
    """
    earlier = Earlier(settings)
    record = RunDirectory(settings.directory)
    log = TuneLog(settings, when, watcher)
    axes = [f.axes[settings.axis] for f in FIRMWARE.values() if settings.axis in f.axes]
    try:
        with (
            jit_warmup(settings.connection.uri, (a.dof for a in axes), (a.law for a in axes)) as worker,
            connect_craft(
                settings.connection, operator, log, record, settings.control_rate, settings.axis, settings.patience
            ) as craft,
        ):
            context = _set_out(settings, operator, log, record, craft, worker, earlier)
            await_warmup(craft, worker, log)
            with log_of_run(settings.fetch_log, craft, record, operator, log) as onboard:
                announce(context)
                try:
                    with armed(craft, log, record, settings.connection) as journal:
                        loop = autopilot_loop(context)
                        tune_loop(loop, log, context.agrees, journal, dry_run=settings.dry_run)
                finally:
                    read_again(craft, log, record)
        onboard.identify([log.fit] if log.fit is not None else [], when)
    except BaseException as error:
        log.abort(error)
        on = way_on(settings, log.finished, error)
        if on:
            log.say(on)
        raise
    finally:
        _leave_report(log, record)
    return log.story()


def _leave_report(log: TuneLog, record: RunDirectory) -> None:
    """Write the report, if there was a link; a disk that is full must not hide how the run ended."""
    if not record.is_made:
        return
    story = log.story()
    try:
        if story.awaits_proof and story.proposal is not None:
            comment = f"proposed by gcs-autotune {story.title}, {story.when}, neither written nor proved. To prove:"
            record.save_proposed(story.proposal.new, *log.parameter_types(), f"{comment}\n{proof_command(story)}")
        write_story(story, record.path)
    except (OSError, BadFile) as error:
        log.say(f"the report could not be written to {record.path}: {error}")


def _set_out(
    settings: TuneSettings,
    operator: Operator,
    log: TuneLog,
    record: RunDirectory,
    craft: MavlinkCraft,
    worker: Worker,
    earlier: Earlier,
) -> TuneContext:
    """Learn what is tuned and what the vehicle has now; nothing moves yet."""
    axis = axis_of(craft.firmware, settings.axis)
    lookup(LAWS, axis.law, "control law")  # refused before anything else when there is none
    given = None if settings.given is None else supplied_for(settings.given, axis, settings.full_scale)
    log.meet(craft)
    axis, own = learn_parameters(craft, axis, log)
    log.parameters_before = own
    earlier.verify_same_vehicle(craft, own)
    craft.parameters.watch(own)  # a gain that another station writes from now on belies what is flown
    note_setting_out(record, settings, craft, own)
    present = axis.names.to_canonical(own)
    throttle, speed = speed_for(settings, axis, present)
    check_throttle_is_free(craft, axis.dof, throttle)
    check_depth_is_reported(craft, axis.dof)
    envelope, keep = replace(settings.envelope, cruise=speed), recorder(craft, record, log)
    ask = partial(asked_now, craft, operator, log)
    runner = ManoeuvreRunner(craft, envelope, log, keep, settings.patience, ask, gains=True)
    log.say(f"present parameters saved to {record.save_parameters('before', own)}")
    if settings.resume is not None:
        names = ", ".join(earlier.names) or "no completed experiment there"
        log.say(f"using from {settings.resume}: {names}; vehicle and parameters are unchanged")
    for remark in remarks_on(craft):
        log.say(remark)
    about = axis, given, present, throttle, speed
    context = TuneContext(settings, operator, log, record, craft, runner, worker, earlier, *about)
    if settings.gains is not None:
        log.given_changes = changes_of(context, settings.gains)
        if not log.given_changes:
            raise UsageError(f"the vehicle already has the gains of {settings.gains.file}; nothing to prove")
    return context


def learn_parameters(craft: MavlinkCraft, axis: Axis, log: TuneLog) -> tuple[Axis, dict[str, float]]:
    """Return *axis* under the vehicle's own names, and the values found, keyed by those.

    Raises
    ------
    ParameterMissing
        The vehicle has one of the gains under no name we know.
    """
    wanted = [*(gain.parameter for gain in axis.gains), *axis.context]
    names, found = read_named(craft.parameters, wanted)
    missing = [name for name in wanted if names.own(name) not in found]
    gains = [gain.parameter for gain in axis.gains if gain.parameter in missing]
    if gains:
        raise ParameterMissing(
            f"{craft.session.vehicle} has no parameter {', '.join(gains)}, nor any newer known name of it. "
            "Its firmware is too old, too new or lacks that feature",
            name=gains[0],
        )
    if missing:
        log.say(f"this firmware has no {', '.join(missing)}; the design omits it")
    return axis.called(names), found


def read_again(craft: MavlinkCraft, log: TuneLog, record: RunDirectory) -> None:
    """Read the parameters once more, whatever happened: the proof of what the vehicle holds now."""
    try:
        with craft.shielded():
            after = craft.parameters.read_existing(log.parameters_before, as_is=True)
    except AutotuneError as error:
        log.say(f"the parameters could not be read back: {error}")
    else:
        log.parameters_after = after
        record.save_parameters("after", after)
