"""The first sentences of a diagnosis and its hints, in words for the owner of the boat."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_autotune.diagnose import Cause, Diagnosis, ErrorReduction, Hint, Lack
from gcs_autotune.effects import EFFECTS, columns_of, effect_words
from gcs_autotune.report.diagnosis.wording import base_error, signal_words, value_words
from gcs_autotune.report.toolkit.document import Note
from gcs_autotune.report.toolkit.wording import format_number, format_seconds, listed, sentence
from gcs_autotune.sname import DOFS

__all__ = ["FILLED", "hint_notes", "hint_title", "lead_sentence", "plain_sentence"]

FILLED = frozenset({"craft", "simulation", "motion", "command", "signal"})
"""Names of the placeholders in braces that an effect's sentence for owners may contain."""

MOTIONS: Mapping[str, str] = {
    "surge": "moving ahead",
    "sway": "moving sideways",
    "heave": "diving",
    "roll": "rolling",
    "pitch": "pitching",
    "yaw": "turning",
}
COMMANDS: Mapping[str, str] = {
    "X": "throttle",
    "Y": "sideways thrust",
    "Z": "vertical thrust",
    "K": "roll command",
    "M": "pitch command",
    "N": "steering",
    "delta": "rudder",
    "n": "throttle",
    "force_left": "left thrust",
    "force_right": "right thrust",
}
OWNERS: Mapping[str, str] = {"u": "speed ahead", "v": "sideways speed", "w": "diving speed", "r": "turn rate"}
"""Signal -> common name for the owner of the craft, where it differs from :data:`.SIGNALS`."""

UNITS: Mapping[str, tuple[str, float]] = {
    "rad": ("degrees", 180.0 / math.pi),
    "rad/s": ("degrees per second", 180.0 / math.pi),
    "m": ("metres", 1.0),
    "m/s": ("metres per second", 1.0),
}
"""SI unit -> (unit as text for owners, factor from SI)."""

LONGER = 1.5
"""Least factor on the length of the runs when more of them are advised. Evidence also varies from run to run. Project
choice.
"""

MORE = ("", "one more", "two more", "three more", "four more", "five more")


def lead_sentence(diagnosis: Diagnosis) -> str:
    """Return one or two sentences on what the simulation gets wrong and by how much, without technical words."""
    simulation = _simulation(diagnosis)
    if diagnosis.verdict == "unfinished":
        return f"The search was stopped before it could show what {simulation} gets wrong."
    if diagnosis.verdict == "no-effect":
        return f"{_begun(simulation)} follows your craft as closely as these runs can show.{_error(diagnosis)}"
    if diagnosis.wrong_numbers and diagnosis.numbers is not None:
        gain = diagnosis.numbers.gain
        return f"{_wrong_numbers(diagnosis)} {_difference(gain, 'After the correction')}"
    if diagnosis.causes:
        more = MORE[min(len(diagnosis.causes) - 1, len(MORE) - 1)]
        begin = f"With this cause and {more} in the simulation" if more else "With this cause in the simulation"
        maybe = "A possible cause: " if diagnosis.verdict == "partly-explained" else ""
        return f"{maybe}{plain_sentence(diagnosis, diagnosis.causes[0])} {_difference(diagnosis.gain, begin)}"
    said = f"{_begun(simulation)} differs from your craft by more than noise. These runs do not show why."
    hint = f" A possible cause: {plain_sentence(diagnosis, diagnosis.hints[0])}" if diagnosis.hints else ""
    return said + _error(diagnosis) + hint


def plain_sentence(diagnosis: Diagnosis, cause: Cause | Hint) -> str:
    """Return a sentence on what a cause means for the owner of the craft."""
    slug, place = (cause.cause, cause.place) if isinstance(cause, Hint) else (cause.effect.slug, cause.effect.place)
    entry = EFFECTS.get(slug)
    if entry is None or not entry.plain:
        return sentence(cause.meaning)
    parts = columns_of(place)
    dof = next((d.name for d in DOFS.values() if parts[0] in (d.name, d.force, d.velocity, d.position)), "")
    filled = {
        "simulation": _simulation(diagnosis),
        "motion": MOTIONS.get(dof or diagnosis.base_model.base.form.dofs[0], "moving"),
        "command": listed([COMMANDS.get(part, "the command") for part in parts]),
        "signal": listed([_signal(part) for part in parts]),
    }
    return _begun(entry.plain.format(**filled))


def _simulation(diagnosis: Diagnosis) -> str:
    return "a plain simulation" if diagnosis.numbers is None else "your simulation"


def _begun(text: str) -> str:
    return text[:1].upper() + text[1:]


def _signal(name: str) -> str:
    return "clock" if name == "t" else COMMANDS.get(name) or OWNERS.get(name) or signal_words(name)


def _wrong_numbers(diagnosis: Diagnosis) -> str:
    assert diagnosis.numbers is not None
    names = [f"{n.meaning or n.name}" for n in diagnosis.wrong_numbers]
    if len(names) == 1:
        return f"One number of your simulation is wrong: {names[0]}."
    return f"{len(names)} numbers of your simulation are wrong: {listed(names[:3])}{' and others' * (len(names) > 3)}."


def _error(diagnosis: Diagnosis) -> str:
    error, unit, signal = base_error(diagnosis)
    if not math.isfinite(error) or unit not in UNITS:
        return ""
    return f" The simulated {_signal(signal)} is wrong by {_both(error, error, unit)[0]}."


def _difference(gain: ErrorReduction | None, begin: str) -> str:
    """Return a sentence with the errors on held-out data before and after, or one that there is no improvement."""
    if gain is None or not (math.isfinite(gain.before) and math.isfinite(gain.after)):
        return "The improvement on runs not used for the fit was not measured."
    ahead = f" {gain.metric.removeprefix('error ')}" if gain.metric.endswith(" s ahead") else ""
    what = f"the predicted {_signal(gain.signal)}{ahead}"
    after, before = _both(gain.after, gain.before, gain.unit)
    if gain.ratio >= 1.0:
        return f"{begin}, {what} is no better on runs not used for the fit."
    said = f"{begin}, {what} is wrong by {after} instead of {before}"
    if gain.is_felt:
        return f"{said}."
    return f"{said}. This improvement is not certain." if gain.is_uncertain else f"{said}. The difference is slight."


def _both(one: float, other: float, unit: str) -> tuple[str, str]:
    """Return two errors as text, with the unit after the first and enough digits to show the difference."""
    words, factor = UNITS.get(unit, (unit, 1.0))
    texts = [format_number(factor * one, 2), format_number(factor * other, 2)]
    if texts[0] == texts[1] and one != other:
        texts = [format_number(factor * one, 3), format_number(factor * other, 3)]
    return f"{texts[0]} {words}".rstrip(), texts[1]


# -- hints


LACKS: Mapping[Lack, str] = {
    "weak": "The improvement is too small to identify a cause.",
    "not-on-each": "The prediction improves too little, or not on every held-out part.",
    "not-sure": "The improvement on held-out data may be chance.",
    "no-gain": "The prediction error on held-out data does not clearly fall.",
    "brief": "The time constant is shorter than the sampling interval. A sensor filter looks the same.",
    "no-model": (
        "The fit is not a usable model: the disturbance is about as large as the commands, or the craft's time "
        "constant is shorter than one sample."
    ),
}


def hint_title(hint: Hint) -> str:
    """Return the heading of a hint: its effect and place, and the effects that the runs do not distinguish from it."""
    return _begun(" or ".join([f"{effect_words(hint.cause)} ({hint.place})", *map(effect_words, hint.alike)]))


def hint_notes(diagnosis: Diagnosis, hint: Hint) -> tuple[Note, ...]:
    """Return notes on a hint: its meaning, its gain in log-likelihood, and the run that would confirm or reject it."""
    numbers = ", ".join(f"{n} {value_words(v, n)}" for n, v in hint.parameters.items())
    means = plain_sentence(diagnosis, hint) + (f" Estimate: {numbers}." if numbers else "")
    return (
        Note(means, "What it would mean"),
        Note(_evidence(hint), "Evidence"),
        Note(_settles(hint), "How to confirm or reject it"),
    )


def _evidence(hint: Hint) -> str:
    said = f"This cause improves the log-likelihood of these runs by {format_number(hint.gained, 2)}"
    if hint.unseen:
        parts = ", ".join(f"{v:+.1f}" for v in hint.unseen)
        said += f". Held-out data: {sum(hint.unseen):+.1f} ({hint.held_out}: {parts})"
    return f"{said}. Noise alone improves some candidate as much in {_odds(hint.chance)}. {LACKS[hint.lacks]}"


def _odds(chance: float) -> str:
    if chance > 0.5:
        return "more than half of such searches"
    return f"1 of {round(1.0 / chance)} such searches" if chance > 1e-4 else "less than 1 of 10 000 such searches"


def _settles(hint: Hint) -> str:
    more = (
        f"Fly the same manoeuvres for {format_seconds(max(hint.needed, LONGER * hint.seconds))} in total instead of "
        f"{format_seconds(hint.seconds)}: evidence grows with length"
    )
    said = sentence(f"{more}. Alternatively: {hint.separated_by}")
    if hint.alike:
        said += f" These runs do not distinguish it from {' or '.join(effect_words(s) for s in hint.alike)}."
    return said
