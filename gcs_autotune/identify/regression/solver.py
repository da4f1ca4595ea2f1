"""Least squares of the accelerations, the estimator of every method in this package.

The papers solve for the acceleration, ``nu_dot = Phi theta`` (Miskovic2007 (5)-(8), Miskovic2010 (4.17)-(4.22)). The
noise of the acceleration is by far the largest. In this form it is the error of the equation and causes no bias. For a
form, the cost to minimise is ``|M^-1 (M nu_dot + C nu - F)|^2``. For uncoupled rows this cost equals that of (4.15)
after a change of variables. For a full M it is the generalisation. Gauss-Newton minimises it. Each degree of freedom is
weighted by its residual variance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.problems.least_squares import Local, descend, inverse_of
from gcs_autotune.identify.regression.rows import Rows
from gcs_autotune.identify.signals.whiteness import scores_covariance
from gcs_autotune.models import SPECIAL, Form, inertia_matrix, inertia_of, program_of

__all__ = ["Barrier", "Equations", "Estimate", "solve"]

Array = NDArray[np.float64]

ROUNDS = 8
"""Maximum number of rounds in which the equations are weighted by their residuals.

Two to four suffice. Project choice.
"""

SETTLED = 1e-3
"""Relative change of the weights below which the rounds of weighting end. Project choice."""

LEVERAGE = 1e-9
"""Ridge added to the information on each parameter, as a fraction of that information.

Project choice. It affects only parameters that are not excited.
"""

Barrier = Callable[[Array], "Local | None"]
"""Type of a function of all parameters (p,) that returns a cost to add to the sum of squares, None where it is
infinite.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Rows of all stretches for one form.

    - ``E`` (n, k, p + 1): coefficients of the parameters; the last column is the constant part.
    - ``ends``: index of the first row after each stretch.
    - ``free``: indices of the free parameters.
    - ``by_inertia`` (f, k, k): derivative of M by each free parameter.
    """

    form: Form
    E: Array
    ends: tuple[int, ...]
    free: tuple[int, ...]
    by_inertia: Array

    @classmethod
    def of(cls, form: Form, rows: Sequence[Rows]) -> Equations:
        """Return the rows of all stretches as one set of equations.

        Raises
        ------
        UsageError
            Delay, lag or current are free parameters, and the equations are not linear in them.
        """
        odd = [n for n in form.free if n in SPECIAL]
        if odd:
            raise UsageError(
                f"least squares cannot estimate {', '.join(odd)} of '{form.name}', because the equations are not "
                "linear in them. Set them to known values, or use output-error"
            )
        active = program_of(form).active
        base = inertia_matrix(form, np.zeros(len(form.parameters)))
        by = []
        for p in range(len(form.free)):
            one = np.zeros(len(form.parameters))
            one[p] = 1.0
            by.append((inertia_matrix(form, one) - base)[np.ix_(active, active)])
        stack = np.concatenate([r.E for r in rows])
        _check_scale(form, stack)
        ends = tuple(int(e) for e in np.cumsum([len(r.E) for r in rows]))
        return cls(form, stack, ends, tuple(range(len(form.free))), np.array(by))

    def inertia(self, theta: Array) -> Array:
        """Return the inertia matrix M (k, k) for the parameters *theta*."""
        active = program_of(self.form).active
        M: Array = inertia_matrix(self.form, theta)[np.ix_(active, active)]
        return M

    def errors(self, theta: Array) -> tuple[Array, Array] | None:
        """Return the acceleration errors (n, k) and their Jacobian (n, k, f), or None if M is singular."""
        M = self.inertia(theta)
        size = np.sqrt(np.maximum(np.abs(np.diag(M)), 1e-300))
        if not np.linalg.cond(M / np.outer(size, size)) < 1e10:
            return None
        inverse = np.linalg.inv(M)
        e = (self.E @ np.append(theta, 1.0)) @ inverse.T
        moved = np.einsum("fij,nj->nif", self.by_inertia, e, optimize=True)
        J = np.einsum("ij,njf->nif", inverse, self.E[:, :, list(self.free)] - moved, optimize=True)
        return e, J


def _check_scale(form: Form, E: Array) -> None:
    """Raise UsageError for equations without a known term, which determine only ratios of their parameters."""
    f = len(form.free)
    theta = np.array([form.known.get(n, 0.0) for n in form.parameters] + [1.0])
    scaled = np.any((E @ theta) != 0.0, axis=0)
    uses = np.any(E[:, :, :f] != 0.0, axis=0)
    while True:
        known = uses[scaled].any(axis=0)
        reached = scaled | (uses & known).any(axis=1)
        if np.array_equal(reached, scaled):
            break
        scaled = reached
    lost = [d for d, has, any_free in zip(form.dofs, scaled, uses.any(axis=1), strict=True) if any_free and not has]
    if lost:
        raise UsageError(
            f"the equation of {' and '.join(lost)} in '{form.name}' has no known force and no known parameter. Only "
            "ratios of its parameters can be estimated. Set one of them to a known value, for example its inertia"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Result of least squares.

    - ``theta`` (p,): all parameters.
    - ``errors`` (n, k), ``jacobian`` (n, k, f): errors of the accelerations and their derivatives.
    - ``weights`` (n, k): inverse variance of each error, lower for outliers.
    - ``covariance`` (f, f): covariance of the free parameters, robust to coloured residuals.
    - ``converged``: whether the iteration converged.
    - ``excess`` (k,): rms of the errors relative to that caused by the noise of the signals, if known.
    """

    equations: Equations
    theta: Array
    errors: Array
    jacobian: Array
    weights: Array
    covariance: Array
    converged: bool
    excess: Array | None = None

    @property
    def free(self) -> Array:
        """Values of the free parameters (f,)."""
        return self.theta[: len(self.equations.free)]

    @property
    def information(self) -> Array:
        """Information matrix ``J' W J`` (f, f)."""
        return information(self.jacobian, self.weights)


def information(J: Array, weights: Array) -> Array:
    """Return the information matrix ``J' W J`` for J (n, k, f) and weights (n, k)."""
    flat = (J * np.sqrt(weights)[:, :, None]).reshape(-1, J.shape[2])
    gram: Array = flat.T @ flat
    return gram


def solve(
    equations: Equations, starts: Sequence[Array], *, robust: bool = False, barrier: Barrier | None = None
) -> Estimate:
    """Return the least-squares estimate with the lowest cost from any of *starts*, each of which has all parameters
    (p,).

    robust : whether to use the weights of the soft-L1 loss against outliers.

    Raises
    ------
    NotInformative
        No start has a regular inertia matrix, or there are fewer rows than parameters.
    """
    n, k = equations.E.shape[:2]
    f = len(equations.free)
    if n * k < f + 1:
        raise NotInformative(f"{n} rows do not determine {f} parameters of '{equations.form.name}'. Use longer runs")
    best: tuple[float, Estimate] | None = None
    for start in starts:
        candidate = _from(equations, start, robust, barrier)
        if candidate is not None:
            level = float(np.sum(np.log(np.maximum(np.mean(candidate.errors**2, axis=0), 1e-300))))
            if best is None or level < best[0] - 1e-9:
                best = (level, candidate)
    if best is None:
        raise NotInformative(
            f"the accelerations of '{equations.form.name}' do not follow from its inputs, so no inertia could be "
            "estimated. Check that inputs and motion belong together"
        )
    estimate = best[1]
    return replace(estimate, covariance=_covariance(estimate))


def _from(equations: Equations, start: Array, robust: bool, barrier: Barrier | None) -> Estimate | None:
    theta, f = start.copy(), len(equations.free)
    linearised = equations.errors(theta)
    if linearised is None:
        return None
    weights = _weights(linearised[0], robust)
    converged = False
    for _ in range(ROUNDS):
        at = weights

        def local(x: Array, w: Array = at) -> Local | None:
            full = np.concatenate([x, theta[f:]])
            there = equations.errors(full)
            extra = barrier(full) if barrier is not None else None
            if there is None or (barrier is not None and extra is None):
                return None
            e, J = there
            curvature = information(J, w)
            curvature = curvature + LEVERAGE * np.diag(np.diag(curvature))
            here = Local(float(np.sum(w * e * e)), np.einsum("nif,ni->f", J, w * e, optimize=True), curvature)
            return here if extra is None else _sum(here, extra)

        minimum = descend(local, theta[:f], np.full(f, -np.inf), np.full(f, np.inf))
        if minimum is None:
            return None
        theta[:f] = minimum.x
        linearised = equations.errors(theta)
        if linearised is None:
            return None
        fresh = _weights(linearised[0], robust)
        change = float(np.max(np.abs(np.log(np.mean(fresh, axis=0) / np.mean(weights, axis=0)))))
        weights, converged = fresh, minimum.converged
        if change < SETTLED:
            break
    e, J = linearised
    return Estimate(equations, theta, e, J, weights, np.zeros((f, f)), converged)


def _sum(a: Local, b: Local) -> Local:
    return Local(a.cost + b.cost, a.gradient + b.gradient, a.curvature + b.curvature)


def _weights(e: Array, robust: bool) -> Array:
    variance = np.mean(e**2, axis=0) if not robust else (1.4826 * np.median(np.abs(e), axis=0)) ** 2
    variance = np.maximum(variance, 1e-12 * max(float(variance.max()), 1e-290))
    w = np.ones_like(e) / variance
    return w / np.sqrt(1.0 + e**2 / variance) if robust else w


def _covariance(estimate: Estimate) -> Array:
    """Return the covariance of the free parameters, robust to coloured residuals.

    It is a sandwich of the information and the covariance of the scores. Each stretch is a separate series.
    """
    bread = inverse_of(estimate.information)
    scores = np.einsum("nif,ni->nf", estimate.jacobian, estimate.weights * estimate.errors, optimize=True)
    parts = np.split(scores, list(estimate.equations.ends[:-1]))
    covariance: Array = bread @ scores_covariance([p for p in parts if len(p)]) @ bread
    return covariance


def row_starts(equations: Equations) -> list[Array]:
    """Return a list of start values (p,): those of the form, if any, and those of two methods.

    The first method is least squares of the forces. It underestimates inertia if accelerations are noisy. The second
    method regresses each row's acceleration on all other terms, as in Miskovic2007 (8). Noise of the acceleration does
    not bias the result, because the inertia comes from the gain of the inputs.
    """
    form, f = equations.form, len(equations.free)
    theta = np.array([{**form.start, **form.known}.get(n, 0.0) for n in form.parameters])
    given = np.append(np.where(np.arange(len(theta)) < f, 0.0, theta), 1.0)
    y = -(equations.E @ given).ravel()
    A = equations.E[:, :, :f].reshape(-1, f)
    starts = [theta.copy()] if form.start else []
    forces = theta.copy()
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    forces[:f] = np.linalg.lstsq(A / scale, y, rcond=1e-10)[0] / scale
    starts += [forces, _by_rows(equations, forces)]
    return starts


def _by_rows(equations: Equations, theta: Array) -> Array:
    """Return *theta* with each diagonal inertia from a regression of its own acceleration."""
    form, out = equations.form, theta.copy()
    active = program_of(form).active
    for p, name in enumerate(form.free):
        inertia = inertia_of(name)
        if inertia is None or inertia.row != inertia.column:
            continue
        row = int(np.flatnonzero(active == inertia.row)[0])
        E = equations.E[:, row]
        own = E[:, p]
        fixed = E @ np.append(np.where(np.arange(len(theta)) < len(form.free), 0.0, theta), 1.0)
        others = [q for q in equations.free if q != p and np.any(E[:, q] != 0.0)]
        if not np.any(fixed != 0.0):
            continue
        A = np.column_stack([fixed, *(E[:, q] for q in others)])
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        c = np.linalg.lstsq(A / scale, -own, rcond=1e-10)[0] / scale
        if abs(c[0]) > 0.0:
            out[p] = 1.0 / c[0]
            out[others] = c[1:] / c[0]
    return out
