"""The figure of a proposal for a notebook: the predicted step with the old and the new gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_autotune.report.toolkit.canvas import legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gcs_autotune.design import Proposal

__all__ = ["plot_step"]

BEFORE, AFTER, WANTED = "#d55e00", "#0072b2", "#009e73"
"""Colours of the step with old gains, with new gains, and of the command, from the colour-blind-safe palette of
Okabe2008.
"""


def plot_step(proposal: Proposal, ax: Axes | None) -> Figure | Axes:
    """Plot the predicted step with old and new gains on *ax* and return *ax*. If *ax* is None, plot on a new figure and
    return that.
    """
    if ax is None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        _draw(figure.subplots(), proposal)
        return figure
    _draw(ax, proposal)
    return ax


def _draw(ax: Axes, proposal: Proposal) -> None:
    before, after = proposal.before, proposal.after
    ax.plot(after.t, after.target, color="#8a8a8a", lw=0.9, ls="--", label="set point")
    ax.plot(after.t, after.wanted, color=WANTED, lw=1.2, label="wanted")
    ax.plot(before.t, before.position, color=BEFORE, lw=1.4, label="old gains")
    if proposal.changes:
        ax.plot(after.t, after.position, color=AFTER, lw=1.4, label="new gains")
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"{proposal.axis} [SI]")
    legend(ax)
