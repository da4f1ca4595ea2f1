"""Draw the README's picture from the run directory of a real tune:

python3 docs/draw_picture.py runs/... docs/pictures/tune.png
python3 docs/draw_picture.py --check runs/... docs/pictures/tune.png     # is it still what a tune comes to?
"""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

COLOURS = {"before": "#d55e00", "after": "#0072b2"}
AFTER_STEP = 30.0
"""How much of the step is drawn [s]."""


KEY, WITHIN = "gains", 0.05
"""Entry of the picture that holds the new gains of its run; share by which another run's may differ."""


def drawn_from(picture: Path) -> dict[str, float]:
    """Return the new gains of the run that *picture* was drawn from."""
    with Image.open(picture) as image:
        return dict(json.loads(image.info.get(KEY, "{}")))


def new_gains(run: Path) -> dict[str, float]:
    """Return the new gains of *run*."""
    return {c["parameter"]: c["new"] for c in json.loads((run / "gains.json").read_text())["changes"]}


def differs(run: Path, picture: Path) -> list[str]:
    """Return the gains of *run* that are not those of *picture*."""
    now, then = new_gains(run), drawn_from(picture)
    names = sorted(now.keys() | then.keys())
    return [n for n in names if not math.isclose(now.get(n, math.nan), then.get(n, math.nan), rel_tol=WITHIN)]


def step_in(run: Path, which: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return heading times (n,) and headings (n,) [deg], output times (m,) and outputs (m,) [% of full], about the
    step's beginning, and its size [deg].
    """
    [path] = run.glob(f"trials/*step-{which}.csv")
    marks = json.loads(path.with_suffix(".json").read_text())["marks"]
    targets = {m["detail"]["phase"]: (m["t"], m["detail"]["value"]) for m in marks if m["kind"] == "target"}
    (_, reference), (begin, wanted) = targets["hold"], targets["step"]
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    t, psi = np.array([(float(r["t[s]"]), float(r["psi[rad]"])) for r in rows if r["psi[rad]"]]).T
    output_t, output = np.array([(float(r["t[s]"]), float(r["N[1]"])) for r in rows if r["N[1]"]]).T
    heading = np.degrees(np.unwrap(psi))
    heading -= 360.0 * round((np.interp(begin, t, heading) - math.degrees(reference)) / 360.0)
    return (
        t - begin,
        heading - math.degrees(reference),
        output_t - begin,
        100.0 * output,
        math.degrees(wanted - reference),
    )


def figure_of(run: Path) -> Figure:
    """Return the picture: heading and actuator of the step before and after, and what was written."""
    summary = json.loads((run / "gains.json").read_text())
    figure, (top, low) = plt.subplots(
        2, 1, figsize=(8.0, 4.2), dpi=110, sharex=True, height_ratios=(2.4, 1.0), layout="constrained"
    )
    for which, words in (("before", "gains as found"), ("after", "gains proved by this tool")):
        t, heading, output_t, output, size = step_in(run, which)
        shown, driven = (t > -5.0) & (t < AFTER_STEP), (output_t > -5.0) & (output_t < AFTER_STEP)
        top.plot(t[shown], heading[shown], color=COLOURS[which], label=words)
        low.plot(output_t[driven], output[driven], color=COLOURS[which], linewidth=0.9)
    top.step(
        [-5.0, 0.0, AFTER_STEP],
        [0.0, size, size],
        where="post",
        color="#555555",
        linestyle="--",
        linewidth=1.0,
        label="wanted",
    )
    top.set_ylabel("heading from start [°]")
    low.set_ylabel("steering [% of full]")
    low.set_xlabel("time from the step [s]")
    changes = ", ".join(f"{c['parameter']} {c['old']:.3g} → {c['new']:.3g}" for c in summary["changes"])
    top.set_title(f"The same {size:.0f}° step, before and after `gcs-autotune tune heading`\n{changes}", fontsize=9)
    top.legend(frameon=False, fontsize=9)
    for axes in (top, low):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    return figure


def main(run: Path, picture: Path) -> None:
    """Draw the picture of *run* into a file."""
    figure = figure_of(run)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, metadata={KEY: json.dumps(new_gains(run))})


if __name__ == "__main__":
    if sys.argv[1] == "--check":
        other = differs(Path(sys.argv[2]), Path(sys.argv[3]))
        sys.exit(f"the picture is of other gains: {', '.join(other)}; draw it again" if other else 0)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
