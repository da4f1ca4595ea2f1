"""The sentences: endings, verdicts, safety, decisions, doubts and how to undo."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Literal

from gcs_autotune.design.result import Margins, Proposal, StepMetrics
from gcs_autotune.identify.result import AxisFit, Decision, Doubt
from gcs_autotune.report.numbers import (
    format_change,
    format_number,
    format_percent,
    format_quantity,
    format_seconds,
    format_share,
    format_value,
)
from gcs_autotune.report.story import TuneStory

__all__ = [
    "PROOF_SENTENCE",
    "Headline",
    "Tone",
    "bound_sentence",
    "decision_sentence",
    "doubt_sentence",
    "headline",
    "improvement",
    "model_sentences",
    "parameters_sentence",
    "proof_command",
    "safety",
    "sentence",
    "structure_words",
    "undo_command",
    "undo_sentence",
]

Tone = Literal["good", "neutral", "bad"]


@dataclass(frozen=True, slots=True)
class Headline:
    """The verdict: one sentence, its tone, and the sentences that follow from it."""

    text: str
    tone: Tone
    sentences: tuple[str, ...]


PROOF_SENTENCE = (
    "The new gains are in proposed.param (Mission Planner, MAVProxy) and proposed.params (QGroundControl). This writes "
    "them, flies the same step again and keeps them only if they are better:"
)
"""What introduces :func:`proof_command`."""

_ENDINGS: Mapping[str, tuple[str, Tone]] = {
    "kept": ("The new {axis} gains are on the vehicle, and proved better.", "good"),
    "restored": ("The new {axis} gains did not prove better; the old ones were put back.", "neutral"),
    "dry-run": ("Dry run: new {axis} gains are proposed, nothing was written.", "neutral"),
    "declined": ("New {axis} gains were proposed and declined; nothing was written.", "neutral"),
    "unchanged": ("The present {axis} gains stay: nothing better was found for them.", "neutral"),
    "aborted": ("The {axis} tune was aborted.", "bad"),
}
"""Ending -> headline, tone."""

_STRUCTURES: Mapping[str, str] = {
    "linear": "constant drag",
    "nonlinear": "drag growing with speed",
    "affine": "drag with a constant and a growing part",
}
"""Structure -> what it means (thesis: linear and nonlinear model)."""


def headline(story: TuneStory) -> Headline:
    """Return the verdict of a whole tune in words: what changed, how much better, is it safe."""
    text, tone = _ENDINGS.get(story.ending, ("The {axis} tune ended: " + story.ending + ".", "neutral"))
    says_enough = story.ending in ("kept", "restored", "dry-run", "declined")
    sentences = [] if says_enough else [sentence(story.reason)]
    if story.metrics_before is not None and story.metrics_after is not None:
        sentences.append(improvement(story.metrics_before, story.metrics_after, "measured"))
    elif story.proposal is not None:
        before, after = story.proposal.before.metrics, story.proposal.after.metrics
        sentences.append(improvement(before, after, "predicted, not proved on the water"))
    if story.proposal is not None and story.ending != "unchanged":
        sentences.append(safety(story.proposal))
    sentences.append(parameters_sentence(story))
    if story.ending == "kept" and story.proposal is not None and not story.proposal.worst_margins.stable:
        tone = "bad"
    return Headline(text.replace("{axis}", story.axis), tone, tuple(s for s in sentences if s))


def improvement(before: StepMetrics, after: StepMetrics, how: str) -> str:
    """Return one sentence that compares two steps; *how* says where the numbers come from."""
    return (
        f"Step response ({how}): tracking error {_change_words(before.itae, after.itae)}; overshoot "
        f"{format_share(after.overshoot)}, before {format_share(before.overshoot)}; "
        f"{_settling_words(after.settling)}, before {format_seconds(before.settling, 'never')}."
    )


def _settling_words(settling: float) -> str:
    return "never settled" if math.isnan(settling) else f"settled after {format_seconds(settling)}"


def _change_words(before: float, after: float) -> str:
    change = format_change(before, after)
    if change.startswith("-"):
        return f"{change[1:]} lower"
    if change.startswith("+"):
        return f"{change[1:]} HIGHER"
    return {"": "not comparable", "no change": "unchanged"}.get(change, f"{change} HIGHER")


def safety(proposal: Proposal) -> str:
    """Return whether the loop with the new gains is stable, at the model and over its uncertainty."""
    margins, worst = proposal.margins, proposal.worst_margins
    if not margins.stable:
        return "NOT SAFE: with the new gains the identified loop is unstable; do not use them."
    if not worst.stable:
        return (
            "CAREFUL: the loop is stable at the identified model, but not everywhere in its 95 % region; "
            "identify again with a longer or calmer run before relying on these gains."
        )
    return (
        "With the new gains the loop is stable over the whole 95 % region of the identified model; "
        f"at its worst point {_margin_words(worst)} remain."
    )


def _margin_words(margins: Margins) -> str:
    gain = "more than a factor of 100" if margins.gain > 100.0 else f"a factor of {format_number(margins.gain, 2)}"
    return (
        f"{gain} in gain, "
        f"{format_quantity(margins.phase, 'rad', 2)} of phase and {format_seconds(margins.delay)} of extra delay"
    )


def parameters_sentence(story: TuneStory) -> str:
    """Return what is known of the vehicle's parameters at the end, and nothing more than that."""
    if not story.parameters_before:
        return "No parameter was read, and none was written."
    if not story.changes or story.ending in ("dry-run", "declined", "unchanged"):
        return "No parameter was written."
    if not story.parameters_after:
        return (
            "The parameters were not read back at the end: the events below say how far it came; to be sure, run "
            f"`{undo_command(story)}`."
        )
    changed = story.differences
    if not changed:
        return "All parameters were read back at the end and are as they were found."
    written = [name for name in changed if name in {c.parameter for c in story.changes}]
    names, own = ", ".join(written), ", ".join(name for name in changed if name not in written)
    also = f" The vehicle itself changed {own}, which this tool does not write." if own else ""
    if not written:
        return f"All parameters that were written were read back at the end and are as they were found.{also}"
    if story.ending == "kept" or story.kept:
        return f"Changed on the vehicle and read back: {names}.{also}"
    return f"NOT as found, although they should be: {names}; run `{undo_command(story)}`.{also}"


def undo_sentence(story: TuneStory) -> str:
    """Return what introduces :func:`undo_command`."""
    written = bool(story.changes) and story.ending in ("kept", "restored", "aborted")
    if written:
        return "The parameters as they were found are saved. Connect to the vehicle and run:"
    return "Nothing was written, so there is nothing to undo. The parameters as they were found are saved:"


def undo_command(story: TuneStory) -> str:
    """Return the command that puts the old parameters back."""
    path = PurePath(story.directory) / story.restore_file
    return f"gcs-autotune params restore {shlex.quote(str(path))}"


def proof_command(story: TuneStory) -> str:
    """Return the command that writes the gains proposed and proves them by the step that was flown."""
    return f"{story.proving} {shlex.quote(str(PurePath(story.directory) / 'proposed.param'))}"


def structure_words(structure: str) -> str:
    """Return what a drag structure means, e.g. ``nonlinear`` -> ``drag growing with speed``."""
    return _STRUCTURES.get(structure, structure)


def doubt_sentence(doubt: Doubt) -> str:
    """Return a doubt with its cure."""
    return f"{sentence(doubt.cause)} Cure: {sentence(doubt.cure)}"


def decision_sentence(decision: Decision) -> str:
    """Return the two-experiment decision (7.1)-(7.2) in words."""
    gap = decision.sigma_beta - decision.sigma_beta_quadratic
    numbers = (
        "Between the two experiments the constant-drag coefficient differs by "
        f"{format_percent(decision.sigma_beta)}, the speed-proportional one by "
        f"{format_percent(decision.sigma_beta_quadratic)}, the inertia by {format_percent(decision.sigma_alpha)}."
    )
    if decision.verdict == "undecided":
        return (
            f"{numbers} The difference of {format_percent(abs(gap))} is within the margin of "
            f"{format_percent(decision.margin)}, so this criterion cannot tell: a third experiment with a clearly "
            "different relay output would."
        )
    return (
        f"{numbers} The steadier of the two decides, by {format_percent(abs(gap))} against a margin of "
        f"{format_percent(decision.margin)}: {structure_words(decision.verdict)}."
    )


def bound_sentence(bound: tuple[float, float]) -> str:
    """Return the stability bound of thesis (8.22)-(8.27), evaluated."""
    left, right = bound
    if math.isnan(left) or math.isnan(right):
        return "The closed-form stability bound (thesis 8.22-8.27) is about loops on a position, not on a velocity."
    verdict = "fulfilled" if left < right else "NOT fulfilled"
    sign = "<" if left < right else ">="
    return (
        "Closed-form stability bound (thesis 8.22-8.27): "
        f"{format_number(left, 3)} {sign} {format_number(right, 3)}, {verdict}."
    )


def model_sentences(fit: AxisFit) -> tuple[str, ...]:
    """Return what the model means for the craft: its lag, its top speed at full output, and how well it fits."""
    model, axis = fit.model, fit.model.axis
    unit = "rad/s" if axis.angular else "m/s"
    said = []
    if model.beta != 0.0 and fit.structure != "nonlinear":
        said.append(f"Slow motion dies out with a time constant of {format_seconds(model.alpha / model.beta)}.")
    if model.input_unit == "1":
        top = abs(model.steady_velocity(1.0 - model.delta))
        if math.isfinite(top):
            said.append(f"Full output sustains {format_quantity(top, unit)}.")
    fitted = fit.traces[0].unit if fit.traces and fit.traces[0].unit else axis.position_unit
    if "thrust_curve" in fit.extra:
        curve = fit.extra["thrust_curve"]
        said.append(
            f"Thrust at throttle x goes as (1 - q) x + q x\u00b2 with q = "
            f"{format_value(float(curve['square']), float(curve['std']))}: 0 is proportional, 1 a plain propeller."
        )
    said.append(
        f"The model, simulated from the inputs alone, explains {format_percent(fit.fit_percent)} of the "
        f"measured motion; {format_quantity(fit.residual_rms, fitted, 2)} rms remain, of which "
        f"{format_quantity(fit.noise_std, fitted, 2)} is measurement noise."
    )
    return tuple(said)


def sentence(text: str) -> str:
    """Return *text* with a capital at its beginning and a stop at its end."""
    text = text.strip()
    if not text:
        return ""
    first = text.split()[0].rstrip(",.:;")
    start = text[0].upper() if first.isalpha() else text[0]
    return start + text[1:] + ("" if text[-1] in ".!?" else ".")
