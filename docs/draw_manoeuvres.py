"""Draw zig-zag, circle and steps of a vehicle from the run directory of a flight of `docs/three.toml`:

gcs-autotune fly docs/three.toml --connect "sitl:charlie-sway?seed=1" --yes --out runs/charlie-sway
python3 docs/draw_manoeuvres.py runs/charlie-sway docs/pictures/charlie-sway.svg
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

BLUE, RED, GREY = "#0072b2", "#d55e00", "#888888"
POINTS = 200
"""Most points of a line: the picture is small."""

Signals = dict[str, tuple[np.ndarray, np.ndarray]]


def flown(run: Path, name: str) -> Signals:
    """Return column -> times [s] from the beginning and values of the manoeuvre *name*."""
    [path] = run.glob(f"trials/*-{name}.csv")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    begin = float(rows[0]["t[s]"])
    found = {}
    for column in rows[0]:
        pairs = [(float(r["t[s]"]) - begin, float(r[column])) for r in rows if r[column]]
        if pairs and column != "t[s]":
            t, values = np.array(pairs).T
            found[column.partition("[")[0]] = (t, values) if column.startswith("N") else thinned(t, values)
    return found


def thinned(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return :data:`POINTS` of them at most."""
    step = -(-len(t) // POINTS)
    return t[::step], values[::step]


def main(run: Path, picture: Path) -> None:
    """Draw the three panels."""
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "manoeuvres", "font.size": 8.0})
    figure, (zigzag, circle, steps) = plt.subplots(1, 3, figsize=(9.0, 2.6), layout="constrained")
    seen = flown(run, "zig-zag")
    t, psi = seen["psi"]
    heading = np.degrees(np.unwrap(psi))
    zigzag.plot(t, heading - heading[0], color=BLUE, lw=1.0, label="heading [°]")
    t, N = seen["N"]
    changes = np.flatnonzero(np.diff(N, prepend=np.nan, append=np.nan))[: 4 * POINTS]
    t, N = t[np.minimum(changes, len(t) - 1)], N[np.minimum(changes, len(N) - 1)]
    zigzag.step(t, 100.0 * N / 5.0, where="post", color=GREY, lw=0.7, label="steering [5 % of full]")
    zigzag.set_title("zig-zag")
    zigzag.set_xlabel("t [s]")
    zigzag.legend(frameon=False, fontsize=6.5)
    seen = flown(run, "turning-circle")
    (t, x), (t_y, y) = seen["x"], seen["y"]
    circle.plot(np.interp(t, t_y, y) - y[0], x - x[0], color=BLUE, lw=1.0)
    circle.set_aspect("equal", adjustable="datalim")
    circle.set_title("turning circle")
    circle.set_xlabel("east [m]")
    circle.set_ylabel("north [m]")
    seen = flown(run, "steps")
    t, r = seen["r"]
    steps.plot(t, np.degrees(r), color=BLUE, lw=1.0, label="r [°/s]")
    if "v" in seen:
        t, v = seen["v"]
        steps.plot(t, 100.0 * v, color=RED, lw=0.8, label="v [cm/s]")
    steps.set_title("steps of the yaw moment")
    steps.set_xlabel("t [s]")
    steps.legend(frameon=False, fontsize=6.5)
    for axes in (zigzag, circle, steps):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
