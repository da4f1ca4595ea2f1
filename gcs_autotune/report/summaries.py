"""Terminal output of the commands without a page: logs, plans, ship figures, thrusters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType

from gcs_autotune.identify import CONTRADICTION, Agreement, PlanResult
from gcs_autotune.report.toolkit.page import Table
from gcs_autotune.report.toolkit.terminal import bullet, contradictions_shown, doubts_shown, grid, paragraph, title
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    contradictions_in,
    doubt_sentence,
    format_number,
    format_seconds,
    format_value,
    pretty_unit,
    to_people,
)
from gcs_autotune.rounding import EXACT
from gcs_autotune.seatrials import Figure, Sheet
from gcs_autotune.thrusters import PropellerFit, ThrusterFit

__all__ = ["log_summary", "plan_summary", "propeller_summary", "sheet_table", "sheets_summary", "thruster_summary"]


MESSAGES = 12
"""Most kinds of messages shown; the most frequent first. Chosen."""

CHANGES = 8
"""Most changes of mode or arming shown per boot. Chosen."""

AT_ONCE = 2.0
"""States first reported within this time [s] of a log's start count as initial; heartbeats come once a second."""


def log_summary(told: Mapping[str, Any]) -> Group:
    """Return the output of ``logs list`` for one log."""
    counts = told["counts"]
    damage = f", {counts['damaged']} damaged and skipped" if counts.get("damaged") else ""
    stamps = f", {counts['damaged_stamps']} damaged stamps" if counts.get("damaged_stamps") else ""
    cut = ", truncated in the middle of a message" if counts.get("truncated") else ""
    parts: list[RenderableType] = [
        *contradictions_shown(cause for slug, cause, _ in told["notes"] if slug == CONTRADICTION),
        title(f"{told['source']}: {told['format']}"),
        paragraph(f"{counts.get('messages', 0)} messages{damage}{stamps}{cut}."),
    ]
    for number, boot in enumerate(told["boots"], start=1):
        which = f"Boot {number}: " if len(told["boots"]) > 1 else ""
        parts.append(
            paragraph(
                f"{which}{boot['vehicle']}, {format_seconds(boot['duration'])}, clock: {boot['clock']}; "
                f"{boot['parameters']} parameters; inputs: {boot['servo_map']}."
            )
        )
        parts.append(paragraph(_course(boot)))
        if boot["dated_by_arrival"]:
            parts.append(
                paragraph(f"Timed by arrival, without a timestamp of their own: {', '.join(boot['dated_by_arrival'])}.")
            )
    parts.append(grid(_messages(told["messages"])))
    if told["truth"]:
        parts.append(
            paragraph(f"The log contains a simulator's true state ({', '.join(told['truth'])}); it is not used.")
        )
    parts.append(title("Runs") if told["runs"] else paragraph(_no_run(told["boots"])))
    for run in told["runs"]:
        parts.append(paragraph(f"{run['name']} (inputs: {run['input_from']})"))
        parts += [bullet(_look(look)) for look in run["excitation"]]
    parts += [bullet(f"skipped {row['name']}: {row['why']}") for row in told["left_out"]]
    if told["notes"]:
        parts += doubts_shown(f"{cause}: {cure}" for _, cause, cure in told["notes"])
    return Group(*parts)


def _no_run(boots: Sequence[Mapping[str, Any]]) -> str:
    told = [on for boot in boots for _, on in boot["armed"]]
    never = " The vehicle was never armed." if told and not any(told) else ""
    return f"No run to identify from.{never}"


def _course(boot: Mapping[str, Any]) -> str:
    said = [(t, f"{mode}") for t, mode in boot["modes"]]
    said += [(t, "armed" if on else "disarmed") for t, on in boot["armed"]]
    said.sort(key=lambda row: row[0])
    said = [row for i, row in enumerate(said) if i == 0 or row[1] != said[i - 1][1]]
    shown = "; ".join(what if t < AT_ONCE else f"after {format_seconds(t)} {what}" for t, what in said[:CHANGES])
    more = f" and {len(said) - CHANGES} more" if len(said) > CHANGES else ""
    return f"Timeline: {shown}{more}." if said else "The log has no modes and no arming; it counts as armed throughout."


def _messages(kinds: Mapping[str, Mapping[str, Any]]) -> Table:
    read = [(kind, row) for kind, row in kinds.items() if row["read"]]
    rest = len(kinds) - len(read)
    rows = [(kind, str(row["count"]), f"{row['rate']:.1f} Hz") for kind, row in read[:MESSAGES]]
    if rest:
        rows.append((f"{rest} other kinds", str(sum(r["count"] for r in kinds.values() if not r["read"])), ""))
    return Table(("message", "count", "rate"), "lrr", tuple(rows))


def _look(look: Mapping[str, Any]) -> str:
    why = f": {look['why']}" if look["why"] else ""
    quiet = format_number(look["response_to_noise"], 2)
    return (
        f"{look['dof']}: {look['verdict']}{why} (input {look['input']}, range {format_number(look['input_range'], 2)}, "
        f"{look['swings']} reversals, sampled every {format_seconds(look['input_interval'])}; response "
        f"{look['response']}, {quiet} times its noise, sampled every {format_seconds(look['response_interval'])})"
    )


def plan_summary(result: PlanResult) -> Group:
    """Return the result of a plan: steps with validation, agreement, parameters, final validation, doubts."""
    parts: list[RenderableType] = [title(f"Plan {result.plan.name}: {result.plan.title}"), grid(_steps(result))]
    if result.agreements:
        parts += [title("Shared parameters, compared between steps"), grid(_agreements(result.agreements))]
    parts += [title("Parameters of the joint fit of all runs"), grid(_plan_parameters(result))]
    if result.final is not None:
        parts += [
            title("Final validation on held-out runs"),
            grid(_final(result)),
            paragraph(f"Fit {result.final.fit_percent:.1f} % on average."),
        ]
    step_doubts = [f"{s.step.name}: {doubt_sentence(d)}" for s in result.steps for d in s.fit.doubts]
    parts += doubts_shown([*(doubt_sentence(d) for d in result.doubts), *step_doubts])
    return Group(*parts)


def _steps(result: PlanResult) -> Table:
    rows = []
    for s in result.steps:
        checked = UNKNOWN if s.validation is None else f"{s.validation.fit_percent:.1f} %"
        remark = "" if s.unseen else "on its own run"
        rows.append((s.step.name, str(len(s.fit.used)), f"{s.fit.fit_percent:.1f} %", checked, remark))
    rows += [(name, "0", UNKNOWN, UNKNOWN, "no runs") for name in result.skipped]
    return Table(("step", "runs", "fit", "validation", "remark"), "lrrrl", tuple(rows))


def _agreements(found: tuple[Agreement, ...]) -> Table:
    rows = tuple(
        (
            a.name,
            ", ".join(format_value(v, s) for v, s in zip(a.values, a.stds, strict=True)),
            format_number(a.probability),
        )
        for a in found
    )
    return Table(("parameter", "by step", "chance"), "llr", rows)


def _plan_parameters(result: PlanResult) -> Table:
    rows = tuple(
        (p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1", format_number(result.combined[p.name]))
        for p in result.parameters.values()
    )
    return Table(("parameter", "value ± std", "unit", "steps combined"), "lrlr", rows)


def _final(result: PlanResult) -> Table:
    assert result.final is not None
    rows = tuple(
        (t.run, t.signal, f"{format_number(s.rms)} {t.unit}", f"{s.fit_percent:.1f} %")
        for t, s in zip(result.final.traces, result.final.statistics, strict=True)
    )
    return Table(("run", "signal", "rms", "fit"), "llrr", rows)


_VERDICTS = {"meets": "met", "fails": "FAILED", "open": "too close"}


def sheets_summary(sheets: Sequence[Sheet]) -> Group:
    """Return the output of ``figures``: per manoeuvre its figures, verdict and doubts."""
    parts: list[RenderableType] = []
    parts += contradictions_shown(dict.fromkeys(c for sheet in sheets for c in contradictions_in(sheet.doubts)))
    for sheet in sheets:
        parts.extend((title(f"{sheet.run}: {sheet.title}"), grid(sheet_table(sheet))))
        if sheet.verdict:
            parts.append(paragraph(f"{sheet.verdict[0].upper()}{sheet.verdict[1:]}."))
        if sheet.doubts:
            parts.extend(doubts_shown((doubt_sentence(d) for d in sheet.doubts), about="figures"))
    return Group(*parts)


def sheet_table(sheet: Sheet) -> Table:
    """Return the figures with standard errors, the IMO criterion and whether it is met."""
    return Table(("figure", "value ± std", "unit", "IMO limit", ""), "lrlrl", tuple(_row(f) for f in sheet.figures))


def _row(figure: Figure) -> tuple[str, ...]:
    reading = figure.reading
    unit, factor = to_people(reading.unit)
    value = reading.value * factor
    shown = format_value(value, reading.std * factor) if math.isfinite(reading.std) else format_number(value)
    if reading.std == 0.0:
        shown = format_number(value)
    if figure.limit is None:
        return figure.name, shown or UNKNOWN, pretty_unit(unit), "", ""
    return figure.name, shown, pretty_unit(unit), format_number(figure.limit.value * factor), _VERDICTS[figure.verdict]


_MEANING = {
    "a_f": "ahead, per squared command",
    "b_f": "ahead, per command",
    "a_b": "astern, per squared command",
    "b_b": "astern, per command",
    "x_f": "start of thrust ahead",
    "x_b": "start of thrust astern",
    "offset": "zero offset of the dynamometer",
}

SHOWN = 5
"""Most rival structures shown. Chosen."""

_POINTS = 9
"""Number of rows of the compensation table. Chosen."""


def thruster_summary(fit: ThrusterFit) -> Group:
    """Return the output of ``thrusters``: the map, the choice of its structure, and commands for required forces."""
    m = fit.map
    low, high = m.dead_zone
    way = "A higher command thrusts ahead." if m.direction > 0 else "A higher command thrusts astern."
    zone = (
        f"No dead zone; neutral at {format_number(m.neutral)} {pretty_unit(m.unit)}".rstrip() + "."
        if low == high
        else f"Dead zone from {format_number(low)} to {format_number(high)} {pretty_unit(m.unit)}."
    )
    scatter = _force_left(fit, fit.noise)
    parts: list[RenderableType] = [
        title(f"Thruster map of {fit.pulls.name}: {fit.structure.name}"),
        grid(_thruster_parameters(fit)),
        paragraph(f"{way} {zone} Scatter of one reading: {scatter} N; fit {fit.fit_percent:.1f} %."),
        title("Which structure"),
        grid(_candidates(fit)),
        title("Command for a required force"),
        grid(_compensation(fit)),
        *doubts_shown(doubt_sentence(d) for d in fit.doubts),
    ]
    return Group(*parts)


def propeller_summary(fit: PropellerFit) -> Group:
    """Return the output of ``thrusters`` for an open-water test."""
    rows = tuple((p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1") for p in fit.parameters.values())
    noise = ", ".join(f"{n} {format_number(s)}" for n, s in fit.noise.items())
    return Group(
        title(f"Propeller: {fit.kind}"),
        grid(Table(("coefficient", "value ± std", "unit"), "lrl", rows)),
        paragraph(f"Scatter of one run: {noise}."),
        *doubts_shown(doubt_sentence(d) for d in fit.doubts),
    )


def _thruster_parameters(fit: ThrusterFit) -> Table:
    turned = {"x_f": fit.map.direction, "x_b": fit.map.direction}
    rows = tuple(
        (p.name, format_value(turned.get(p.name, 1) * p.value, p.std), pretty_unit(p.unit) or "1", _MEANING[p.name])
        for p in fit.parameters.values()
        if p.status != "absent" or p.name in ("x_f", "x_b")
    )
    return Table(("parameter", "value ± std", "unit", "meaning"), "lrll", rows)


def _force_left(fit: ThrusterFit, rms: float) -> str:
    """Return the residual scatter of a map [N]; for exact data only rounding."""
    return format_number(rms if rms > EXACT * max(abs(float(f)) for f in fit.pulls.force) else 0.0)


def _candidates(fit: ThrusterFit) -> Table:
    best = fit.candidates[0].bic
    rows = tuple(
        (c.structure, str(c.free_parameters), _force_left(fit, c.rms), f"{c.bic - best:.1f}")
        for c in fit.candidates[:SHOWN]
    )
    return Table(("structure", "free", "rms, N", "BIC more"), "lrrr", rows)


def _compensation(fit: ThrusterFit) -> Table:
    low, high = fit.map.limits
    wanted = [low + (high - low) * i / (_POINTS - 1) for i in range(_POINTS)]
    rows = tuple((format_number(f), format_number(float(fit.map.inverse(f)))) for f in wanted)
    return Table(("force, N", f"command, {pretty_unit(fit.map.unit) or '1'}"), "rr", rows)
