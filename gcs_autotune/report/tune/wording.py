"""The sentences of a tune: endings, verdicts, safety and how to undo."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import PurePath

from gcs_autotune.design import Linearity, Margins, PositionMetrics, Proposal, StepMetrics, TrackMetrics, is_foretold
from gcs_autotune.report.toolkit.document import Tone, Verdict
from gcs_autotune.report.toolkit.wording import (
    format_change,
    format_factor,
    format_number,
    format_quantity,
    format_seconds,
    format_share,
    sentence,
)
from gcs_autotune.report.tune.story import TuneStory

__all__ = [
    "PROOF_SENTENCE",
    "SIMULATED_UNDO",
    "bound_sentence",
    "follows",
    "improvement",
    "not_reached",
    "parameters_sentence",
    "proof_command",
    "safety",
    "settling_cell",
    "undo_command",
    "undo_sentence",
    "verdict_of",
]


PROOF_SENTENCE = (
    "The new gains are in proposed.param (Mission Planner, MAVProxy) and proposed.params (QGroundControl). The next "
    "command writes these gains and flies the same step again. It keeps them only if they are better:"
)
"""Sentence that introduces :func:`proof_command`."""

_ENDINGS: Mapping[str, tuple[str, Tone]] = {
    "kept": ("The new {axis} {gains} are better {measured} and are kept.", "good"),
    "restored": ("The new {axis} {gains} were not kept. The old ones were restored.", "neutral"),
    "dry-run": ("Dry run: new {axis} {gains} are proposed. Nothing was written to the vehicle.", "neutral"),
    "declined": ("New {axis} {gains} were proposed and declined. Nothing was written to the vehicle.", "neutral"),
    "unchanged": ("The design gave no better {axis} {gains}. The present {gains} stay on the vehicle.", "neutral"),
    "aborted": ("The {axis} tune was aborted.", "bad"),
}
"""Ending -> headline, tone."""
_OTHER: tuple[str, Tone] = ("The {axis} tune ended: {ending}.", "neutral")
"""Headline and tone of an ending that is not in the table."""
_NAMED: Mapping[str, str] = {"actuators": "actuator"}
"""Axis -> its name before another noun, where it differs."""


def verdict_of(story: TuneStory) -> Verdict:
    """Return the verdict of a tune: what changed, by how much, and whether it is safe."""
    headline, tone = _ENDINGS.get(story.ending, _OTHER)
    gains, measured = "gains", "in a measured step"
    if story.thrust_before is not None:
        gains, measured = "parameters", "as measured"
    elif story.track_before is not None:
        gains, measured = "parameters", "in a measured mission"
    text = headline.format(axis=_NAMED.get(story.axis, story.axis), gains=gains, measured=measured, ending=story.ending)
    is_conclusive = story.ending in ("kept", "dry-run", "declined")
    sentences = [] if is_conclusive else [sentence(story.reason)]
    if story.thrust_before is not None and story.thrust_after is not None:
        sentences.append(thrust_words(story.thrust_before, story.thrust_after))
    if story.metrics_before is not None and story.metrics_after is not None:
        sentences.append(improvement(story.metrics_before, story.metrics_after, "measured"))
        if story.beside is not None:
            sentences.append(turn_rates(*story.beside))
    elif story.track_before is not None:
        sentences.append(route_words(story.track_before, story.track_after))
    elif story.position_before is not None:
        sentences.append(position_words(story.position_before, story.position_after))
    elif story.ending == "unchanged" and story.metrics_before is not None:
        sentences.append(as_it_is(story.metrics_before))
    elif story.proposal is not None:
        before, after = story.proposal.before.metrics, story.proposal.after.metrics
        sentences.append(improvement(before, after, "predicted, not measured"))
    if story.proposal is not None and story.ending != "unchanged":
        sentences.append(safety(story.proposal))
        sentences.append(_missed(story.proposal, story.metrics_after))
    sentences.append(parameters_sentence(story))
    if story.ending == "kept" and story.proposal is not None and not story.proposal.worst_margins.stable:
        tone = "bad"
    return Verdict(text, tone, tuple(s for s in sentences if s))


def _missed(proposal: Proposal, measured: StepMetrics | None) -> str:
    """Return a doubt about the margins if the step *measured* with the new gains was predicted badly, else ""."""
    predicted = proposal.after.metrics.itae
    if measured is None or not proposal.changes or is_foretold(predicted, measured.itae):
        return ""
    was, now = (format_quantity(itae, "s^2", 3) for itae in (predicted, measured.itae))
    return f"These margins are doubtful: the model predicted a tracking error of {was}, and {now} was measured."


def improvement(before: StepMetrics, after: StepMetrics, how: str) -> str:
    """Return one sentence that compares two steps; *how*: text that states the origin of the numbers."""
    return (
        f"Step response ({how}): tracking error {_change_words(before.itae, after.itae)}; overshoot "
        f"{format_share(after.overshoot)} (before: {format_share(before.overshoot)}); "
        f"{_settling_words(after)} (before: {settling_cell(before)})."
    )


def thrust_words(before: Linearity, after: Linearity) -> str:
    """Return one sentence on how far the thrust departs from the command."""
    now, was = f"{100.0 * after.departure:.1f} %", f"{100.0 * before.departure:.1f} %"
    return f"Thrust (measured): departs from the command by {now} of full output (before: {was})."


def route_words(before: TrackMetrics, after: TrackMetrics | None) -> str:
    """Return one sentence on how the mission was followed."""
    now = before if after is None else after
    was = "" if after is None else f" (before: {format_quantity(before.rms, 'm', 2)} and {_metres(before.corners)})"
    return (
        f"Distance from the route (measured): {format_quantity(now.rms, 'm', 2)} rms; corners off by "
        f"{_metres(now.corners)}{was}."
    )


def position_words(before: PositionMetrics, after: PositionMetrics | None) -> str:
    """Return one sentence on the step, and on the push, or on the holding without a push or if it became worse."""
    now = before if after is None else after
    was = "" if after is None else f" (before: {format_quantity(before.itae, 's^2', 3)})"
    words = f"Position (measured): step error {format_quantity(now.itae, 's^2', 3)}{was}"
    worse = after is not None and after.hold > before.hold
    shown = [("push", "under the push")] if math.isfinite(now.push) else []
    for name, when in [*shown, ("hold", "while holding")][: 1 + worse]:
        if math.isfinite(getattr(now, name)):
            was = "" if after is None else f" (before: {format_quantity(getattr(before, name), 'm', 3)})"
            words += f"; distance {when} {format_quantity(getattr(now, name), 'm', 3)} rms{was}"
    return f"{words}."


def _metres(corners: Sequence[float]) -> str:
    return ", ".join(format_number(corner, 2) for corner in corners) + " m"


def turn_rates(before: StepMetrics, after: StepMetrics) -> str:
    """Return one sentence on the turn-rate step of a heading tune, flown with old and new gains."""
    old, new = (format_share(max(1.0 - m.steady_error, 0.0)) for m in (before, after))
    return (
        f"Turn-rate step with the same gains (measured): tracking error {_change_words(before.itae, after.itae)}; "
        f"reached {new} of the step (before: {old})."
    )


def as_it_is(now: StepMetrics) -> str:
    """Return one sentence on the step flown with gains that are not changed."""
    return (
        f"Step response with these gains (measured): overshoot {format_share(now.overshoot)}; {_settling_words(now)}."
    )


def _settling_words(metrics: StepMetrics) -> str:
    if math.isfinite(metrics.settling):
        return f"settled after {format_seconds(metrics.settling)}"
    if metrics.hidden_by_noise:
        return "settling time unknown: readings leave the 5 % band by noise"
    if math.isfinite(metrics.span):
        return f"not settled in {format_seconds(metrics.span)}"
    return "not settled within the 5 % band at the end of the record"


def settling_cell(metrics: StepMetrics) -> str:
    """Return the text of a table cell: the settling time, or the reason why there is none."""
    return format_seconds(metrics.settling, "hidden by noise" if metrics.hidden_by_noise else not_reached(metrics.span))


def not_reached(span: float, unknown: str = "not reached") -> str:
    """Return the text for a time that a record of *span* [s] does not contain: the craft may get there later.

    unknown : the text without a known span.
    """
    return f"not in {format_seconds(span)}" if math.isfinite(span) else unknown


def _change_words(before: float, after: float) -> str:
    change = format_change(before, after)
    if change.startswith("-"):
        return f"{change[1:]} lower"
    if change.startswith("+"):
        return f"{change[1:]} HIGHER"
    return {"": "not comparable", "no change": "unchanged"}.get(change, f"{change} HIGHER")


def safety(proposal: Proposal) -> str:
    """Return a sentence on whether the loop with the proposed gains is stable, for the model and over its uncertainty.

    If the proposal changes nothing, these are the present gains.
    """
    margins, worst = proposal.margins, proposal.worst_margins
    gains = f"the {'new' if proposal.changes else 'present'} gains"
    if not margins.stable:
        return f"NOT SAFE: the identified loop is unstable with {gains}. Do not use them."
    if not worst.stable:
        return (
            "CAREFUL: the loop is stable with the identified model, but not everywhere in the model's 95 % region. "
            "Identify again from a longer or calmer run before you rely on these gains."
        )
    return (
        f"With {gains} the loop is stable over the whole 95 % region of the identified model. "
        f"Margins at its worst point: {_margin_words(worst)}."
        + (f" The style requires more: {'; '.join(proposal.unmet)}." if proposal.unmet else "")
    )


def follows(proposal: Proposal) -> str:
    """Return a sentence on what the closed loop follows, as far as the ranges of the gains permit."""
    if not proposal.changes:
        return f"The design found no better gains (law {proposal.law})."
    if not proposal.is_matched:
        return f"The control law is {proposal.law}."
    wanted = proposal.wanted
    return (
        f"The gains are matched, within their ranges, to a {wanted.kind.capitalize()} reference model of "
        f"{format_number(wanted.omega_0, 3)} rad/s (law {proposal.law})."
    )


def _margin_words(margins: Margins) -> str:
    return (
        f"a factor of {format_factor(margins.gain, 2)} in gain, {format_quantity(margins.phase, 'rad', 2)} of phase "
        f"and {format_seconds(margins.delay)} of extra delay"
    )


def parameters_sentence(story: TuneStory) -> str:
    """Return a sentence on the state of the vehicle's parameters at the end of a tune, as far as known."""
    if not story.parameters_before or not story.changes or story.ending in ("dry-run", "declined", "unchanged"):
        return "No parameter was written."
    if not story.parameters_after:
        return (
            "The parameters were not read back at the end. The events show how far the run got. To restore the "
            f"parameters, run `{undo_command(story)}`."
        )
    changed = story.differences
    if not changed:
        return "All parameters have their original values, verified by reading back."
    written = [name for name in changed if name in {c.parameter for c in story.changes}]
    names, others = ", ".join(written), ", ".join(name for name in changed if name not in written)
    also = f" Not this tool but the vehicle or another station changed {others}." if others else ""
    if not written:
        return (
            f"All parameters written during the run have their original values again, verified by reading back.{also}"
        )
    if story.ending == "kept" or story.kept:
        values = (f"{n} {format_number(changed[n][0])} -> {format_number(changed[n][1])}" for n in written)
        return f"Changed on the vehicle, verified by reading back: {', '.join(values)}.{also}"
    return f"NOT RESTORED: {names}. Run `{undo_command(story)}`.{also}"


SIMULATED_UNDO = (
    "This simulated vehicle ended with its run. After a run on a real one, this command restores the original "
    "parameters"
)
"""Introduction of the command that undoes a run, if there is no vehicle any more."""


def undo_sentence(story: TuneStory) -> str:
    """Return the sentence that introduces :func:`undo_command`."""
    written = bool(story.changes) and story.ending in ("kept", "restored", "aborted")
    if written and story.parameters_after and not any(c.parameter in story.differences for c in story.changes):
        return (
            "The original gains are on the vehicle, so there is nothing to undo. This command restores the saved "
            "original parameters:"
        )
    if written and story.vehicle.get("simulated", False):
        return f"{SIMULATED_UNDO}:"
    if written:
        return "To restore the original parameters, connect to the vehicle and run:"
    return "Nothing was written, so there is nothing to undo. This command restores the saved original parameters:"


def undo_command(story: TuneStory) -> str:
    """Return the command line that restores the old parameters."""
    return f"gcs-autotune params restore {shlex.quote(story.directory)}"


def proof_command(story: TuneStory) -> str:
    """Return the command line that writes the proposed gains and tests them by the step that was flown."""
    return f"{story.proving} {shlex.quote(str(PurePath(story.directory) / 'proposed.param'))}"


def bound_sentence(bound: tuple[float, float]) -> str:
    """Return a sentence on whether the gains satisfy the stability bound of Miskovic2010, eq. (8.22)-(8.27), with its
    value.
    """
    left, right = bound
    if math.isnan(left) or math.isnan(right):
        return (
            "The closed-form stability bound (Miskovic2010, 8.22-8.27) applies to position loops, not to velocity "
            "loops."
        )
    verdict = "fulfilled" if left < right else "NOT fulfilled"
    sign = "<" if left < right else ">="
    return (
        f"Closed-form stability bound (Miskovic2010, 8.22-8.27): {format_number(left, 3)} {sign} "
        f"{format_number(right, 3)}, {verdict}."
    )
