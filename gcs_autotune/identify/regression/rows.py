"""The equations of motion as rows that are linear in the parameters, for any form.

``M nu_dot + C(nu) nu - F(nu, eta, inputs) = sum_p theta_p E_p + E_0``: the regression matrices (4.17)-(4.22) of the
Miskovic2010, eq. (8) of Miskovic2007 and (25) of ZhaoUSV are special cases. Two ways to use them:

* ``derivative``: as they stand, with the smoothed accelerations;
* ``integral``: multiplied by a bump function and integrated over short windows. By parts the derivative moves from the
  measured velocity to the known bump (Shinbrot1957; modulating functions), so noise is averaged, not amplified, and
  the kinks that input jumps leave in the velocity do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.regression.drive import drives_of
from gcs_autotune.identify.regression.motion import Motion
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form, kernel
from gcs_autotune.models.coupled.kernel import Program
from gcs_autotune.models.coupled.program import program_of

__all__ = ["EQUATIONS", "Rows", "force_columns", "inertia_columns", "rows_of"]

Array = NDArray[np.float64]

EQUATIONS = ("integral", "derivative")
"""Values of the option ``equation``."""

OVERLAP = 6
"""Windows that cover each instant. Chosen: more of them tell nothing new."""

EDGE = 2
"""Grid points left out at either end, where a smoothed derivative is worst."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The equations of one stretch: ``E`` (n, k, p + 1), the last column without a parameter, at times ``t`` (n,)."""

    run: str
    t: Array
    E: Array


def rows_of(record: Segment, form: Form, motion: Motion, equation: str, window: float) -> Rows:
    """Return the rows of one stretch.

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
    """Return the weighted sums of *values* (n, ...) over windows, one every *every* points."""
    views = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=0)[::every]
    return np.asarray(views @ weights, dtype=np.float64)


def inertia_columns(form: Form, nu_dot: Array) -> Array:
    """Return what accelerations (n, 6) contribute to the rows (n, k, p + 1)."""
    program = program_of(form)
    E = np.zeros((len(nu_dot), 6, len(form.parameters) + 1))
    for (row, column, par), coefficient in zip(program.inertia, program.inertia_coefs, strict=True):
        E[:, row, par] += coefficient * nu_dot[:, column]
    return E[:, program.active]


def force_columns(form: Form, nu: Array, eta: Array, drives: Array) -> Array:
    """Return ``C(nu) nu - F`` per parameter (n, k, p + 1)."""
    program = program_of(form)
    E = np.zeros((len(nu), 6, len(form.parameters) + 1))
    for j, (row, par, coefficient, factors) in enumerate(
        zip(program.rows, program.pars, program.coefs, program.factors, strict=True)
    ):
        product = coefficient * drives[:, j]
        for code in factors:
            if 0 <= code < kernel.INPUT:
                product = product * _factor(int(code), nu, eta)
        E[:, row, par] -= product
    if program.coriolis:
        _add_coriolis(program, nu, E)
    return E[:, program.active]


def _factor(code: int, nu: Array, eta: Array) -> Array:
    if code < kernel.NU_SIZE:
        return nu[:, code]
    if code < kernel.ETA:
        return np.abs(nu[:, code - kernel.NU_SIZE])
    if code < kernel.SIN_PHI:
        return eta[:, code - kernel.ETA]
    return np.sin(eta[:, 3 if code == kernel.SIN_PHI else 4])


def _add_coriolis(program: Program, nu: Array, E: Array) -> None:
    """Add ``C(nu) nu = [nu_2 x a; nu_1 x a + nu_2 x b]`` with momenta ``(a, b) = M nu`` (Fossen2011, (3.46))."""
    for (row, column, par), coefficient in zip(program.inertia, program.inertia_coefs, strict=True):
        momentum = np.zeros((len(nu), 3))
        momentum[:, row % 3] = coefficient * nu[:, column]
        turned = np.cross(nu[:, 3:], momentum)
        if row < 3:
            E[:, :3, par] += turned
            E[:, 3:, par] += np.cross(nu[:, :3], momentum)
        else:
            E[:, 3:, par] += turned
