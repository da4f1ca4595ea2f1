"""Ship manoeuvres: open-loop steps, zig-zags, and the figures ship people expect.

=================  ============================================================================================
readings           numbers with standard errors, read off noisy samples by local polynomials
log, holds, track  a run as a ship's log; where its input stands still; its path and the current
step_table         Miskovic2010, table 4.1, and the integrals along a response it is a special case of
steps              readings of every step; ``step_model`` one model from all, ``step_evidence``: is it one story?
by_steps           the method ``step``
executes, zigzag   helm orders, and the figures of a zig-zag made of them
zigzag_integrals   (4.51)-(4.53) between the instants of ``zigzag_instants``; ``nomoto``: K and T
by_zigzag          the method ``zig-zag``
turning_circle     advance, transfer, tactical diameter, the steady turn
spiral, pull_out   directional stability
imo                the criteria of MSC.137(76)
figures            which manoeuvre is it, and its ``sheet`` of figures (``zigzag_sheet``)
=================  ============================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.ship.figures import MANOEUVRES, ship_figures
from gcs_autotune.identify.ship.imo import Figure
from gcs_autotune.identify.ship.readings import Reading
from gcs_autotune.identify.ship.sheet import Particulars, Sheet

__all__ = ["MANOEUVRES", "Figure", "Particulars", "Reading", "Sheet", "ship_figures"]
