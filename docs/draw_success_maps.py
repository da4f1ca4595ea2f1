"""Draw the success maps of docs/study.md from the rows of the study benchmarks/studies/thesis_7_5.toml:

PYTHONPATH=. python3 docs/draw_success_maps.py runs/studies/thesis_7_5-... docs/pictures/thesis-7-5.svg

Maps of `study report`: valid experiments of each day, and pairs of experiments whose decision is the linear model.
"""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from benchmarks.thesis_7_5 import decisions
from gcs_autotune.report import SuccessMap, draw_success_map
from gcs_autotune.study import open_study, success_map

VALID = "valid experiments"
PAIRS = {
    "pairs decided for the linear model, no margin": False,
    "all pairs, of two speeds by drag over inertia": True,
}
"""Figures of the benchmark that the maps show; their names there begin with the day."""
DESCRIPTION = "{http://purl.org/dc/elements/1.1/}description"
"""Entry of the picture that holds the counts it was drawn from."""


def maps_of(rows: pd.DataFrame) -> dict[str, SuccessMap]:
    """Return the maps of both days by the name of the benchmark's figure."""
    found = {}
    for number, (_, day) in enumerate(rows.groupby("effect", sort=False), 1):
        own = day.rename(columns={"argument.C": "relay output C [deg]", "argument.x_a": "hysteresis [deg]"})
        axes = ("relay output C [deg]", "hysteresis [deg]")
        found[f"day {number}: {VALID}"] = success_map(axes, own, own["valid"].to_numpy() == 1)
        for name, over_inertia in PAIRS.items():
            pairs, right = _pairs(day[day["valid"] == 1].to_dict("records"), over_inertia)
            found[f"day {number}: {name}"] = success_map(tuple(pairs.columns), pairs, right)
    return found


def _pairs(valid: list[dict[Any, Any]], over_inertia: bool) -> tuple[pd.DataFrame, np.ndarray]:
    """Return both speeds of every pair with different relay outputs, the smaller first, and whether it is right."""
    speeds, right = [], []
    for a, b in combinations(valid, 2):
        if a["argument.C"] != b["argument.C"]:
            speeds.append(sorted((a["argument.n2"], b["argument.n2"])))
            right.append(decisions([a, b], "none", over_inertia=over_inertia) == (1, 0, 0))
    names = ["n² of the slower [V²]", "n² of the faster [V²]"]
    return pd.DataFrame(speeds, columns=names, dtype=int), np.array(right)


def counts_of(maps: Mapping[str, SuccessMap]) -> dict[str, list[int]]:
    """Return (successes, cases) of each map."""
    return {name: [sum(map(sum, m.hits)), sum(map(sum, m.totals))] for name, m in maps.items()}


def drawn_from(picture: Path) -> dict[str, list[int]]:
    """Return the counts that *picture* was drawn from."""
    text = next(ET.parse(picture).getroot().iter(DESCRIPTION)).text
    return dict(json.loads(text or "{}"))


def main(folder: Path, picture: Path) -> None:
    """Draw the maps of the study in *folder* into a file."""
    mpl.rcParams.update({"svg.hashsalt": "success", "svg.fonttype": "none", "font.size": 8})
    maps = maps_of(open_study(folder))
    figure, grid = plt.subplots(2, 3, figsize=(10.0, 5.2), layout="constrained")
    for axes, (name, found) in zip(grid.flat, maps.items(), strict=True):
        image = draw_success_map(found, axes)
        axes.set_title(name.replace(", ", ",\n"), fontsize=8)
    figure.colorbar(image, ax=grid, label="success", shrink=0.6)
    text = {"Description": json.dumps(counts_of(maps)), "Date": None}
    figure.savefig(picture, metadata=text)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
