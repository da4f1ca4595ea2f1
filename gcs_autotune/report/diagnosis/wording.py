"""The sentences of a diagnosis, and the names of effects, channels and values in them."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from gcs_autotune.diagnose import (
    Cause,
    Diagnosis,
    ErrorReduction,
    MissingCurve,
    Number,
    Numbers,
    Signature,
    Value,
)
from gcs_autotune.effects import effect_words
from gcs_autotune.identify import CONTRADICTION, MOVED_TOO
from gcs_autotune.report.toolkit.document import Note, Tone, Verdict
from gcs_autotune.report.toolkit.wording import (
    NOT_IDENTIFIABLE,
    UNKNOWN,
    format_error,
    format_number,
    format_parameter,
    format_share,
    format_value,
    listed,
    pretty_unit,
    rounded_to,
    sentence,
    to_people,
)
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = [
    "base_error",
    "base_words",
    "commands",
    "first_gain",
    "found_words",
    "gain_sentence",
    "given_words",
    "interval_words",
    "is_noise",
    "left_sentence",
    "missing_over",
    "named",
    "numbers_sentence",
    "numbers_title",
    "place_words",
    "rests_on",
    "signal_words",
    "standing",
    "value_words",
    "verdict_of",
]


MOST_PLACES = 3
"""Largest number of columns listed in a sentence. Project choice."""


def signal_words(signal: str) -> str:
    """Return the name of a channel: ``psi`` is ``heading``; unknown channels keep their name."""
    return SIGNALS[signal][1].split(",")[0] if signal in SIGNALS else signal


def place_words(place: str) -> str:
    """Return the name of the place of an effect: ``N`` is ``yaw moment (N)``, ``yaw`` is unchanged, ``t`` becomes the
    file's clock.
    """
    parts = place.split("+")
    if len(parts) > MOST_PLACES:
        return f"{len(parts)} columns ({', '.join(parts)})"
    return listed([_place(part) for part in parts])


def _place(part: str) -> str:
    if part == "t":
        return "the file's clock"
    return f"{signal_words(part)} ({part})" if part in SIGNALS else part


def named(cause: Cause) -> str:
    """Return an effect with its place: ``dead zone on yaw moment (N)``, ``input bias in yaw``."""
    place, effect = cause.effect.place, effect_words(cause.effect.slug)
    first = place.split("+")[0]
    if first not in DOFS and first not in SIGNALS and first != "t":
        return f"{effect} ({place})"
    return f"{effect} {'in' if first in DOFS else 'on'} {place_words(place)}"


def value_words(value: Value, name: str = "") -> str:
    """Return an estimate as text with its standard error and unit, angles also in degrees.

    name : name of the parameter; an ``anchor`` or a ``direction`` in radians is a heading. A ``frequency`` is not a
        turn rate, so it is not shown in degrees.
    """
    number = format_parameter(name, value.value, value.std, value.unit)
    shown = pretty_unit(value.unit)
    if not shown or number in (UNKNOWN, NOT_IDENTIFIABLE):
        return number
    unit, factor = ("", 1.0) if name == "frequency" else to_people(value.unit)
    angle = value.value % (2.0 * math.pi) if name in ("anchor", "direction") else value.value
    degrees = f" ({rounded_to(factor * angle, factor * value.std)}{unit})" if unit.startswith("°") else ""
    return f"{number} {shown}{degrees}"


NOISE_P = 0.01
"""p-value of the whiteness test below which a residual counts as not white. Project choice."""

_TONES: Mapping[str, Tone] = {
    "wrong-numbers": "good",
    "wrong-numbers-and-effect": "good",
    "effect-found": "good",
    "partly-explained": "neutral",
    "unexplained": "bad",
    "no-effect": "good",
    "unfinished": "neutral",
}
"""Verdict -> tone. Good means that the result is reliable, whether pleasant or not."""


def verdict_of(diagnosis: Diagnosis) -> Verdict:
    """Return the verdict of a diagnosis: one sentence, its tone, and the sentences after it."""
    verdict = _verdict(diagnosis)
    unseen = (sentence(f"{d.cause}: {d.cure}") for d in diagnosis.doubts if d.slug == MOVED_TOO)
    is_doubtful = any(d.slug == CONTRADICTION for d in diagnosis.doubts)
    return replace(verdict, tone="bad" if is_doubtful else verdict.tone, sentences=(*verdict.sentences, *unseen))


def _verdict(diagnosis: Diagnosis) -> Verdict:
    tone = _TONES[diagnosis.verdict]
    if diagnosis.verdict == "no-effect":
        follows = ["This holds for the motion in these runs. Other motion may show a missing effect."]
        if diagnosis.numbers is not None and diagnosis.numbers.rows:
            follows.insert(0, f"These runs contradict no number of the {diagnosis.numbers.of}.")
        return Verdict(_nothing(diagnosis), "neutral" if diagnosis.doubts else tone, tuple(follows))
    if diagnosis.verdict == "unfinished":
        return Verdict(
            _unfinished(diagnosis), tone, ("No cause is reported yet: the rest of the search may still reject it.",)
        )
    if diagnosis.verdict == "unexplained":
        return Verdict(_unexplained(diagnosis), tone, _findings(diagnosis.left))
    sentences = _beside_numbers(diagnosis)
    if diagnosis.verdict == "partly-explained":
        sentences.append(_hypotheses(diagnosis))
    elif diagnosis.verdict == "wrong-numbers":
        sentences.append("With the numbers corrected, the runs show no missing effect.")
    else:
        followed = "The extended model follows the held-out data"
        sentences.append(f"{followed}{_as_closely(diagnosis.left)}.")
    if diagnosis.indistinguishable:
        sentences.append("Other causes remain possible: see 'Causes that these runs do not distinguish'.")
    return Verdict(
        _wrong(diagnosis.numbers, diagnosis) if diagnosis.numbers and diagnosis.wrong_numbers else _found(diagnosis),
        tone,
        tuple(sentences),
    )


NEARLY = 0.02
"""Relative difference up to which a number is not reported as wrong. Project choice."""

MOST_NUMBERS = 4
"""Largest number of wrong numbers listed in the headline. Project choice."""


def _wrong(numbers: Numbers, diagnosis: Diagnosis) -> str:
    """Return the headline on wrong numbers, which has priority over causes."""
    wrong = numbers.wrong
    parts = [_against(n) for n in wrong[:MOST_NUMBERS]]
    if len(wrong) > MOST_NUMBERS:
        parts.append(f"{len(wrong) - MOST_NUMBERS} more")
    begin = f"Wrong number{'s' if len(wrong) > 1 else ''} in the {numbers.of}"
    if diagnosis.verdict == "partly-explained":
        begin = f"Partly explained: {begin[0].lower()}{begin[1:]}"
    return f"{begin}: {'; '.join(parts)} (95 %)."


def _against(number: Number) -> str:
    if not number.of_record:
        return f"{number.name} is {given_words(number)}, but {found_words(number)} from these runs"
    unit = "" if number.unit == "1" else f" {pretty_unit(number.unit)}"
    return f"{number.name} ({number.meaning}) is {given_words(number)}{unit}, not {format_number(number.value)}"


def given_words(number: Number) -> str:
    """Return the value of *number* in the model as text, with half its 95 % interval if known, in the model's unit."""
    return "not stated" if math.isnan(number.given) else format_value(number.given, HALF_WIDTH * number.given_std)


def found_words(number: Number) -> str:
    """Return the value of *number* estimated from the runs as text, with half its 95 % interval, in the model's
    unit.
    """
    if math.isnan(number.value):
        return NOT_IDENTIFIABLE
    if number.of_record:
        return format_number(number.value)
    text = format_value(number.value, 0.5 * (number.ci95[1] - number.ci95[0]))
    return text if number.unit in ("", "1") else f"{text} {pretty_unit(number.unit)}"


def standing(number: Number) -> str:
    """Return a short text that states whether the runs agree with *number*."""
    if number.wrong:
        return "wrong"
    off = abs(number.value - number.given)
    if math.isnan(off):
        return "not determined"
    if number.explained:
        return "explained by a cause"
    if off <= 3.0 * math.hypot(number.std, number.given_std):
        return "agrees"
    return "nearly agrees" if off <= NEARLY * abs(number.given) else "not determined"


def _beside_numbers(diagnosis: Diagnosis) -> list[str]:
    """Return the improvement due to corrected numbers, then that due to causes."""
    sentences = []
    if diagnosis.numbers is not None and diagnosis.wrong_numbers:
        sentences.append(numbers_sentence(diagnosis.numbers, causes=bool(diagnosis.causes)))
        sentences += scale_words(diagnosis.numbers)
        if diagnosis.causes:
            sentences.append("Also " + _found(diagnosis))
    if diagnosis.gain is not None:
        sentences.append(gain_sentence(diagnosis.gain))
        if diagnosis.numbers is not None:
            owner = diagnosis.numbers.of
            fitted, as_it_is = "fitted to these runs", "as supplied. Fitting it to these runs increases its error"
            over = fitted if diagnosis.numbers.over == "fitted" else as_it_is
            sentences.append(f"This improvement is relative to the {owner} {over}.")
    return sentences


def numbers_sentence(numbers: Numbers, *, causes: bool) -> str:
    """Return a sentence on how much corrected numbers reduce the held-out error, before any cause is added."""
    gain = numbers.gain
    if all(n.of_record for n in numbers.wrong):
        return "The correction was made before any other comparison."
    if gain is None:
        return f"Without correction the {numbers.of} diverges on these runs."
    if gain.ratio >= 1.0:
        return (
            "Correcting only the wrong numbers does not reduce the held-out error. They may compensate for a missing "
            "effect."
        )
    before, after = (format_error(e, gain.unit, 3) for e in (gain.before, gain.after))
    interval = interval_words(gain)
    these = "these numbers" if len(numbers.wrong) > 1 else "this number"
    return (
        f"With {these} corrected{', before any cause is added' if causes else ''},"
        f" the error of the simulated {signal_words(gain.signal)}{_ahead(gain)} falls from {before} to {after}"
        " on held-out data"
        + (f" (to {format_share(gain.ratio)} of the error before; 95 % interval {interval})." if interval else ".")
    )


def scale_words(numbers: Numbers) -> list[str]:
    """Return the alternative explanation, in one sentence, if all non-zero numbers are wrong by one factor;
    else nothing.
    """
    rows = [n for n in numbers.rows if n.given != 0.0 and n.value != 0.0]
    if numbers.of != "model" or len(numbers.wrong) < 2 or not all(n.wrong for n in rows):
        return []
    factors = np.array([n.value / n.given for n in rows])
    errors = np.array([abs(f) * n.std / abs(n.value) for f, n in zip(factors, rows, strict=True)])
    mean = float(np.average(factors, weights=1.0 / np.maximum(errors, 1e-300) ** 2))
    if np.any(np.abs(factors - mean) > 3.0 * errors):
        return []
    return [
        f"All numbers differ by the same factor ({format_number(mean, 3)}). "
        "A wrong scale of the commands explains this as well."
    ]


def numbers_title(numbers: Numbers) -> str:
    """Return the heading of the table that compares a model's numbers with the runs."""
    if numbers.of == "model":
        return "The model's numbers and these runs"
    return "The plain model fitted to the simulation and to these runs"


def _hypotheses(diagnosis: Diagnosis) -> str:
    if not diagnosis.causes:
        return "Part of the error is unexplained: no known cause improves prediction of held-out data."
    names = "The cause improves" if len(diagnosis.causes) == 1 else "The causes improve"
    rest = "Part of the error is unexplained"
    treat = "treat the cause as a hypothesis" if len(diagnosis.causes) == 1 else "treat the causes as hypotheses"
    return f"{names} prediction of held-out data. {rest}; {treat}."


def _found(diagnosis: Diagnosis) -> str:
    begin = "Partly explained" if diagnosis.verdict == "partly-explained" else "Found"
    if diagnosis.wrong_numbers:
        begin = "found" if diagnosis.verdict == "wrong-numbers-and-effect" else "a hypothesis"
    said = f"{begin}: {_named_by_kind(diagnosis)}."
    gain = diagnosis.gain
    if gain is None or not gain.ratio >= 1.0:
        return said  # the sentence on the improvement follows
    it = "it" if len(diagnosis.causes) == 1 else "them"
    where = f"{signal_words(gain.signal)}{_ahead(gain)}"
    return f"{said} Adding {it} does not improve prediction of the {where} on held-out data."


def _named_by_kind(diagnosis: Diagnosis) -> str:
    """Return the causes: errors first, then effects that a first model of such a craft usually omits."""
    causes = diagnosis.causes
    alone = len(causes) == 1 and causes[0].parameters
    names = [(c.is_structural, f"{named(c)}, {_parameters(c)}" if alone else named(c)) for c in causes]
    wrong, lacking = ("; ".join(n for structural, n in names if structural == kind) for kind in (False, True))
    return "; ".join(filter(None, (wrong, lacking and f"missing from {base_words(diagnosis)}: {lacking}")))


def base_words(diagnosis: Diagnosis) -> str:
    """Return the name of the examined simulation in a sentence: that of the user, or ``the plain model`` fitted to the
    runs.
    """
    return "the plain model" if diagnosis.numbers is None else f"the {diagnosis.numbers.of}"


def _parameters(cause: Cause) -> str:
    return ", ".join(f"{name} {value_words(value, name)}" for name, value in cause.parameters.items())


def _nothing(diagnosis: Diagnosis) -> str:
    error, unit, signal = base_error(diagnosis)
    said = "These runs show no missing effect"
    if not math.isfinite(error):
        return said + "."
    return (
        f"{said}: the error of the simulated {signal_words(signal)} is {format_error(error, unit, 3)}, "
        f"{_remains(diagnosis.left)}."
    )


def is_noise(left: Signature) -> bool:
    """Return whether a residual is consistent with white noise; a correlated one is not."""
    return not left.whiteness_p < NOISE_P


def _remains(left: Signature) -> str:
    if is_noise(left):
        return "and the residual is indistinguishable from measurement noise"
    return "with a correlated residual that no effect tried explains"


def _as_closely(left: Signature) -> str:
    if is_noise(left):
        return " within measurement noise"
    return ", with a small but correlated, unexplained residual"


def _ahead(gain: ErrorReduction) -> str:
    """Return the prediction horizon of an error if no free run was possible."""
    return f" {gain.metric.removeprefix('error ')}" if gain.metric.endswith(" s ahead") else ""


def _unexplained(diagnosis: Diagnosis) -> str:
    error, unit, signal = base_error(diagnosis)
    if any(d.slug == "no-model" for d in diagnosis.doubts):
        return "An effect is missing, but no cause is reported: no model of the craft could be fitted."
    said = "An effect is missing, and no effect tried explains it"
    if diagnosis.hints:
        said = "An effect is missing, and the evidence is too weak to identify it"
    if math.isfinite(error):
        said += f": the error of the simulated {signal_words(signal)} is {format_error(error, unit, 3)}"
    if not diagnosis.tried:
        return f"{said}. The search finished none of the candidates."
    if diagnosis.hints:
        hints = (
            "one is reported as a hint"
            if len(diagnosis.hints) == 1
            else f"{len(diagnosis.hints)} are reported as hints"
        )
        return f"{said}. Of {diagnosis.tried} candidates tried, {hints}."
    return f"{said}. None of the {diagnosis.tried} candidates tried improves prediction of held-out data."


def _unfinished(diagnosis: Diagnosis) -> str:
    """Return a sentence on a stopped search: the limit reached, and how to continue."""
    what = "work" if any(d.slug == "out-of-work" for d in diagnosis.doubts) else "time"
    return f"Unfinished: the search reached its {what} limit and was stopped. Use --resume to continue."


def first_gain(diagnosis: Diagnosis) -> ErrorReduction | None:
    """Return the reduction of the original simulation's error: by corrected numbers, or else by causes."""
    numbers = None if diagnosis.numbers is None else diagnosis.numbers.gain
    return diagnosis.gain if numbers is None else numbers


def base_error(diagnosis: Diagnosis) -> tuple[float, str, str]:
    """Return the base model's (RMS error, unit, signal): on held-out data if measured, else on the plotted runs."""
    first = first_gain(diagnosis)
    if first is not None:
        return first.before, first.unit, first.signal
    if not diagnosis.before or not diagnosis.before[0].traces:
        return math.nan, "1", ""
    portrait = diagnosis.before[0]
    error = np.concatenate([t.measured - t.fitted for t in portrait.traces])
    error = error[np.isfinite(error)]
    return (float(np.sqrt(np.mean(error**2))) if len(error) else math.nan), portrait.unit, portrait.signal


def gain_sentence(gain: ErrorReduction) -> str:
    """Return a sentence on the held-out error of one signal, before and after, with the 95 % interval of their
    ratio.
    """
    said = (
        f"Error of the simulated {signal_words(gain.signal)} on held-out data: "
        f"{format_error(gain.before, gain.unit, 3)} before, {format_error(gain.after, gain.unit, 3)} after (RMS)"
    )
    if math.isfinite(gain.ratio):
        said += f", {format_share(gain.ratio)} of the error before"
    interval = interval_words(gain)
    return said + (f" (95 % interval {interval})." if interval else ".")


def interval_words(gain: ErrorReduction) -> str:
    """Return the 95 % interval of an error reduction as text, e.g. ``12 % to 19 %``; empty if unknown."""
    low, high = gain.ci95
    return f"{format_share(low)} to {format_share(high)}" if math.isfinite(low) and math.isfinite(high) else ""


def missing_over(curve: MissingCurve) -> str:
    """Return the name of the variable over which the missing force is plotted."""
    return {"time": "time into the run", "drift": "drift angle"}.get(curve.over, signal_words(curve.over))


def left_sentence(left: Signature) -> str:
    """Return a sentence with the result of the whiteness test of a residual."""
    if not math.isfinite(left.whiteness_p):
        return ""
    p = left.whiteness_p
    chance = "p < 0.0001" if p < 1e-4 else f"p = {format_number(p, 2)}"
    verdict = "below the limit of {}: not only noise" if p < NOISE_P else "above the limit of {}: consistent with noise"
    return f"Whiteness test of the residual: {chance}, {verdict.format(NOISE_P)}."


def _findings(signature: Signature) -> tuple[str, ...]:
    return tuple(map(sentence, signature.findings[:2]))


def rests_on(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return sentences on the runs used and held out, the number of candidates, and the RMS residual of each signal."""
    said = [f"Runs used: {', '.join(diagnosis.used)}."] if diagnosis.used else []
    if diagnosis.held_out:
        said.append(f"Held out: {', '.join(diagnosis.held_out)}.")
    said.append(
        f"Candidates tried: {diagnosis.tried}; p-values are corrected for this number. Time: {diagnosis.seconds:.1f} s."
    )
    levels = [
        f"{signal_words(n)} {format_error(s, SIGNALS[n][0], 2)}" for n, s in diagnosis.noise.items() if n in SIGNALS
    ]
    if levels:
        said.append(f"Residual of each signal in the fitted runs (rms): {', '.join(levels)}.")
    return tuple(said)


_AXES: Mapping[str, str] = {"yaw": "heading", "heave": "depth"}
"""Degree of freedom -> axis of ``tune``."""


def commands(diagnosis: Diagnosis, model_file: str) -> Iterator[Note]:
    """Yield the commands that use the extended model in *model_file*."""
    file = shlex.quote(str(PurePath(model_file)))
    axis = next((_AXES[d] for d in diagnosis.extended_model.base.form.dofs if d in _AXES), "heading")
    for what, command in (
        ("Simulate a vehicle with this model:", f"gcs-autotune sitl VEHICLE --model {file}"),
        ("Refine the model with another run:", f"gcs-autotune identify RUN --start {file}"),
        ("Design gains with the model:", f"gcs-autotune tune {axis} --model {file}"),
    ):
        yield Note(command, what, kind="command")
