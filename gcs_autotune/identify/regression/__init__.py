"""Least-squares methods for any form whose equations of motion are linear in the parameters.

:func:`motion_of` and :func:`drives_of` provide the same motion and inputs for other linear methods.

================  ==============================================================================================
smoothing         value, rate and acceleration of one signal: Savitzky-Golay or a regularised spline
motion            velocities and accelerations of a record on an even grid; ``drive``: its averaged inputs
rows              equations linear in the parameters, with accelerations or integrated over windows
solver            least squares of the accelerations, weighted by the residuals of each degree of freedom
recipe            from records to equations, always in the same way; the options
by_least_squares  the method ``least-squares``; similar: ``by_instruments``, ``by_recursion``
spread            standard errors from the noise of the signals
noise_bias        bias of least squares caused by noise; ``collinearity``: correlated terms
physical          checks: M symmetric positive, C skew, D positive
outcome           the result as a ``Fit``
================  ==============================================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.regression.drive import drives_of
from gcs_autotune.identify.regression.motion import NU, GriddedMotion, motion_of

__all__ = [
    "NU",
    "GriddedMotion",
    "drives_of",
    "motion_of",
]
