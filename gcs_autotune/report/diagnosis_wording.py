"""The sentences about a diagnosis: what is wrong with the simulation, how sure that is, what to do next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from pathlib import PurePath

import numpy as np

from gcs_autotune.diagnose.result import Cause, Diagnosis, Gain, Signature
from gcs_autotune.effects.book import BOOK
from gcs_autotune.report.diagnosis_names import effect_words, listed, named, signal_words, value_words
from gcs_autotune.report.numbers import (
    format_number,
    format_quantity,
    format_share,
)
from gcs_autotune.report.wording import Headline, Tone, sentence
from gcs_autotune.sname import SIGNALS

__all__ = [
    "base_error",
    "cannot_tell",
    "cause_remarks",
    "cause_title",
    "commands",
    "gain_sentence",
    "interval_words",
    "left_sentence",
    "rests_on",
    "verdict_headline",
]

_TONES: Mapping[str, Tone] = {
    "effect-found": "good",
    "partly-explained": "neutral",
    "unexplained": "bad",
    "no-effect": "good",
}
"""Verdict -> tone: good is what can be relied on, whether it is pleasant or not."""


def verdict_headline(told: Diagnosis) -> Headline:
    """Return the verdict: one sentence with its number, its tone, and what follows from it."""
    tone = _TONES[told.verdict]
    if told.verdict == "no-effect":
        follows = ["This is no proof that nothing is missing elsewhere: it holds for what these runs do."]
        return Headline(_nothing(told), "neutral" if told.doubts else tone, tuple(follows))
    if told.verdict == "unexplained":
        return Headline(_unexplained(told), tone, _findings(told.left))
    sentences = [] if told.gain is None else [gain_sentence(told.gain)]
    if told.verdict == "partly-explained":
        names = "The name is a hypothesis: it pays" if len(told.causes) == 1 else "The names are hypotheses: they pay"
        sentences.append(f"{names} on unseen data, but more remains than the measurement noise allows.")
    else:
        sentences.append("With this the simulation follows the unseen data as closely as the measurement noise allows.")
    if told.indistinguishable:
        sentences.append("These runs leave other names possible: see below what they cannot tell.")
    return Headline(_found(told), tone, tuple(sentences))


def _found(told: Diagnosis) -> str:
    begin = "Found" if told.verdict == "effect-found" else "Partly explained"
    names = [named(c) for c in told.causes]
    if len(told.causes) == 1 and told.causes[0].parameters:
        names[0] += f", {_parameters(told.causes[0])}"
    said = f"{begin}: {'; '.join(names)}."
    gain = told.gain
    if gain is None or not (math.isfinite(gain.before) and math.isfinite(gain.after)):
        return said
    it = "it" if len(names) == 1 else "them"
    return (
        f"{said} With {it}, the simulated {signal_words(gain.signal)} errs by "
        f"{format_quantity(gain.after, gain.unit, 3)} instead of {format_quantity(gain.before, gain.unit, 3)} "
        "on data it has not seen."
    )


def _parameters(cause: Cause) -> str:
    return ", ".join(f"{name} {value_words(value)}" for name, value in cause.parameters.items())


def _nothing(told: Diagnosis) -> str:
    error, unit, signal = base_error(told)
    said = "Nothing is missing that these runs could show"
    if not math.isfinite(error):
        return said + "."
    return (
        f"{said}: the simulation errs by {format_quantity(error, unit, 3)} in {signal_words(signal)}, "
        "and what remains cannot be told from measurement noise."
    )


def _unexplained(told: Diagnosis) -> str:
    error, unit, signal = base_error(told)
    said = "Something is missing, and it is not in the book"
    if math.isfinite(error):
        said += f": the simulation errs by {format_quantity(error, unit, 3)} in {signal_words(signal)}"
    return f"{said}; none of the {told.tried} candidates tried pays on unseen data."


def base_error(told: Diagnosis) -> tuple[float, str, str]:
    """Return the base model's error, its unit and signal: held out where that was measured, else of the pictures."""
    if told.gain is not None:
        return told.gain.before, told.gain.unit, told.gain.signal
    if not told.before or not told.before[0].traces:
        return math.nan, "1", ""
    portrait = told.before[0]
    error = np.concatenate([t.measured - t.fitted for t in portrait.traces])
    error = error[np.isfinite(error)]
    return (float(np.sqrt(np.mean(error**2))) if len(error) else math.nan), portrait.unit, portrait.signal


def gain_sentence(gain: Gain) -> str:
    """Return one signal's gain with its interval."""
    said = (
        f"Error of the simulated {signal_words(gain.signal)} on held-out data: "
        f"{format_quantity(gain.before, gain.unit, 3)} before, {format_quantity(gain.after, gain.unit, 3)} after (RMS)"
    )
    if math.isfinite(gain.ratio):
        said += f", {format_share(gain.ratio)} of what it was"
    interval = interval_words(gain)
    return said + (f" (95 % interval {interval})." if interval else ".")


def interval_words(gain: Gain) -> str:
    """Return ``12 % to 19 %``; empty when it is not known."""
    low, high = gain.ci95
    return f"{format_share(low)} to {format_share(high)}" if math.isfinite(low) and math.isfinite(high) else ""


def cause_title(told: Diagnosis, cause: Cause) -> str:
    """Return the heading over a cause: a hypothesis is called one."""
    text = named(cause)
    return f"Hypothesis: {text}" if told.verdict == "partly-explained" else text[0].upper() + text[1:]


def cause_remarks(cause: Cause) -> tuple[tuple[str, str], ...]:
    """Return (label, sentence): what the effect is, how much it explains, what it is easily mistaken for."""
    said = [("What it is", sentence(cause.meaning))]
    if math.isfinite(cause.share):
        text = f"It removes {format_share(cause.share)} of the squared error that noise does not account for."
        said.append(("What it explains on held-out data", text))
    entry = BOOK.get(cause.applied.slug)
    if entry is not None:
        said.append(("Where it shows", sentence(entry.shown_by)))
        if entry.mistaken_for:
            others = ", ".join(effect_words(s) for s in entry.mistaken_for)
            said.append(("Easily mistaken for", sentence(others)))
            said.append(("What tells them apart", sentence(entry.separated_by)))
    return tuple(said)


def cannot_tell(told: Diagnosis) -> tuple[str, ...]:
    """Return one sentence per group of effects these runs cannot tell apart."""
    groups = (listed([effect_words(s) for s in group]) for group in told.indistinguishable)
    return tuple(sentence(f"{names}: each explains these runs about as well as the others") for names in groups)


def left_sentence(left: Signature) -> str:
    """Return how likely plain noise would look like what is left."""
    if not math.isfinite(left.whiteness_p):
        return ""
    p = left.whiteness_p
    chance = "less than 1 time in 10 000" if p < 1e-4 else f"with probability {format_number(p, 2)}"
    verdict = "so this is not noise" if p < 0.01 else "so nothing speaks against noise"
    return f"Pure noise would look at least this regular {chance}, {verdict}."


def _findings(signature: Signature) -> tuple[str, ...]:
    return signature.findings[:2]


def rests_on(told: Diagnosis) -> tuple[str, ...]:
    """Return what was used, held out, tried, and the noise found."""
    said = [f"Runs used: {', '.join(told.used)}."] if told.used else []
    if told.held_out:
        said.append(f"Held out: {', '.join(told.held_out)}.")
    said.append(f"Candidates tried: {told.tried}; the p-values allow for that many. Time: {told.seconds:.1f} s.")
    levels = [
        f"{signal_words(n)} {format_quantity(s, SIGNALS[n][0], 2)}" for n, s in told.noise.items() if n in SIGNALS
    ]
    if levels:
        said.append(f"Noise each signal is left with: {', '.join(levels)}.")
    return tuple(said)


_AXES: Mapping[str, str] = {"yaw": "heading", "heave": "depth"}
"""Degree of freedom -> axis of ``tune``."""


def commands(told: Diagnosis, model_file: str) -> tuple[tuple[str, str], ...]:
    """Return (what for, command) for the extended model in *model_file*."""
    file = shlex.quote(str(PurePath(model_file)))
    axis = next((_AXES[d] for d in told.extended_model.base.form.dofs if d in _AXES), "heading")
    return (
        ("Fly it: the simulated vehicle moves as this model does", f"gcs-autotune sitl VEHICLE --model {file}"),
        ("Refine it with another run", f"gcs-autotune identify RUN --start {file}"),
        ("Design gains with it", f"gcs-autotune tune {axis} --model {file}"),
    )
