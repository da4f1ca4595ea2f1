"""Figures of the two shipped studies: boats of 0.5 to 8 m, and which effect can be named at which size and noise.

Run a study, which a stopped run continues, then read its folder::

    gcs-autotune study run benchmarks/studies/boats.toml --out runs/boats
    gcs-autotune study run benchmarks/studies/names_under_noise.toml --out runs/names
    python3 -m benchmarks.shipped_studies boats runs/boats
    python3 -m benchmarks.shipped_studies names runs/names

The figures are recorded only from the checkout that the study ran on. A case that failed counts as a miss.
`study report DIR` shows every failure.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.results import RECORD, Figure, count, headline
from gcs_autotune.study import open_study
from gcs_autotune.study.build import build_of


def boats(table: Any) -> list[Figure]:
    """Return how many tunes are kept, and how the error of the heading step changes from ArduPilot's defaults."""
    done = table[table["status"] == "done"]
    ratio = done["metrics.after.itae"] / done["metrics.before.itae"]
    figures = [count("tunes kept", int((done["kept"] == 1).sum()), len(table), least=0.95)]
    figures += [
        Figure(f"error of the step against the defaults, {name}", float(ratio.quantile(q)))
        for name, q in (("median", 0.5), ("95 % of boats below", 0.95), ("largest", 1.0))
    ]
    for name, when in (("defaults", "before"), ("tuned", "after")):
        median = 100.0 * float(done[f"metrics.{when}.overshoot"].median())
        figures.append(Figure(f"overshoot of the step, {name}, median", median, "%"))
    return figures


def names(table: Any) -> list[Figure]:
    """Return how often each effect is the first cause, by noise; of a craft without one, how often none is reported."""
    reported = table["causes.0"].fillna("none")
    true = table["effect"].str.partition(".")[0]
    right = (reported == true) & (table["status"] == "done")
    figures = [count("right first cause, or none without an effect", int(right.sum()), len(table))]
    for (effect, noise), group in right.groupby([table["effect"], table["vehicle.sensors.gyro_noise"]], sort=False):
        figures.append(count(f"{effect}, gyro noise {noise:g} rad/s", int(group.sum()), len(group)))
    return figures


STUDIES: Mapping[str, tuple[Any, str]] = {
    "boats": (boats, "128 boats of 0.5 to 8 m: tune heading against ArduPilot's defaults"),
    "names": (names, "an effect hidden in a multisine of an ROV: reported, at two noises of the gyro"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.shipped_studies")
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("folder", type=Path, help="results folder of the study")
    args = parser.parse_args(argv)
    figures, measures = STUDIES[args.study]
    ran = json.loads((args.folder / "study.json").read_text(encoding="utf-8"))["build"]["version"]
    if os.environ.get(RECORD) and ran != build_of().version:
        parser.error(f"the study ran on {ran}, this is {build_of().version}. Use the checkout that it ran on")
    headline(f"shipped_studies-{args.study}", measures, figures(open_study(args.folder)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
