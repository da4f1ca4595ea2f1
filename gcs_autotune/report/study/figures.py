"""The figures of an identification: correlation, comparison of methods, and convergence of recursive estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_autotune.identify import Fit, Model
from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, FAINT, INK, WANTED, legend, new_axes
from gcs_autotune.rounding import HALF_WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["convergence_of", "draw_convergence", "draw_correlation", "draw_methods"]


DEEPEST = 0.7
"""Opacity of a cell with correlation 1. Its number is legible on light and dark pages. Project choice."""

_COLOURS = (AFTER, BEFORE, WANTED, "#cc79a7", "#e69f00", "#56b4e9", FAINT)


def draw_correlation(fit: Fit[Model]) -> Figure | None:
    """Return a figure with the correlation of every pair of estimates; None for fewer than three estimates."""
    from matplotlib.patches import Rectangle

    names = [n for n, p in fit.parameters.items() if p.std > 0.0]
    if len(names) < 3:
        return None
    places = [list(fit.parameters).index(n) for n in names]
    table = fit.correlation[np.ix_(places, places)]
    figure, (axes,) = new_axes((max(1.2, 0.27 * len(names)),))
    for i, j in np.ndindex(table.shape):
        # As deep as the pair is correlated, on the page's own paper: a dark page has no white cells.
        deep, colour = abs(float(table[i, j])), AFTER if table[i, j] < 0.0 else BEFORE
        axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, color=colour, alpha=DEEPEST * deep, lw=0))
        told = f"{table[i, j]:.2f}".replace("0.", ".")
        axes.text(j, i, told, ha="center", va="center", fontsize=6.5, color=INK)
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.grid(False)
    return figure


MOST_CONVERGED = 12
"""Largest number of parameters whose convergence is plotted. Project choice."""


def convergence_of(fit: Fit[Model]) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """Return (run, history) for each run over which a recursive method estimated the parameters; empty for others.

    A history contains the stamps ``t`` [s], and the ``value`` and ``std`` of each parameter, as lists.
    """
    history = fit.extra.get("history")
    if not isinstance(history, Mapping):
        return ()
    if "runs" in history:
        return tuple((str(row["run"]), row) for row in history["runs"])
    return (("", {"t": history["t"], "value": history["values"], "std": history["stds"]}),)


def draw_convergence(fit: Fit[Model], history: Mapping[str, Any]) -> Figure | None:
    """Return a figure with each parameter over time, its 95 % interval, and the final estimate, as ZhaoUSV figures 4
    to 6; None without a parameter.
    """
    names = [n for n in history["value"] if n in fit.parameters][:MOST_CONVERGED]
    if not names:
        return None
    figure, every = new_axes((0.9,) * len(names))
    t = np.asarray(history["t"]) - history["t"][0]
    for name, axes in zip(names, every, strict=True):
        value, reach = np.asarray(history["value"][name]), HALF_WIDTH * np.asarray(history["std"][name])
        axes.fill_between(t, value - reach, value + reach, color=AFTER, alpha=0.25, lw=0)
        axes.plot(t, value, color=AFTER, lw=1.2)
        final = fit.parameters[name].value
        axes.axhline(final, color=INK, lw=0.8, ls="--")
        later = slice(len(t) // 10, None)  # the first interval may be a hundred times wider than the last
        low, high = float(np.min((value - reach)[later])), float(np.max((value + reach)[later]))
        margin = 0.05 * max(high - low, 1e-12)
        axes.set_ylim(min(low, final) - margin, max(high, final) + margin)
        axes.set_ylabel(name)
    every[-1].set_xlabel("time [s]")
    return figure


def draw_methods(selected: Fit[Model], fits: Sequence[Fit[Model]]) -> Figure | None:
    """Return a figure with the estimates of each method relative to those of the *selected* method; None for a single
    method.
    """
    if len(fits) < 2:
        return None
    names = [n for n, p in selected.parameters.items() if p.status == "fitted" and p.value != 0.0][:10]
    fits = fits[: len(_COLOURS)]
    figure, (axes,) = new_axes((0.34 * len(names) + 0.6,))
    for k, fit in enumerate(fits):
        for i, name in enumerate(names):
            parameter = fit.parameters.get(name)
            if parameter is None or parameter.status == "absent":
                continue
            truth = selected.parameters[name].value
            reach = abs(HALF_WIDTH * parameter.std / truth) if np.isfinite(parameter.std) else 0.0
            y = i + 0.7 * (k / max(len(fits) - 1, 1) - 0.5)
            label = fit.method if i == 0 else None
            axes.errorbar(parameter.value / truth, y, xerr=reach, fmt="o", ms=3, lw=1, color=_COLOURS[k], label=label)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlim(0.0, 2.0)
    axes.invert_yaxis()
    axes.set_xlabel("estimate / selected")
    legend(axes)
    return figure
