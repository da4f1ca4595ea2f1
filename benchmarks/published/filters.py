"""ZhaoUSV, table 3: the paper's filter and least squares compared with ours, at known noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks import ekf_vs_ls
from benchmarks.published.section import Row, Section

__all__ = ["ekf_vs_least_squares"]

SEEDS, NOISE = 1, 0.001


def ekf_vs_least_squares(tables: Mapping[str, Any]) -> list[Section]:
    """Average error over the coefficients; ours must not exceed the paper's filter (the better of its two starts)."""
    printed = tables["ekf_vs_ls_seed_001_table_3_percent"]
    average = {name: float(printed[name][-1]) for name in ("EKF1", "EKF2", "LS1", "LS2")}
    filters, squares = min(average["EKF1"], average["EKF2"]), min(average["LS1"], average["LS2"])
    sections = []
    for motion in ("circle", "zigzag"):
        found = ekf_vs_ls.table(motion, SEEDS, NOISE)
        rows = [
            Row(title, squares if title.startswith("LS") else filters, float(np.mean(errors)), _counts(title))
            for title, errors in found.items()
        ]
        basis = f"simulated here: {motion}, {SEEDS} seed, noise {NOISE:g} m/s and rad/s; mean error [%]"
        sections.append(Section(f"ZhaoUSV, table 3: {motion}", basis, tuple(rows), below=True))
    return sections


def _counts(title: str) -> bool:
    return title in ("smoother", "prediction-error", "output-error")
