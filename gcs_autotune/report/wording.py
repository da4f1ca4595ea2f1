"""The sentences: endings, verdicts, safety, decisions, doubts and how to undo."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Literal

from gcs_autotune.design.result import Margins, Proposal, StepMetrics
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.colour import Remainder
from gcs_autotune.identify.extended.wish import label_of
from gcs_autotune.identify.result import AxisFit, Decision, Doubt
from gcs_autotune.report.diagnosis_names import listed
from gcs_autotune.report.numbers import (
    format_change,
    format_error,
    format_factor,
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
    "explains",
    "headline",
    "improvement",
    "model_sentences",
    "model_words",
    "parameters_sentence",
    "proof_command",
    "remainder_sentence",
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
    "linear": "linear damping",
    "nonlinear": "quadratic damping",
    "affine": "linear and quadratic damping",
}
"""Structure -> what the field calls it (Miskovic2010: linear and nonlinear model)."""

_DAMPING: Mapping[str, str] = {
    "linear": "Linear damping: the water's resistance grows in proportion to the speed.",
    "nonlinear": "Quadratic damping: the water's resistance grows with the square of the speed.",
    "affine": "Linear and quadratic damping: one part of the water's resistance grows in proportion to the speed, "
    "one with its square.",
}
"""Structure -> its words explained, once, where a model is first told."""


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
    return (
        f"a factor of {format_factor(margins.gain, 2)} in gain, "
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
    """Return what a structure means, e.g. ``nonlinear`` -> ``quadratic damping``."""
    return _STRUCTURES.get(structure, structure)


def model_words(fit: AxisFit) -> str:
    """Return what a model consists of: its damping, and what was found of its actuator."""
    found = listed([_effect_title(e) for e in fit.effects]) if fit.effects else ""
    return structure_words(fit.structure) + (f", with {found}" if found else "")


def doubt_sentence(doubt: Doubt) -> str:
    """Return a doubt with its cure."""
    return f"{sentence(doubt.cause)} Cure: {sentence(doubt.cure)}"


def decision_sentence(decision: Decision) -> str:
    """Return the two-experiment decision (7.1)-(7.2) in words."""
    gap = decision.sigma_beta - decision.sigma_beta_quadratic
    numbers = (
        "Between the two experiments the linear damping differs by "
        f"{format_percent(decision.sigma_beta)}, the quadratic one by "
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
    """Return the stability bound of Miskovic2010, eq. (8.22)-(8.27), evaluated."""
    left, right = bound
    if math.isnan(left) or math.isnan(right):
        return (
            "The closed-form stability bound (Miskovic2010, 8.22-8.27) is about loops on a position, not on a velocity."
        )
    verdict = "fulfilled" if left < right else "NOT fulfilled"
    sign = "<" if left < right else ">="
    return (
        "Closed-form stability bound (Miskovic2010, 8.22-8.27): "
        f"{format_number(left, 3)} {sign} {format_number(right, 3)}, {verdict}."
    )


def model_sentences(fit: AxisFit) -> tuple[str, ...]:
    """Return what the model means for the craft: damping, lag, top speed at full output, actuator, and its fit."""
    model, axis = fit.model, fit.model.axis
    unit = "rad/s" if axis.angular else "m/s"
    said = [_DAMPING[fit.structure]]
    if model.beta != 0.0 and fit.structure != "nonlinear":
        said.append(f"Slow motion dies out with a time constant of {format_seconds(model.alpha / model.beta)}.")
    if model.input_unit == "1":
        top = abs(model.steady_velocity(1.0 - model.delta))
        if math.isfinite(top):
            said.append(f"Full output sustains {format_quantity(top, unit)}.")
    said.extend(_actuator_sentence(fit, own) for own in fit.effects)
    trace = fit.traces[0] if fit.traces else None
    left = Remainder(fit.residual_rms, fit.residual_rms) if trace is None else fit.remainder[trace.signal]
    shown = trace.unit if trace is not None and trace.unit else axis.position_unit
    said.append(
        f"The model, simulated from the inputs alone, {explains(fit.fit_percent)} "
        f"the motion it was fitted to. {remainder_sentence(left, shown)}"
    )
    return tuple(said)


def explains(percent: float) -> str:
    """Return ``explains 74 % of``; a model that errs by more than there is to explain explains nothing of it."""
    if percent > 0.0:
        return f"explains {format_percent(percent)} of"
    return "explains nothing of"


def remainder_sentence(left: Remainder, unit: str) -> str:
    """Return what a model leaves: what changes from sample to sample is noise, what is correlated is unexplained."""
    rms = format_error(left.rms, unit, 2)
    if not math.isfinite(left.rms):
        return ""
    if left.unexplained <= 0.0:
        return f"{rms} rms remain, which change from sample to sample, as measurement noise does."
    noise, rest = format_error(left.noise, unit, 2), format_error(left.unexplained, unit, 2)
    return f"{rms} rms remain: {noise} change from sample to sample, as noise does; {rest} stay unexplained."


def _actuator_sentence(fit: AxisFit, own: EffectInstance) -> str:
    """Return what was found of the actuator, its number rounded to its error."""

    def number(name: str) -> str:
        found = fit.parameters.get(label_of(own, name))
        return format_value(own[name], math.nan if found is None else found.std)

    if own.slug == "quadratic-actuator":
        return (
            f"The force at output x goes as (1 - q) x + q x² with q = {number('share')}: 0 is proportional, 1 a plain "
            "propeller."
        )
    if own.slug == "dead-zone":
        return f"The actuator does nothing below {number('width')} of full output (dead zone)."
    values = ", ".join(f"{name} {number(name)}" for name in own.values)
    return f"Found of the actuator: {_effect_title(own)}, {values}."


def _effect_title(own: EffectInstance) -> str:
    return {"quadratic-actuator": "thrust curve"}.get(own.slug, own.slug.replace("-", " "))


def sentence(text: str) -> str:
    """Return *text* with a capital at its beginning and a stop at its end."""
    text = text.strip()
    if not text:
        return ""
    first = text.split()[0].rstrip(",.:;")
    start = text[0].upper() if first.isalpha() else text[0]
    return start + text[1:] + ("" if text[-1] in ".!?" else ".")
