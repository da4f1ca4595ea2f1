"""The method ``least-squares``: linear regression of the equations of motion, for any form.

With the option ``physical``, a logarithmic barrier keeps M and D(nu) positive definite. Both are linear in the
parameters, so the sets where they are positive definite are convex. ``-log det`` is their self-concordant barrier
(Nesterov1994). As its weight decreases step by step, the minimum approaches that of the constrained problem; see
docs/decisions/0005.

``-log det`` alone decreases without limit as parameters grow on which the runs contain no information. Adding the trace
relative to the previous step turns the barrier into the divergence ``tr(A_0^-1 A) - log det A`` (James1961). The
divergence is convex too, and smallest at ``A = A_0``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.fit_builder import model_of
from gcs_autotune.identify.free_run import RUNS_AWAY
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.problems.least_squares import Local
from gcs_autotune.identify.regression.collinearity import collinearity_doubts, inflation_factors
from gcs_autotune.identify.regression.noise_bias import noise_bias, noise_bias_doubt, with_bias
from gcs_autotune.identify.regression.outcome import regression_fit
from gcs_autotune.identify.regression.physical import check_physics, damping_slopes, physics_doubts, velocities_visited
from gcs_autotune.identify.regression.recipe import OPTIONS as RECIPE_OPTIONS
from gcs_autotune.identify.regression.recipe import recipe_of
from gcs_autotune.identify.regression.solver import Barrier, Equations, Estimate, solve
from gcs_autotune.identify.regression.spread import excess_doubt
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.settled_stamps import on_settled_stamps
from gcs_autotune.models import CoupledModel, Form, inertia_matrix, program_of

__all__ = [
    "METHOD",
    "OPTIONS",
    "barrier_of",
    "feasible_start",
    "fit_axis_by_least_squares",
    "fit_by_least_squares",
    "refusing_runaways",
    "solve_physical",
]

OPTIONS = (
    *RECIPE_OPTIONS,
    ("physical", "True: M and D(nu) are constrained to be positive definite (constrained least squares)"),
)
"""Options of ``fit`` that this method reads, with a line of help each."""


@on_settled_stamps
def fit_by_least_squares(case: Case) -> Fit[CoupledModel]:
    """Return the fit of *case* by least squares of the equations of motion.

    Sources: Miskovic2010, eq. (4.10)-(4.22), Miskovic2007 (5)-(11), ZhaoUSV (19)-(26).

    Raises
    ------
    UsageError
        The form has a free delay, lag or current, or an option has an invalid value.
    MissingChannel, NotInformative
        The runs do not contain all velocities of the form, or too few samples of them.
    """
    recipe, motions, estimate, draws = recipe_of(case, robust=case.robust)
    visited = velocities_visited(motions)
    if case.options.get("physical", False):
        held = solve_physical(estimate.equations, estimate.theta, visited, robust=case.robust)
        estimate = recipe.with_spread(held, draws)
    bias = noise_bias(estimate, recipe, case.records, motions, robust=case.robust)
    doubts: list[Doubt] = collinearity_doubts(estimate)
    missed = excess_doubt(estimate)
    doubts += [] if missed is None else [missed]
    noisy = noise_bias_doubt(estimate, bias)
    if noisy is not None:
        doubts.append(noisy)
    checks = check_physics(model_of(recipe.form, estimate.theta), visited)
    doubts += physics_doubts(checks)
    names = recipe.form.free
    extra: dict[str, Any] = {
        "equation": recipe.equation,
        "derivative": recipe.derivative,
        "window": recipe.window,
        "noise_bias": dict(zip(names, bias.tolist(), strict=True)),
        "variance_inflation": dict(zip(names, inflation_factors(estimate.information).tolist(), strict=True)),
        "physics": [check.description for check in checks],
        "converged": estimate.converged,
    }
    return regression_fit(case, with_bias(estimate, bias), motions, "least-squares", doubts, extra)


def refusing_runaways(fit: Fit[CoupledModel]) -> Fit[CoupledModel]:
    """Return *fit* unchanged, or raise NotInformative if its model cannot be simulated.

    A comparison of structures then excludes the model.

    Raises
    ------
    NotInformative
        The model diverges on its own runs.
    """
    for doubt in fit.doubts:
        if doubt.slug == RUNS_AWAY:
            raise NotInformative(f"{doubt.cause}; {doubt.cure}")
    return fit


fit_axis_by_least_squares = for_axis(lambda case: refusing_runaways(fit_by_least_squares(case)))
"""Function that fits one degree of freedom by least squares. It rejects models that diverge on their own runs.

Drag is ``linear`` (Miskovic2010 (4.20)), ``nonlinear`` (4.22) or ``affine``.
"""


Array = NDArray[np.float64]

WEIGHTS = (1.0, 1e-2, 1e-4, 1e-6)
"""Successive weights of the barrier, relative to twice the log-likelihood.

Project choice. At the last one the barrier adds only about a millionth to the cost, in units of a squared standard
error.
"""


def solve_physical(equations: Equations, theta: Array, visited: Array, *, robust: bool = False) -> Estimate:
    """Return the least-squares estimate for which M and D(nu) are positive definite.

    theta : (p,) start values of all parameters.
    visited : (m, 6) velocities at which D must be positive definite.

    Raises
    ------
    UsageError
        The known values of the form make this impossible.
    """
    start = feasible_start(equations.form, theta, visited)
    for weight in WEIGHTS:
        barrier = barrier_of(equations.form, visited, weight, start)
        estimate = solve(equations, [start], robust=robust, barrier=barrier)
        start = estimate.theta
    return estimate


def barrier_of(form: Form, visited: Array, weight: float, near: Array) -> Barrier:
    """Return the sum of the divergences of M and D(nu) from their values at *near*, as a function of all parameters
    (p,).

    The divergence of D is the mean over the velocities.

    weight : factor of the sum.
    near : (p,) parameters for which M and D(nu) are positive definite.
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
    """Return the symmetric parts of the derivatives (p + 1, m, d, d) of M and D by every parameter."""
    inertia, damping = _inertia_slopes(form), damping_slopes(form, visited)[1]
    return 0.5 * (inertia + inertia.swapaxes(-1, -2)), 0.5 * (damping + damping.swapaxes(-1, -2))


def _is_positive(A: Array) -> bool:
    """Return whether all matrices in A (m, d, d) are positive definite, in any units."""
    size = np.sqrt(np.maximum(np.abs(np.diagonal(A, axis1=1, axis2=2)), 1e-150))
    return bool(np.linalg.eigvalsh(A / size[:, :, None] / size[:, None, :]).min() > 1e-12)


def _feasible(form: Form, theta: Array, visited: Array) -> bool:
    full = np.append(theta, 1.0)
    return all(_is_positive(np.tensordot(full, s, axes=1)) for s in _stacks(form, visited) if s.shape[-1])


def _inertia_slopes(form: Form) -> Array:
    """Return the derivative (p + 1, 1, k, k) of M by every parameter; the last entry is the constant part."""
    active, p = program_of(form).active, len(form.parameters)
    base = inertia_matrix(form, np.zeros(p))
    slopes = [inertia_matrix(form, one) - base for one in np.eye(p)] + [base]
    return np.array(slopes)[:, None][:, :, active][:, :, :, active]


def feasible_start(form: Form, theta: Array, visited: Array) -> Array:
    """Return *theta* (p,), or else a point near it for which M and D(nu) are positive definite.

    At that point couplings are zero and wrong signs are corrected.

    Raises
    ------
    UsageError
        Known values alone violate a constraint.
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
            f"physical: the known values of '{form.name}' allow no positive definite M and D(nu). Free some of them"
        )
    return out


METHOD = Method(
    "least-squares",
    "linear regression of the equations of motion",
    axis=fit_axis_by_least_squares,
    coupled=fit_by_least_squares,
    options=OPTIONS,
    bears=frozenset({"stamps"}),
)
