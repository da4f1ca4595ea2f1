"""Figures of a fit, for notebooks and for the report's pages. Angles are drawn in degrees.

Matplotlib is imported when the first one is drawn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.identify.result import Trace
from gcs_autotune.sname import SIGNALS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gcs_autotune.identify.result import Fit

__all__ = ["as_headings", "draw_trace", "fit_picture"]

MEASURED, MODEL, BAND, INK = "#d55e00", "#0072b2", "#9ecae1", "#222222"
"""The colour-blind-safe set of Okabe2008."""

MOST_POINTS = 900
"""Samples drawn of one trace; more cannot be told apart."""


def draw_trace(top: Axes, bottom: Axes, trace: Trace, label: str = "") -> None:
    """Draw measured and fitted motion on *top*, what is left over on *bottom*, from the trace's own start on."""
    degrees = "rad" in trace.unit or not trace.unit
    scale, unit = (math.degrees(1.0), (trace.unit or "rad").replace("rad", "°")) if degrees else (1.0, trace.unit)
    name = label or SIGNALS.get(trace.signal, ("", trace.signal))[1].split(",")[0]
    index = np.unique(np.linspace(0, len(trace.t) - 1, min(len(trace.t), MOST_POINTS)).astype(int))
    t, fitted, band = trace.t[index] - trace.t[0], scale * trace.fitted[index], scale * trace.band[index]
    measured = scale * trace.measured[index]
    top.fill_between(t, fitted - band, fitted + band, color=BAND, alpha=0.6, lw=0, label="95 % band")
    top.plot(t, fitted, color=MODEL, lw=1.4, label="model, from the inputs alone")
    top.plot(t, measured, ".", ms=2.4, color=MEASURED, label="measured")
    top.set_ylabel(f"{name} [{unit}]")
    if trace.signal == "psi":
        as_headings(top)
    bottom.fill_between(t, -band, band, color=BAND, alpha=0.6, lw=0)
    bottom.plot(t, measured - fitted, color=INK, lw=0.8)
    bottom.set_ylabel(f"residual [{unit}]")


def as_headings(axes: Axes) -> None:
    """Label a vertical axis in degrees as people read headings: 0 to 360, however often the record turned."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 1.5, 3, 4.5, 9, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda degrees, _: f"{round(degrees, 2) % 360.0:g}"))


def fit_picture(fit: Fit) -> Figure:
    """Return a figure: per run and signal the measured and the fitted motion, below what is left over."""
    from matplotlib.figure import Figure

    traces = fit.traces
    figure = Figure(figsize=(9.0, 2.8 * max(len(traces), 1)), layout="constrained")
    if not traces:
        figure.text(0.5, 0.5, "this fit has no traces", ha="center")
        return figure
    grid = figure.subplots(2 * len(traces), 1, squeeze=False, gridspec_kw={"height_ratios": [2, 1] * len(traces)})
    for i, trace in enumerate(traces):
        draw_trace(grid[2 * i, 0], grid[2 * i + 1, 0], trace)
        grid[2 * i, 0].set_title(trace.run, fontsize="small", loc="left")
    grid[0, 0].legend(loc="upper right", fontsize="small")
    grid[-1, 0].set_xlabel("time [s]")
    return figure
