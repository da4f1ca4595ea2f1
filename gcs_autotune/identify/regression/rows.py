"""Write the equations of motion as rows linear in the parameters (:mod:`gcs_autotune.models.coupled.regressors`).

There are two kinds:

* ``derivative``: the equations as they are, with smoothed accelerations;
* ``integral``: the equations multiplied by a bump function and integrated over short windows. Integration by parts
  moves the derivative from the measured velocity to the known bump (Shinbrot1957; modulating functions). Noise is
  therefore averaged, not amplified. Corners of the velocity at jumps of the input do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.regression.drive import drives_of
from gcs_autotune.identify.regression.motion import GriddedMotion
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form, force_columns, inertia_columns

__all__ = ["EQUATIONS", "Rows", "rows_of"]

Array = NDArray[np.float64]

EQUATIONS = ("integral", "derivative")
"""Values that the option ``equation`` accepts; the first is the default."""

OVERLAP = 6
"""Number of integration windows that cover each instant. More windows add no information."""

EDGE = 2
"""Number of grid points left out at each end, where a smoothed derivative is least accurate."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Equations of one stretch.

    - ``E`` (n, k, p + 1): coefficients of the parameters; the last column is the constant part.
    - ``t`` (n,): times of the rows.
    """

    run: str
    t: Array
    E: Array


def rows_of(record: Segment, form: Form, motion: GriddedMotion, equation: str, window: float) -> Rows:
    """Return the equations of one stretch.

    window : length [s] of the bump of ``integral``.
    """
    drives = drives_of(record, form, motion.t, motion.step)
    force = force_columns(form, motion.nu, motion.eta, drives)
    if equation == "derivative":
        E = force + inertia_columns(form, motion.nu_dot)
        keep = slice(EDGE, len(motion.t) - EDGE)
        return Rows(motion.run, motion.t[keep], E[keep])
    m = min(max(round(window / motion.step), 6), len(motion.t) - 1)
    s = np.linspace(-1.0, 1.0, m + 1)
    bump, slope = (1.0 - s**2) ** 3, -6.0 * s * (1.0 - s**2) ** 2 * (2.0 / (m * motion.step))
    area = float(bump.sum())
    every = max(1, m // OVERLAP)
    E = _windowed(force, bump / area, every) + inertia_columns(form, _windowed(motion.nu, -slope / area, every))
    return Rows(motion.run, motion.t[m // 2 : len(motion.t) - (m - m // 2) : every][: len(E)], E)


def _windowed(values: Array, weights: Array, every: int) -> Array:
    """Return the weighted sums of *values* (n, ...) over windows that start at every *every*-th point."""
    views = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=0)[::every]
    return np.asarray(views @ weights, dtype=np.float64)
