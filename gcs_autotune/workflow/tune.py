"""``tune``: from the link to proved gains. On every other ending the initial gains are restored.

The sequence is that of a :class:`.Mission`, with the sequence of every tune (``tunable_loop``) inside it, for a loop of
the autopilot (``autopilot_loop``). The steps are: fly the step with the present gains, identify, design, ask, write,
read back, fly the same step, keep or restore. The report comes last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module

from gcs_autotune.design import LAWS, style_of
from gcs_autotune.errors import AutotuneError, BadFile, LinkLost, UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.observer import Observer
from gcs_autotune.registry import lookup
from gcs_autotune.report import TuneStory, parameters_sentence, proof_command, write_story
from gcs_autotune.tunables import tunable
from gcs_autotune.workflow.announcement import battery, how_long, room, some_of, styled
from gcs_autotune.workflow.autopilot_loop import autopilot_loop, learn_parameters
from gcs_autotune.workflow.connection import axis_of
from gcs_autotune.workflow.context import TuneContext, tune_runner
from gcs_autotune.workflow.experiments import speed_for
from gcs_autotune.workflow.itinerary import Itinerary, pace_of
from gcs_autotune.workflow.mission import Mission, Visit, run_mission, visiting
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import (
    check_depth_is_reported,
    check_loop_has_motors,
    check_throttle_is_free,
    remarks_on,
)
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import Earlier, way_on
from gcs_autotune.workflow.settings import SETTLED, TuneSettings
from gcs_autotune.workflow.supplied_gains import changes_of
from gcs_autotune.workflow.supplied_model import supplied_for
from gcs_autotune.workflow.tunable_loop import tune_loop
from gcs_autotune.workflow.tune_log import TuneLog
from gcs_autotune.workflow.tune_preview import excursion_of, movements_of, tune_legs

__all__ = ["TuneJob", "fly_job", "job_of", "leave_report", "read_back", "tune"]


@dataclass(frozen=True, slots=True)
class TuneJob:
    """How one row of ``TUNABLES`` is tuned.

    ``run``: tune it, as :func:`tune` does. ``declare``: return what that will do on the vehicle of a visit, with the
    errors of its checks; nothing moves.
    """

    run: Callable[[TuneSettings, Operator, Observer, str], TuneStory]
    declare: Callable[[TuneSettings, Visit[TuneLog]], Mission]


def job_of(name: str) -> TuneJob:
    """Return the job of the tunable called *name*; ``KeyError`` if there is none."""
    module, _, attribute = tunable(name).job.partition(":")
    job: TuneJob = getattr(import_module(module), attribute)
    return job


def fly_job(
    declare: Callable[[TuneSettings, Visit[TuneLog]], Mission],
    settings: TuneSettings,
    operator: Operator,
    observer: Observer,
    when: str,
    *,
    name: str,
    dofs: tuple[str, ...],
) -> TuneStory:
    """Fly the mission that *declare* returns, and return its story. However it ends, the run directory has its files.

    name : of the row of ``TUNABLES``. dofs : degrees of freedom whose code is compiled before the link is opened.
    Errors are those of :func:`tune`.
    """
    record, log = RunDirectory(settings.directory), TuneLog(settings, when, observer, name)
    visit = visiting(settings, operator, log, record, settings.axis, dofs=dofs)
    try:
        run_mission(visit, partial(declare, settings), log)
    finally:
        leave_report(log, record)
    return log.story()


def tune(settings: TuneSettings, operator: Operator, observer: Observer, when: str) -> TuneStory:
    """Tune one axis and return its record. However it ends, all its files are in the run directory.

    Raises
    ------
    AutotuneError
        The cause of an early end. By then the vehicle is restored (or ``NotAsFound`` lists what is not), and the report
        of the aborted run is written.
    """
    earlier, record, log = Earlier(settings), RunDirectory(settings.directory), TuneLog(settings, when, observer)
    axes = [f.axes[settings.axis] for f in FIRMWARE.values() if settings.axis in f.axes]
    compiled = {"dofs": tuple(a.dof for a in axes), "laws": tuple(a.law for a in axes)}
    visit = visiting(settings, operator, log, record, settings.axis, **compiled)
    try:
        onboard = run_mission(visit, partial(_declare, settings, earlier), log)
        onboard.identify([log.fit] if log.fit is not None else [], when)
    finally:
        leave_report(log, record)
    return log.story()


def _declare(settings: TuneSettings, earlier: Earlier, visit: Visit[TuneLog]) -> Mission:
    """Return what this tune will do on the vehicle of *visit*; nothing moves yet."""
    context = _learn(settings, earlier, visit)
    craft, log, axis = visit.craft, visit.log, context.axis
    now, firmware = craft.observe(), craft.firmware
    pace, slow = (pace_of(craft.steered_by, restless=restless) for restless in (False, True))
    itinerary = Itinerary(tune_legs(context, pace, now), pace.turn)
    patient = Itinerary(tune_legs(replace(context, settings=replace(settings, stop_rule=SETTLED)), slow, now))
    whole = excursion_of(context, now, (itinerary, patient) if settings.ends_early else (itinerary,))
    movements, moves = movements_of(context, now)
    loop, designs = autopilot_loop(context), settings.gains is None
    tuned = [axis.names.own(g.parameter) for g in axis.gains] if designs else [c.parameter for c in log.given_changes]
    sentence, briefly = some_of(tuned, asks=not settings.agreed, every=not designs)
    return Mission(
        itinerary=itinerary,
        modes=(firmware.hold_mode, firmware.manual_mode),
        movements=movements,
        needs=(
            room(axis.dof, context.speed, settings, now, whole),
            how_long(itinerary, patient),
            battery(now, settings.envelope, itinerary.seconds),
            *([styled(settings.style, designs=designs)] if designs or style_of(settings.style).slower > 1.0 else []),
        ),
        fly=lambda journal: tune_loop(loop, log, visit.agrees, journal, dry_run=settings.dry_run),
        writes="write no parameter (dry run)" if settings.dry_run else sentence,
        moves_briefly=moves,
        writes_briefly="" if settings.dry_run else briefly,
        held=log.parameters_before,
        finish=partial(read_back, loop.read, visit),
        way_on=lambda error: "" if settings.agreed else way_on(settings, log.finished, error),
    )


def _learn(settings: TuneSettings, earlier: Earlier, visit: Visit[TuneLog]) -> TuneContext:
    """Determine what is tuned and the vehicle's present values; nothing moves yet."""
    craft, log, record = visit.craft, visit.log, visit.record
    axis = axis_of(craft.firmware, settings.axis)
    lookup(LAWS, axis.law, "control law")  # refused before anything else when there is none
    given = None if settings.given is None else supplied_for(settings.given, axis, settings.full_scale)
    log.meet(craft)
    check_loop_has_motors(axis, craft)
    axis, own = learn_parameters(craft, axis, log)
    log.parameters_before = own
    earlier.verify_same_vehicle(craft, own)
    craft.parameters.watch(own)  # a gain that another station writes from now on belies what is flown
    present = axis.names.to_canonical(own)
    throttle, speed = speed_for(settings, axis, present)
    check_throttle_is_free(craft, axis.dof, throttle)
    check_depth_is_reported(craft, axis.dof)
    runner = tune_runner(settings, visit, speed)
    log.say(f"present parameters saved to {record.save_parameters('before', own)}")
    if settings.resume is not None:
        names = ", ".join(earlier.names) or "no completed experiment there"
        log.say(f"using from {settings.resume}: {names}. Vehicle and parameters are unchanged")
    for remark in remarks_on(craft):
        log.say(remark)
    context = TuneContext(settings, visit, runner, earlier, axis, given, present, throttle, speed)
    if settings.gains is not None:
        log.given_changes = changes_of(context, settings.gains)
        if not log.given_changes:
            raise UsageError(f"the vehicle already has the gains of {settings.gains.file}. There is nothing to test")
    return context


def leave_report(log: TuneLog, record: RunDirectory) -> None:
    """Write the report if the link was opened. A full disk must not hide how the run ended."""
    if not record.is_made:
        return
    story = log.story()
    if story.ending == "aborted":  # other endings state it in their verdict
        log.say(parameters_sentence(story))
    log.say("writing the report")
    try:
        if story.awaits_proof and story.proposal is not None:
            comment = f"proposed by gcs-autotune {story.title}, {story.when}, not written and not tested. To test them:"
            record.save_proposed(story.proposal.new, *log.parameter_types(), f"{comment}\n{proof_command(story)}")
        write_story(story, record.path)
    except (OSError, BadFile) as error:
        log.say(f"the report could not be written to {record.path}: {error}")


def read_back(read: Callable[[], Mapping[str, float]], visit: Visit[TuneLog]) -> None:
    """Read the gains once more on every ending, as evidence of the vehicle's present values."""
    log = visit.log
    try:
        with visit.craft.shielded():
            after = dict(read())
    except LinkLost:  # the error that ends the run has the silence
        log.say("the parameters could not be read back")
    except AutotuneError as error:
        log.say(f"the parameters could not be read back: {error}")
    else:
        log.parameters_after = after
        visit.record.save_parameters("after", after)


JOB = TuneJob(tune, lambda settings, visit: _declare(settings, Earlier(settings), visit))
