"""Whole tunes of the position, calm and in a current: ``python3 -m benchmarks.position``.

Each case runs ``gcs-autotune tune position`` on a simulated craft at ArduPilot's defaults. The current is a fifth of
the cruise speed. Figures of the tool's own proof, means of the seeds: ITAE of the step, its
rise time and overshoot, and the rms and the largest distance under the push. Goal: never worse, that is, no run ends
with gains whose proof is worse.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmarks.results import count, headline

HULLS = ("bluerov2-sway", "blueboat")
CURRENTS = {"bluerov2-sway": 0.2, "blueboat": 0.3}
"""Hull -> current [m/s]: a fifth of WPNAV_SPEED or of the cruise speed."""
WATER = ("calm", "current")
SHOWN = ("itae", "rise", "overshoot", "push", "excursion")


def tuned(hull: str, water: str, seed: int, folder: Path) -> dict[str, Any]:
    """Tune one craft and return its summary."""
    out = folder / f"{hull}-{water}-{seed}"
    moving = f"&effect=steady-current.V_x={0.6 * CURRENTS[hull]:g},V_y={0.8 * CURRENTS[hull]:g}"
    uri = f"sitl:{hull}?seed={seed}{moving if water == 'current' else ''}"
    command = [sys.executable, "-m", "gcs_autotune", "tune", "position", "--connect", uri, "--yes", "--quiet"]
    subprocess.run([*command, "--out", str(out)], check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


def is_worse(summary: dict[str, Any]) -> bool:
    """Return whether the run ended with gains whose step or push is worse than that of the old ones."""
    if summary["ending"] != "kept":
        return bool(summary["differences"])
    before, after = summary["position"]["before"], summary["position"]["after"]
    return any(after[name] > before[name] for name in ("itae", "push") if before[name] and after[name])


def show(hull: str, water: str, runs: Sequence[dict[str, Any]]) -> None:
    """Print the means of each figure before and after."""
    proved = [run["position"] for run in runs if run["position"] and run["position"]["after"]]
    cells = []
    for name in SHOWN:
        pairs = [
            [p[when][name] if p[when][name] is not None else math.nan for p in proved] for when in ("before", "after")
        ]
        old, new = (fmean(values) if values else math.nan for values in pairs)
        cells.append(f"{old:6.3f} {new:6.3f}")
    endings = ", ".join(run["ending"] for run in runs)
    print(f"{hull:14} {water:8} {'  '.join(cells)}  {endings}", flush=True)


def main() -> int:
    """Run all cases; 0 when no run ends worse."""
    parser = argparse.ArgumentParser(prog="benchmarks.position", description=__doc__.splitlines()[0])
    parser.add_argument("hulls", nargs="*", default=list(HULLS), help=f"of {', '.join(HULLS)}; default all")
    parser.add_argument("--water", nargs="*", default=list(WATER), choices=WATER)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    print(f"{'hull':14} {'water':8} {'  '.join(f'{name:>6} after ' for name in SHOWN)}")
    summaries: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="position-") as folder:
        for hull, water in itertools.product(options.hulls, options.water):
            runs = [tuned(hull, water, seed, Path(folder)) for seed in range(1, options.seeds + 1)]
            show(hull, water, runs)
            summaries += runs
    fine = [run for run in summaries if not is_worse(run)]
    kept = [run for run in summaries if run["ending"] == "kept"]
    figures = [
        count("position tunes that end no worse than they began", len(fine), len(summaries), least=1.0),
        count("position tunes whose new gains were kept", len(kept), len(summaries)),
    ]
    headline("position", "tunes of the position in simulated water", figures)
    return 0 if all(figure.met is not False for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
