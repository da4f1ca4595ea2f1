"""The classic diagrams of manoeuvres: zig-zag, turning circle, spiral and stopping track."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, FAINT, INK, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.document import Figure
from gcs_autotune.report.toolkit.figures import finite, thin
from gcs_autotune.seatrials import Shape, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

__all__ = ["ship_diagram"]

_CAPTIONS = {
    "time": "Heading change and helm over the time from the first helm order (execute). Numbers: overshoot angles.",
    "track": "Track from the execute (circle), with the approach upwards.",
    "curve": "Steady turn rate over the helm.",
}


def ship_diagram(sheet: Sheet, slug: str) -> Figure | None:
    """Return the diagram of *sheet*, or None if its manoeuvre has none. *slug*: unique on the page."""
    if sheet.shape is None:
        return None
    draw = {"time": _over_time, "track": _track, "curve": _curve}[sheet.shape.kind]
    return Figure(f"{slug}-diagram", _CAPTIONS[sheet.shape.kind], partial(draw, sheet.shape))


def _over_time(shape: Shape) -> Drawing:
    figure, (axes,) = new_axes((2.6,))
    (name, t, psi), (helm_name, at, helm) = shape.lines
    one_axis = shape.helm_unit == "rad"
    label = helm_name if one_axis else f"{helm_name} [% of full, right]"
    beside = axes if one_axis else _beside(axes)
    scale = math.degrees(1.0) if one_axis else 100.0
    beside.step(at, scale * helm, where="post", color=BEFORE, lw=1.1)
    few = thin(finite(t, np.degrees(psi)))
    axes.plot([], [], color=BEFORE, lw=1.1, label=label)
    axes.plot(few.t, few.y, color=AFTER, label=name)
    for told, x, y in shape.points:
        up = y > 0.0
        axes.plot(x, math.degrees(y), "o", ms=3.5, color=INK)
        axes.annotate(
            told,
            (x, math.degrees(y)),
            (0.0, 4.0 if up else -4.0),
            textcoords="offset points",
            ha="center",
            va="bottom" if up else "top",
            fontsize=7.5,
        )
    axes.axhline(0.0, color=FAINT, lw=0.7)
    axes.margins(y=0.15)
    axes.set_xlabel("time since the execute [s]")
    axes.set_ylabel("heading change, helm [°]" if one_axis else "heading change [°]")
    legend(axes)
    return figure


def _beside(axes: Axes) -> Axes:
    """Return a second vertical axis for a helm in percent."""
    beside = axes.twinx()
    beside.spines["right"].set_visible(True)
    beside.grid(visible=False)
    beside.set_ylim(-110.0, 110.0)
    return beside


def _track(shape: Shape) -> Drawing:
    figure, (axes,) = new_axes((3.6,), share=False)
    for _, abeam, ahead in shape.lines:
        axes.plot(abeam, ahead, color=AFTER, lw=1.3)
    axes.plot(0.0, 0.0, "o", ms=5.0, color=INK, mfc="none")
    for (told, x, y), colour in zip(shape.points, (WANTED, BEFORE), strict=False):
        axes.plot([0.0, x, x], [y, y, 0.0], color=colour, lw=0.8, ls=":")
        axes.plot(x, y, "o", ms=4.5, color=colour, label=told)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("abeam [m]")
    axes.set_ylabel("ahead [m]")
    legend(axes, 2)
    return figure


def _curve(shape: Shape) -> Drawing:
    figure, (axes,) = new_axes((2.8,))
    scale, unit = (math.degrees(1.0), "°") if shape.helm_unit == "rad" else (100.0, "% of full")
    for (name, helm, rate), colour in zip(shape.lines, (INK, AFTER, BEFORE), strict=False):
        axes.plot(scale * helm, np.degrees(rate), "o-", ms=3.5, lw=1.1, color=colour, label=name)
    axes.axhline(0.0, color=FAINT, lw=0.7)
    axes.axvline(0.0, color=FAINT, lw=0.7)
    axes.set_xlabel(f"helm [{unit}]")
    axes.set_ylabel("turn rate [°/s]")
    legend(axes)
    return figure
