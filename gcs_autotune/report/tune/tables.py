"""The tables of a tune."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from gcs_autotune.design import Change, Linearity, Margins, PositionMetrics, Proposal, StepMetrics, TrackMetrics
from gcs_autotune.report.toolkit.document import Table
from gcs_autotune.report.toolkit.wording import (
    MOST_FACTOR,
    format_change,
    format_factor,
    format_number,
    format_quantity,
    format_seconds,
    format_share,
)
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.report.tune.wording import not_reached, settling_cell

__all__ = [
    "changed_parameters",
    "gains_table",
    "margins_table",
    "metrics_table",
    "position_table",
    "rates_table",
    "route_table",
    "thrust_table",
    "vehicle_table",
]


_METRICS: tuple[tuple[str, str, Callable[[StepMetrics], str]], ...] = (
    ("itae", "tracking error (ITAE per unit step)", lambda m: _with_unit(m.itae, "s²")),
    ("overshoot", "overshoot", lambda m: format_share(m.overshoot)),
    ("rise", "rise time (10 to 90 %)", lambda m: format_seconds(m.rise, not_reached(m.span))),
    ("settling", "settling time (to within 5 %)", settling_cell),
    ("steady_error", "remaining error", lambda m: format_share(m.steady_error)),
    ("travel", "actuator travel per second", lambda m: format_share(m.travel)),
)
"""Field of StepMetrics -> its label and its format."""

_VEHICLE: Mapping[str, str] = {
    "name": "vehicle",
    "firmware": "firmware",
    "version": "version",
    "system_id": "system id",
    "link": "link",
    "simulated": "simulated",
}
"""Keys of ``TuneStory.vehicle`` -> label; other keys are shown unchanged."""
_NAMES: Mapping[str, Mapping[object, str]] = {
    "autopilot": {3: "ArduPilot"},
    "vehicle_type": {10: "ground rover", 11: "surface boat", 12: "submarine"},
}
"""Keys of ``TuneStory.vehicle`` -> number of MAV_AUTOPILOT or MAV_TYPE -> its name, for the vehicles that are tuned."""


def gains_table(changes: Sequence[Change]) -> Table:
    """Return a table of old and new gains, with documented range and reason. A reason common to all is shown once, as a
    note.
    """
    common = _common_reason(changes)
    rows = tuple(_gain_row(change, common) for change in changes)
    if not common:
        return Table(("parameter", "old", "new", "range", "why"), "lrrll", rows)
    every = all(_split(change.reason)[1] == common for change in changes)
    note = f"{'All are' if every else 'The others are'} {common}."
    return Table(("parameter", "old", "new", "range", "purpose"), "lrrll", rows, note)


def _common_reason(changes: Sequence[Change]) -> str:
    """Return the reason that two or more gains share, else empty."""
    told = Counter(_split(change.reason)[1] for change in changes)
    reason, count = max(told.items(), key=lambda pair: pair[1], default=("", 0))
    return reason if count > 1 and reason.startswith(("chosen", "matched", "measured")) else ""


def _split(reason: str) -> tuple[str, str]:
    """Return the purpose of a gain and how it was chosen, without the remark that it is at its limit."""
    meaning, _, how = reason.partition(": ")
    return meaning, how.partition(", limited to ")[0]


def _gain_row(change: Change, common: str) -> tuple[str, ...]:
    meaning, how = _split(change.reason)
    limits = f"{format_number(change.low)} to {format_number(change.high)}"
    remark = " (at limit)" if change.at_limit else " (beyond)" if change.beyond else ""
    return (
        change.parameter,
        format_number(change.old),
        format_number(change.new),
        limits + remark,
        meaning if common and how == common else change.reason,
    )


def metrics_table(before: StepMetrics | None, after: StepMetrics | None) -> Table:
    """Return a table of the step metrics before and after, or of a single step. For all metrics, lower is better."""
    if after is None or before is None:
        return _metrics_of_one(before or after)
    rows = []
    for name, label, show in _METRICS:
        old, new = float(getattr(before, name)), float(getattr(after, name))
        rows.append(
            (
                label,
                show(before),
                show(after),
                format_change(old, new),
            )
        )
    span = min(before.span, after.span)
    return Table(("lower is better", "before", "after", "change"), "lrrr", tuple(rows), _span_note(span))


def _span_note(span: float) -> str:
    """Return a sentence on the time [s] over which steps are measured; empty if it is unknown."""
    if not math.isfinite(span):
        return ""
    return f"Over at least {format_seconds(span)} after each step; remaining error: over the last third."


def beside_table(story: TuneStory) -> Table:
    """Return a table of the metrics of a heading tune's turn-rate step; it has no rows without such a step."""
    before, after = story.beside or (None, None)
    table = metrics_table(before, after)
    return replace(table, heads=("turn rate, lower is better", *table.heads[1:]))


def route_table(before: TrackMetrics, after: TrackMetrics | None) -> Table:
    """Return how the legs of a mission were followed, before and after."""
    corners = [f"at corner {n}, greatest" for n in range(1, len(before.corners) + 1)]
    places = ("distance from the route, rms", "in the second half of legs, rms", *corners)
    labels = (*places, "time from first to last waypoint")
    values = [(m.rms, m.late, *m.corners, m.seconds) for m in (before, after) if m is not None]
    units = ["m"] * (len(labels) - 1) + ["s"]
    rows = tuple(
        (label, *(_with_unit(value, unit) for value in told), *([format_change(*told)] if len(told) == 2 else []))
        for label, unit, *told in zip(labels, units, *values, strict=True)
    )
    if after is None:
        return Table(("lower is better", "present parameters"), "lr", rows)
    return Table(("lower is better", "before", "after", "change"), "lrrr", rows)


_POSITION: tuple[tuple[str, str, Callable[[PositionMetrics], str]], ...] = (
    ("itae", "step error (ITAE per unit step)", lambda m: _with_unit(m.itae, "s²")),
    ("rise", "rise time (to 90 %)", lambda m: format_seconds(m.rise, "not reached")),
    ("overshoot", "overshoot", lambda m: format_share(m.overshoot)),
    ("hold", "distance while holding, rms", lambda m: _with_unit(m.hold, "m")),
    ("push", "distance under the push, rms", lambda m: _with_unit(m.push, "m")),
    ("excursion", "distance under the push, greatest", lambda m: _with_unit(m.excursion, "m")),
    ("travel", "actuator travel per second", lambda m: format_share(m.travel)),
)
"""Field of PositionMetrics -> its label and its format."""


def position_table(before: PositionMetrics, after: PositionMetrics | None) -> Table:
    """Return how the position was stepped and held, before and after."""
    shown = [row for row in _POSITION if math.isfinite(getattr(before, row[0])) or row[0] == "rise"]
    if after is None:
        return Table(("lower is better", "present gains"), "lr", tuple((what, show(before)) for _, what, show in shown))
    rows = tuple(
        (what, show(before), show(after), format_change(getattr(before, name), getattr(after, name)))
        for name, what, show in shown
    )
    return Table(("lower is better", "before", "after", "change"), "lrrr", rows)


def thrust_table(before: Linearity, after: Linearity | None) -> Table:
    """Return the thrust at each command, before and after."""
    told = [before] if after is None else [before, after]
    heads = ("command", "thrust") if after is None else ("command", "thrust before", "thrust after")
    rows = [
        (format_share(command), *(format_share(thrust) for thrust in thrusts))
        for command, *thrusts in zip(before.commands, *(one.thrusts for one in told), strict=True)
    ]
    rows.append(("departure, rms", *(f"{100.0 * one.departure:.1f} %" for one in told)))
    return Table(heads, "l" + "r" * len(told), tuple(rows))


def _metrics_of_one(metrics: StepMetrics | None) -> Table:
    shown = () if metrics is None else _METRICS
    rows = tuple((label, show(metrics)) for _, label, show in shown if metrics is not None)
    note = _span_note(math.nan if metrics is None else metrics.span)
    return Table(("lower is better", "present gains"), "lr", rows, note)


def margins_table(proposal: Proposal) -> Table:
    """Return a table of the stability margins, for the identified model and at the worst point of its 95 % confidence
    region.
    """
    shown = [_margin_cells(m) for m in (proposal.margins, proposal.worst_margins)]
    labels = ("stable", "gain margin", "phase margin", "delay margin")
    rows = tuple((label, *cells) for label, *cells in zip(labels, *shown, strict=True))
    return Table(("", "identified model", "worst case in its 95 % region"), "lrr", rows)


def _margin_cells(margins: Margins) -> tuple[str, ...]:
    gain = format_factor(margins.gain)
    if 0.0 < margins.gain <= MOST_FACTOR:
        gain += f" ({20.0 * math.log10(margins.gain):.1f} dB)"
    phase = format_quantity(margins.phase, "rad")
    return ("yes" if margins.stable else "NO", gain, phase, format_seconds(margins.delay))


def rates_table(rates: Mapping[str, tuple[float, float]]) -> Table:
    """Return a table of the requested and measured message rates [Hz]."""
    rows = tuple(
        (
            name,
            _with_unit(asked, "Hz"),
            _with_unit(measured, "Hz"),
            "slower than requested" if measured < 0.8 * asked else "",
        )
        for name, (asked, measured) in rates.items()
    )
    return Table(("message", "requested", "measured", ""), "lrrl", rows)


def changed_parameters(story: TuneStory, most: int) -> Table:
    """Return a table of all parameters read, changed ones first. If there are more than *most*, the page folds them."""
    changed = story.differences
    names = [*changed, *(n for n in story.parameters_before if n not in changed)]
    rows = tuple(
        (
            name,
            format_number(story.parameters_before[name], 6),
            format_number(story.parameters_after[name], 6) if name in story.parameters_after else "not read",
            "changed" if name in changed else "",
        )
        for name in names
    )
    count = f"{len(rows)} parameters read, {len(changed)} changed"
    heads = ("parameter", "before", "after", "")
    if len(rows) > most:
        return Table(heads, "lrrl", rows, shown=len(changed), fold=count)
    return Table(heads, "lrrl", rows, note=f"{count}.")


def vehicle_table(vehicle: Mapping[str, object]) -> Table:
    """Return a table of the vehicle's data, known keys first. It has no headings and omits nested tables."""
    plain = [k for k, value in vehicle.items() if not isinstance(value, Mapping)]
    keys = [*(k for k in _VEHICLE if k in plain), *(k for k in plain if k not in _VEHICLE)]
    known = ((k, vehicle[k]) for k in keys if vehicle[k] is not None)
    rows = ((_VEHICLE.get(k, k.replace("_", " ")), _plain(k, value)) for k, value in known)
    return Table(("", ""), "ll", tuple(row for row in rows if row[1]))


def _plain(key: str, value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _NAMES.get(key, {}).get(value, str(value)) if isinstance(value, int) else str(value)


def _with_unit(value: float, unit: str) -> str:
    return format_number(value, 3) + (f" {unit}" if math.isfinite(value) else "")
