"""The rows of every table, as text: written once, shown by the page and by the terminal alike."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.design.result import Change, Margins, Proposal, StepMetrics
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.extended.wish import label_of
from gcs_autotune.identify.result import AxisFit, Candidate, IsoEstimate, Parameter
from gcs_autotune.report.numbers import (
    MOST_FACTOR,
    UNKNOWN,
    format_change,
    format_factor,
    format_number,
    format_quantity,
    format_seconds,
    format_share,
    format_value,
    pretty_unit,
)
from gcs_autotune.report.story import TuneStory
from gcs_autotune.report.wording import structure_words

__all__ = [
    "Table",
    "candidate_table",
    "changed_parameters",
    "cycle_table",
    "estimate_table",
    "gains_table",
    "margins_table",
    "meanings",
    "metrics_table",
    "model_table",
    "rates_table",
    "short_name",
    "vehicle_rows",
]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under heads; ``align`` has one letter a column, ``l`` text or ``r`` number. ``note``: a sentence for
    under it, of what holds for all rows."""

    heads: tuple[str, ...]
    align: str
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


_METRICS: tuple[tuple[str, str, Callable[[float], str]], ...] = (
    ("itae", "tracking error (ITAE per unit step)", lambda v: _with_unit(v, "s²")),
    ("overshoot", "overshoot", format_share),
    ("rise", "rise time, 10 to 90 %", lambda v: format_seconds(v, "never")),
    ("settling", "settling time, to 5 %", lambda v: format_seconds(v, "never")),
    ("steady_error", "remaining error", format_share),
    ("travel", "actuator travel, of full per second", format_share),
)
"""Field of StepMetrics, what people call it, how it is shown."""

_STATUS: Mapping[str, str] = {
    "fitted": "",
    "absent": "not in this structure",
    "fixed": "fixed, not fitted",
    "at_bound": "AT ITS BOUND: do not trust it",
}
"""Parameter status -> remark."""

_VEHICLE: Mapping[str, str] = {
    "name": "vehicle",
    "firmware": "firmware",
    "version": "version",
    "system_id": "system id",
    "link": "link",
    "simulated": "simulated",
}
"""Keys of ``TuneStory.vehicle`` -> label; other keys are shown as they are."""


def gains_table(changes: Sequence[Change]) -> Table:
    """Old and new gains, the documented range, and why; what several were chosen by is said once, under the table."""
    common = _common_reason(changes)
    rows = tuple(_gain_row(change, common) for change in changes)
    if not common:
        return Table(("parameter", "old", "new", "range", "why"), "lrrll", rows)
    every = all(_split(change.reason)[1] == common for change in changes)
    note = f"{'All are' if every else 'The others are'} {common}."
    return Table(("parameter", "old", "new", "range", "what it does"), "lrrll", rows, note)


def _common_reason(changes: Sequence[Change]) -> str:
    """Return how most of the gains were chosen, where that is the same for two or more."""
    told = Counter(_split(change.reason)[1] for change in changes)
    reason, count = max(told.items(), key=lambda pair: pair[1], default=("", 0))
    return reason if count > 1 and reason.startswith(("chosen", "matched", "measured")) else ""


def _split(reason: str) -> tuple[str, str]:
    """Return what a gain does and how it was chosen, without the remark that it is at its limit."""
    meaning, _, how = reason.partition(": ")
    return meaning, how.partition(", stopped at ")[0]


def _gain_row(change: Change, common: str) -> tuple[str, ...]:
    meaning, how = _split(change.reason)
    limits = f"{format_number(change.low)} to {format_number(change.high)}"
    remark = " (at limit)" if change.at_limit else ""
    return (
        change.parameter,
        format_number(change.old),
        format_number(change.new),
        limits + remark,
        meaning if common and how == common else change.reason,
    )


def metrics_table(before: StepMetrics | None, after: StepMetrics | None) -> Table:
    """Step measures before and after, or of the only step there was; lower is better throughout."""
    if after is None or before is None:
        return _metrics_of_one(before or after)
    rows = []
    for name, label, show in _METRICS:
        old, new = float(getattr(before, name)), float(getattr(after, name))
        rows.append(
            (
                label,
                show(old),
                show(new),
                format_change(old, new),
            )
        )
    return Table(("lower is better", "before", "after", "change"), "lrrr", tuple(rows))


def _metrics_of_one(metrics: StepMetrics | None) -> Table:
    found = () if metrics is None else _METRICS
    rows = tuple((label, show(float(getattr(metrics, name)))) for name, label, show in found)
    return Table(("lower is better", "present gains"), "lr", rows)


def model_table(fit: AxisFit) -> Table:
    """Identified parameters, rounded to their standard error."""
    meaning = meanings(fit)
    rows = tuple(
        (
            short_name(p.name),
            _parameter_value(p),
            pretty_unit(p.unit) or "1",
            meaning.get(p.name, ""),
            _STATUS[p.status],
        )
        for p in fit.parameters.values()
    )
    return Table(("parameter", "value ± std", "unit", "meaning", "remark"), "lrlll", rows)


def _parameter_value(parameter: Parameter) -> str:
    if parameter.status == "absent":
        return "0"
    return format_value(parameter.value, parameter.std)


def meanings(fit: AxisFit) -> dict[str, str]:
    """Return what each parameter of one axis is in words."""
    words = ("inertia with added mass", "linear damping", "quadratic damping", "constant disturbance")
    found = {**dict(zip(fit.model.axis.parameter_names(), words, strict=True)), "delay": "input to force"}
    for own in fit.effects:
        found |= {label_of(own, q.name): q.meaning for q in EFFECTS[own.slug].parameters}
    return found


def short_name(name: str) -> str:
    """Return what a table calls a parameter: ``dead-zone@N.width`` is ``width``; its meaning stands beside it."""
    return name.rpartition(".")[2] if "@" in name else name


def cycle_table(fit: AxisFit) -> Table:
    """The limit cycles that IS-O read off the relay experiments."""
    unit = fit.model.axis.position_unit
    rows = tuple(_cycle_row(e, unit, fit.model.input_unit) for e in fit.iso)
    heads = ("output C", "x_a set", "x_a* real", "amplitude", "bias", "period", "periods", "scatter", "valid")
    return Table(heads, "rrrrrrrrl", rows)


def _cycle_row(estimate: IsoEstimate, unit: str, input_unit: str) -> tuple[str, ...]:
    cycle = estimate.cycle
    period = 2.0 * math.pi / cycle.omega if cycle.omega > 0.0 else math.nan
    return (
        _output(cycle.C, input_unit),
        format_quantity(cycle.x_a, unit),
        format_quantity(cycle.x_a_star, unit),
        format_quantity(cycle.X_m, unit),
        format_quantity(cycle.x_0, unit, 2),
        format_seconds(period),
        str(cycle.periods),
        format_share(cycle.scatter),
        "yes" if cycle.valid else "NO (7.12)",
    )


def _output(value: float, input_unit: str) -> str:
    return format_share(value) if input_unit == "1" else format_quantity(value, input_unit)


def estimate_table(fit: AxisFit) -> Table:
    """IS-O's own answer per experiment, beside the refined one: the approximation and what became of it."""
    names = fit.model.axis.parameter_names()
    rows = [
        (f"IS-O {i}", *(format_number(v) for v in (e.alpha, e.beta, e.beta_quadratic, e.delta)))
        for i, e in enumerate(fit.iso, start=1)
    ]
    rows.append(("refined", *(_parameter_value(fit.parameters[n]) for n in names)))
    return Table(("", *names), "lrrrr", tuple(rows))


def candidate_table(fit: AxisFit) -> Table:
    """Drag structures side by side; the smallest BIC explains the record with the fewest numbers."""
    best = min((c.bic for c in fit.candidates), default=math.nan)
    unit = fit.traces[0].unit if fit.traces and fit.traces[0].unit else fit.model.axis.position_unit
    rows = tuple(_candidate_row(c, best, unit, fit.structure) for c in fit.candidates)
    return Table(("structure", "meaning", "misfit rms", "fitted", "BIC - best", ""), "llrrrl", rows)


def _candidate_row(candidate: Candidate, best: float, unit: str, chosen: str) -> tuple[str, ...]:
    return (
        candidate.structure,
        structure_words(candidate.structure),
        format_quantity(candidate.rms, unit, 4),
        str(candidate.free_parameters),
        f"{candidate.bic - best + 0.0:.1f}",
        "chosen" if candidate.structure == chosen else "",
    )


def margins_table(proposal: Proposal) -> Table:
    """Stability margins at the model and at the worst point of its 95 % region."""
    shown = [_margin_cells(m) for m in (proposal.margins, proposal.worst_margins)]
    labels = ("stable", "gain margin", "phase margin", "delay margin")
    rows = tuple((label, *cells) for label, *cells in zip(labels, *shown, strict=True))
    return Table(("", "at the model", "worst in 95 %"), "lrr", rows)


def _margin_cells(margins: Margins) -> tuple[str, ...]:
    gain = format_factor(margins.gain)
    if 0.0 < margins.gain <= MOST_FACTOR:
        gain += f" ({20.0 * math.log10(margins.gain):.1f} dB)"
    phase = format_quantity(margins.phase, "rad")
    return ("yes" if margins.stable else "NO", gain, phase, format_seconds(margins.delay))


def rates_table(rates: Mapping[str, tuple[float, float]]) -> Table:
    """Message rates asked for and measured."""
    rows = tuple(
        (
            name,
            _with_unit(asked, "Hz"),
            _with_unit(measured, "Hz"),
            "slower than asked" if measured < 0.8 * asked else "",
        )
        for name, (asked, measured) in rates.items()
    )
    return Table(("message", "asked", "measured", ""), "lrrl", rows)


def changed_parameters(story: TuneStory) -> Table:
    """Every parameter that was read, the changed ones first."""
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
    return Table(("parameter", "before", "after", ""), "lrrl", rows)


def vehicle_rows(vehicle: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    """Label and text of what is known about the vehicle, the known keys first; tables of numbers are left out."""
    plain = [k for k, value in vehicle.items() if not isinstance(value, Mapping)]
    keys = [*(k for k in _VEHICLE if k in plain), *(k for k in plain if k not in _VEHICLE)]
    return tuple((_VEHICLE.get(k, k.replace("_", " ")), _plain(vehicle[k])) for k in keys)


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return UNKNOWN if value is None else str(value)


def _with_unit(value: float, unit: str) -> str:
    return format_number(value, 3) + (f" {unit}" if math.isfinite(value) else "")
