"""The figures of a diagnosis: runs, views of the residual, curves of causes, gains."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose import ErrorReduction, MissingCurve, MissingForce, Portrait
from gcs_autotune.effects import Effect, EffectCurve
from gcs_autotune.identify import Trace
from gcs_autotune.report.diagnosis.wording import missing_over, signal_words
from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, FAINT, INK, legend, new_axes, new_row
from gcs_autotune.report.toolkit.figures import draw_inputs, finite, thin
from gcs_autotune.report.toolkit.wording import pretty_unit, to_people
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.sname import DOFS, SIGNALS, parse_header
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

__all__ = [
    "BINS",
    "View",
    "bin_means",
    "draw_against",
    "draw_curve",
    "draw_flight",
    "draw_gains",
    "draw_left",
    "draw_view",
    "most_informative_view",
    "views_of",
]


Array = NDArray[np.float64]

BINS = 15
"""Number of bins with equal numbers of samples into which a residual is divided, enough to show a kink on either side
of zero. Project choice.
"""

Kind = Literal["against", "cross", "spectrum"]

_VELOCITIES = frozenset(d.velocity for d in DOFS.values())

_FORCES = frozenset({*(d.force for d in DOFS.values()), "delta", "n"})

_FAMILY: Mapping[str, tuple[tuple[Kind, frozenset[str]], ...]] = {
    "data errors": (("cross", _FORCES), ("against", frozenset({"time"}))),
    "actuator": (("against", _FORCES), ("cross", _FORCES)),
    "hydrodynamics": (("against", _VELOCITIES),),
    "environment": (("against", frozenset({"psi", "time", "x", "y", "z"})), ("spectrum", frozenset({""}))),
    "sensor": (("against", frozenset({"psi", "time"}) | _VELOCITIES),),
}
"""For each family of effects, the views in which it usually appears."""

_WORDS: tuple[tuple[str, Kind, frozenset[str]], ...] = (
    (r"command|input|thrust|rudder", "against", _FORCES),
    (r"against heading|with (the )?heading", "against", frozenset({"psi"})),
    (r"speed|rate\b|velocit", "against", _VELOCITIES),
    (r"\btime\b|drift", "against", frozenset({"time"})),
    (r"position", "against", frozenset({"x", "y", "z"})),
    (r"spectr|frequen|narrow|peak", "spectrum", frozenset({""})),
    (r"correlat|delay|\blate\b|\blag", "cross", _FORCES | _VELOCITIES),
)
"""Pattern in an effect's ``shown_by`` -> the view that shows it."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One view of a signal's residual.

    ``kind``: what the residual is plotted as or against.
    ``portrait``: the residual's analysis.
    ``name``: the channel, empty for a spectrum.
    ``share``: fraction of the residual's variance that the view accounts for.
    """

    kind: Kind
    portrait: Portrait
    name: str
    share: float


def bin_means(x: Array, y: Array, bins: int = BINS) -> tuple[Array, Array, Array, Array]:
    """Return (centre of *x*, mean of *y*, standard error of that mean, number of samples), (k,) each, in k <= *bins*
    equally filled bins of *x*.
    """
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    used = np.unique(place)
    groups = [place == k for k in used]
    count = np.array([np.count_nonzero(g) for g in groups], dtype=np.float64)
    centre = np.array([x[g].mean() for g in groups])
    mean = np.array([y[g].mean() for g in groups])
    error = np.array([y[g].std() for g in groups]) / np.sqrt(np.maximum(count - 1.0, 1.0))
    return centre, mean, error, count


def views_of(portrait: Portrait) -> Iterator[View]:
    """Yield every view for which *portrait* contains enough data."""
    for name, (x, y, _) in portrait.against.items():
        keep = np.isfinite(x) & np.isfinite(y)
        if np.count_nonzero(keep) > 2 * BINS and np.ptp(x[keep]) > 0.0:
            yield View("against", portrait, name, _explained(_folded(name, x[keep]), y[keep]))
    for name, (_, rho) in portrait.cross.items():
        if len(rho) > 1:
            floor = portrait.limit**2 if np.isfinite(portrait.limit) else 0.0
            yield View("cross", portrait, name, max(float(np.nanmax(rho**2)) - floor, 0.0))
    if portrait.spectrum is not None and len(portrait.spectrum[0]) > 8:
        yield View("spectrum", portrait, "", _peak(*portrait.spectrum))


def _folded(name: str, x: Array) -> Array:
    """Return headings as compass values (0 to 360 degrees); other channels unchanged."""
    return x % (2.0 * np.pi) if name == "psi" else x


def _explained(x: Array, y: Array) -> float:
    """Return the fraction of the mean square of *y* that is explained by bins of *x*, minus that expected by chance."""
    _, mean, _, count = bin_means(x, y)
    total = float(np.mean(y**2))
    if total <= 0.0 or len(y) <= len(mean):
        return 0.0
    plain = float(np.sum(count * mean**2)) / len(y) / total
    return max(1.0 - (1.0 - plain) * len(y) / (len(y) - len(mean)), 0.0)


def _peak(frequency: Array, power: Array) -> float:
    """Return the fraction of power within a tenth of the strongest frequency, in excess of an even spread."""
    total = float(np.nansum(power))
    if total <= 0.0:
        return 0.0
    near = np.abs(frequency - frequency[int(np.nanargmax(power))]) <= 0.1 * frequency[int(np.nanargmax(power))]
    return max(float(np.nansum(power[near])) / total - float(np.mean(near)), 0.0)


def most_informative_view(portraits: Sequence[Portrait], effect: Effect | None = None, place: str = "") -> View | None:
    """Return the view with the largest fraction of the variance. A view in which the effect usually appears is
    preferred.
    """
    best: tuple[float, View] | None = None
    for portrait in portraits:
        for view in views_of(portrait):
            weight = view.share * (1.0 if effect is None else _fit(view, effect, place))
            if best is None or weight > best[0]:
                best = weight, view
    return None if best is None else best[1]


def _fit(view: View, effect: Effect, place: str) -> float:
    """Return the relevance of a view, from the family, the effect's ``shown_by`` and its place."""
    weight = 1.0
    if any(view.kind == kind and view.name in names for kind, names in _FAMILY[effect.family]):
        weight += 1.0
    if any(view.kind == k and view.name in names and re.search(w, effect.shown_by) for w, k, names in _WORDS):
        weight += 2.0
    parts = place.split("+")
    if view.name in parts:
        weight += 1.0
    touched = {
        s
        for d in DOFS.values()
        for s in (d.velocity, d.position)
        if {d.name, d.force, d.velocity, d.position} & {*parts}
    }
    return weight * (2.0 if view.portrait.signal in touched or view.portrait.signal in parts else 1.0)


MOST_POINTS = 400
"""Largest number of samples in a scatter plot; more cannot be distinguished."""

MOST_DOTS = 250
"""Largest number of measured samples plotted of one trace, so that the page stays small. Project choice."""

_CELLS = 24
"""Points of a spectrum per decade, enough to keep a narrow peak visible. Project choice."""


def scaled(values: Array, unit: str) -> tuple[Array, str]:
    """Return *values* [*unit*] in display units, and the name of the display unit."""
    shown, factor = to_people(unit)
    return factor * values, pretty_unit(shown) or "1"


def draw_flight(
    before: Trace, after: Trace | None = None, run: Trial | None = None, inputs: Sequence[str] = ()
) -> Figure:
    """Plot measurement, simulation and, if supplied, the extended simulation.

    Below them, plot their residuals and the *inputs* of the *run*.
    """
    driven = run is not None and len(inputs) > 0 and len(before.t) > 1
    figure, (top, bottom, *drive) = new_axes((1.7, 0.9, 0.7) if driven else (1.7, 0.9))
    start = float(before.t[0]) if len(before.t) else 0.0
    measured, unit = scaled(before.measured, before.unit)
    dots = finite(before.t - start, measured)
    every = -(-len(dots) // MOST_DOTS) or 1
    top.plot(dots.t[::every], dots.y[::every], ".", ms=4.0, color=FAINT, label="measured")
    for trace, colour, label in ((before, BEFORE, "simulation"), (after, AFTER, "extended simulation")):
        if trace is None:
            continue
        for axes, y in ((top, trace.fitted), (bottom, trace.measured - trace.fitted)):
            few = thin(finite(trace.t - start, scaled(y, trace.unit)[0]), MOST_POINTS)
            axes.plot(few.t, few.y, color=colour, lw=1.2 if axes is top else 0.9, label=label)
    bottom.axhline(0.0, color=FAINT, lw=0.7)
    top.set_ylabel(f"{signal_words(before.signal)} [{unit}]")
    bottom.set_ylabel(f"residual [{unit}]")
    for axes in drive:
        assert run is not None
        draw_inputs(axes, run, inputs, start, float(before.t[-1]))
    (drive[0] if drive else bottom).set_xlabel("time [s]")
    legend(top)
    return figure


def draw_view(view: View, after: Portrait | None = None) -> Figure:
    """Plot the residual of a view; *after*: residual of the same signal with the causes in the model."""
    if view.kind == "against":
        return draw_against(view.portrait, view.name, after)
    figure, (axes,) = new_axes((2.0,))
    if view.kind == "spectrum":
        _spectrum(axes, view.portrait)
    else:
        _correlation(axes, *view.portrait.cross[view.name], view.portrait.limit)
        if after is not None and view.name in after.cross:
            axes.plot(*after.cross[view.name], color=AFTER, lw=1.2, label="with the causes")
        axes.set_xlabel(f"lag of the residual behind {view.name} [s]")
    legend(axes)
    return figure


def draw_against(portrait: Portrait, name: str, after: Portrait | None = None) -> Figure:
    """Plot the residual over a channel, as samples and bin means. *after*: residual of the extended model, as
    bin means.
    """
    figure, (axes,) = new_axes((2.2,))
    x, y = _cloud(portrait, name)
    x_unit, y_unit = scaled(x, portrait.against[name][2])[1], scaled(y, portrait.unit)[1]
    every = -(-len(x) // MOST_POINTS) or 1
    axes.plot(x[::every], y[::every], ".", ms=2.4, color=FAINT, alpha=0.6, label="residual")
    centre, mean, error, _ = bin_means(x, y)
    axes.errorbar(
        centre, mean, yerr=HALF_WIDTH * error, fmt="o-", ms=3.6, lw=1.5, color=BEFORE, label="mean of the residual"
    )
    axes.axhline(0.0, color=INK, lw=0.8)
    if after is not None and name in after.against and len(_cloud(after, name)[0]):
        centre, mean, _, _ = bin_means(*_cloud(after, name))
        axes.plot(centre, mean, "o-", ms=2.6, lw=1.4, color=AFTER, label="mean with the causes")
    if name == "psi":
        _compass(axes)
    axes.set_xlabel({"time": "time [s]", "psi": "heading"}.get(name, f"{_channel(name)} [{x_unit}]"))
    axes.set_ylabel(f"residual of {signal_words(portrait.signal)} [{y_unit}]")
    legend(axes)
    return figure


def _cloud(portrait: Portrait, name: str) -> tuple[Array, Array]:
    """Return channel and residual (n,) in display units, with headings as compass values."""
    x, residual, unit = portrait.against[name]
    keep = np.isfinite(x) & np.isfinite(residual)
    x = x[keep] % (2.0 * np.pi) if name == "psi" else x[keep]
    return scaled(x, unit)[0], scaled(residual[keep], portrait.unit)[0]


def _channel(name: str) -> str:
    return f"{signal_words(name)} {name}" if name in SIGNALS else name


def _compass(axes: Axes) -> None:
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 45), ["N", "NE", "E", "SE", "S", "SW", "W", "NW", "N"])


def draw_left(portrait: Portrait) -> Figure | None:
    """Return a figure with autocorrelation and spectrum of a residual; None if neither was computed."""
    parts = [p for p in (portrait.correlation, portrait.spectrum) if p is not None and len(p[0]) > 1]
    if not parts:
        return None
    figure, row = new_row(len(parts), 1.6)
    for axes, part in zip(row, parts, strict=True):
        if part is portrait.correlation:
            _correlation(axes, *part, portrait.limit)
            axes.set_xlabel("lag [s]")
            axes.set_ylabel("autocorrelation")
        else:
            _spectrum(axes, portrait)
        legend(axes)
    return figure


def _correlation(axes: Axes, lag: Array, rho: Array, limit: float) -> None:
    if np.isfinite(limit):
        axes.axhspan(-limit, limit, color=FAINT, alpha=0.25, lw=0, label="noise (95 % band)")
    axes.axhline(0.0, color=INK, lw=0.7)
    axes.plot(lag, rho, color=BEFORE, lw=1.4)
    axes.set_ylim(-1.05, 1.05)
    axes.set_ylabel("correlation")


def _spectrum(axes: Axes, portrait: Portrait) -> None:
    """Plot power over frequency in decibels below the strongest. Lines that would merge are averaged."""
    assert portrait.spectrum is not None
    frequency, power = portrait.spectrum
    keep = (frequency > 0.0) & (power > 0.0) & np.isfinite(power)
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("power [dB]")
    if not keep.any():
        return
    frequency, power = frequency[keep], power[keep]
    cell = np.floor(_CELLS * np.log10(frequency / frequency[0]))
    cells = [cell == k for k in np.unique(cell)]
    level = 10.0 * np.log10(np.array([power[c].mean() for c in cells]))
    middle = np.array([frequency[c].mean() for c in cells])
    axes.semilogx(middle, level - level.max(), color=BEFORE, lw=1.4)
    strongest = float(middle[int(np.argmax(level))])
    axes.axvline(strongest, color=FAINT, lw=0.9, ls="--", label=f"strongest: {strongest:.2g} Hz")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.set_ylim(min(-30.0, float((level - level.max()).min()) - 3.0), 3.0)


def draw_gains(gains: Sequence[ErrorReduction]) -> Figure | None:
    """Return a figure with the held-out error with the causes, in percent of the error without, for each signal with
    its 95 % interval. None if no error is known.
    """
    known = [g for g in gains if np.isfinite(g.ratio)]
    if not known:
        return None
    figure, (axes,) = new_axes((0.3 * len(known) + 0.35,))
    for i, gain in enumerate(known):
        low, high = gain.ci95
        if np.isfinite(low) and np.isfinite(high):
            axes.plot((100.0 * low, 100.0 * high), (i, i), color=AFTER, lw=2.2, solid_capstyle="butt")
        axes.plot(100.0 * gain.ratio, i, "o", ms=6, color=AFTER)
    axes.axvline(100.0, color=BEFORE, lw=1.4)
    right = max(110.0, *(110.0 * g.ratio for g in known), *(105.0 * g.ci95[1] for g in known if np.isfinite(g.ci95[1])))
    axes.set_xlim(0.0, right)
    axes.set_ylim(len(known) - 0.4, -0.6)
    axes.set_yticks(range(len(known)), [signal_words(g.signal) for g in known])
    axes.set_xlabel("remaining held-out error [% of the simulation's (orange line)]")
    axes.grid(axis="y", visible=False)
    return figure


def draw_curve(curve: EffectCurve) -> Figure:
    """Plot the identified effect in the extended model's colour. The same relation in the plain model is dashed."""
    (x, x_label), (y, y_label) = for_people(curve.x, curve.x_label), for_people(curve.y, curve.y_label)
    plain = None if curve.plain is None else for_people(curve.plain, curve.y_label)[0]
    if curve.polar:
        figure, (rose, axes) = new_row(2, 2.1, polar_first=True)
        _rose(cast("PolarAxes", rose), curve.x, y)
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 90), ["N", "E", "S", "W", "N"])
    else:
        figure, (axes,) = new_axes((2.2,))
    if plain is not None:
        axes.plot(x, plain, color=BEFORE, lw=1.2, ls="--", label="simulation")
    elif not curve.polar:
        axes.axhline(0.0, color=BEFORE, lw=1.2, ls="--", label="simulation: no force")
    axes.plot(x, y, color=AFTER, lw=2.0, label="found")
    if curve.polar:
        axes.axhline(0.0, color=INK, lw=0.8)
    axes.set_xlabel("heading" if curve.polar else x_label)
    axes.set_ylabel(y_label)
    if not curve.polar:
        legend(axes)
    return figure


def draw_missing(missing: MissingForce, curve: MissingCurve) -> Figure:
    """Plot the missing force or moment over a candidate variable, with its 95 % band from the variation between
    runs.
    """
    kind = "moment" if DOFS[missing.dof].angular else "force"
    x, x_label = for_people(curve.x, f"{missing_over(curve)} [{curve.unit or '1'}]")
    y, y_label = for_people(curve.force, f"missing {kind} [{missing.unit}]")
    band, _ = for_people(curve.band, y_label)
    figure, (axes,) = new_axes((2.2,))
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.fill_between(x, y - band, y + band, color=AFTER, alpha=0.2, lw=0, label="95 % band between runs")
    axes.plot(x, y, color=AFTER, lw=2.0, marker="o", ms=3, label="missing")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    legend(axes)
    return figure


def for_people(values: Array, label: str) -> tuple[Array, str]:
    """Return (*values* in display units, *label* with their unit). A label is like ``"heading [rad]"``; radians become
    degrees.
    """
    name, unit = parse_header(label)
    shown, factor = to_people(unit)
    return factor * values, f"{name} [{pretty_unit(shown) or unit}]" if unit else name


def _rose(axes: PolarAxes, heading: Array, y: Array) -> None:
    """Plot *y* over the heading, north up and clockwise. The dark circle is zero; positive values are outside it."""
    reach = float(np.nanmax(np.abs(y))) or 1.0
    around = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_xticks(np.radians(np.arange(0, 360, 45)), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])
    axes.set_ylim(-2.2 * reach, 1.15 * reach)
    axes.set_yticks([-reach, reach], ["", ""])
    axes.plot(around, np.zeros(len(around)), color=INK, lw=1.0)
    axes.fill_between(heading, 0.0, y, color=AFTER, alpha=0.2, lw=0)
    axes.plot(heading, y, color=AFTER, lw=2.0)
    axes.tick_params(pad=-1)
