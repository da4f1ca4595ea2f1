"""``tune``: from the link to proved gains, and back to where it started on every other ending.

Order: connect, say what will happen, read and save the present parameters, fly the step as it is, swing the
relay twice and identify (unless a model is given), design, ask, write, read back, fly the same step, keep or give
back, report.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from gcs_autotune.craft import Observation
from gcs_autotune.design import Actuator, Proposal, Spec, StepMetrics, design, design_from, is_better
from gcs_autotune.design.laws import LAWS
from gcs_autotune.design.plant import in_fractions
from gcs_autotune.errors import AutotuneError, NoGainsMeetSpec, NotAchieved, OperatorStopped, ParameterMissing
from gcs_autotune.firmware import read_named
from gcs_autotune.identify import AxisFit, Fit, fit_axis
from gcs_autotune.identify.model_file import save_model
from gcs_autotune.identify.surge import fit_surge
from gcs_autotune.link import Journal, MavlinkCraft, ParameterLoan
from gcs_autotune.manoeuvres import Flown, Manoeuvre, Relay, Sequencer, visit
from gcs_autotune.registry import lookup
from gcs_autotune.report import TuneStory, write_story
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import TWITCHING, axis_of, come_aboard, say_link_times
from gcs_autotune.workflow.experiments import (
    dive_for,
    measure,
    noise_in,
    relay_for,
    resolution,
    second_output,
    speed_for,
    throttle_steps_for,
    turn_for,
)
from gcs_autotune.workflow.given import STRANGE, Given, explained, given_for
from gcs_autotune.workflow.ledger import Ledger
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import ANNOUNCED, CHECKED, STAGE, remarks_on, see_signs, sign_check_for
from gcs_autotune.workflow.proof import Known, Proof, proof_about_rest, proof_of_speed, proof_of_turn_rate
from gcs_autotune.workflow.readiness import make_ready
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resting import jitter_in, resting_noise
from gcs_autotune.workflow.settings import DEFAULTS, TuneSettings
from gcs_autotune.workflow.surge_curve import reduction_of
from gcs_autotune.workflow.tale import Tale
from gcs_autotune.workflow.third_level import third_level
from gcs_autotune.workflow.thrust_curve import design_with_curve, fit_thrust_curve, told
from gcs_autotune.workflow.waiting import ask, think

__all__ = ["tune"]


def tune(settings: TuneSettings, operator: Operator, watcher: Watcher, when: str) -> TuneStory:
    """Tune one axis and return its story; the run directory holds everything on every ending.

    Raises
    ------
    AutotuneError
        Whatever ended it early. By then the craft is as found (or ``NotAsFound`` says what is not), and the
        report of the aborted run is written.
    """
    record = RunDirectory(settings.directory)
    tale = Tale(settings, when, watcher)
    try:
        with come_aboard(settings.connection, operator, tale, record, settings.control_rate) as craft:
            _Tuner(settings, operator, tale, record, craft).run()
    except BaseException as error:
        tale.abort(error)
        raise
    finally:
        _leave_report(tale, record)
    return tale.story()


def _leave_report(tale: Tale, record: RunDirectory) -> None:
    """Write the report; a disk that is full must not hide how the run ended."""
    try:
        write_story(tale.story(), record.path)
    except OSError as error:
        tale.say(f"the report could not be written to {record.path}: {error.strerror or error}")


class _Tuner:
    """One tune aboard one vehicle; each method is one leg of the journey."""

    def __init__(
        self, settings: TuneSettings, operator: Operator, tale: Tale, record: RunDirectory, craft: MavlinkCraft
    ) -> None:
        self._settings = settings
        self._operator = operator
        self._tale = tale
        self._record = record
        self._craft = craft
        self._axis = axis_of(craft.firmware, settings.axis)
        self._law = lookup(LAWS, self._axis.law, "control law")
        self._envelope = settings.envelope
        self._given = None if settings.given is None else given_for(settings.given, self._axis, settings.full_scale)
        self._noise = 0.0
        self._jitter: float | None = None
        self._curved: Fit | None = None
        self._first_step: Trial | None = None

    def run(self) -> None:
        """Everything between coming aboard and leaving."""
        tale = self._tale
        tale.meet(self._craft)
        own = self._read_parameters()
        tale.parameters_before = own
        present = self._axis.names.to_canonical(own)
        self._envelope = replace(self._envelope, cruise=speed_for(self._settings, self._axis, present)[1])
        self._sequencer = Sequencer(self._craft, self._envelope, tale, self._keep)
        tale.say(f"present parameters saved to {self._record.save_parameters('before', own)}")
        for remark in remarks_on(self._craft):
            tale.say(remark)
        self._announce(self._craft.observe())
        try:
            self._visit(present)
        finally:
            self._read_again()

    def _visit(self, present: Mapping[str, float]) -> None:
        """Work aboard; the journal is settled only when the craft was left as found, else `restore` has work to do."""
        ledger = Ledger(self._record, self._settings.connection, self._tale.say)
        try:
            with visit(self._craft, self._tale, ledger.settle) as found:
                journal = ledger.open(self._craft, found)
                make_ready(self._craft, self._tale)
                self._craft.arm()
                say_link_times(self._craft, self._tale)
                self._on_the_water(present, journal)
        finally:
            ledger.leave()

    def _on_the_water(self, present: Mapping[str, float], journal: Journal) -> None:
        tale = self._tale
        throttle, speed = speed_for(self._settings, self._axis, present)
        self._check_signs(throttle)
        dive = dive_for(self._axis.dof, self._craft.firmware.kind, self._craft.observe())
        if dive is not None:
            self._fly(dive, "diving")
        fit: AxisFit | None = None
        if self._law.controls_velocity:
            if self._given is None:
                fit = self._identify(throttle)
                self._come_about(throttle)
            proof = self._proof_of_velocity(throttle, speed, self._known(fit), present)
        else:
            proof = proof_about_rest(self._settings, self._axis, speed)
        before = self._fly(proof.step("step-before"), "step with present gains")
        self._first_step = before.trial
        grain = resolution(before.trial)
        tale.metrics_before = measure(before.trial, resolution=grain)
        if self._given is None:
            fit = fit or self._identify(throttle)
            self._noise = self._noise_of(fit, before.trial)
            if not self._law.controls_velocity:
                self._noise = min(self._noise, resting_noise(before.trial, grain))
                self._jitter = min(self._noise, jitter_in(before.trial, grain))
            proposal = self._design(fit, present, grain, proof)
        else:
            self._noise = self._given.noise_std or self._noise_of(None, before.trial)
            proposal = self._design_from_file(self._given, before.trial, present, grain, proof)
        tale.metrics_before = measure(before.trial, self._noise, grain)
        if proposal.changes:
            tale.say(_promise(proposal))
        if not proposal.changes:
            tale.end("unchanged", "the present gains are already as good as any this tool can offer")
        elif _is_hopeless(proposal, tale.metrics_before):
            tale.end(
                "unchanged",
                "the present gains do better than any that keep the wanted reserve promise to; nothing was written",
            )
        elif self._settings.dry_run:
            tale.end("dry-run", "dry run: nothing was written")
        elif not self._agrees(f"Write {_shown(proposal)} and prove it by the same step?"):
            tale.end("declined", "the new gains were not wanted; nothing was written")
        else:
            self._prove(proposal, journal, throttle, proof, grain)

    def _known(self, fit: AxisFit | None) -> Known:
        """Return what is known of the craft before its loop is flown."""
        if fit is not None:
            reduction = reduction_of(fit)
            return Known(fit.model, Actuator() if reduction is None else reduction.actuator, fit.noise_std)
        assert self._given is not None
        r, full = self._given.reduction, self._given.full_scale or 1.0
        model, _ = in_fractions(r.model, r.covariance, full)
        return Known(model, r.actuator.in_fractions(full), self._given.noise_std)

    def _proof_of_velocity(self, throttle: float, speed: float, known: Known, present: Mapping[str, float]) -> Proof:
        if self._axis.dof == "surge":
            return proof_of_speed(self._settings, throttle, known, present)
        return proof_of_turn_rate(self._settings, speed, known)

    def _noise_of(self, fit: AxisFit | None, step: Trial) -> float:
        """Return the noise of what is stepped: the fit's when it was fitted to that, else read off the step."""
        signal = str(step.meta["signal"])
        if fit is not None and signal in fit.noise:
            return fit.noise[signal]
        return noise_in(step, signal) if fit is None or self._law.controls_velocity else fit.noise_std

    def _check_signs(self, throttle: float) -> None:
        """See that the actuator acts, and the right way, before the autopilot's own loop or a relay relies on it."""
        craft, axis = self._craft, self._axis
        if axis.dof not in CHECKED:
            return
        check = sign_check_for(
            axis.dof, craft.firmware, craft.servos, throttle, axis.needs_speed, self._settings.relay_output
        )
        self._tale.say(STAGE)
        see_signs(check, self._sequencer.fly)

    def _identify(self, throttle: float) -> AxisFit:
        if self._axis.dof == "surge":
            return self._identify_surge(throttle)
        s, tale = self._settings, self._tale
        kind = self._craft.firmware.kind
        least = self._craft.least_period
        relay = relay_for(s, self._axis.dof, kind, throttle, s.relay_output, "relay-1", least_period=least)
        self._come_about(throttle)
        first = self._fly(relay, "first self-oscillation").trial
        relay = relay_for(s, self._axis.dof, kind, throttle, second_output(first), "relay-2", least_period=least)
        self._come_about(throttle)
        trials = [first, self._fly(relay, "second self-oscillation").trial]
        tale.say("identifying")
        tale.fit = plain = self._fitted(trials)
        if s.structure is not None:
            return plain
        step = self._first_step
        if step is None and s.most_relays > len(trials):
            third = think(self._craft, lambda: third_level(trials, plain))
            if third is not None:
                tale.say(third.why)
                relay = relay_for(s, self._axis.dof, kind, throttle, third.output, "relay-3", least_period=least)
                self._come_about(throttle)
                trials += self._third(relay)
                tale.fit = plain = self._fitted(trials)
        self._curved = think(self._craft, lambda: fit_thrust_curve(trials, plain, step))
        if self._curved is not None:
            tale.say(told(self._curved, plain))
            save_model(self._curved, self._record.path / "model_with_thrust_curve.json")
        return tale.fit

    def _third(self, relay: Relay) -> list[Trial]:
        """Return the third oscillation; none when the craft would not: the two others are enough to go on."""
        try:
            return [self._fly(relay, "third self-oscillation").trial]
        except NotAchieved as error:
            self._tale.say(f"{error}; going on with the two that were flown")
            return []

    def _fitted(self, trials: list[Trial]) -> AxisFit:
        s = self._settings
        delay: float | Literal["auto"] = "auto" if s.delay is None else s.delay
        return think(self._craft, lambda: fit_axis(trials, dof=self._axis.dof, structure=s.structure, delay=delay))

    def _identify_surge(self, throttle: float) -> AxisFit:
        s, tale, trials = self._settings, self._tale, list[Trial]()
        for n, stage in enumerate(("first throttle steps", "second throttle steps")):
            self._come_about(throttle)
            trials.append(self._fly(throttle_steps_for(throttle, n, f"throttle-{n + 1}"), stage).trial)
        tale.say("identifying")
        delay: float | Literal["auto"] = "auto" if s.delay is None else s.delay
        tale.fit = think(self._craft, lambda: fit_surge(trials, structure=s.structure, delay=delay))
        return tale.fit

    def _design_from_file(
        self, given: Given, flown: Trial, present: Mapping[str, float], grain: float, proof: Proof
    ) -> Proposal:
        tale, file = self._tale, given.file
        share = think(self._craft, lambda: explained(given, flown))
        if not math.isnan(share):
            strange = "" if share >= STRANGE else ": is it a model of this craft, at this speed, with this full scale?"
            tale.say(f"the model '{file.name}' explains {share:.0f} % of the step just flown{strange}")
        tale.say(f"designing from the model '{file.name}'")
        spec = replace(self._spec(tale.speed_of([flown]), grain, proof), full_scale=given.full_scale)
        tale.proposal = think(
            self._craft,
            lambda: design_from(
                file.model,
                self._axis,
                present,
                spec,
                inputs=file.inputs,
                names=file.names,
                covariance=file.covariance,
            ),
        )
        for remark in tale.proposal.remarks:
            tale.say(remark.sentence)
        return tale.proposal

    def _spec(self, speed: float, grain: float, proof: Proof) -> Spec:
        s, flown = self._settings, proof.settings
        speed = speed if proof.design_speed is None else proof.design_speed
        return Spec(
            kind=s.model,
            omega_0=s.omega_0,
            settling_time=s.settling_time,
            step=abs(flown.size),
            speed=speed if self._axis.needs_speed and speed > 0.0 else None,
            step_duration=flown.duration,
            noise_std=self._noise,
            jitter_std=self._jitter,
            quantum=grain,
            noise_bandwidth=0.5 * self._craft.rates.granted["ATTITUDE"].granted,
            measured=proof.measured,
            skid=self._craft.skid,
        )

    def _design(self, fit: AxisFit, present: Mapping[str, float], grain: float, proof: Proof) -> Proposal:
        tale = self._tale
        tale.say("designing")
        spec, reduction = self._spec(tale.relay_speed(), grain, proof), reduction_of(fit)
        curved = self._curved
        if curved is not None:
            try:
                tale.proposal = think(self._craft, lambda: design_with_curve(curved, self._axis, present, spec))
                return tale.proposal
            except NoGainsMeetSpec as error:
                tale.say(f"with the thrust curve {error}; designing without it")
        tale.proposal = think(
            self._craft, lambda: design(fit.model, fit.covariance, self._axis, present, spec, reduction)
        )
        return tale.proposal

    def _prove(self, proposal: Proposal, journal: Journal, throttle: float, proof: Proof, grain: float) -> None:
        tale = self._tale
        with ParameterLoan(self._craft.parameters, journal) as loan:
            tale.say("writing " + ", ".join(f"{n} {v:g}" for n, v in proposal.new.items()))
            loan.set(proposal.new)
            tale.say("written and read back")
            self._come_about(throttle)
            after = self._fly(proof.step("step-after"), "step with new gains")
            assert tale.metrics_before is not None
            tale.metrics_after = measure(after.trial, self._noise, grain)
            verdict = is_better(tale.metrics_before, tale.metrics_after, self._law.free_overshoot)
            tale.verdict = (verdict.better, verdict.reasons)
            if verdict.better:
                loan.keep()
                tale.end("kept", "the new gains are better and stay")
        if not verdict.better:
            tale.end("restored", "the new gains are not better; the old ones are back, verified by reading them")

    def _fly(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        self._tale.say(stage)
        flown = self._sequencer.fly(manoeuvre, stage)
        if flown.outcome.ending == "aborted":
            raise NotAchieved(f"{stage}: {flown.outcome.reason}")
        return flown

    def _come_about(self, throttle: float) -> None:
        """Turn a boat round, so that it does not run away in one direction."""
        turn = turn_for(self._craft.firmware.kind, throttle)
        if turn is not None:
            free = replace(self._envelope, heading_excursion=math.inf)
            self._sequencer.fly(turn, "turning about", free)

    def _keep(self, trial: Trial) -> None:
        self._record.keep(trial)
        self._tale.flown(trial.proper)
        self._tale.say(f"{trial.name}: {trial.ending}, {trial.reason} ({trial.duration:.0f} s recorded)")

    def _read_parameters(self) -> dict[str, float]:
        """Return the axis' parameters under the vehicle's own names, and learn those."""
        wanted = [*(gain.parameter for gain in self._axis.gains), *self._axis.context]
        names, found = read_named(self._craft.parameters, wanted)
        missing = [name for name in wanted if names.own(name) not in found]
        gains = [gain.parameter for gain in self._axis.gains if gain.parameter in missing]
        if gains:
            raise ParameterMissing(
                f"{self._craft.session.vehicle} has no parameter {', '.join(gains)}, nor under any newer name we know; "
                "its firmware is older, newer or built without that feature",
                name=gains[0],
            )
        if missing:
            self._tale.say(f"this firmware has no {', '.join(missing)}; the design does without")
        self._axis = self._axis.called(names)
        return found

    def _read_again(self) -> None:
        """Read the parameters once more, whatever happened: the proof of what the vehicle holds now."""
        try:
            with self._craft.shielded():
                after = self._craft.parameters.read_existing(self._tale.parameters_before)
        except AutotuneError as error:
            self._tale.say(f"the parameters could not be read again: {error}")
        else:
            self._tale.parameters_after = after
            self._record.save_parameters("after", after)

    def _announce(self, now: Observation) -> None:
        s, axis, d, firmware = self._settings, self._axis, DEFAULTS[self._axis.dof], self._craft.firmware
        step = s.step if s.step is not None else d.step
        shown = f"{math.degrees(step):.0f} deg " if d.signal == "psi" else f"{step:g} m "
        shown = "" if self._law.controls_velocity else shown
        _, speed = speed_for(s, axis, axis.names.to_canonical(self._tale.parameters_before))
        room = f", turning about in between; about {100.0 * speed:.0f} m of free water around" if speed else ""
        under_way = f" under way at {speed:.1f} m/s{room}" if axis.needs_speed else ""
        gains = ", ".join(axis.names.own(g.parameter) for g in axis.gains)
        dive = dive_for(axis.dof, firmware.kind, now)
        down = f"dive to {dive.settings['depth']:g} m, then " if dive is not None else ""
        signs = ANNOUNCED if axis.dof in CHECKED else ""
        kind = "throttle steps" if axis.dof == "surge" else f"oscillations about the present {DOF_NAMES[axis.dof]}"
        swings = f" and {kind}" if self._given is None else ""
        self._tale.announce(
            (
                ("leave the vehicle armed, as it is" if now.armed else "arm the vehicle, and disarm it at the end")
                + f"; {TWITCHING}",
                f"use the modes {firmware.hold_mode} and {firmware.manual_mode}, and go back to {now.mode} at the end",
                f"move: {signs}{down}{shown}steps in {axis.name}{swings}{under_way}",
                "write no parameter (dry run)"
                if s.dry_run
                else f"write some of {gains}, after asking again; the old values come back unless the new prove better",
            )
        )
        if not self._agrees("Go ahead?"):
            raise OperatorStopped("not started: the answer was no; nothing was armed, moved or written")

    def _agrees(self, question: str) -> bool:
        if self._craft.session.transport.is_simulated:
            self._tale.say(f"{question} Simulated vehicle: not asking.")
            return True
        return ask(self._craft, self._operator, question)


def _is_hopeless(proposal: Proposal, measured: StepMetrics) -> bool:
    """Whether the new gains promise no better step than the present ones promise and were just seen to give."""
    return proposal.after.metrics.itae >= max(proposal.before.metrics.itae, measured.itae)


DOF_NAMES = {"yaw": "heading", "heave": "depth"}
"""Degree of freedom -> what oscillates, to people."""


def _shown(proposal: Proposal) -> str:
    return ", ".join(f"{c.parameter} {c.old:g} -> {c.new:g}" for c in proposal.changes)


def _promise(proposal: Proposal) -> str:
    """Say what the new gains promise on the identified model, before anybody is asked about them."""
    old, new, low = proposal.before.metrics, proposal.after.metrics, proposal.worst_margins
    return (
        f"predicted: error over time {old.itae:.3g} -> {new.itae:.3g} s^2, overshoot {old.overshoot:.0%} -> "
        f"{new.overshoot:.0%}; margins at worst {min(low.gain, 100.0):.1f} in gain, {math.degrees(low.phase):.0f} deg "
        "in phase"
    )
