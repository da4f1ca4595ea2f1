"""Thruster maps and propellers for the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType

from gcs_autotune.report.numbers import format_number, format_value, pretty_unit
from gcs_autotune.report.tables import Table
from gcs_autotune.report.terminal import doubts_shown, grid, paragraph, title
from gcs_autotune.report.wording import doubt_sentence
from gcs_autotune.thrusters import PropellerFit, ThrusterFit

__all__ = ["propeller_summary", "thruster_summary"]

_MEANING = {
    "a_f": "ahead, per command squared",
    "b_f": "ahead, per command",
    "a_b": "astern, per command squared",
    "b_b": "astern, per command",
    "x_f": "pulls ahead from here on",
    "x_b": "pulls astern from here on",
    "offset": "zero of the dynamometer",
}

SHOWN = 5
"""Rival structures shown."""

_POINTS = 9
"""Rows of the compensation table."""


def thruster_summary(fit: ThrusterFit) -> Group:
    """Return what ``thrusters`` shows: the map, how its structure was decided, and the commands for given forces."""
    m = fit.map
    low, high = m.dead_zone
    way = "A higher command pulls ahead." if m.direction > 0 else "A higher command pulls astern."
    zone = (
        f"No dead zone; neutral at {format_number(m.neutral)} {m.unit}."
        if low == high
        else f"Dead zone from {format_number(low)} to {format_number(high)} {pretty_unit(m.unit)}."
    )
    parts: list[RenderableType] = [
        title(f"Thruster map of {fit.pulls.name}: {fit.structure.name}"),
        grid(_parameters(fit)),
        paragraph(f"{way} {zone} One pull scatters by {format_number(fit.noise)} N; fit {fit.fit_percent:.1f} %."),
        title("Which structure"),
        grid(_candidates(fit)),
        title("Command for a wanted force"),
        grid(_compensation(fit)),
        *doubts_shown(doubt_sentence(d) for d in fit.doubts),
    ]
    return Group(*parts)


def propeller_summary(fit: PropellerFit) -> Group:
    """Return what ``thrusters`` shows for an open-water test."""
    rows = tuple((p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1") for p in fit.parameters.values())
    noise = ", ".join(f"{n} {format_number(s)}" for n, s in fit.noise.items())
    return Group(
        title(f"Propeller: {fit.kind}"),
        grid(Table(("coefficient", "value ± std", "unit"), "lrl", rows)),
        paragraph(f"Scatter of one run: {noise}."),
        *doubts_shown(doubt_sentence(d) for d in fit.doubts),
    )


def _parameters(fit: ThrusterFit) -> Table:
    turned = {"x_f": fit.map.direction, "x_b": fit.map.direction}
    rows = tuple(
        (p.name, format_value(turned.get(p.name, 1) * p.value, p.std), pretty_unit(p.unit) or "1", _MEANING[p.name])
        for p in fit.parameters.values()
        if p.status != "absent" or p.name in ("x_f", "x_b")
    )
    return Table(("parameter", "value ± std", "unit", "meaning"), "lrll", rows)


def _candidates(fit: ThrusterFit) -> Table:
    best = fit.candidates[0].bic
    rows = tuple(
        (c.structure, str(c.free_parameters), format_number(c.rms), f"{c.bic - best:.1f}")
        for c in fit.candidates[:SHOWN]
    )
    return Table(("structure", "free", "rms, N", "BIC more"), "lrrr", rows)


def _compensation(fit: ThrusterFit) -> Table:
    low, high = fit.map.limits
    wanted = [low + (high - low) * i / (_POINTS - 1) for i in range(_POINTS)]
    rows = tuple((format_number(f), format_number(float(fit.map.inverse(f)))) for f in wanted)
    return Table(("force, N", f"command, {pretty_unit(fit.map.unit) or '1'}"), "rr", rows)
