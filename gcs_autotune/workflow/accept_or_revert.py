"""What becomes of a proposal: left alone, only shown, or written, proved by the same step, and kept or given back."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from gcs_autotune.axes import axis_kind
from gcs_autotune.design import Change, Proposal, StepMetrics, Verdict, is_better, scatter_of, told_over
from gcs_autotune.firmware import Axis, Firmware
from gcs_autotune.link import Journal, ParameterTransaction
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.report import format_factor
from gcs_autotune.trial import Trial
from gcs_autotune.watch import NewValue, ProposedGains
from gcs_autotune.workflow.beside import StepBeside
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.designing import StepCriteria
from gcs_autotune.workflow.experiments import STEP_AHEAD
from gcs_autotune.workflow.proof import Known

__all__ = ["accept_or_revert", "accept_or_revert_supplied", "on_the_other_axis"]

PROVING = "step with new gains"
"""The stage in which a proposal is proved."""


def accept_or_revert(
    context: TuneContext,
    proposal: Proposal,
    before: Trial,
    criteria: StepCriteria,
    journal: Journal,
    known: Known | None = None,
) -> None:
    """End the tune with *proposal*, as it deserves and the operator wants; *before* is the step with present gains.

    known : of the craft; it sizes the turn-rate step that is flown beside a heading step.

    Both steps are compared over what both recorded: each ends by itself once the craft stands at its target. The log
    has the metrics of the step *before* already.

    Raises
    ------
    ParameterNotAccepted, LinkError, NotAchieved, ...
        Writing or flying the new gains failed; by then the old ones are back.
    """
    log = context.log
    if proposal.changes:
        log.say(_promise(proposal))
        old, new = proposal.before.metrics.itae, proposal.after.metrics.itae
        log.note(ProposedGains(_values(proposal.changes), old, new, new * (1.0 + proposal.spread)))
    if not proposal.changes:
        log.end(
            "unchanged",
            "no gains found inside the documented ranges do better than the present ones; nothing was written",
        )
    elif log.metrics_before is not None and _is_hopeless(proposal, log.metrics_before):
        log.end(
            "unchanged",
            "the present gains do better than is predicted of any that keep the wanted margins; nothing was written",
        )
    elif context.settings.dry_run:
        log.end("dry-run", "dry run: nothing was written")
    elif not context.agrees(f"Write {_shown(proposal.changes)} and prove it by the same step?"):
        log.end("declined", "the new gains were not wanted; nothing was written")
    else:
        beside = StepBeside.flown(context, known)
        _prove(context, proposal.new, before, criteria, journal, beside)


def accept_or_revert_supplied(context: TuneContext, before: Trial, criteria: StepCriteria, journal: Journal) -> None:
    """End the tune with the gains given by file, likewise; errors as those of :func:`decide`."""
    log, changes = context.log, context.log.given_changes
    log.note(ProposedGains(_values(changes)))
    if context.settings.dry_run:
        log.end("dry-run", "dry run: nothing was written")
    elif not context.agrees(f"Write {_shown(changes)} and prove it by the same step?"):
        log.end("declined", "the gains of the file were not wanted; nothing was written")
    else:
        _prove(context, {c.parameter: c.new for c in changes}, before, criteria, journal)


def _prove(
    context: TuneContext,
    new: Mapping[str, float],
    before: Trial,
    criteria: StepCriteria,
    journal: Journal,
    beside: StepBeside | None = None,
) -> None:
    log = context.log
    with ParameterTransaction(context.craft.parameters, journal) as loan:
        log.say("writing " + ", ".join(f"{n} {v:g}" for n, v in new.items()))
        loan.set(new)
        log.say("written and read back")
        context.come_about("step-after", STEP_AHEAD, last=beside is None)
        if not context.law.controls_velocity:
            context.runner.come_to_rest(PROVING, axis_kind(context.axis.name))
        after = context.fly(criteria.proof.step("step-after"), PROVING).trial
        alike = common_windows(before, after)
        if min(alike, default=math.inf) < criteria.proof.settings.duration:
            there_and_back = " and ".join(f"{seconds:.0f} s" for seconds in alike)
            log.say(f"both are read over the first {there_and_back} of step and step back: what both recorded")
        then, now, scatter, log.proposal = context.run_in_background(
            _compared, criteria, before, after, alike, log.proposal
        )
        log.metrics_before, log.metrics_after = then, now
        other = None if beside is None else beside.compared(context)
        log.beside = None if other is None else (other.before, other.after)
        errors = None if other is None else (other.before.itae, other.after.itae)
        verdict = is_better(then, now, context.law.free_overshoot, errors, scatter)
        followed = Verdict(True, ()) if other is None else other.verdict
        verdict = Verdict(verdict.better and followed.better, (*verdict.reasons, *followed.reasons))
        log.verdict = (verdict.better, verdict.reasons)
        if verdict.better:
            loan.keep()
            for sentence in on_the_other_axis(context.axis, context.craft.firmware, log.proposal, log.beside):
                log.say(sentence)
            log.end("kept", "the new gains are better and stay")
    if not verdict.better:
        log.end("restored", "the new gains are not better; the old ones are back, verified by reading them")


def _compared(
    criteria: StepCriteria, before: Trial, after: Trial, windows: Sequence[float], proposal: Proposal | None
) -> tuple[StepMetrics, StepMetrics, Mapping[str, float], Proposal | None]:
    """Return what both steps read over their *windows* [s] come to, their scatter, and the proposal's prediction read
    so."""
    told = None if proposal is None else told_over(proposal, windows)
    scatter = scatter_of(criteria.halves(before, windows), criteria.halves(after, windows))
    return criteria.read(before, windows), criteria.read(after, windows), scatter, told


def _is_hopeless(proposal: Proposal, measured: StepMetrics) -> bool:
    """Whether the new gains promise no better step than the present ones promise and were just seen to give."""
    return proposal.after.metrics.itae >= max(proposal.before.metrics.itae, measured.itae)


WORSE, ENOUGH = 1.05, 0.9
"""A predicted error that is higher by more than this factor is worth advice; turn rates count as followed from this
share of the asked rate on."""


def on_the_other_axis(
    axis: Axis, firmware: Firmware, proposal: Proposal | None, measured: tuple[StepMetrics, StepMetrics] | None
) -> Iterator[str]:
    """Yield what the new gains of *axis* mean for another axis with the same parameters, by what is known of it.

    measured : the turn-rate step before and after, where it was flown.
    """
    beside = None if proposal is None else proposal.beside
    others = [other for other in firmware.axes.values() if beside is not None and other.law == beside.law]
    if beside is None or not others:
        return
    other = others[0]
    mine = {gain.parameter for gain in axis.gains}
    shared = ", ".join(axis.names.own(gain.parameter) for gain in other.gains if gain.parameter in mine)
    head = f"`tune {axis.name}` and `tune {other.name}` both set {shared}, and the later one wins."
    if measured is not None:
        reached = max(1.0 - measured[1].steady_error, 0.0)
        yield f"{head} These gains were proved in both modes: turn rates reach {reached:.0%} of the asked rate" + (
            "" if reached >= ENOUGH else f"; `tune {other.name}` would follow them better and hold headings worse"
        )
    elif beside.after > WORSE * beside.before:
        yield (
            f"{head} Predicted: the {other.name} step falls short by {beside.after:.1%}, before by "
            f"{beside.before:.1%}. Run `tune heading` for gains that serve both"
        )


def _values(changes: Sequence[Change]) -> tuple[NewValue, ...]:
    return tuple(NewValue(c.parameter, c.old, c.new, c.reason) for c in changes)


def _shown(changes: Sequence[Change]) -> str:
    return ", ".join(f"{c.parameter} {c.old:g} -> {c.new:g}" for c in changes)


def _promise(proposal: Proposal) -> str:
    """Say what the new gains promise on the identified model, before anybody is asked about them."""
    old, new, low = proposal.before.metrics, proposal.after.metrics, proposal.worst_margins
    return (
        f"predicted: error over time {old.itae:.3g} -> {new.itae:.3g} s^2, overshoot {old.overshoot:.0%} -> "
        f"{new.overshoot:.0%}; margins at worst {format_factor(low.gain, 2)} in gain, "
        f"{math.degrees(low.phase):.0f} deg in phase"
    )
