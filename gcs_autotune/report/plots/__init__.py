"""Figures of results, for notebooks and pages. Results are plain data; only this package plots them."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from gcs_autotune.design import Proposal
from gcs_autotune.diagnose import Diagnosis
from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Fit, Model
from gcs_autotune.report.plots.experiments import correlation_plot, plan_plot, profile_plot
from gcs_autotune.report.plots.fits import draw_trace, fit_plot, label_as_read, plot_trace
from gcs_autotune.report.plots.frequency import frequency_plot
from gcs_autotune.report.plots.residuals import plot_residuals
from gcs_autotune.report.plots.steps import plot_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "correlation_plot",
    "draw_trace",
    "frequency_plot",
    "label_as_read",
    "plan_plot",
    "plot",
    "profile_plot",
]


def plot(
    result: Fit[Model] | Proposal | Diagnosis, ax: Axes | None = None, *, run: str = "", signal: str = ""
) -> Figure | Axes:
    """Plot *result* and return the new figure, or *ax* if it is supplied.

    A fit: model, measurement and residual per run and signal; on *ax* one trace. A proposal: the predicted step with
    the old and the new gains. A diagnosis: the residual of the simulation without and with the causes. *run* and
    *signal* select a trace; the default is the first trace. Units are SI, but angles of a fit are in degrees.

    Raises
    ------
    UsageError
        There is no such trace, or *result* is of another type.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from gcs_autotune.api import example_run, fit, plot
    >>> ax = Figure().subplots()
    >>> plot(fit(example_run(), "linear", dof="yaw", delay=0.0), ax, signal="psi") is ax
    True
    """
    _let_notebooks_show_figures()
    if isinstance(result, Fit):
        return fit_plot(result) if ax is None else plot_trace(ax, result.traces, run, signal)
    if isinstance(result, Proposal):
        return plot_step(result, ax)
    if isinstance(result, Diagnosis):
        return plot_residuals(result, ax, run, signal)
    raise UsageError(f"a {type(result).__name__} has no plot. Plot a fit, a proposal or a diagnosis")


def _let_notebooks_show_figures() -> None:
    """Let IPython show figures, which it learns only when ``pyplot`` is imported. Here figures are made without it."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is None:
        return
    from matplotlib.figure import Figure

    if Figure not in shell.display_formatter.formatters["image/png"].type_printers:
        tools: Any = import_module("IPython.core.pylabtools")
        tools.select_figure_formats(shell, {"png"})
