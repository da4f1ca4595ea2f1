"""The figure of a predicted limit cycle, for a design at the desk and for the preview of a relay."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.models import SingleDof
from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, INK, legend, new_axes
from gcs_autotune.report.toolkit.document import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from gcs_autotune.identify.relay import PredictedCycle

__all__ = ["goldfarb_figure"]


def goldfarb_figure(model: SingleDof, cycle: PredictedCycle, name: str = "goldfarb") -> Figure:
    """Return the Nyquist plot of *model* with the relay's ``-1/N`` (Goldfarb; Miskovic2010, 5.35)."""
    caption = "Nyquist plot of the craft, and -1/N(X) of the relay. Their intersection is the limit cycle."
    return Figure(name, caption, partial(_draw_goldfarb, model, cycle))


def _draw_goldfarb(model: SingleDof, cycle: PredictedCycle) -> Drawing:
    figure, (axes,) = new_axes((3.6,))
    omega = cycle.omega * np.logspace(-0.6, 1.5, 800)
    process = cycle.process(model, omega)
    least = max(cycle.x_a + abs(cycle.x_0), 1e-3 * cycle.X_m)
    inverse = cycle.inverse(np.linspace(least, 2.0 * cycle.X_m, 200)[1:])
    axes.plot(process.real, process.imag, color=AFTER, lw=1.3, label="craft G(jω)")
    axes.plot(inverse.real, inverse.imag, color=BEFORE, lw=1.3, label="relay -1/N(X)")
    (at,) = cycle.process(model, np.array([cycle.omega]))
    axes.plot([at.real], [at.imag], "o", color=INK, ms=4.0, label="limit cycle")
    axes.set_xlim(-2.5 * abs(at), 0.5 * abs(at))
    axes.set_ylim(-2.5 * abs(at), 0.5 * abs(at))
    axes.set_aspect("equal")
    axes.set_xlabel("real part [rad or m per output]")
    axes.set_ylabel("imaginary part")
    legend(axes, 3)
    return figure
