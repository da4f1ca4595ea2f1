"""Check whether published tables of identified parameters describe one craft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gcs_autotune.diagnose import ParameterTable, TableFinding, diagnose_table

__all__ = ["lines_of", "tables_of"]


def tables_of(published: Mapping[str, Any]) -> list[ParameterTable]:
    """Return tables 7.9, 7.10 and 7.11 of Miskovic2010; inputs in 1e-2 N m, inertia and drag in the units printed."""
    found = []
    for name, key, rate in (
        ("VideoRay, IS-O", "videoray_iso_table_7_9", ("X_m_deg", "omega_rad_s")),
        ("AutoMarine, IS-O", "automarine_iso_table_7_11", ("X_m_deg", "omega_rad_s")),
        ("AutoMarine, steps", "automarine_step_table_7_10", ("k_ss_deg_s",)),
    ):
        table = published[key]
        rows = np.array(table["rows"], dtype=float)
        columns = {c: rows[:, i] for i, c in enumerate(table["columns"])}
        found.append(
            ParameterTable(
                name,
                columns["N_1e-2Nm"],
                columns["alpha_r_1e-4Nms2_per_deg"],
                columns["beta_rr_1e-6Nms2_per_deg2"],
                columns["beta_r_1e-4Nms_per_deg"],
                np.abs(np.prod([columns[c] for c in rate], axis=0)),
            )
        )
    return found


def lines_of(table: ParameterTable) -> list[str]:
    """Return the findings on one table, without single levels and rows that are consistent."""
    findings = diagnose_table(table)
    quiet = [f for f in findings if f.question == "level" and f.answer != "yes"]
    lines = [_line(f) for f in findings if f not in quiet]
    undecided = sum(f.answer == "cannot tell" for f in quiet)
    lines.append(f"  {len(quiet)} other level questions: {len(quiet) - undecided} 'no', {undecided} undecided")
    return [f"{table.name} ({len(table.level)} rows)", *lines, *_readings(findings)]


def _line(f: TableFinding) -> str:
    low, high = f.ci95
    size = (
        f"{f.share:6.2f} [{low:.2f}, {high:.2f}]"
        if f.question == "drag-order"
        else f"{100 * f.share:+5.0f} % [{100 * low:+.0f}, {100 * high:+.0f}]"
    )
    return f"  {f.question:15}{f.quantity:12}{f.where:27}{f.answer:12}{size:22} p {f.p:.2g}"


def _readings(findings: Sequence[TableFinding]) -> list[str]:
    readings = dict.fromkeys(
        f.reading for f in findings if f.reading and (f.answer == "yes" or f.question == "drag-order")
    )
    return [f"  -> {reading}" for reading in readings]
