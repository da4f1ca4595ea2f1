"""Sea trials: figures of zig-zags, turning circles, spirals and pull-outs.

==============  ===================================================================================
figures         recognition of the manoeuvre, and its sheet of figures
criteria        the sheet, and the criteria of MSC.137(76)
zigzag          overshoot angles, times, initial turning, K and T
turning_circle  advance, transfer, tactical diameter, the steady turn, the current
spiral          directional stability: direct and reverse spirals, pull-outs
closed_loop     natural frequency and damping of the heading loop from relays on its set-point
stopping        track reach, head reach and time after thrust is removed or reversed
==============  ===================================================================================

Models are fitted to the same runs by the methods ``step`` and ``zig-zag`` (:mod:`gcs_autotune.identify.open_loop`).
"""

from __future__ import annotations

from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.seatrials.closed_loop import LARGE_OVERSHOOT, POORLY_DAMPED, WELL_DAMPED
from gcs_autotune.seatrials.criteria import Figure, Particulars, Shape, Sheet
from gcs_autotune.seatrials.figures import MANOEUVRES, ship_figures

__all__ = [
    "LARGE_OVERSHOOT",
    "MANOEUVRES",
    "POORLY_DAMPED",
    "WELL_DAMPED",
    "Figure",
    "Particulars",
    "Reading",
    "Shape",
    "Sheet",
    "ship_figures",
]
