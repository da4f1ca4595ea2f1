"""Linear pieces that the loops share: the PID with the autopilot's filters, and how fast its integral works."""

from __future__ import annotations

import numpy as np

from gcs_autotune.design.open_loop import Rational, constant, first_order, integrator

__all__ = ["integral_over_proportional", "pid_path"]


def pid_path(p: float, i: float = 0.0, d: float = 0.0, *, error_cutoff: float, slope_cutoff: float = 0.0) -> Rational:
    """Return the transfer from measured value to output (sign aside) of a PID on a filtered error.

    Cut-offs in Hz, of the error and of its slope; 0 for no filter.
    """
    pid = constant(p)
    if i > 0.0:
        pid = pid + integrator(i)
    if d > 0.0:
        pid = pid + Rational(np.array([d, 0.0]), np.array([1.0])) * first_order(slope_cutoff)
    return pid * first_order(error_cutoff)


def integral_over_proportional(outer: float, proportional: float, integral: float) -> float:
    """Return ``A I / (A P + I)`` [1/s] of a loop with *outer* gain A on the position around a PI on its velocity."""
    return outer * integral / max(outer * proportional + integral, 1e-12)
