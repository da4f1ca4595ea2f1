"""Miskovic2010, tables 7.9 and 7.11 from their readings, and the decisions (7.1)-(7.2) over all pairs of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.published.section import Row, Section, rows_of
from gcs_autotune.identify.relay.iso import decide, estimate
from gcs_autotune.identify.result import IsoEstimate, LimitCycle

__all__ = ["automarine", "videoray"]

GOAL = 0.8
"""[%], the goal stated for both tables."""

DECISIONS = {"none": (74, 9, 0), "sigma": (63, 4, 16), "sigma+5": (49, 0, 34), "sigma+10": (30, 0, 53)}
"""Miskovic2010, figure 7.3: pairs decided correctly, falsely, not at all, by margin."""

RIGHT_WITHOUT_MARGIN = 63.0
"""[%], Miskovic2010, 7.4.2 on figure 7.11: "about 63 %" of the AutoMarine pairs."""

_NAMES = ("alpha_r", "beta_r", "beta_rr")


def reading(C: float, x_a_star: float, X_m: float, omega: float, x_0: float = 0.0) -> LimitCycle:
    """Return a limit cycle as the tables print it, symmetric in time."""
    half = float(np.pi / omega)
    return LimitCycle(C, x_a_star, x_a_star, X_m, x_0, omega, half, half, 5, 0.0, True)


def _rows(label: str, found: IsoEstimate, printed: Sequence[float]) -> list[Row]:
    return rows_of(label, _NAMES, printed, (found.alpha * 1e4, found.beta * 1e4, found.beta_quadratic * 1e6))


def videoray(tables: Mapping[str, Any]) -> list[Section]:
    """Table 7.9 (inputs N, x_a*, X_m, omega, x_0 as printed) and figure 7.3."""
    table = tables["videoray_iso_table_7_9"]
    rows, pairs = [], []
    for i, (N, x_s, X_m, omega, x_0, *printed) in enumerate(table["rows"], 1):
        cycle = reading(N * 1e-2, x_s, X_m, omega, x_0)
        rows += _rows(f"{i:2d} N {N}", estimate(cycle, table["total_delay_s"]), printed)
        pairs.append((N, _as_printed(cycle, printed)))
    counted = []
    for margin, published in DECISIONS.items():
        counted += rows_of(margin, ("correct", "false", "undecided"), published, _counts(pairs, margin))
    return [
        Section("Table 7.9: VideoRay, IS-O, 15 experiments", "computed from the printed readings", tuple(rows), GOAL),
        Section("Figure 7.3: VideoRay, decisions", "computed from the printed parameters", tuple(counted), exact=True),
    ]


def automarine(tables: Mapping[str, Any]) -> list[Section]:
    """Table 7.11 (no delay, no bias) and the share of right decisions without a margin."""
    rows, pairs = [], []
    for i, (N, X_m, omega, x_s, _, *printed) in enumerate(tables["automarine_iso_table_7_11"]["rows"], 1):
        cycle = reading(N * 1e-2, x_s, X_m, omega)
        rows += _rows(f"{i:2d} N {N}", estimate(cycle), printed)
        pairs.append((N, _as_printed(cycle, printed)))
    right, wrong, undecided = _counts(pairs, "none")
    share = Row("right without a margin [%]", RIGHT_WITHOUT_MARGIN, 100.0 * right / (right + wrong + undecided))
    return [
        Section(
            "Table 7.11: AutoMarine, IS-O, 32 experiments", "computed from the printed readings", tuple(rows), GOAL
        ),
        Section("Figure 7.11: AutoMarine, decisions", "computed from the printed parameters", (share,), 3.0),
    ]


def _as_printed(cycle: LimitCycle, printed: Sequence[float]) -> IsoEstimate:
    return IsoEstimate(cycle, *printed, 0.0, 0.0)


def _counts(pairs: Sequence[tuple[float, IsoEstimate]], margin: str) -> tuple[int, int, int]:
    verdicts = Counter(decide(a, b, margin).verdict for (N, a), (M, b) in combinations(pairs, 2) if N != M)
    return verdicts["nonlinear"], verdicts["linear"], verdicts["undecided"]
