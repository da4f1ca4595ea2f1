"""The autopilot's own loops as tunable loops: the gains are parameters, and the proof is a step out and back.

A heading or depth loop is stepped first, and the craft is identified afterwards. A speed or turn-rate step is flown
about the velocity that the experiments measured, so there the experiments come first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from gcs_autotune.design import (
    Proposal,
    StepMetrics,
    Verdict,
    is_better,
    is_calmer,
    is_foretold,
    over_windows,
    scatter_of,
    style_of,
)
from gcs_autotune.errors import ParameterMissing
from gcs_autotune.firmware import Axis, Firmware, read_named
from gcs_autotune.link import Journal, MavlinkCraft, ParameterTransaction
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.report import format_factor
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.accompanying_step import AccompanyingStep, compared_over
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.designing import StepCriteria, design_from_file, design_from_fit, question_of
from gcs_autotune.workflow.experiments import STEP_AHEAD, measure, noise_in, resolution, steering_throttle
from gcs_autotune.workflow.identification import Identified, again_with_step, identify
from gcs_autotune.workflow.noise_estimate import jitter_in, noise_behind, noise_while_held
from gcs_autotune.workflow.proof import Known, Proof, known_of, proof_about_rest, proof_of_velocity, turn_sentence
from gcs_autotune.workflow.settings import SuppliedGains
from gcs_autotune.workflow.stop_rule import SPREAD, KnownDesign
from gcs_autotune.workflow.supplied_gains import step_of
from gcs_autotune.workflow.supplied_model import SuppliedModel
from gcs_autotune.workflow.tunable_loop import GainLoan, Offer, ProofResult, TunableLoop
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["autopilot_loop", "learn_parameters", "lend_parameters", "on_the_other_axis"]

PROVING = "step with new gains"
"""Name of the stage in which proposed gains are tested."""


def autopilot_loop(context: TuneContext) -> TunableLoop:
    """Return the tunable loop of the tune's axis.

    It uses the gains of a file if supplied, otherwise gains designed here.
    """
    if context.settings.gains is not None:
        return _SuppliedGains(context, context.settings.gains)
    return _DesignedGains(context)


def learn_parameters(craft: MavlinkCraft, axis: Axis, log: TuneLog) -> tuple[Axis, dict[str, float]]:
    """Return *axis* with the vehicle's own parameter names, and the parameter values under those names.

    Raises
    ------
    ParameterMissing
        The vehicle has no parameter of a known name for one of the gains.
    """
    wanted = [*(gain.parameter for gain in axis.gains), *axis.context]
    names, found = read_named(craft.parameters, wanted)
    missing = [name for name in wanted if names.own(name) not in found]
    gains = [gain.parameter for gain in axis.gains if gain.parameter in missing]
    if gains:
        raise ParameterMissing(
            f"{craft.session.vehicle} has no parameter {', '.join(gains)}, also not under a newer name. "
            "Check the firmware: it is too old, too new, or built without this loop",
            name=gains[0],
        )
    if missing:
        log.say(f"this firmware has no {', '.join(missing)}. The design omits it")
    return axis.called(names), found


def lend_parameters(craft: MavlinkCraft, journal: Journal) -> GainLoan:
    """Return the transaction on the parameters of *craft*."""
    return ParameterTransaction(craft.parameters, journal)


class _AutopilotLoop:
    """Code shared by both kinds of loop: access to the parameters, and the step that proves the gains."""

    def __init__(self, context: TuneContext) -> None:
        self.context = context
        self._known: Known | None = None
        self._beside: AccompanyingStep | None = None
        self._before: Trial
        self._criteria: StepCriteria

    @property
    def name(self) -> str:
        """Name of the tuned axis."""
        return self.context.axis.name

    def read(self) -> Mapping[str, float]:
        """Return the vehicle's present gains and the other parameters used by the design, under the vehicle's own
        names."""
        return self.context.craft.parameters.read_existing(self.context.log.parameters_before, as_is=True)

    def lend(self, journal: Journal) -> GainLoan:
        """Return a context manager that changes the vehicle's parameters and can restore them."""
        return lend_parameters(self.context.craft, journal)

    def fly_baseline(self) -> None:
        """Fly the turn-rate step that accompanies a heading step, if the craft's model is known well enough to compute
        its size.
        """
        self._beside = AccompanyingStep.flown(self.context, self._known)

    def prove(self) -> ProofResult:
        """Fly the step with the new gains.

        Return the comparison with the step with the old gains, over the time that both records contain.
        """
        context, log, before, criteria = self.context, self.context.log, self._before, self._criteria
        context.turn_around("step-after", STEP_AHEAD, last=self._beside is None)
        if not context.law.controls_velocity:
            context.runner.come_to_rest(PROVING, context.axis.kind)
        after = context.fly(criteria.proof.step("step-after"), PROVING)
        alike = common_windows(before, after)
        if min(alike, default=math.inf) < criteria.proof.settings.duration:
            log.say(compared_over(alike))
        then, now, scatter, log.proposal = context.run_in_background(
            _compared, criteria, before, after, alike, log.proposal
        )
        log.metrics_before, log.metrics_after = then, now
        other = None if self._beside is None else self._beside.compared(context)
        log.beside = None if other is None else (other.before, other.after)
        errors = None if other is None else (other.before.itae, other.after.itae)
        slower = style_of(context.settings.style).slower
        verdict = is_better(then, now, context.law.free_overshoot, errors, scatter, slower)
        if other is not None:
            verdict = Verdict((*verdict.criteria, *other.verdict.criteria))
        return ProofResult(
            verdict, tuple(on_the_other_axis(context.axis, context.craft.firmware, log.proposal, log.beside))
        )

    def _fly_step(self, proof: Proof) -> Trial:
        """Fly the step with the present gains and return it.

        A boat turns around first if the step would leave its space.
        """
        if not self.context.law.controls_velocity and self.context.settings.ends_early:
            self.context.turn_around("step-before", STEP_AHEAD, last=True)
        if proof.settings.signal == "r":
            self.context.log.say(turn_sentence(proof.settings, self.context.settings.envelope.heading_excursion))
        return self.context.fly(proof.step("step-before"), "step with present gains")


class _DesignedGains(_AutopilotLoop):
    """Gains designed from a model, either identified during this run or read from a file."""

    def __init__(self, context: TuneContext) -> None:
        super().__init__(context)
        self._found: Identified | None = None

    def experiment(self) -> None:
        """Fly the step with the present gains and the identification experiments, in the order that the loop
        requires.
        """
        context = self.context = self.context.begin()
        moving, found = context.law.controls_velocity, self._found
        if moving:
            if context.given is None:
                found = identify(context, early=context.settings.ends_early)
                if not found.short:  # else it has just turned around
                    context.turn_around("step-before", STEP_AHEAD)
            proof = self._proof_of_velocity(found or context.given)
        else:
            proof = proof_about_rest(context.settings, context.axis, context.speed)
        before = self._before = self._fly_step(proof)
        if context.axis.steers_by_way and found is None:
            throttle = steering_throttle(before, context.present, context.throttle)
            context = self.context = replace(context, throttle=throttle)
        proof, grain = proof.after(before), resolution(before)
        context.log.metrics_before = context.run_in_background(measure, before, resolution=grain)
        if context.given is not None:
            noise = context.given.noise_std or noise_in(before, str(before.meta["signal"]))
            self._criteria = StepCriteria(proof, noise, grain)
            return
        if found is None:
            found = identify(context, before, self._stop_rule(proof, grain))
        else:
            found = again_with_step(context, found, before)
            proof = replace(proof, measured=self._proof_of_velocity(found).measured)
        noise = noise_behind(before, found.fit, moving, grain)
        self._criteria = StepCriteria(proof, noise, grain, None if moving else min(noise, jitter_in(before, grain)))
        self._found = found

    def propose(self) -> Offer:
        """Return gains designed from the experiments. If short experiments leave the step's predicted cost too
        uncertain, fly the full experiments first.
        """
        context, before, criteria, found = self.context, self._before, self._criteria, self._found
        if context.given is not None:
            proposal = design_from_file(context, context.given, before, criteria)
        else:
            assert found is not None
            proposal = design_from_fit(context, found, criteria, before)
            if found.short and _uncertainty(proposal) > SPREAD:
                context.log.say(
                    f"Predicted ITAE uncertain by {proposal.spread:.0%}: running the full set of experiments"
                )
                found = self._found = identify(context, before)
                proposal = design_from_fit(context, found, criteria, before)
        measured = context.log.metrics_before = context.run_in_background(criteria.read, before, proposal.windows)
        source = found or context.given
        self._known = None if source is None else known_of(source, context.axis)
        return _offer_of(proposal, measured, style_of(context.settings.style).slower)

    def _proof_of_velocity(self, source: Identified | SuppliedModel | None) -> Proof:
        assert source is not None
        context = self.context
        known = known_of(source, context.axis)
        return proof_of_velocity(
            context.axis.dof, context.settings, context.throttle, context.speed, known, context.present
        )

    def _stop_rule(self, proof: Proof, grain: float) -> KnownDesign | None:
        """Return the rule that ends the oscillations once the gains are known, using the previous step.

        None means no such rule.
        """
        context, before = self.context, self._before
        noise = noise_while_held(before, grain)
        if not context.settings.ends_early or not math.isfinite(noise):
            return None
        criteria = StepCriteria(proof, noise, grain, min(noise, jitter_in(before, grain)))
        return KnownDesign(context.craft, context.visit.worker, question_of(context, criteria, before), context.log)


class _SuppliedGains(_AutopilotLoop):
    """Gains from a file. Nothing is identified or designed; the gains are only proved."""

    def __init__(self, context: TuneContext, gains: SuppliedGains) -> None:
        super().__init__(context)
        self._gains = gains

    def experiment(self) -> None:
        """Fly the step with the present gains."""
        context = self.context = self.context.begin()
        asked = proof_about_rest(context.settings, context.axis, context.speed)
        proof = replace(asked, settings=step_of(self._gains, asked.settings))
        before = self._before = self._fly_step(proof)
        grain = resolution(before)
        self._criteria = StepCriteria(proof.after(before), self._noise(grain), grain)
        context.log.metrics_before = context.run_in_background(self._criteria.read, before)

    def propose(self) -> Offer:
        """Return the gains from the file."""
        return Offer(self.context.log.given_changes)

    def _noise(self, grain: float) -> float:
        """Return the measurement noise for the proof; :func:`noise_behind` computes it if a fit exists."""
        before, noise = self._before, self._gains.noise
        signal = str(before.meta["signal"])
        if self.context.law.controls_velocity:
            return noise.get(signal, noise_in(before, signal))
        found = min(noise.get(signal, math.inf), noise_while_held(before, grain))
        return found if math.isfinite(found) else noise_in(before, signal)


def _uncertainty(proposal: Proposal) -> float:
    """Return the excess of the worst predicted ITAE of the new gains over the nominal one, as a fraction.

    It is relative to the new ITAE, or to the improvement if that is larger. Beside a large improvement the uncertainty
    of a small remainder does not matter.
    """
    old, new = proposal.before.metrics.itae, proposal.after.metrics.itae
    return proposal.spread * min(1.0, new / max(old - new, 1e-9))


def _offer_of(proposal: Proposal, measured: StepMetrics, slower: float) -> Offer:
    """Return the offer that *proposal* makes, compared with the step *measured* with the present gains.

    slower : that of the required style.
    """
    if not proposal.changes:
        return Offer((), "the design found no better gains than the present ones")
    old, new = proposal.before.metrics.itae, proposal.after.metrics.itae
    refusal = ""
    calmer = is_calmer(proposal.before.metrics, proposal.after.metrics, slower)
    if new >= max(old, measured.itae) and not calmer:
        # They promise no better step than the present ones promise, and no better than these were just seen to give.
        refusal = (
            "no gains with the required margins are predicted to be better than the present gains "
            f"(ITAE {new:.3g} instead of {old:.3g} s^2){proposal.limit and '. '}{proposal.limit}"
        )
    promise = "; ".join(filter(None, (_promise(proposal), _missed(old, measured.itae))))
    return Offer(proposal.changes, refusal, promise, (old, new, new * (1.0 + proposal.spread)))


def _missed(predicted: float, measured: float) -> str:
    """Return a doubt about the prediction if the step *measured* with the present gains was predicted badly."""
    if is_foretold(predicted, measured):
        return ""
    return (
        f"doubtful, because the model predicts {predicted:.3g} s^2 for the step with the present gains, and "
        f"{measured:.3g} s^2 was measured"
    )


def _compared(
    criteria: StepCriteria, before: Trial, after: Trial, windows: Sequence[float], proposal: Proposal | None
) -> tuple[StepMetrics, StepMetrics, Mapping[str, float], Proposal | None]:
    """Return the mean metrics of both steps over their *windows* [s], their scatter, and the prediction read in the
    same way."""
    told = None if proposal is None else over_windows(proposal, windows)
    scatter = scatter_of(criteria.halves(before, windows), criteria.halves(after, windows))
    return criteria.read(before, windows), criteria.read(after, windows), scatter, told


WORSE, ENOUGH = 1.05, 0.9
"""Factor by which a predicted error must rise before a warning, and fraction of the commanded turn rate above which the
craft counts as tracking it. Project choice.
"""


def on_the_other_axis(
    axis: Axis, firmware: Firmware, proposal: Proposal | None, measured: tuple[StepMetrics, StepMetrics] | None
) -> Iterator[str]:
    """Yield sentences on how the new gains of *axis* affect another axis that uses the same parameters.

    measured : the turn-rate step before and after, where it was flown.
    """
    beside = None if proposal is None else proposal.beside
    others = [other for other in firmware.axes.values() if beside is not None and other.law == beside.law]
    if beside is None or not others:
        return
    other = others[0]
    mine = {gain.parameter for gain in axis.gains}
    shared = ", ".join(axis.names.own(gain.parameter) for gain in other.gains if gain.parameter in mine)
    head = f"`tune {axis.name}` and `tune {other.name}` both set {shared}. The later tune overwrites the earlier one."
    if measured is not None:
        reached = max(1.0 - measured[1].steady_error, 0.0)
        yield f"{head} These gains were tested in both modes: turn rates reach {reached:.0%} of the commanded rate" + (
            "" if reached >= ENOUGH else f". `tune {other.name}` may improve turn rates, and may worsen heading hold"
        )
    elif beside.after > WORSE * beside.before:
        yield (
            f"{head} Predicted shortfall in {other.name}: {beside.after:.1%} (before: "
            f"{beside.before:.1%}). Run `tune heading` to design for both loops"
        )


def _promise(proposal: Proposal) -> str:
    """Return a sentence with the predicted effect of the new gains."""
    old, new, low = proposal.before.metrics, proposal.after.metrics, proposal.worst_margins
    span = min(old.span, new.span)  # the error over time depends on it, so it is stated with the error
    over = f" over {span:.2g} s after each step" if math.isfinite(span) else ""
    return (
        f"predicted{over}: ITAE {old.itae:.3g} -> {new.itae:.3g} s^2, overshoot {old.overshoot:.0%} -> "
        f"{new.overshoot:.0%}; smallest margins a factor of {format_factor(low.gain, 2)} in gain, "
        f"{math.degrees(low.phase):.0f} deg in phase"
    )
