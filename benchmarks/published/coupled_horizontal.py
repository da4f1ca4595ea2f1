"""Miskovic2007: the VideoRay's horizontal model, tables I and II, from S-manoeuvres measured by a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.published.section import Row, Section, rows_of
from benchmarks.published.water import DOFS, HORIZONTAL_INPUTS, camera_run
from gcs_autotune.identify import fit
from gcs_autotune.models.coupled import CoupledModel, Form

__all__ = ["videoray_horizontal"]

GOAL = 3.0
"""[%]. Six runs of 40 s at 10 Hz with 3 mm and 0.01 rad of noise; the paper states no noise."""


def videoray_horizontal(tables: Mapping[str, Any]) -> list[Section]:
    """Return fits with independent couplings (table I) and with related ones (table II) of runs of the final model."""
    table = tables["videoray_coupled_seed_000"]
    runs = [camera_run(i, 1.5 + 0.2 * i, 0.05 + 0.01 * i) for i in range(6)]
    tied = Form("tied", "", DOFS, ("m", "N_rdot", "X_u", "Y_v", "N_r"), {}, HORIZONTAL_INPUTS)
    names = ("X_udot", "N_rdot", "X_u", "Y_v", "N_r", "X_vr", "Y_ur", "N_uv")
    untied = Form("untied", "", DOFS, names, {"Y_vdot": -1.0}, HORIZONTAL_INPUTS, coriolis=False)
    model = fit(runs, tied, "least-squares").model
    assert isinstance(model, CoupledModel)
    final = rows_of("M", ("surge", "sway", "yaw"), table["mass_matrix_diag"], list(np.diag(model.inertia)))
    final += rows_of("D", ("surge", "sway", "yaw"), table["damping_diag"], list(np.diag(model.linear_damping)))
    loose = fit(runs, untied, "least-squares").parameters
    p = {n: q.value for n, q in loose.items()}
    ours = {
        "alpha1": p["N_r"] / -p["N_rdot"],
        "alpha2": 1.0 / -p["N_rdot"],
        "beta1": p["X_u"] / -p["X_udot"],
        "beta2": 1.0 / -p["X_udot"],
        "beta3": p["X_vr"] / -p["X_udot"],
        "gamma1": p["Y_v"],
        "gamma3": p["Y_ur"],
    }
    return [
        Section("Miskovic2007: final matrices, least squares", "simulated here, camera only", tuple(final), GOAL),
        _table(table, "II", ours, GOAL, "simulated here, couplings free; the truth flown is table II's"),
        _table(table, "I", ours, float("inf"), "the same estimates beside table I, whose couplings are unphysical"),
    ]


def _table(
    table: Mapping[str, Mapping[str, float]], number: str, ours: Mapping[str, float], goal: float, basis: str
) -> Section:
    rows: list[Row] = []
    for motion in ("yaw", "surge", "sway"):
        printed = table[f"{motion}_table_{number}"]
        rows += [Row(f"{motion} {n}", v, ours[n]) for n, v in printed.items() if n in ours]
    return Section(f"Miskovic2007: table {number}, couplings free", basis, tuple(rows), goal)
