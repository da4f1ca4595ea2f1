"""The Bode diagram of a measured frequency response, with its confidence band, coherence, and models to compare."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.identify.frequency import COHERENT, FrequencyResponse
from gcs_autotune.models import Nomoto1, Nomoto2, TransferFunction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["frequency_plot"]

COLOURS = ("#1f5fa8", "#b04a3a", "#3a8a4a", "#8a5aa8")


def frequency_plot(
    response: FrequencyResponse, models: Mapping[str, Nomoto1 | Nomoto2 | TransferFunction] | None = None
) -> Figure:
    """Return a figure with magnitude [dB], phase [deg] and coherence over frequency [rad/s].

    Points with too low a coherence are pale. The error bars are 95 % confidence intervals.

    Parameters
    ----------
    models : name for the legend -> model whose response is plotted as a line.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 7.5), layout="constrained")
    gain, phase, coherence = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 3, 1.4]})
    magnitude, degrees = response.magnitude, np.degrees(response.phase)
    # The circle about the gain, seen from the origin: where it holds the origin nothing is known.
    share = np.minimum(response.radius() / np.maximum(magnitude, np.finfo(float).tiny), 0.999)
    decibels = 20.0 * np.log10(np.maximum(magnitude, np.finfo(float).tiny))
    up, down = 20.0 * np.log10(1.0 + share), -20.0 * np.log10(1.0 - share)
    turn = np.degrees(np.arcsin(share))
    good = response.coherence >= COHERENT
    for keep, colour, label in ((good, "#333333", "measured"), (~good, "#c0c0c0", f"coherence below {COHERENT:g}")):
        if not keep.any():
            continue
        style = {"fmt": "o", "ms": 3.5, "lw": 1.0, "color": colour}
        gain.errorbar(response.omega[keep], decibels[keep], np.array([down[keep], up[keep]]), label=label, **style)
        phase.errorbar(response.omega[keep], degrees[keep], turn[keep], **style)
    if len(response):
        grid = np.geomspace(response.omega.min(), response.omega.max(), 300)
        for i, (name, model) in enumerate((models or {}).items()):
            value = model.response(grid)
            colour = COLOURS[i % len(COLOURS)]
            gain.plot(grid, 20.0 * np.log10(np.abs(value)), color=colour, lw=1.4, label=name)
            curve = np.degrees(np.unwrap(np.angle(value)))
            near = np.interp(response.omega[0], grid, curve)
            phase.plot(grid, curve + 360.0 * np.round((degrees[0] - near) / 360.0), color=colour, lw=1.4)
        gain.legend(fontsize="small")
    gain.set_ylabel("gain [dB]")
    phase.set_ylabel("phase [deg]")
    coherence.plot(response.omega, response.coherence, "o-", ms=3.0, lw=0.8, color="#333333")
    coherence.axhline(COHERENT, lw=0.6, color="#888888", ls="--")
    coherence.set_ylim(0.0, 1.05)
    coherence.set_ylabel("coherence")
    coherence.set_xlabel("frequency [rad/s]")
    coherence.set_xscale("log")
    for axes in (gain, phase, coherence):
        axes.grid(True, which="both", lw=0.3, color="#dddddd")
    return figure
