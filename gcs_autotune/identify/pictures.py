"""Figures of a fit, for notebooks and for the report page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gcs_autotune.identify.result import Fit

__all__ = ["fit_picture"]


def fit_picture(fit: Fit) -> Figure:
    """Return a figure: per run and signal the measured and the fitted motion, below what is left over.

    Angles are drawn in degrees.
    """
    from matplotlib.figure import Figure

    traces = fit.traces
    figure = Figure(figsize=(9.0, 2.6 * max(len(traces), 1)), layout="constrained")
    if not traces:
        figure.text(0.5, 0.5, "this fit has no traces", ha="center")
        return figure
    grid = figure.subplots(2 * len(traces), 1, squeeze=False, gridspec_kw={"height_ratios": [2, 1] * len(traces)})
    for i, trace in enumerate(traces):
        degrees = "rad" in trace.unit
        scale, unit = (np.degrees(1.0), trace.unit.replace("rad", "deg")) if degrees else (1.0, trace.unit)
        upper, lower = grid[2 * i, 0], grid[2 * i + 1, 0]
        upper.plot(trace.t, scale * trace.measured, ".", ms=2, color="#888888", label="measured")
        upper.plot(trace.t, scale * trace.fitted, lw=1.2, color="#1f5fa8", label="model")
        upper.set_ylabel(f"{trace.signal} [{unit}]")
        upper.set_title(trace.run, fontsize="small", loc="left")
        lower.plot(trace.t, scale * (trace.measured - trace.fitted), lw=0.8, color="#b04a3a")
        lower.axhline(0.0, lw=0.5, color="#444444")
        lower.set_ylabel("left over")
    grid[0, 0].legend(loc="upper right", fontsize="small")
    grid[-1, 0].set_xlabel("t [s]")
    return figure
