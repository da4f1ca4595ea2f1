"""The equations of motion as rows that are linear in the parameters, for any form.

They are ``M nu_dot + C(nu) nu - F(nu, eta, inputs) = sum_p theta_p E_p + E_0``. The regression matrices of
Miskovic2010, eq. (4.17)-(4.22), of Miskovic2007, eq. (8), and of ZhaoUSV, eq. (25) are special cases. The code uses
NumPy over all stamps at once, independently of the compiled kernel, which has the same terms. Tests compare the two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.form import Form
from gcs_autotune.models.coupled.program import program_of

__all__ = ["Balance", "balance_of", "force_columns", "inertia_columns"]

Array = NDArray[np.float64]


class Balance(NamedTuple):
    """Force balance of the equations of motion.

    - ``F - C nu - M nu_dot`` (s, k), which is zero if the equations are satisfied.
    - Derivatives (s, k, p) by the parameters that enter linearly. Columns of special parameters have no meaning.
    """

    values: Array
    by: Array


def balance_of(program: kernel.Program, theta: Array, X: Array, nu_dot: Array, inputs: Array) -> Balance:
    """Return the force balance for the states *X* (s, n), the accelerations *nu_dot* (s, k) and the *inputs* (s, m)."""
    full = np.zeros((len(X), 12))
    here = program.column >= 0
    full[:, here] = X[:, program.column[here]]
    if program.depth >= 0 and program.column[8] < 0:
        full[:, 8] = inputs[:, program.depth]
    acceleration = np.zeros((len(X), 6))
    acceleration[:, program.active] = nu_dot
    acting = X[:, 2 * len(program.active) :] if program.lag >= 0 else inputs
    drives = _products(program, acting)
    for term, row in enumerate(program.rows):
        if program.payload[row] >= 0:  # the same forces on so many times the inertia
            drives[:, term] /= inputs[:, program.payload[row]]
    E = _forces(program, theta, full[:, :6], full[:, 6:], drives) + _inertia(program, len(theta), acceleration)
    return Balance(-(E[:, :, :-1] @ theta + E[:, :, -1]), -E[:, :, :-1])


def _products(program: kernel.Program, inputs: Array) -> Array:
    """Return the product of the input factors of every term (s, T); 1 for none."""
    out = np.ones((len(inputs), len(program.rows)))
    for j, factors in enumerate(program.factors):
        for code in factors:
            if code >= kernel.INPUT_SIZE:
                out[:, j] *= np.abs(inputs[:, code - kernel.INPUT_SIZE])
            elif code >= kernel.INPUT:
                out[:, j] *= inputs[:, code - kernel.INPUT]
    return out


def inertia_columns(form: Form, nu_dot: Array) -> Array:
    """Return the contribution of the accelerations *nu_dot* (n, 6) to the rows (n, k, p + 1).

    The last column has no parameter.
    """
    return _inertia(program_of(form), len(form.parameters), nu_dot)


def _inertia(program: kernel.Program, parameters: int, nu_dot: Array) -> Array:
    E = np.zeros((len(nu_dot), 6, parameters + 1))
    for (row, column, par), coefficient in zip(program.inertia, program.inertia_coefs, strict=True):
        E[:, row, par] += coefficient * nu_dot[:, column]
    return E[:, program.active]


def force_columns(form: Form, nu: Array, eta: Array, drives: Array) -> Array:
    """Return ``C(nu) nu - F`` per parameter (n, k, p + 1).

    nu, eta : (n, 6) velocities and positions.
    drives : (n, T) product of the input factors of each term.

    Other parameters of a term (walls, bottom, reach) have the known values of the form.
    """
    known = np.array([form.known.get(n, 0.0) for n in form.parameters])
    return _forces(program_of(form), known, nu, eta, drives)


def _forces(program: kernel.Program, theta: Array, nu: Array, eta: Array, drives: Array) -> Array:
    E = np.zeros((len(nu), 6, len(theta) + 1))
    for j, (row, par, scale, coefficient, factors) in enumerate(
        zip(program.rows, program.pars, program.scales, program.coefs, program.factors, strict=True)
    ):
        product = coefficient * drives[:, j]
        if scale >= 0:
            product = theta[scale] * product
        for code in factors:
            if 0 <= code < kernel.INPUT:
                product = product * _factor(int(code), program, theta, nu, eta)
        E[:, row, par] -= product
    if program.coriolis:
        _add_coriolis(program, nu, E)
    return E[:, program.active]


def _factor(code: int, program: kernel.Program, theta: Array, nu: Array, eta: Array) -> Array:
    if code < kernel.NU_SIZE:
        return nu[:, code]
    if code < kernel.ETA:
        return np.abs(nu[:, code - kernel.NU_SIZE])
    if code < kernel.SIN_PHI:
        return eta[:, code - kernel.ETA]
    if code == kernel.NEAR:
        reach = theta[program.reach] if program.reach >= 0 else 1.0
        bottom = theta[program.bottom] if program.bottom >= 0 else 0.0
        return np.asarray(np.exp(np.minimum((eta[:, 2] - bottom) / reach, kernel.STEEPEST)))
    if code == kernel.COS_PSI:
        return np.cos(eta[:, 5])
    angle = {kernel.SIN_PHI: 3, kernel.SIN_THETA: 4, kernel.SIN_PSI: 5}[code]
    return np.sin(eta[:, angle])


def _add_coriolis(program: kernel.Program, nu: Array, E: Array) -> None:
    """Add ``C(nu) nu = [nu_2 x a; nu_1 x a + nu_2 x b]`` with momenta ``(a, b) = M nu`` (Fossen2011, eq. (3.46))."""
    for (row, column, par), coefficient in zip(program.inertia, program.inertia_coefs, strict=True):
        momentum = np.zeros((len(nu), 3))
        momentum[:, row % 3] = coefficient * nu[:, column]
        turned = np.cross(nu[:, 3:], momentum)
        if row < 3:
            E[:, :3, par] += turned
            E[:, 3:, par] += np.cross(nu[:, :3], momentum)
        else:
            E[:, 3:, par] += turned
