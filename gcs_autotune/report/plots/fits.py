"""Figures of a fit. Angles are plotted in degrees.

Matplotlib is imported with the first plot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Trace
from gcs_autotune.report.toolkit.canvas import legend
from gcs_autotune.sname import SIGNALS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gcs_autotune.identify import Fit, Model

__all__ = ["draw_trace", "fit_plot", "label_as_read", "plot_trace"]

Array = NDArray[np.float64]

MEASURED, MODEL, BAND, INK = "#8a8a8a", "#0072b2", "#9ecae1", "#222222"
"""Colours of measurement, model, uncertainty band and residual, from the colour-blind-safe palette of Okabe2008."""

MOST_POINTS = 900
"""Largest number of samples plotted per trace; more are not distinguishable. Project choice."""


def draw_trace(top: Axes, bottom: Axes, trace: Trace, label: str = "") -> None:
    """Plot measured and fitted motion of *trace* on *top* and the residual on *bottom*. Time is zero at the start of
    the trace.
    """
    t, band, residual, unit = _draw_motion(top, trace, label)
    bottom.fill_between(t, -band, band, color=BAND, alpha=0.6, lw=0)
    bottom.plot(t, residual, color=INK, lw=0.8)
    bottom.set_ylabel(f"residual [{unit}]")


def _draw_motion(top: Axes, trace: Trace, label: str) -> tuple[Array, Array, Array, str]:
    """Plot measured and fitted motion. Return time, band, measured minus fitted, and the unit shown."""
    degrees = "rad" in trace.unit or not trace.unit
    scale, unit = (math.degrees(1.0), (trace.unit or "rad").replace("rad", "°")) if degrees else (1.0, trace.unit)
    name = label or SIGNALS.get(trace.signal, ("", trace.signal))[1].split(",")[0]
    index = np.unique(np.linspace(0, len(trace.t) - 1, min(len(trace.t), MOST_POINTS)).astype(int))
    t, fitted, band = trace.t[index] - trace.t[0], scale * trace.fitted[index], scale * trace.band[index]
    measured = scale * trace.measured[index]
    top.fill_between(t, fitted - band, fitted + band, color=BAND, alpha=0.6, lw=0, label="95 % band")
    top.plot(t, measured, ".", ms=2.8, color=MEASURED, alpha=0.5, label="measured")
    top.plot(t, fitted, color=MODEL, lw=1.4, label="model, from the inputs alone")
    top.set_ylabel(f"{name} [{unit}]")
    label_as_read(top, trace.signal, float(measured[0]) if len(measured) else 0.0)
    return t, band, measured - fitted, unit


def label_as_read(axes: Axes, signal: str, first: float) -> None:
    """Label a vertical axis of *signal*; *first* [deg, m] is the first plotted value.

    Depth increases downwards. A heading starts within 0 to 360 degrees and continues beyond that range. If each label
    were wrapped separately, they would read 300, 0, 60 upwards.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    row = SIGNALS.get(signal)
    if row is None:
        return
    if row.down and not axes.yaxis_inverted():
        axes.invert_yaxis()
    if row.wraps and math.isfinite(first):
        turns = 360.0 * math.floor(first / 360.0)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 1.5, 3, 4.5, 9, 10]))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda degrees, _: f"{round(degrees - turns, 2):g}"))


def plot_trace(ax: Axes, traces: Sequence[Trace], run: str = "", signal: str = "") -> Axes:
    """Plot the first of *traces*, or the one of *run* and *signal* if supplied, on *ax* and return *ax*.

    Raises
    ------
    UsageError
        There is no such trace.
    """
    trace = next((t for t in traces if run in ("", t.run) and signal in ("", t.signal)), None)
    if trace is None:
        have = ", ".join(f"{t.signal} of {t.run}" for t in traces) or "none"
        raise UsageError(f"no trace of {signal or 'any signal'} of {run or 'any run'}. Available: {have}")
    _draw_motion(ax, trace, "")
    ax.set_xlabel("time [s]")
    legend(ax)
    return ax


def fit_plot(fit: Fit[Model]) -> Figure:
    """Return a figure with the measured and the fitted motion for each run and signal, and their residual below."""
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
    legend(grid[0, 0], side="right")
    grid[-1, 0].set_xlabel("time [s]")
    return figure
