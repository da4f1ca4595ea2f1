"""The figure of a diagnosis for a notebook: the residual of a run, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_autotune.errors import UsageError
from gcs_autotune.report.toolkit.canvas import legend
from gcs_autotune.sname import SIGNALS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gcs_autotune.diagnose import Diagnosis, Portrait
    from gcs_autotune.identify import Trace

__all__ = ["plot_residuals"]

BEFORE, AFTER = "#d55e00", "#0072b2"
"""Colours of the residual without and with the causes, from the colour-blind-safe palette of Okabe2008."""


def plot_residuals(found: Diagnosis, ax: Axes | None, run: str, signal: str) -> Figure | Axes:
    """Plot the measured minus the simulated motion of one run on *ax* and return *ax*. If *ax* is None, plot on a new
    figure and return that.
    """
    before, after = (_trace(portraits, run, signal) for portraits in (found.before, found.after))
    if before is None:
        have = ", ".join(f"{p.signal} of {t.run}" for p in found.before for t in p.traces) or "none"
        raise UsageError(f"no residual of {signal or 'any signal'} of {run or 'any run'}. Available: {have}")
    if ax is None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        _draw(figure.subplots(), before, after)
        return figure
    _draw(ax, before, after)
    return ax


def _trace(portraits: tuple[Portrait, ...], run: str, signal: str) -> Trace | None:
    traces = (t for p in portraits for t in p.traces if signal in ("", p.signal) and run in ("", t.run))
    return next(traces, None)


def _draw(ax: Axes, before: Trace, after: Trace | None) -> None:
    for trace, colour, label in ((before, BEFORE, "original simulation"), (after, AFTER, "with the causes included")):
        if trace is not None:
            ax.plot(trace.t - trace.t[0], trace.measured - trace.fitted, color=colour, lw=1.0, label=label)
    name = SIGNALS.get(before.signal, ("", before.signal))[1].split(",")[0]
    ax.set_ylabel(f"{name}, measured minus simulated [{before.unit}]")
    ax.set_xlabel("time [s]")
    ax.set_title(before.run, fontsize="small", loc="left")
    legend(ax, side="right")
