"""Least squares, the whole family, for any form whose parameters enter the equations of motion linearly.

:func:`motion_of` and :func:`drives_of` give other linear methods the same motion and inputs.

================  ==============================================================================================
smoothing         value, rate and acceleration of one signal: Savitzky-Golay or a regularised spline
motion            velocities and accelerations of a record on an even grid; drive: its inputs, averaged
rows              the equations as rows linear in the parameters: with accelerations or integrated over windows
solver            least squares of the accelerations, degrees of freedom weighed by what they leave
recipe            records to equations, always alike; the options
by_least_squares  the method ``least-squares``; its kin: by_instruments, by_recursion
spread            standard errors: the noise of the signals followed to the estimate
noise_bias        how far noise has shifted least squares; collinearity: which terms move together
physical          M symmetric positive, C skew, D positive; barrier: the same as constraints
outcome           all that as a ``Fit``
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
