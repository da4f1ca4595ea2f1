"""``tune``: from the link to proved gains, and back to where it started on every other ending.

Order: connect, say what will happen (``announcement``), read and save the present parameters (``axis_parameters``),
fly the step as it is, swing the relay twice and identify (``identification``, unless a model is given), design
(``designing``), ask, write, read back, fly the same step, keep or give back (``decision``), report. The legs share a
:class:`Voyage`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from gcs_autotune.design.laws import LAWS
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Journal, MavlinkCraft
from gcs_autotune.manoeuvres import restore_on_exit
from gcs_autotune.registry import lookup
from gcs_autotune.report import TuneStory, proof_command, write_story
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import axis_of, come_aboard, say_link_times
from gcs_autotune.workflow.announcement import announce
from gcs_autotune.workflow.axis_parameters import learn_parameters, read_again
from gcs_autotune.workflow.decision import decide, decide_on_given
from gcs_autotune.workflow.designing import Ruler, design_from_file, design_from_fit
from gcs_autotune.workflow.desk import Desk
from gcs_autotune.workflow.experiments import dive_for, measure, noise_in, resolution, speed_for, steering_throttle
from gcs_autotune.workflow.given import given_for
from gcs_autotune.workflow.given_gains import GivenGains, changes_of, step_of
from gcs_autotune.workflow.helm import Helm
from gcs_autotune.workflow.identification import Identified, again_with_step, identify
from gcs_autotune.workflow.ledger import Ledger
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import (
    STAGE,
    remarks_on,
    see_depth_is_told,
    see_signs,
    see_throttle_is_free,
    sign_check_for,
)
from gcs_autotune.workflow.proof import known_of, proof_about_rest, proof_of_velocity
from gcs_autotune.workflow.readiness import make_ready
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resting import jitter_in, noise_behind, resting_noise
from gcs_autotune.workflow.resuming import Earlier, note_setting_out, way_on
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.tale import Tale
from gcs_autotune.workflow.voyage import Voyage
from gcs_autotune.workflow.waiting import agreed, beside
from gcs_autotune.workflow.warming import warmed, warming

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
    tale = Tale(settings, when, watcher)
    axes = [f.axes[settings.axis] for f in FIRMWARE.values() if settings.axis in f.axes]
    try:
        with (
            warming(settings.connection.uri, (a.dof for a in axes), (a.law for a in axes)) as desk,
            come_aboard(settings.connection, operator, tale, record, settings.control_rate, settings.axis) as craft,
        ):
            voyage = _set_out(settings, operator, tale, record, craft, desk, earlier)
            warmed(craft, desk, tale)
            announce(voyage)
            try:
                _visit(voyage)
            finally:
                read_again(craft, tale, record)
    except BaseException as error:
        tale.abort(error)
        on = way_on(settings, tale.finished)
        if on:
            tale.say(on)
        raise
    finally:
        _leave_report(tale, record)
    return tale.story()


def _leave_report(tale: Tale, record: RunDirectory) -> None:
    """Write the report, if there was a link; a disk that is full must not hide how the run ended."""
    if not record.is_made:
        return
    story = tale.story()
    try:
        if story.awaits_proof and story.proposal is not None:
            comment = f"proposed by gcs-autotune {story.title}, {story.when}; not written and not proved. To prove:"
            record.save_proposed(story.proposal.new, *tale.parameter_types(), f"{comment}\n{proof_command(story)}")
        write_story(story, record.path)
    except (OSError, BadFile) as error:
        tale.say(f"the report could not be written to {record.path}: {error}")


def _set_out(
    settings: TuneSettings,
    operator: Operator,
    tale: Tale,
    record: RunDirectory,
    craft: MavlinkCraft,
    desk: Desk,
    earlier: Earlier,
) -> Voyage:
    """Learn what is tuned and what the vehicle has now; nothing moves yet."""
    axis = axis_of(craft.firmware, settings.axis)
    law = lookup(LAWS, axis.law, "control law")
    given = None if settings.given is None else given_for(settings.given, axis, settings.full_scale)
    tale.meet(craft)
    axis, own = learn_parameters(craft, axis, tale)
    tale.parameters_before = own
    earlier.see_that_it_is_the_same(craft, own)
    note_setting_out(record, settings, craft, own)
    present = axis.names.to_canonical(own)
    throttle, speed = speed_for(settings, axis, present)
    see_throttle_is_free(craft, axis.dof, throttle)
    see_depth_is_told(craft, axis.dof)
    envelope, keep = replace(settings.envelope, cruise=speed), _keeper(craft, record, tale)
    helm = Helm(craft, envelope, tale, keep, settings.patience, partial(agreed, craft, operator, tale))
    tale.say(f"present parameters saved to {record.save_parameters('before', own)}")
    if settings.resume is not None:
        names = ", ".join(earlier.names) or "nothing was flown to its end there"
        tale.say(f"of {settings.resume} will be used: {names}; the vehicle and its parameters are the same")
    for remark in remarks_on(craft):
        tale.say(remark)
    about = axis, law, given, present, throttle, speed
    voyage = Voyage(settings, operator, tale, record, craft, helm, desk, earlier, *about)
    if settings.gains is not None:
        tale.given_changes = changes_of(voyage, settings.gains)
        if not tale.given_changes:
            raise UsageError(f"the vehicle has the gains of {settings.gains.file} already: there is nothing to prove")
    return voyage


def _keeper(craft: MavlinkCraft, record: RunDirectory, tale: Tale) -> Callable[[Trial], None]:
    def keep(trial: Trial) -> None:
        beside(craft, partial(record.keep, trial))
        tale.flown(trial.proper)
        tale.say(f"{trial.name}: {trial.ending}, {trial.reason} ({trial.duration:.0f} s recorded)")

    return keep


def _visit(voyage: Voyage) -> None:
    """Work aboard; the journal is settled only when the craft was left as found, else `restore` has work to do."""
    craft, tale = voyage.craft, voyage.tale
    ledger = Ledger(voyage.record, voyage.settings.connection, tale.say)
    try:
        with restore_on_exit(craft, tale, ledger.settle) as found:
            journal = ledger.open(craft, found)
            make_ready(craft, tale)
            craft.arm()
            say_link_times(craft, tale)
            _on_the_water(voyage, journal)
    finally:
        ledger.leave()


def _on_the_water(voyage: Voyage, journal: Journal) -> None:
    settings, tale, axis, given = voyage.settings, voyage.tale, voyage.axis, voyage.given
    _check_signs(voyage)
    dive = dive_for(axis.dof, voyage.craft.firmware, voyage.craft.observe())
    if dive is not None:
        voyage.fly(dive, "diving")
    if settings.gains is not None:
        _prove_given(voyage, settings.gains, journal)
        return
    found: Identified | None = None
    if voyage.law.controls_velocity:
        if given is None:
            found = identify(voyage)
            voyage.come_about("step-before")
            known = known_of(found, axis)
        else:
            known = known_of(given, axis)
        proof = proof_of_velocity(axis.dof, settings, voyage.throttle, voyage.speed, known, voyage.present)
    else:
        proof = proof_about_rest(settings, axis, voyage.speed)
    before = voyage.fly(proof.step("step-before"), "step with present gains").trial
    if axis.dof == "yaw" and axis.needs_speed and found is None:
        voyage = replace(voyage, throttle=steering_throttle(before, voyage.present, voyage.throttle))
    grain = resolution(before)
    tale.metrics_before = measure(before, resolution=grain)
    if given is None:
        moving = voyage.law.controls_velocity
        found = identify(voyage, before) if found is None else again_with_step(voyage, found, before)
        noise = noise_behind(before, found.fit, moving, grain)
        ruler = Ruler(proof, noise, grain, None if moving else min(noise, jitter_in(before, grain)))
        proposal = design_from_fit(voyage, found, ruler)
    else:
        ruler = Ruler(proof, given.noise_std or noise_in(before, str(before.meta["signal"])), grain)
        proposal = design_from_file(voyage, given, before, ruler)
    tale.metrics_before = measure(before, ruler.noise, grain)
    decide(voyage, proposal, tale.metrics_before, ruler, journal)


def _prove_given(voyage: Voyage, gains: GivenGains, journal: Journal) -> None:
    """Fly the step of a proof with the present gains, then with those of a file; the better ones stay."""
    asked = proof_about_rest(voyage.settings, voyage.axis, voyage.speed)
    proof = replace(asked, settings=step_of(gains, asked.settings))
    before = voyage.fly(proof.step("step-before"), "step with present gains").trial
    grain = resolution(before)
    ruler = Ruler(proof, _noise_in_proof(before, gains, voyage.law.controls_velocity, grain), grain)
    metrics = voyage.tale.metrics_before = measure(before, ruler.noise, ruler.grain)
    decide_on_given(voyage, metrics, ruler, journal)


def _noise_in_proof(before: Trial, gains: GivenGains, moving: bool, grain: float) -> float:
    """Return the noise a proof of given gains is measured through, as :func:`noise_behind` where there is a fit."""
    signal = str(before.meta["signal"])
    if moving:
        return gains.noise.get(signal, noise_in(before, signal))
    found = min(gains.noise.get(signal, math.inf), resting_noise(before, grain))
    return found if math.isfinite(found) else noise_in(before, signal)


def _check_signs(voyage: Voyage) -> None:
    """See that the actuator acts, and the right way, before the autopilot's own loop or a relay relies on it."""
    craft, axis = voyage.craft, voyage.axis
    output = voyage.settings.relay_output
    check = sign_check_for(axis.dof, craft.firmware, craft.servos, voyage.throttle, axis.needs_speed, output)
    voyage.tale.say(STAGE)
    see_signs(check, voyage.helm.fly)
