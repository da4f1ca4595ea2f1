"""Draw the README's picture from the run directory of a tune:

python3 docs/draw_picture.py runs/... docs/pictures/tune.png
python3 docs/draw_picture.py --check runs/... docs/pictures/tune.png     # does a tune still give these gains?
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
LEAD = 2.0
"""Seconds drawn before a command."""


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


def legs_in(run: Path, which: str) -> list[dict[str, np.ndarray | float]]:
    """Return the step and the step back of a trial, each from its command on.

    ``t``, ``heading`` [s, deg], ``output_t``, ``output`` [s, % of full], ``target`` [deg] and ``lasted`` [s]; headings
    are counted from where the step began.
    """
    [path] = run.glob(f"trials/*step-{which}.csv")
    told = json.loads(path.with_suffix(".json").read_text())
    targets = [(m["t"], math.degrees(m["detail"]["value"])) for m in told["marks"] if m["kind"] == "target"]
    base = targets[0][1]
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    t, psi = np.array([(float(r["t[s]"]), float(r["psi[rad]"])) for r in rows if r["psi[rad]"]]).T
    output_t, output = np.array([(float(r["t[s]"]), float(r["N[1]"])) for r in rows if r["N[1]"]]).T
    heading = np.degrees(np.unwrap(psi))
    heading -= 360.0 * round((np.interp(targets[1][0], t, heading) - base) / 360.0)
    return [
        {
            "t": t - begin,
            "heading": heading - base,
            "output_t": output_t - begin,
            "output": 100.0 * output,
            "from": targets[i][1] - base,
            "target": target - base,
            "lasted": lasted,
        }
        for i, ((begin, target), lasted) in enumerate(zip(targets[1:], told["meta"]["lasted"], strict=False))
    ]


def figure_of(run: Path) -> Figure:
    """Return the figure: heading and actuator of step and step back, before and after, as far as both were flown."""
    summary = json.loads((run / "gains.json").read_text())
    before, after = (legs_in(run, which) for which in ("before", "after"))
    figure, grid = plt.subplots(
        2, 2, figsize=(8.0, 4.2), dpi=110, sharex="col", sharey="row", height_ratios=(2.4, 1.0), layout="constrained"
    )
    legends = ("gains as found", "gains proved by this tool")
    for k, (top, low) in enumerate(grid.T):
        until = min(before[k]["lasted"], after[k]["lasted"])
        for leg, which, words in zip((before[k], after[k]), ("before", "after"), legends, strict=True):
            for axes, times, values, width in (
                (top, leg["t"], leg["heading"], 1.5),
                (low, leg["output_t"], leg["output"], 0.9),
            ):
                shown = (times > -LEAD) & (times < until)
                axes.plot(times[shown], values[shown], color=COLOURS[which], linewidth=width, label=words)
        begin, end = after[k]["from"], after[k]["target"]
        wanted = {"where": "post", "color": "#555555", "linestyle": "--", "linewidth": 1.0, "label": "target"}
        top.step([-LEAD, 0.0, until], [begin, end, end], **wanted)
        top.set_title("step back" if k else "step", fontsize=9)
        low.set_xlabel("time from the command [s]")
    grid[0, 0].set_ylabel("heading from start [°]")
    grid[1, 0].set_ylabel("steering [% of full]")
    changes = ", ".join(f"{c['parameter']} {c['old']:.3g} → {c['new']:.3g}" for c in summary["changes"])
    size = after[0]["target"]
    figure.suptitle(f"The same {size:.0f}° step, before and after `gcs-autotune tune heading`\n{changes}", fontsize=9)
    grid[0, 0].legend(frameon=False, fontsize=9)
    for axes in grid.flat:
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
