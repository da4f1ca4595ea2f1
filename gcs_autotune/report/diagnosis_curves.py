"""A cause drawn as its curve; what goes with the heading as a compass rose beside the same unrolled."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import Curve
from gcs_autotune.report.canvas import AFTER, BEFORE, INK, legend, new_axes, new_row
from gcs_autotune.report.numbers import pretty_unit, to_people
from gcs_autotune.sname import parse_header

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

__all__ = ["draw_curve"]

Array = NDArray[np.float64]


def draw_curve(curve: Curve) -> Figure:
    """The effect as it was found, in the extended model's colour; the plain model's idea of it dashed."""
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
        axes.axhline(0.0, color=BEFORE, lw=1.2, ls="--", label="simulation: none")
    axes.plot(x, y, color=AFTER, lw=2.0, label="found")
    if curve.polar:
        axes.axhline(0.0, color=INK, lw=0.8)
    axes.set_xlabel("heading" if curve.polar else x_label)
    axes.set_ylabel(y_label)
    if not curve.polar:
        legend(axes)
    return figure


def for_people(values: Array, label: str) -> tuple[Array, str]:
    """Return a curve's numbers and label ``"heading [rad]"`` with radians made degrees."""
    name, unit = parse_header(label)
    shown, factor = to_people(unit)
    return factor * values, f"{name} [{pretty_unit(shown) or unit}]" if unit else name


def _rose(axes: PolarAxes, heading: Array, y: Array) -> None:
    """Draw *y* over the heading, north up and clockwise; the dark circle is zero, outside is positive."""
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
