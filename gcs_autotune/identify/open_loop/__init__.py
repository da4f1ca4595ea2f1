"""The methods ``step`` and ``zig-zag``, which derive a model from open-loop manoeuvres.

The package ``seatrials`` uses the same functions for its ship figures. A :class:`Reading` has a value and a standard
error. A :class:`ShipLog` contains heading and steering of a run.

================  =================================================================================
readings          values with standard errors, from local polynomials; intervals of constant input
ship_log          heading and rudder of a run, and its helm orders
steps             readings from every step of the input
step_table        Miskovic2010, table 4.1, and whether all steps agree
by_steps          the method ``step``
zigzag_integrals  equations (4.51)-(4.53), integrated between instants of a zig-zag
by_zigzag         the method ``zig-zag``: K and T
answer            the fit that both methods return
================  =================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.open_loop.by_zigzag import nomoto_of, solve_zigzag
from gcs_autotune.identify.open_loop.readings import (
    Hold,
    LocalFit,
    Reading,
    find_holds,
    local_fit,
    mean_reading,
    rate_of,
)
from gcs_autotune.identify.open_loop.ship_log import Execute, ShipLog, find_executes, ship_log, steered
from gcs_autotune.identify.open_loop.steps import StepReading, read_steps
from gcs_autotune.identify.open_loop.zigzag_integrals import rows_of

__all__ = [
    "Execute",
    "Hold",
    "LocalFit",
    "Reading",
    "ShipLog",
    "StepReading",
    "find_executes",
    "find_holds",
    "local_fit",
    "mean_reading",
    "nomoto_of",
    "rate_of",
    "read_steps",
    "rows_of",
    "ship_log",
    "solve_zigzag",
    "steered",
]
