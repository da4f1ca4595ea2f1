"""The reports of the commands without a page: logs, plans, manoeuvring figures, thrusters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gcs_autotune.identify import CONTRADICTION
from gcs_autotune.identify.plan import Agreement, PlanResult
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Note,
    Part,
    Remark,
    Section,
    Table,
    bullets,
    cautions,
)
from gcs_autotune.report.toolkit.ship_diagrams import ship_diagram
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    contradictions_in,
    doubt_sentence,
    doubt_sentences,
    format_number,
    format_seconds,
    format_value,
    pretty_unit,
    remarks,
    sentence,
    to_people,
)
from gcs_autotune.rounding import EXACT, counted
from gcs_autotune.seatrials import Figure, Sheet
from gcs_autotune.thrusters import PropellerFit, ThrusterFit, TwinFit
from gcs_autotune.vision import Calibration

__all__ = [
    "laser_document",
    "log_document",
    "plan_document",
    "propeller_document",
    "sheet_section",
    "sheets_document",
    "thruster_document",
    "twin_document",
]


MESSAGES = 12
"""Largest number of message types shown for a log, the most frequent first. Project choice."""

CHANGES = 8
"""Largest number of changes of mode or armed state shown per boot. Project choice."""

AT_ONCE = 2.0
"""Time [s] from the start of a log within which first reported states count as initial, because heartbeats arrive once
a second."""


MESSAGE_OF: Mapping[str, str] = {
    "hud": "VFR_HUD",
    "stick": "MANUAL_CONTROL",
    "esc": "ESC_TELEMETRY",
    "rpm": "RPM",
    "ahrs2": "AHRS2",
}
"""Source in a log -> message that contains it, if messages of a telemetry log have no timestamp of their own."""


def log_document(contents: Mapping[str, Any]) -> Document:
    """Return the report of one log: its contents, the autopilot's boots, and the runs in it."""
    contradictions = tuple(cause for slug, cause, _ in contents["notes"] if slug == CONTRADICTION)
    doubts = tuple(f"{sentence(cause)} Cure: {sentence(cure)}" for _, cause, cure in contents["notes"])
    heading = f"{contents['source']}: {contents['format']}"
    return Document(
        title=heading,
        contradictions=contradictions,
        doubts=cautions(doubts) or None,
        doubted="log",
        sections=(
            Section("log", heading, tuple(_log(contents)), facts=IN_RESULT),
            Section("runs", "Runs", tuple(_log_runs(contents)), facts=IN_RESULT),
        ),
        facts=contents,
    )


def _log(contents: Mapping[str, Any]) -> Iterator[Part]:
    counts = contents["counts"]
    damage = f", {counts['damaged']} damaged and skipped" if counts.get("damaged") else ""
    stamps = f", {counts['damaged_stamps']} damaged timestamps" if counts.get("damaged_stamps") else ""
    cut = ", truncated in the middle of a message" if counts.get("truncated") else ""
    yield Note(f"{counts.get('messages', 0)} messages{damage}{stamps}{cut}.")
    for number, boot in enumerate(contents["boots"], start=1):
        which = f"Boot {number}: " if len(contents["boots"]) > 1 else ""
        yield Note(
            f"{which}{boot['vehicle']}, {format_seconds(boot['duration'])}, clock: {boot['clock']}; "
            f"{boot['parameters']} parameters; inputs: {boot['servo_map']}."
        )
        yield Note(_course(boot))
        if boot["dated_by_arrival"]:
            named = ", ".join(MESSAGE_OF.get(source, source) for source in boot["dated_by_arrival"])
            yield Note(f"Messages without a timestamp of their own, timed by arrival: {named}.")
    yield _messages(contents["messages"])
    if contents["truth"]:
        yield Note(f"The log contains a simulator's true state ({', '.join(contents['truth'])}), which is not used.")


def _log_runs(contents: Mapping[str, Any]) -> Iterator[Part]:
    if not contents["runs"]:
        yield Note(_no_run(contents["boots"]))
    for run in contents["runs"]:
        yield Note(f"{run['name']} (inputs: {run['input_from']})")
        yield from bullets(tuple(_look(look) for look in run["excitation"]))
    yield from bullets(tuple(f"skipped {row['name']}: {row['why']}" for row in contents["left_out"]))


def _no_run(boots: Sequence[Mapping[str, Any]]) -> str:
    is_armed = [on for boot in boots for _, on in boot["armed"]]
    never = " The vehicle was never armed." if is_armed and not any(is_armed) else ""
    return f"The log contains no run to identify from.{never}"


def _course(boot: Mapping[str, Any]) -> str:
    said = [(t, f"{mode}") for t, mode in boot["modes"]]
    said += [(t, "armed" if on else "disarmed") for t, on in boot["armed"]]
    said.sort(key=lambda row: row[0])
    said = [row for i, row in enumerate(said) if i == 0 or row[1] != said[i - 1][1]]
    shown = "; ".join(what if t < AT_ONCE else f"after {format_seconds(t)} {what}" for t, what in said[:CHANGES])
    more = f" and {len(said) - CHANGES} more" if len(said) > CHANGES else ""
    return (
        f"Timeline: {shown}{more}."
        if said
        else ("The log contains no mode and no arming state. The vehicle is taken as armed throughout.")
    )


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
        f"{counted(look['swings'], 'reversal')}, sampled every {format_seconds(look['input_interval'])}; response "
        f"{look['response']}, {quiet} times its noise, sampled every {format_seconds(look['response_interval'])})"
    )


def plan_document(result: PlanResult) -> Document:
    """Return the report of an identification plan: steps with validation, agreement, parameters, final validation and
    doubts.
    """
    step_doubts = (Remark(f"{s.step.name}: {doubt_sentence(d)}", d.grade) for s in result.steps for d in s.fit.doubts)
    return Document(
        title=f"Plan {result.plan.name}: {result.plan.title}",
        doubts=(*remarks(result.doubts), *step_doubts),
        sections=tuple(_plan_sections(result)),
        facts=result.to_dict(),
    )


def _plan_sections(result: PlanResult) -> Iterator[Section]:
    yield Section("steps", f"Plan {result.plan.name}: {result.plan.title}", (_steps(result),), facts=IN_RESULT)
    if result.agreements:
        table = _agreements(result.agreements)
        yield Section("agreements", "Agreement of parameters that several steps identify", (table,), facts=IN_RESULT)
    joint = _plan_parameters(result)
    yield Section("parameters", "Parameters of the joint fit of all runs", (joint,), facts=IN_RESULT)
    if result.final is not None:
        parts = (_final(result), Note(f"Mean fit: {result.final.fit_percent:.1f} %."))
        yield Section("final", "Final validation on held-out runs", parts, facts=IN_RESULT)


def _steps(result: PlanResult) -> Table:
    rows = []
    for s in result.steps:
        checked = UNKNOWN if s.validation is None else f"{s.validation.fit_percent:.1f} %"
        remark = "" if s.unseen else "on the run used for the fit"
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
    return Table(("parameter", "value per step", "chance"), "llr", rows)


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


_VERDICTS = {"meets": "met", "fails": "FAILED", "open": "undecided"}


def sheets_document(sheets: Sequence[Sheet]) -> Document:
    """Return the report of manoeuvring figures: for each manoeuvre its figures, verdict and doubts."""
    return Document(
        title="Ship figures",
        contradictions=tuple(dict.fromkeys(c for sheet in sheets for c in contradictions_in(sheet.doubts))),
        sections=tuple(
            sheet_section(sheet, f"figures-{i}", doubts=True, facts=IN_RESULT)
            for i, sheet in enumerate(sheets, start=1)
        ),
        facts={"schema": 1, "sheets": [sheet.to_dict() for sheet in sheets]},
    )


def sheet_section(sheet: Sheet, slug: str, *, doubts: bool = False, facts: Mapping[str, Any] | None = None) -> Section:
    """Return the section with a manoeuvre's figures and verdict. *doubts*: include the doubts, if they are not shown
    elsewhere.
    """
    verdict = f"{sheet.verdict[0].upper()}{sheet.verdict[1:]}." if sheet.verdict else ""
    about = tuple(bullets(doubt_sentences(sheet.doubts))) if doubts else ()
    diagram = ship_diagram(sheet, slug)
    parts = (
        *(() if diagram is None else (diagram,)),
        sheet_table(sheet),
        Note(verdict),
        Section(f"{slug}-doubts", "Doubts about the figures", about),
    )
    title = sheet.title if sheet.run in sheet.title.split() else f"{sheet.run}: {sheet.title}"
    return Section(slug, title, parts, facts=facts)


def sheet_table(sheet: Sheet) -> Table:
    """Return a table of a manoeuvre's figures with standard errors, the IMO criteria, and whether these are met."""
    return Table(("figure", "value ± std", "unit", "IMO limit", ""), "lrlrl", tuple(_row(f) for f in sheet.figures))


def _row(figure: Figure) -> tuple[str, ...]:
    reading = figure.reading
    unit, factor = ("%", 100.0) if figure.slug == "helm" and reading.unit == "1" else to_people(reading.unit)
    value = reading.value * factor
    shown = format_value(value, reading.std * factor) if math.isfinite(reading.std) else format_number(value)
    if reading.std == 0.0:
        shown = format_number(value)
    if figure.limit is None:
        return figure.name, shown or UNKNOWN, pretty_unit(unit), "", ""
    return figure.name, shown, pretty_unit(unit), format_number(figure.limit.value * factor), _VERDICTS[figure.verdict]


_MEANING = {
    "a_f": "force ahead per squared command",
    "b_f": "force ahead per command",
    "a_b": "force astern per squared command",
    "b_b": "force astern per command",
    "x_f": "command at which thrust ahead starts",
    "x_b": "command at which thrust astern starts",
    "offset": "zero offset of the dynamometer",
}

SHOWN = 5
"""Largest number of rejected thruster structures shown. Project choice."""

_POINTS = 9
"""Number of rows of the compensation table. Project choice."""


def thruster_document(fit: ThrusterFit) -> Document:
    """Return the report of a thruster map: its structure, and the commands for required forces."""
    m = fit.map
    low, high = m.dead_zone
    way = (
        "A higher command gives more thrust ahead."
        if m.direction > 0
        else ("A higher command gives more thrust astern.")
    )
    zone = (
        f"No dead zone. Neutral at {format_number(m.neutral)} {pretty_unit(m.unit)}".rstrip() + "."
        if low == high
        else f"Dead zone from {format_number(low)} to {format_number(high)} {pretty_unit(m.unit)}."
    )
    scatter = _force_left(fit, fit.noise)
    heading = f"Thruster map of {fit.pulls.name}: {fit.structure.name}"
    quality = Note(f"{way} {zone} Standard deviation of one reading: {scatter} N. Fit: {fit.fit_percent:.1f} %.")
    return Document(
        title=heading,
        doubts=remarks(fit.doubts),
        sections=(
            Section("map", heading, (_thruster_parameters(fit), quality), facts=IN_RESULT),
            Section("structure", "Choice of structure", (_candidates(fit),), facts=IN_RESULT),
            Section("commands", "Command for a required force", (_compensation(fit),), facts=IN_RESULT),
        ),
        facts=fit.to_dict(),
    )


def laser_document(found: Calibration) -> Document:
    """Return the report of a calibration of lasers: the curves in the units of Miskovic2010, table 3.1, and errors."""
    module, heading = found.module, "Calibration of two lasers"
    curves = (("port", module.port), ("starboard", module.starboard))
    rows = tuple((side, f"{100.0 * c.a:.4g}", f"{c.b:.4g}", f"{100.0 * c.c:.4g}", f"{c.d:.4g}") for side, c in curves)
    worst = 100.0 * abs(found.errors).max(axis=0)
    rms = 100.0 * (found.errors**2).mean(axis=0) ** 0.5
    errors = tuple((side, f"{rms[i]:.2f}", f"{worst[i]:.2f}") for i, (side, _) in enumerate(curves))
    parts = (
        Note(
            f"{len(found.distances)} distances from {100.0 * module.nearest:g} to {100.0 * module.furthest:g} cm, "
            f"lasers {100.0 * module.apart:g} cm apart. L = a exp(b x) + c exp(d x)."
        ),
        Table(("laser", "a [cm]", "b [1/px]", "c [cm]", "d [1/px]"), "lrrrr", rows),
        Table(("laser", "rms error [cm]", "largest error [cm]"), "lrr", errors),
    )
    sections = (Section("lasers", heading, parts, facts=IN_RESULT),)
    return Document(title=heading, sections=sections, facts=found.to_dict())


def propeller_document(fit: PropellerFit) -> Document:
    """Return the report of a propeller's open-water test."""
    rows = tuple((p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1") for p in fit.parameters.values())
    noise = ", ".join(f"{n} {format_number(s)}" for n, s in fit.noise.items())
    heading = f"Propeller: {fit.kind}"
    parts = (
        Table(("coefficient", "value ± std", "unit"), "lrl", rows),
        Note(f"Standard deviation of one run: {noise}."),
    )
    return Document(
        title=heading,
        doubts=remarks(fit.doubts),
        sections=(Section("propeller", heading, parts, facts=IN_RESULT),),
        facts=fit.to_dict(),
    )


def twin_document(fit: TwinFit) -> Document:
    """Return the report of two equal thrusters, with the commands for some forces and moments at rest."""
    rows = tuple((p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1") for p in fit.parameters.values())
    noise = ", ".join(f"{n} {format_number(s)}" for n, s in fit.noise.items())
    twin, unit = fit.thrusters, fit.thrusters.port.unit
    X, N = 2.0 * twin.port.limits[1], 0.5 * twin.B * (twin.port.limits[1] - twin.starboard.limits[0])
    asked = tuple(twin.commands(x * X, n * N) for x, n in ((1.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.0, 1.0), (0.5, 0.5)))
    commands = tuple(tuple(format_number(v) for v in (c.X, c.N, c.port, c.starboard)) for c in asked)
    heading = "Two thrusters"
    on = "" if unit == "1" else f" [{pretty_unit(unit)}]"
    parts = (
        Table(("coefficient", "value ± std", "unit"), "lrl", rows),
        Note(f"Standard deviation of one row: {noise}."),
        Table(("X [N]", "N [N m]", f"port{on}", f"starboard{on}"), "rrrr", commands),
        Note("Commands at rest. Outside the range, the moment has priority over the force."),
    )
    return Document(
        title=heading,
        doubts=remarks(fit.doubts),
        sections=(Section("thrusters", heading, parts, facts=IN_RESULT),),
        facts=fit.to_dict(),
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
    """Return the residual scatter of a map [N]; for exact data it is only rounding."""
    return format_number(rms if rms > EXACT * max(abs(float(f)) for f in fit.pulls.force) else 0.0)


def _candidates(fit: ThrusterFit) -> Table:
    best = fit.candidates[0].bic
    rows = tuple(
        (c.structure, str(c.free_parameters), _force_left(fit, c.rms), f"{c.bic - best:.1f}")
        for c in fit.candidates[:SHOWN]
    )
    return Table(("structure", "parameters", "rms [N]", "BIC - best"), "lrrr", rows)


def _compensation(fit: ThrusterFit) -> Table:
    low, high = fit.map.limits
    wanted = [low + (high - low) * i / (_POINTS - 1) for i in range(_POINTS)]
    rows = tuple((format_number(f), format_number(float(fit.map.inverse(f)))) for f in wanted)
    return Table(("force, N", f"command, {pretty_unit(fit.map.unit) or '1'}"), "rr", rows)
