"""Format numbers and sentences for users: rounded to their uncertainty, in degrees, with unit signs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime

from gcs_autotune.identify import CONTRADICTION, AxisFit, Doubt
from gcs_autotune.report.toolkit.document import Remark
from gcs_autotune.rounding import UNKNOWN, format_number, format_value, rounded, rounded_to
from gcs_autotune.sname import SIGNALS

__all__ = [
    "BEFORE_UNIT",
    "MOST_FACTOR",
    "NOT_IDENTIFIABLE",
    "UNKNOWN",
    "beside_telemetry",
    "contradictions_in",
    "doubt_sentence",
    "doubt_sentences",
    "format_change",
    "format_error",
    "format_factor",
    "format_moment",
    "format_number",
    "format_parameter",
    "format_percent",
    "format_quantity",
    "format_seconds",
    "format_share",
    "format_value",
    "glued",
    "how_to_resume",
    "listed",
    "pretty_unit",
    "remarks",
    "rounded_to",
    "sentence",
    "to_people",
    "with_signs",
]


MOST_FACTOR = 100.0
"""Largest gain margin shown as a number; above it differences have no practical meaning. Project choice."""

NOT_IDENTIFIABLE = "not identifiable from these runs"
"""Text for a number that the runs do not determine."""

_VERBATIM = re.compile(r"`[^`]*`|(?<!\w)'[^']*'(?!\w)|\"[^\"]*\"|gcs-autotune .*")
"""Parts of a sentence to copy or quoted from elsewhere: commands, options, messages of a vehicle."""

COMMAND = ": gcs-autotune "
"""Text between a sentence and the command that ends it."""

_UNIT = r"(?:min|ms|dB|Hz|rad|deg|kg|[ckm]?m|s|N|V)[²³]?(?:/(?:rad|deg|s|m)[²³]?)?(?!\w)"
BEFORE_UNIT = re.compile(rf"(?<=\d) (?=[%°]|{_UNIT})|(?<=\d N) (?=[ms][²³]?(?!\w))|(?<=\d min) (?=\d+ s(?!\w))")
"""Space between a number and its unit."""

_HEADINGS = ("anchor", "direction")
"""Parameters that are headings if their unit is rad."""

_PEOPLE: dict[str, tuple[str, float]] = {
    "rad": ("°", 180.0 / math.pi),
    "rad/s": ("°/s", 180.0 / math.pi),
}
"""SI unit -> (display unit, factor); others are shown unchanged."""


def to_people(unit: str) -> tuple[str, float]:
    """Return (display unit, factor from SI) of an SI *unit*; ``rad`` becomes degrees."""
    return _PEOPLE.get(unit, (unit, 1.0))


def with_signs(text: str) -> str:
    """Return *text* in the notation of the reports: ``30°``, ``5°/s`` and ``50 %`` for ``30 deg``, ``5 deg/s`` and
    ``50%``. Commands and quotations stay as they are.
    """
    return _in_prose(text, _signs)


def glued(text: str) -> str:
    """Return *text* for HTML: in the notation of the reports, with each number and its unit on one line and an arrow
    between old and new. Commands and quotations stay as they are.
    """
    return _in_prose(with_signs(text), _without_breaks)


def _in_prose(text: str, change: Callable[[str], str]) -> str:
    """Return *text* with *change* applied outside commands and quotations."""
    pieces, at = [], 0
    for kept in _VERBATIM.finditer(text):
        pieces += [change(text[at : kept.start()]), kept[0]]
        at = kept.end()
    return "".join((*pieces, change(text[at:])))


def _without_breaks(text: str) -> str:
    text = BEFORE_UNIT.sub("\u00a0", text)
    text = re.sub(r"(?<=[\d%°²]) (?=(?:->|±) -?\d)|(?<=\d\u00a0[ms]) (?=-> -?\d)", "\u00a0", text)
    return re.sub(r"(?<=±) (?=\d)", "\u00a0", text.replace("-> ", "\N{RIGHTWARDS ARROW}\u00a0"))


def _signs(text: str) -> str:
    text = re.sub(r"(?<=\d)%(?!\w)", " %", re.sub(r"(?<=\d) deg\b", "°", text))
    return re.sub(r"(?<=[\d.]) s\^2\b", " s²", text.replace(" +- ", " ± "))


def format_parameter(name: str, value: float, std: float, unit: str) -> str:
    """Return a parameter's value with its standard error as text, by :func:`format_value`. A heading (``anchor``,
    ``direction`` [rad]) is first wrapped to 0 to 2 pi.

    A heading with a standard error above a quarter turn is shown as not identifiable.
    """
    if unit != "rad" or name.rpartition(".")[2] not in _HEADINGS or not math.isfinite(value):
        return format_value(value, std)
    if std > 0.5 * math.pi:
        return NOT_IDENTIFIABLE
    return format_value(value % (2.0 * math.pi), std)


def beside_telemetry(telemetry: AxisFit, onboard: AxisFit) -> list[str]:
    """Return lines that compare a model identified from an onboard log with the one from telemetry."""
    lines = [f"{telemetry.dof}, from telemetry and from the onboard log:"]
    for name, one in telemetry.parameters.items():
        other = onboard.parameters.get(name)
        if other is None or "absent" in (one.status, other.status):
            continue
        apart = abs(one.value - other.value) / (math.hypot(one.std, other.std) or math.inf)
        both = " and ".join(format_parameter(name, p.value, p.std, p.unit) for p in (one, other))
        lines.append(
            f"{name} [{pretty_unit(one.unit)}]: {both}"
            + (f", {apart:.1f} standard errors apart" if apart > 0.0 else "")
        )
    return lines


def format_factor(factor: float, digits: int = 3) -> str:
    """Return a margin's factor as text; a factor above 100, or infinite, is ``more than 100``."""
    return "more than 100" if factor > MOST_FACTOR else format_number(factor, digits)


def format_quantity(value: float, unit: str, digits: int = 3) -> str:
    """Return *value* [SI *unit*] as text in display units: ``format_quantity(0.5, "rad")`` is ``"28.6°"``."""
    shown, factor = to_people(unit)
    if not math.isfinite(value):
        return format_number(value)
    space = "" if shown.startswith("°") else " "
    unit_text = "" if shown in ("", "1") else space + pretty_unit(shown)
    return format_number(value * factor, digits) + unit_text


def format_error(value: float, unit: str, digits: int = 3) -> str:
    """Return an error [SI *unit*] as text in display units. For a heading error above half a turn, the text states only
    that.
    """
    if unit == "rad" and math.isfinite(value) and abs(value) > math.pi:
        return "over 180°"
    return format_quantity(value, unit, digits)


def format_seconds(t: float, missing: str = UNKNOWN) -> str:
    """Return a time span [s] as text: tenths of a second below a minute, else ``2 min 05 s``. NaN results in
    *missing*.
    """
    if math.isnan(t):
        return missing
    if math.isinf(t):
        return "unlimited"
    if abs(t) < 1.0:
        return f"{rounded(t, -2)} s"
    if abs(t) < 59.95:
        return f"{rounded(t, -1)} s"
    whole = round(abs(t))
    return f"{'-' if t < 0 else ''}{whole // 60} min {whole % 60:02d} s"


def format_percent(percent: float) -> str:
    """Return a percentage as text: to a tenth below 10 and from 90 to 100, else whole.

    ``format_percent(34.2)`` is ``"34 %"``, ``format_percent(98.63)`` is ``"98.6 %"``.
    """
    if not math.isfinite(percent):
        return format_number(percent)
    is_fine = abs(percent) < 9.95 or 90.0 <= percent < 100.0
    return f"{round(percent, 1 if is_fine else 0) + 0.0:g} %"


def format_share(share: float) -> str:
    """Return a fraction as text in percent: ``format_share(0.245)`` is ``"24 %"``."""
    return format_percent(100.0 * share)


def format_change(before: float, after: float) -> str:
    """Return the relative change from *before* to *after*, e.g. ``"-63 %"``; ``""`` if undefined."""
    if not (math.isfinite(before) and math.isfinite(after)) or abs(before) < 1e-12:
        return ""
    change = round(100.0 * (after - before) / abs(before))
    if change > 999:
        return f"x {after / before:.0f}"
    return "no change" if change == 0 else f"{change:+d} %"


def format_moment(when: str) -> str:
    """Return an ISO 8601 moment as ``2026-11-20 20:12 UTC``; any other text unchanged."""
    try:
        moment = datetime.fromisoformat(when)
    except ValueError:
        return when
    zone = moment.tzname()
    return f"{moment:%Y-%m-%d %H:%M}" + (f" {zone}" if zone else "")


def pretty_unit(unit: str) -> str:
    """Return a unit with powers as superscripts: ``"N m s^2/rad^2"`` becomes ``"N m s²/rad²"``.

    The unit ``1`` becomes ``""``. A normalised output times a unit becomes the unit alone.
    """
    return "" if unit == "1" else unit.removeprefix("1 ").replace("^2", "²").replace("^3", "³")


def listed(names: Sequence[str]) -> str:
    """Return the items of a list as text: ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def contradictions_in(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Return one sentence per contradiction between columns, for the beginning of a result."""
    return tuple(sentence(d.cause) for d in doubts if d.slug == CONTRADICTION)


def doubt_sentence(doubt: Doubt) -> str:
    """Return a doubt and its remedy as text."""
    return f"{sentence(doubt.cause)} Cure: {sentence(doubt.cure)}"


def doubt_sentences(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Return each doubt and its remedy as text."""
    return tuple(doubt_sentence(doubt) for doubt in doubts)


def remarks(doubts: Iterable[Doubt]) -> tuple[Remark, ...]:
    """Return each doubt and its remedy as text, with its grade."""
    return tuple(Remark(doubt_sentence(doubt), doubt.grade) for doubt in doubts)


NOTHING_WRITTEN = "No parameter was written, so there is nothing to undo."
"""Sentence of a verdict of a flight that tunes nothing."""


def how_to_resume(way_on: str) -> dict[str, str]:
    """Return the ``command`` that continues an interrupted run and the ``text`` before it; empty without a command.

    way_on : a sentence that ends with the command.
    """
    text, _, command = way_on.partition(COMMAND)
    return {"text": f"{sentence(text).rstrip('.')}:", "command": f"{COMMAND.strip(': ')} {command}"} if command else {}


def sentence(text: str) -> str:
    """Return *text* with a capital first letter and a full stop; signal names keep their case."""
    text = text.strip()
    if not text:
        return ""
    first = text.split()[0].rstrip(",.:;")
    start = text[0].upper() if first.replace("-", "").isalpha() and first not in SIGNALS else text[0]
    return start + text[1:] + ("" if text[-1] in ".!?" else ".")
