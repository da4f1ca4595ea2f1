"""Bode plot of a loop with old and new gains, with its margins.

The margins come from a grid four times as fine as the design's. ``tests/report`` compares them with python-control,
which takes longer to import than all figures take to plot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.design import OpenLoop, crossings
from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, FAINT, legend, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LoopMargins", "draw_bode", "loop_margins"]


OMEGA = np.logspace(-3.0, 3.0, 3000)
"""Frequency grid of the margins [rad/s], 500 points per decade. Project choice."""

DECADES = 1.3
"""Decades of frequency plotted below the lowest and above the highest crossing. Project choice."""

HIGHEST, LOWEST, LEAST_PHASE = 40.0, -50.0, -360.0
"""Plot limits: highest and lowest magnitude [dB], lowest phase [deg]. Margins are well inside them. Project choice."""


@dataclass(frozen=True, slots=True)
class LoopMargins:
    """The smallest margins of several loops.

    ``gain``: factor by which the gain may increase or decrease, at ``gain_at`` [rad/s].
    ``phase``: phase margin [rad], at ``phase_at`` [rad/s].
    They are infinite and pi if no crossing limits them.
    ``narrowest``: index of the loop with the smallest phase margin.
    """

    stable: bool
    gain: float = math.inf
    gain_at: float = math.nan
    phase: float = math.pi
    phase_at: float = math.nan
    narrowest: int = 0


def loop_margins(loops: Sequence[OpenLoop]) -> LoopMargins:
    """Return the smallest margins of *loops*, opened at the actuator, with exact delays."""
    gain, gain_at, phase, phase_at, narrowest = math.inf, math.nan, math.pi, math.nan, 0
    stable = True
    for k, loop in enumerate(loops):
        stable &= bool(np.all(loop.closed_loop_poles().real < 0.0))
        turned, unity = crossings(loop.response(OMEGA)[None, :], OMEGA)
        for g, w in zip(np.exp(np.abs(turned.value)).tolist(), turned.at.tolist(), strict=True):
            gain, gain_at = min((gain, gain_at), (g, w), key=lambda pair: pair[0])
        for p, w in zip(np.abs(unity.value).tolist(), unity.at.tolist(), strict=True):
            if p < phase:
                phase, phase_at, narrowest = p, w, k
    return LoopMargins(stable, gain, gain_at, phase, phase_at, narrowest)


def draw_bode(
    loops: Sequence[Sequence[OpenLoop]],
    margins: Sequence[LoopMargins],
    labels: Sequence[str] = ("present gains", "new gains"),
) -> Figure:
    """Plot magnitude and phase of *loops*, a group for each set of gains. The loop with the smallest phase margin is
    bold.

    margins : results of :func:`loop_margins` with the old and the new gains.
    """
    figure, (top, bottom) = new_axes((1.8, 1.5))
    read = tuple(zip(loops, (BEFORE, AFTER)[-len(loops) :], labels, margins, strict=True))
    crossings = [w for *_, m in read for w in (m.gain_at, m.phase_at) if math.isfinite(w)] or [1.0]
    low, high = min(crossings) / 10.0**DECADES, max(crossings) * 10.0**DECADES
    for group, colour, label, margin in read:
        for k, loop in enumerate(group):
            strong = k == margin.narrowest
            _draw(top, bottom, loop, (low, high), colour, label if strong else "", strong)
        if margin.stable and math.isfinite(margin.phase_at):
            bottom.plot([margin.phase_at] * 2, [-180.0, math.degrees(margin.phase) - 180.0], color=colour, lw=2.4)
        if margin.stable and math.isfinite(margin.gain_at):
            at_180 = -20.0 * math.log10(margin.gain) * (1.0 if margin.gain_at > margin.phase_at else -1.0)
            top.plot([margin.gain_at] * 2, [0.0, at_180], color=colour, lw=2.4)
    top.axhline(0.0, color=FAINT, lw=0.9)
    bottom.axhline(-180.0, color=FAINT, lw=0.9)
    top.set_xscale("log")
    top.set_xlim(low, high)
    top.set_ylim(max(top.get_ylim()[0], LOWEST), min(top.get_ylim()[1], HIGHEST))
    bottom.set_yticks(range(-360, 91, 90))
    bottom.set_ylim(max(bottom.get_ylim()[0], LEAST_PHASE), min(bottom.get_ylim()[1], 90.0))
    top.set_ylabel("magnitude [dB]")
    bottom.set_ylabel("phase [°]")
    bottom.set_xlabel("frequency [rad/s] (thick lines: margins)")
    bottom.xaxis.set_major_formatter("{x:g}")
    bottom.xaxis.set_minor_formatter("")
    legend(top)
    return figure


def _draw(
    top: Axes, bottom: Axes, loop: OpenLoop, limits: tuple[float, float], colour: str, label: str, strong: bool
) -> None:
    omega = np.logspace(math.log10(limits[0]), math.log10(limits[1]), 240)
    response = loop.response(omega)
    magnitude, phase = np.abs(response), np.unwrap(np.angle(response))
    phase -= math.tau * math.ceil((phase[0] - 0.5 * math.pi) / math.tau)
    width, alpha = (1.6, 1.0) if strong else (0.7, 0.5)
    top.plot(omega, 20.0 * np.log10(magnitude), label=label or None, color=colour, lw=width, alpha=alpha)
    bottom.plot(omega, np.degrees(phase), color=colour, lw=width, alpha=alpha)
