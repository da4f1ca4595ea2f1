"""Design gains from a model of the craft, either identified in this run or read from a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.axes import SIGNAL_FORCES
from gcs_autotune.design import LoopStart, Proposal, Spec, StepMetrics, design, design_from, style_of
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import Fit, Model
from gcs_autotune.manoeuvres import StepSettings, windows_of
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiments import measure, measure_halves, noise_as_read, noise_in, resolution
from gcs_autotune.workflow.identification import Identified, delay_of
from gcs_autotune.workflow.noise_estimate import jitter_in, noise_while_held
from gcs_autotune.workflow.proof import Proof, design_input_of, reduction_of
from gcs_autotune.workflow.stop_rule import DesignQuestion
from gcs_autotune.workflow.supplied_model import STRANGE, SuppliedModel, explained

__all__ = [
    "StepCriteria",
    "criteria_of",
    "design_from_file",
    "design_from_fit",
    "question_of",
    "spec_as_flown",
]


@dataclass(frozen=True, slots=True, eq=False)
class StepCriteria:
    """Criteria for evaluating a step.

    ``proof``: the step as flown.
    ``noise``: standard deviation of the signal's noise (SI).
    ``grain``: resolution of the signal's sensor (SI).
    ``jitter``: standard deviation of the noise that moves the actuator; None: all of ``noise``.
    """

    proof: Proof
    noise: float
    grain: float
    jitter: float | None = None

    def read(self, step: Trial, windows: Sequence[float] = ()) -> StepMetrics:
        """Return the metrics of a flown *step*; each half is evaluated over its first *windows* [s]."""
        return measure(step, self.noise, self.grain, windows)

    def halves(self, step: Trial, windows: Sequence[float] = ()) -> list[StepMetrics]:
        """Return the metrics of the step out and of the step back."""
        return measure_halves(step, self.noise, self.grain, windows)


def design_from_fit(context: TuneContext, found: Identified, criteria: StepCriteria, flown: Trial) -> Proposal:
    """Return gains for the model just identified. Use its actuator effects if gains can be designed with them.

    flown : the step with the present gains.
    """
    log, axis, fit = context.log, context.axis, found.fit
    log.say("designing")
    spec, reduction = _spec(context, log.relay_speed(), criteria, flown), reduction_of(fit)
    extended = found.extended
    if extended is not None:
        try:
            log.proposal = context.run_in_background(_design_extended, extended, axis, context.present, spec)
            return log.proposal
        except NoGainsMeetSpec as error:
            log.say(f"design with the identified actuator failed: {error}. Designing with an ideal actuator")
            log.fit = fit
    log.proposal = context.run_in_background(
        design, fit.model, fit.craft_covariance, axis, context.present, spec, reduction
    )
    return log.proposal


def question_of(context: TuneContext, criteria: StepCriteria, flown: Trial) -> DesignQuestion:
    """Return the question that the experiments answer: the gains to design, with the specification from *criteria*.
    *flown*: the step with the present gains.
    """
    spec = _spec(context, context.log.speed_of([flown]), criteria, flown)
    s = context.settings
    return DesignQuestion(context.axis, context.present, spec, flown, s.structure, delay_of(s))


def design_from_file(context: TuneContext, given: SuppliedModel, flown: Trial, criteria: StepCriteria) -> Proposal:
    """Return gains for the model from a file. Report how much of the step *flown* with the present gains the model
    explains.
    """
    log, file = context.log, given.file
    share = context.run_in_background(explained, given, flown)
    if not math.isnan(share):
        strange = "" if share >= STRANGE else ". Check that the model is of this craft, at this speed and full scale"
        log.say(f"the model '{file.name}' explains {share:.0f} % of the step just flown{strange}")
    log.say(f"designing from the model '{file.name}'")
    spec = replace(_spec(context, log.speed_of([flown]), criteria, flown), full_scale=given.full_scale)
    log.proposal = context.run_in_background(
        design_from,
        file.model,
        context.axis,
        context.present,
        spec,
        inputs=file.inputs,
        names=file.names,
        covariance=file.covariance,
    )
    for remark in log.proposal.remarks:
        log.say(remark.sentence)
    return log.proposal


def _spec(context: TuneContext, speed: float, criteria: StepCriteria, before: Trial) -> Spec:
    s, proof = context.settings, criteria.proof
    style = style_of(s.style)
    speed = speed if proof.design_speed is None else proof.design_speed
    by_thrust = context.craft.skid or context.present.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0
    spec = Spec(
        kind=s.model,
        omega_0=s.omega_0,
        settling_time=s.settling_time,
        bandwidth=style.bandwidth,
        gain_margin=style.gain_margin,
        phase_margin=style.phase_margin,
        speed=speed if context.axis.needs_speed and speed > 0.0 else None,
        start=_start_of(before) if context.law.controls_velocity else None,
        noise_bandwidth=0.5 * context.craft.rates.granted["ATTITUDE"].granted,
        measured=proof.measured,
        skid=context.craft.skid,
        throttle=context.throttle if by_thrust else 0.0,
        beyond_ranges=s.beyond_ranges,
    )
    return spec_as_flown(spec, criteria, before)


def spec_as_flown(spec: Spec, criteria: StepCriteria, before: Trial) -> Spec:
    """Return *spec* for the step that was flown as *before* and is evaluated by *criteria*."""
    flown = criteria.proof.settings
    return replace(
        spec,
        step=abs(flown.size),
        step_duration=flown.duration,
        windows=windows_of(before),
        settled_band=float(before.meta.get("band", math.inf)),
        settled_time=flown.enough,
        settled_least=flown.least_enough,
        hold=min(flown.hold, flown.least_hold),
        noise_std=noise_as_read(before, criteria.noise),
        jitter_std=criteria.noise if criteria.jitter is None else criteria.jitter,
        quantum=criteria.grain,
    )


def criteria_of(step: Trial, *, moving: bool) -> StepCriteria:
    """Return the criteria for evaluating a *step* that an earlier run flew.

    moving : whether the loop controls a velocity.
    """
    own, signal, grain = step.meta, str(step.meta["signal"]), resolution(step)
    kept = {name: float(own.get(name, math.inf)) for name in ("enough", "least_hold", "least_enough")}
    hold = float(own.get("hold", 0.0))
    settings = StepSettings(signal, float(own["size"]), float(own["duration"]), hold=hold, **kept)
    jitter = jitter_in(step, grain)
    noise = noise_in(step, signal) if moving else noise_while_held(step, grain)
    noise = noise if math.isfinite(noise) else jitter
    return StepCriteria(Proof(settings, None, {}).after(step), noise, grain, None if moving else min(noise, jitter))


START_WINDOW = 1.0
"""Time [s] before a step over which velocity and output are averaged. Project choice: ten samples of the velocity."""


def _start_of(step: Trial) -> LoopStart | None:
    """Return the state of a velocity loop at the start of the flown *step*; None if it was not recorded.

    A speed loop with slow gains does not come to rest in the space there is. The prediction of such a step must start
    where the flown step did.
    """
    targets = [mark for mark in step.marks if mark.kind == "target"]
    if len(targets) < 2:
        return None
    until, base, signal = targets[1].t, float(targets[0].detail["value"]), str(step.meta["signal"])
    side = math.copysign(1.0, float(step.meta["size"]))
    means = []
    for name in (signal, SIGNAL_FORCES[signal]):
        channel = step.channels.get(name)
        before = None if channel is None else channel.between(until - START_WINDOW, until).values
        if before is None or len(before) == 0:
            return None
        means.append(float(np.mean(before)))
    return LoopStart(side * (means[0] - base), side * means[1])


def _design_extended(found: Fit[Model], axis: Axis, present: Mapping[str, float], spec: Spec) -> Proposal:
    """Return gains designed with the actuator of *found* in the loop.

    Errors as for :func:`gcs_autotune.design.design_from`.
    """
    model, units, covariance = design_input_of(found)
    return design_from(model, axis, present, spec, inputs=units, names=tuple(found.parameters), covariance=covariance)
