"""Positive definite M and D(nu) as constraints of the least squares: a logarithmic barrier, and a point inside it.

M and D are linear in the parameters, so the sets where they are positive definite are convex and ``-log det`` is their
self-concordant barrier (Nesterov1994). With its weight lowered step by step the minimum goes to that
of the constrained problem; see docs/decisions/0005. By itself ``-log det`` rewards growth without end where the runs
say nothing; with the trace against the step before it is the divergence ``tr(A_0^-1 A) - log det A`` (James1961),
convex too and smallest at ``A = A_0``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.least_squares import Local
from gcs_autotune.identify.regression.physical import damping_slopes
from gcs_autotune.identify.regression.solver import Barrier, Equations, Estimate, solve
from gcs_autotune.models import Form, inertia_matrix, program_of

__all__ = ["barrier_of", "feasible_start", "solve_physical"]

Array = NDArray[np.float64]

WEIGHTS = (1.0, 1e-2, 1e-4, 1e-6)
"""Weights of the barrier against twice the log-likelihood: the last costs a millionth of a standard error squared."""


def solve_physical(equations: Equations, theta: Array, visited: Array, *, robust: bool = False) -> Estimate:
    """Return the least-squares estimate with M and D(nu) positive definite over *visited* (m, 6).

    Raises
    ------
    UsageError
        What the form holds as known makes that impossible.
    """
    start = feasible_start(equations.form, theta, visited)
    for weight in WEIGHTS:
        barrier = barrier_of(equations.form, visited, weight, start)
        estimate = solve(equations, [start], robust=robust, barrier=barrier)
        start = estimate.theta
    return estimate


def barrier_of(form: Form, visited: Array, weight: float, near: Array) -> Barrier:
    """Return the divergences of M and, in the mean, D(nu) from those at *near*, as a cost of all parameters (p,).

    near : (p,), a point where both are positive definite.
    """
    stacks = [s for s in _stacks(form, visited) if s.shape[-1]]
    pulls = [np.linalg.inv(np.tensordot(np.append(near, 1.0), s, axes=1)) for s in stacks]
    f = len(form.free)

    def barrier(theta: Array) -> Local | None:
        value, gradient, curvature = 0.0, np.zeros(f), np.zeros((f, f))
        full = np.append(theta, 1.0)
        for slopes, pull in zip(stacks, pulls, strict=True):
            A = np.tensordot(full, slopes, axes=1)
            if not _is_positive(A):
                return None
            share = weight / len(A)
            value += share * float(np.einsum("mij,mji->", pull, A) - np.sum(np.linalg.slogdet(A)[1]))
            through = np.linalg.inv(A) @ slopes[:f]
            drawn = np.einsum("mij,pmji->p", pull, slopes[:f], optimize=True)
            gradient += 0.5 * share * (drawn - np.einsum("pmii->p", through))
            curvature += 0.5 * share * np.einsum("pmij,qmji->pq", through, through, optimize=True)
        return Local(value, gradient, curvature)

    return barrier


def _stacks(form: Form, visited: Array) -> tuple[Array, Array]:
    """Return the symmetric parts of M's and D's derivatives (p + 1, m, d, d) by every parameter."""
    inertia, damping = _inertia_slopes(form), damping_slopes(form, visited)[1]
    return 0.5 * (inertia + inertia.swapaxes(-1, -2)), 0.5 * (damping + damping.swapaxes(-1, -2))


def _is_positive(A: Array) -> bool:
    """Return whether all of A (m, d, d) are positive definite, whatever their units."""
    size = np.sqrt(np.maximum(np.abs(np.diagonal(A, axis1=1, axis2=2)), 1e-150))
    return bool(np.linalg.eigvalsh(A / size[:, :, None] / size[:, None, :]).min() > 1e-12)


def _feasible(form: Form, theta: Array, visited: Array) -> bool:
    full = np.append(theta, 1.0)
    return all(_is_positive(np.tensordot(full, s, axes=1)) for s in _stacks(form, visited) if s.shape[-1])


def _inertia_slopes(form: Form) -> Array:
    """Return M's derivative (p + 1, 1, k, k) by every parameter; the last is what belongs to none."""
    active, p = program_of(form).active, len(form.parameters)
    base = inertia_matrix(form, np.zeros(p))
    slopes = [inertia_matrix(form, one) - base for one in np.eye(p)] + [base]
    return np.array(slopes)[:, None][:, :, active][:, :, :, active]


def feasible_start(form: Form, theta: Array, visited: Array) -> Array:
    """Return *theta*, or, when it breaks a constraint, a point near it that breaks none: couplings gone, signs mended.

    Raises
    ------
    UsageError
        Known values alone break the constraint.
    """
    if _feasible(form, theta, visited):
        return theta
    out, f = theta.copy(), len(form.free)
    for slopes in _stacks(form, visited):
        if not slopes.shape[-1]:
            continue
        typical = np.mean(slopes, axis=1)
        for p in range(f):
            diagonal = np.diag(typical[p])
            if not np.any(typical[p]):
                continue
            if np.any(diagonal):
                out[p] = np.sign(diagonal[np.argmax(np.abs(diagonal))]) * max(abs(theta[p]), 1e-6)
            else:
                out[p] = 0.0
    if not _feasible(form, out, visited):
        raise UsageError(
            f"physical: the known values of '{form.name}' leave no positive definite M and D(nu); free some of them"
        )
    return out
