"""What is in a log, for the terminal: from the plain data of ``gcs_autotune.logs.survey``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType

from gcs_autotune.report.numbers import format_number, format_seconds
from gcs_autotune.report.tables import Table
from gcs_autotune.report.terminal import bullet, doubts_shown, grid, paragraph, title

__all__ = ["log_summary"]

MESSAGES = 12
"""Kinds of messages shown, the most frequent of those that are read."""
CHANGES = 8
"""Changes of mode or arming shown of each boot."""


def log_summary(told: Mapping[str, Any]) -> Group:
    """Return what ``logs list`` shows of one log."""
    counts = told["counts"]
    damage = f", {counts['damaged']} damaged and skipped" if counts.get("damaged") else ""
    stamps = f", {counts['damaged_stamps']} damaged stamps" if counts.get("damaged_stamps") else ""
    cut = ", cut off in the middle of a message" if counts.get("truncated") else ""
    parts: list[RenderableType] = [
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
            parts.append(paragraph(f"Dated by arrival (no stamp of their own): {', '.join(boot['dated_by_arrival'])}."))
    parts.append(grid(_messages(told["messages"])))
    if told["truth"]:
        parts.append(paragraph(f"A simulator's own truth ({', '.join(told['truth'])}) is in it and is not used."))
    parts.append(title("Runs") if told["runs"] else paragraph("No run to identify from."))
    for run in told["runs"]:
        parts.append(paragraph(f"{run['name']} (inputs: {run['input_from']})"))
        parts += [bullet(_look(look)) for look in run["excitation"]]
    parts += [bullet(f"left out: {row['name']}: {row['why']}") for row in told["left_out"]]
    if told["notes"]:
        parts += doubts_shown(f"{cause}: {cure}" for _, cause, cure in told["notes"])
    return Group(*parts)


def _course(boot: Mapping[str, Any]) -> str:
    said = [(t, f"{mode}") for t, mode in boot["modes"]]
    said += [(t, "armed" if on else "disarmed") for t, on in boot["armed"]]
    said.sort(key=lambda row: row[0])
    said = [row for i, row in enumerate(said) if i == 0 or row[1] != said[i - 1][1]]
    shown = "; ".join(f"{format_seconds(t)} {what}" for t, what in said[:CHANGES])
    more = f" and {len(said) - CHANGES} more" if len(said) > CHANGES else ""
    return f"Course: {shown}{more}." if said else "It tells neither mode nor arming: it counts as armed throughout."


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
        f"{look['dof']}: {look['verdict']}{why} (input {look['input']} {format_number(look['input_range'], 2)} wide, "
        f"{look['swings']} swings, every {format_seconds(look['input_interval'])}; response {look['response']} "
        f"{quiet} times its noise, every {format_seconds(look['response_interval'])})"
    )
