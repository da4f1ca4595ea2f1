"""Figures: correlations, profile likelihoods, expected improvement by the next manoeuvre."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.experiments import Identifiability, Profile, RankedManoeuvre, Ranking
from gcs_autotune.report.toolkit.canvas import legend

__all__ = ["correlation_plot", "plan_plot", "profile_plot"]

if TYPE_CHECKING:
    from matplotlib.figure import Figure


BLUE, RED, GREY = "#1f5fa8", "#b04a3a", "#888888"


def correlation_plot(found: Identifiability) -> Figure:
    """Return a plot of the correlation of the estimates. A dark square off the diagonal marks a correlated pair."""
    from matplotlib.figure import Figure

    p = len(found.names)
    figure = Figure(figsize=(2.0 + 0.45 * p, 1.6 + 0.42 * p), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(found.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    axes.set_xticks(range(p), found.names, rotation=90, fontsize="small")
    axes.set_yticks(range(p), found.names, fontsize="small")
    figure.colorbar(image, ax=axes, shrink=0.8, label="correlation")
    axes.set_title("correlation of the estimates", fontsize="small", loc="left")
    return figure


def profile_plot(profiles: Sequence[Profile]) -> Figure:
    """Return a plot of the rise of the deviance for each parameter, with the threshold at which the confidence interval
    ends.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * max(len(profiles), 1), 2.8), layout="constrained")
    grid = figure.subplots(1, max(len(profiles), 1), squeeze=False)[0]
    for axes, profile in zip(grid, profiles, strict=False):
        axes.plot(profile.values, profile.deviance, "o-", ms=3, lw=1.2, color=BLUE)
        axes.axhline(profile.threshold, lw=0.8, color=RED)
        for end in (profile.low, profile.high):
            if math.isfinite(end):
                axes.axvline(end, lw=0.8, ls="--", color=RED)
        axes.set_ylim(0.0, 2.0 * profile.threshold)
        axes.locator_params(axis="x", nbins=4)
        axes.set_xlabel(f"{profile.name} [{profile.unit}]")
        axes.set_title("closed" if profile.closed else "open", fontsize="small", loc="left")
    grid[0].set_ylabel("increase of -2 log-likelihood")
    return figure


def plan_plot(proposal: RankedManoeuvre, plan: Ranking | None = None) -> Figure:
    """Return a bar plot of the relative standard errors before and after *plan* (the best one), on a logarithmic
    scale.

    An infinite standard error reaches the right edge.
    """
    from matplotlib.figure import Figure

    chosen = plan or proposal.best
    before, after = 100.0 * proposal.now.relative, 100.0 * chosen.std / proposal.now.scales.size
    finite = np.concatenate([before[np.isfinite(before)], after[np.isfinite(after)]])
    edge = 3.0 * float(finite.max(initial=1.0))
    rows = np.arange(len(proposal.names))
    figure = Figure(figsize=(7.0, 1.2 + 0.32 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.barh(rows - 0.2, np.minimum(before, edge), 0.38, color=GREY, label="from the runs so far")
    axes.barh(rows + 0.2, np.minimum(after, edge), 0.38, color=BLUE, label="with the proposed manoeuvre")
    axes.set_yticks(rows, proposal.names, fontsize="small")
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(right=edge)
    axes.set_xlabel("standard error [% of value]")
    axes.set_title(f"{chosen.candidate.title}, {proposal.seconds:.0f} s", fontsize="small", loc="left")
    legend(axes, side="right")
    return figure
