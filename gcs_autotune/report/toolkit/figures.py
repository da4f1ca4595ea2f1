"""Figures that several pages share: fit, inputs, track, thrust curve, parameter intervals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import Actuator
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.identify import Parameter, Trace
from gcs_autotune.models import CoupledModel, SingleDof
from gcs_autotune.report.plots import draw_trace
from gcs_autotune.report.toolkit.canvas import AFTER, BAND, BEFORE, FAINT, INK, PAPER, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.wording import format_percent, pretty_unit, to_people
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "INTERVALS_CAPTION",
    "Curve",
    "draw_fit",
    "draw_inputs",
    "draw_intervals",
    "draw_thrust",
    "draw_track",
    "finite",
    "inputs_of",
    "is_bent",
    "thin",
]


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Samples of one signal: times ``t`` and values ``y``, (n,) each, in SI units and finite."""

    t: Array
    y: Array

    def __len__(self) -> int:
        return len(self.t)


def finite(t: Array, y: Array) -> Curve:
    """Return the samples at which both *t* and *y* are finite."""
    keep = np.isfinite(t) & np.isfinite(y)
    return Curve(t[keep], y[keep])


def thin(curve: Curve, most: int = 600) -> Curve:
    """Return *curve* reduced to about *most* samples: minimum and maximum of equal intervals."""
    n = len(curve)
    if n <= most:
        return curve
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    keep: set[int] = {0, n - 1}
    for low, high in itertools.pairwise(edges):
        part = curve.y[low:high]
        keep.update((low + int(np.argmin(part)), low + int(np.argmax(part))))
    index = np.array(sorted(keep))
    return Curve(curve.t[index], curve.y[index])


COLOURS = (AFTER, BEFORE, WANTED, "#cc79a7", "#e69f00", "#56b4e9", FAINT)

LEAST_TRACK = 5.0
"""Shortest track that is plotted [m]; below it receiver noise dominates. Project choice."""

MOST_INPUTS = 3
"""Largest number of inputs plotted of one run. Project choice."""

WIDEST = 100.0
"""Widest interval plotted [% of the value]. A wider interval includes zero. Project choice."""


def inputs_of(model: object, trial: Trial | None) -> tuple[str, ...]:
    """Return the names of the channels of *trial* that drive *model*; empty if there are none."""
    wanted: Iterable[str] = ()
    if isinstance(model, SingleDof):
        wanted = (model.axis.force, "delta")
    elif isinstance(model, CoupledModel):
        wanted = model.form.inputs
    elif isinstance(model, ExtendedModel):
        wanted = model.base.form.inputs
    return () if trial is None else tuple(n for n in wanted if n in trial and len(trial[n]))[:MOST_INPUTS]


def draw_inputs(axes: Axes, trial: Trial, names: Sequence[str], start: float, end: float) -> None:
    """Plot the inputs of a run from *start* to *end* [s by its timestamps], constant between samples.

    The time axis begins at *start*.
    """
    units = []
    for name, colour in zip(names, (INK, *COLOURS), strict=False):
        channel = trial[name]
        t = np.concatenate([[start], channel.t[(channel.t > start) & (channel.t <= end)], [end]])
        scale, unit = (100.0, "% of full output") if channel.unit == "1" else (to_people(channel.unit)[1], "")
        units.append(unit or pretty_unit(to_people(channel.unit)[0]))
        few = thin(finite(t - start, scale * np.array([channel.held_at(moment) for moment in t])))
        axes.step(few.t, few.y, where="post", color=colour, lw=1.0, label=name if len(names) > 1 else None)
    axes.set_ylabel(f"{', '.join(names)} [{', '.join(dict.fromkeys(units))}]")
    if len(names) > 1:
        legend(axes, len(names))


def draw_track(runs: Mapping[str, Trial]) -> Figure | None:
    """Plot the track over ground, north up, with equal scales. Return the figure, or None if the craft hardly moved."""
    tracks = []
    for label, trial in runs.items():
        if "x" in trial and "y" in trial and len(trial["x"]) > 1 and len(trial["y"]) > 1:
            x, y = (finite(trial[n].t, trial[n].values) for n in ("x", "y"))
            if len(x) > 1 and len(y) > 1:
                tracks.append((label, x.y, np.interp(x.t, y.t, y.y)))
    if not tracks:
        return None
    north, east = (np.concatenate([t[k] for t in tracks]) for k in (1, 2))
    if math.hypot(float(np.ptp(north)), float(np.ptp(east))) < LEAST_TRACK:
        return None
    figure, (axes,) = new_axes((3.4,), share=False)
    for (label, along, across), colour in zip(tracks, COLOURS, strict=False):
        every = -(-len(along) // 400) or 1
        axes.plot(across[::every], along[::every], color=colour, lw=1.2, label=label)
        axes.plot(across[0], along[0], "o", ms=5.0, mfc=PAPER, mec=colour, mew=1.3)
        axes.plot(across[-1], along[-1], "s", ms=4.5, color=colour)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [m]; circle: start, square: end")
    axes.set_ylabel("north [m]")
    legend(axes, 4)
    return figure


def is_bent(actuator: Actuator | None) -> bool:
    """Return whether the thrust of a fitted actuator is not proportional to its normalised output."""
    return actuator is not None and not actuator.is_plain


def draw_thrust(actuator: Actuator, flown: Sequence[float] = ()) -> Figure:
    """Return a figure of thrust over output, both in percent of full. *flown*: normalised outputs of the
    experiments.
    """
    figure, (axes,) = new_axes((2.4,), share=False)
    u = np.linspace(-1.0, 1.0, 401)
    ahead_only = bool(flown) and min(flown) >= 0.0
    u = u[u >= 0.0] if ahead_only else u
    force = actuator.static(u)
    full = float(np.max(np.abs(force))) or 1.0
    axes.plot(100.0 * u, 100.0 * u, color=BEFORE, lw=1.0, ls="--", label="proportional")
    axes.plot(100.0 * u, 100.0 * force / full, color=AFTER, lw=2.0, label="found")
    levels = sorted({round(v, 3) for v in flown})
    at = np.array(levels)
    if levels:
        axes.plot(100.0 * at, 100.0 * actuator.static(at) / full, "o", ms=5.0, mfc=PAPER, mec=INK, label="flown")
    axes.axhline(0.0, color=FAINT, lw=0.7)
    axes.set_xlabel("output [% of full output]")
    axes.set_ylabel("force [% of full force]")
    legend(axes)
    return figure


def draw_intervals(parameters: Mapping[str, Parameter]) -> Figure | None:
    """Plot the 95 % interval of every fitted parameter in percent of its value. Return the figure, or None if no
    interval is known.
    """
    known = [p for p in parameters.values() if p.status in ("fitted", "at_bound") and p.value and p.std > 0.0]
    known = [p for p in known if math.isfinite(p.std)]
    if not known:
        return None
    reach = [196.0 * p.std / abs(p.value) for p in known]
    figure, (axes,) = new_axes((0.27 * len(known) + 0.3,), share=False)
    limit = 1.15 * min(max(reach), WIDEST)
    for i, (p, half) in enumerate(zip(known, reach, strict=True)):
        told = half <= WIDEST
        axes.plot([-min(half, limit), min(half, limit)], [i, i], color=AFTER if told else BEFORE, lw=2.4)
        axes.plot(0.0, i, "o", ms=4.5, color=AFTER if told else BEFORE)
        words = f"± {format_percent(half)}" + ("" if told else ", may be zero")
        axes.text(1.01, i, words, transform=axes.get_yaxis_transform(), va="center", fontsize=7.5)
        if math.isfinite(p.bound) and p.bound > 0.0:
            bound = min(196.0 * p.bound / abs(p.value), limit)
            axes.plot([-bound, bound], [i, i], color=BAND, lw=6.0, alpha=0.6, solid_capstyle="butt", zorder=1)
    axes.set_yticks(range(len(known)), [p.name for p in known])
    axes.set_ylim(len(known) - 0.4, -0.6)
    axes.set_xlim(-limit, limit)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("95 % interval [% of value]")
    box = axes.get_position()
    axes.set_position((box.x0 + 0.03, box.y0, box.width - 0.28, box.height))
    return figure


INTERVALS_CAPTION = (
    "95 % interval of each parameter, in percent of its value. Pale (if known): the smallest interval that any "
    "unbiased method could reach with these runs."
)


def draw_fit(trace: Trace, run: Trial | None, model: object, noun: str = "") -> Figure | None:
    """Plot model and measurement, the residual, and the inputs of *run* that drive *model*."""
    measured = finite(trace.t, trace.measured)
    if len(measured) < 2:
        return None
    inputs = inputs_of(model, run)
    figure, axes = new_axes((1.9, 0.9, 0.9) if inputs else (1.9, 0.9))
    draw_trace(axes[0], axes[1], trace, noun)
    if run is not None and inputs:
        draw_inputs(axes[2], run, inputs, float(trace.t[0]), float(trace.t[-1]))
    axes[-1].set_xlabel("time [s]")
    legend(axes[0])
    return figure
