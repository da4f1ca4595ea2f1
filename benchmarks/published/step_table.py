"""Miskovic2010, table 7.10: AutoMarine's step responses, from the printed steady rates and velocity errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.published.section import Row, Section, rows_of
from gcs_autotune.identify.open_loop.step_table import row_from_table, unevenness_doubts

__all__ = ["automarine_steps"]

GOAL = 0.8
"""[%]. Inputs are printed to 0.01e-2 N m, so rows of small N carry a rounding of up to 1.5 %; see :func:`_rounding`."""

MEANS = {"beta_rr": 22.55, "alpha_r": 7.11}
"""Printed means of the table, in its units."""


def _rounding(N: float) -> float:
    """Return by how much [%] half a unit of the last printed digit of N moves every figure of its row."""
    return 0.5 / abs(N)


def automarine_steps(tables: Mapping[str, Any]) -> list[Section]:
    """(4.43), (4.47), (4.48) row by row, the means, and what is uneven about them."""
    rows, found = [], []
    for N, k_ss, eps_v, *printed in tables["automarine_step_table_7_10"]["rows"]:
        row = row_from_table(N * 1e-2, k_ss, math.copysign(eps_v, N))
        found.append(row)
        ours = (row.beta * 1e4, row.beta_quadratic * 1e6, row.alpha_nonlinear * 1e4)
        exact = _rounding(N) < GOAL
        for one in rows_of(f"N {N:5.2f}", ("beta_r", "beta_rr", "alpha_r"), printed, ours):
            rows.append(Row(one.name, one.published, one.ours, exact))
    means = (np.mean([r.beta_quadratic for r in found]) * 1e6, np.mean([r.alpha_nonlinear for r in found]) * 1e4)
    rows += rows_of("mean", list(MEANS), list(MEANS.values()), [float(m) for m in means])
    uneven = ", ".join(d.slug for d in unevenness_doubts(found, "nonlinear"))
    return [
        Section(
            "Table 7.10: AutoMarine, steps, 24 experiments",
            "computed from the printed readings; rows of |N| < 0.63 are rounded too coarsely to count. "
            f"Doubts raised: {uneven}",
            tuple(rows),
            GOAL,
        )
    ]
