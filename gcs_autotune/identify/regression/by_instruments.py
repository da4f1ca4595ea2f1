"""The method ``instrumental-variables``: least squares without its noise bias.

Least squares is biased because its regressors contain the same noise as the errors of the equations. Instruments are
regressors without this noise. They are calculated from the motion that is simulated with the last estimate (refined
instrumental variables, Young2011). They are updated until the estimate settles. Smoothing and sampling cause the same
errors in the simulated equations, and these are subtracted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.fit_builder import model_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.regression.by_least_squares import refusing_runaways
from gcs_autotune.identify.regression.collinearity import collinearity_doubts
from gcs_autotune.identify.regression.noise_bias import as_simulated
from gcs_autotune.identify.regression.outcome import regression_fit
from gcs_autotune.identify.regression.physical import check_physics, physics_doubts, velocities_visited
from gcs_autotune.identify.regression.recipe import OPTIONS as RECIPE_OPTIONS
from gcs_autotune.identify.regression.recipe import Recipe, recipe_of
from gcs_autotune.identify.regression.solver import Estimate, information
from gcs_autotune.identify.regression.spread import NoiseDraw, excess_doubt, raised
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.settled_stamps import on_settled_stamps
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.identify.signals.whiteness import scores_covariance
from gcs_autotune.models import CoupledModel

__all__ = ["METHOD", "OPTIONS", "fit_axis_by_instruments", "fit_by_instruments"]

Array = NDArray[np.float64]

OPTIONS = RECIPE_OPTIONS
"""Options of ``fit`` that this method reads, with a line of help each."""

ROUNDS = 25
"""Maximum number of rounds, each of which simulates all runs. Five to eight suffice. Project choice."""

SETTLED = 0.01
"""Largest change of the estimate in a round, in standard errors, at which it counts as settled. Project choice."""

HALVINGS = 8
"""Maximum number of attempts with half the step, if the model of a step cannot be simulated. Project choice."""


@on_settled_stamps
def fit_by_instruments(case: Case) -> Fit[CoupledModel]:
    """Return the fit of *case* by refined instrumental variables, starting from least squares.

    Exceptions are those of :func:`.fit_by_least_squares`.
    """
    recipe, motions, first, draws = recipe_of(case, robust=case.robust)
    doubts: list[Doubt] = []
    try:
        estimate, rounds = _refined(recipe, case.records, first, draws)
    except NotInformative as error:
        estimate, rounds = first, 0
        doubts.append(
            Doubt(
                "no-instruments",
                f"no instruments could be simulated ({error}). The result is the least-squares estimate, which noise "
                "biases",
                "use output-error, or a form with fewer terms",
            )
        )
    if rounds and not estimate.converged:
        doubts.append(
            Doubt(
                "not-converged",
                f"the instrumental-variable estimate did not converge in {rounds} rounds",
                "fly larger or more varied inputs, or use output-error",
            )
        )
    doubts += collinearity_doubts(estimate)
    missed = excess_doubt(estimate)
    doubts += [] if missed is None else [missed]
    checks = check_physics(model_of(recipe.form, estimate.theta), velocities_visited(motions))
    doubts += physics_doubts(checks)
    extra: dict[str, Any] = {
        "equation": recipe.equation,
        "derivative": recipe.derivative,
        "window": recipe.window,
        "rounds": rounds,
        "least_squares": dict(zip(recipe.form.free, first.free.tolist(), strict=True)),
        "physics": [check.description for check in checks],
        "converged": estimate.converged,
    }
    return regression_fit(case, estimate, motions, "instrumental-variables", doubts, extra)


@dataclass(frozen=True, slots=True, eq=False)
class _Instruments:
    """Errors (n, k) of the equations for the simulated motion, and their Jacobian (n, k, f)."""

    errors: Array
    jacobian: Array


def _simulated(recipe: Recipe, records: Sequence[Segment], theta: Array) -> _Instruments:
    """Return the instruments for the parameters *theta*.

    Raise NotInformative if a run cannot be simulated.
    """
    linearised = recipe.equations(as_simulated(recipe, records, theta)).errors(theta)
    if linearised is None:
        raise NotInformative(f"the inertia matrix of '{recipe.form.name}' became singular")
    return _Instruments(*linearised)


def _refined(
    recipe: Recipe, records: Sequence[Segment], first: Estimate, draws: Sequence[NoiseDraw]
) -> tuple[Estimate, int]:
    equations, f = first.equations, len(first.equations.free)
    theta, trusted = first.theta.copy(), _simulated(recipe, records, first.theta)
    estimate, rounds, base = first, 0, first.errors
    Z, bread = first.jacobian, np.eye(f)
    for rounds in range(1, ROUNDS + 1):
        linearised = equations.errors(theta)
        assert linearised is not None
        base, J = linearised
        errors = base - trusted.errors
        weights = np.ones_like(errors) / np.maximum(np.mean(errors**2, axis=0), 1e-300)
        Z = trusted.jacobian * weights[:, :, None]
        gain = np.einsum("nif,nig->fg", Z, J, optimize=True)
        gain += 1e-9 * np.diag(np.diag(information(trusted.jacobian, weights))) + 1e-300 * np.eye(f)
        scores = np.einsum("nif,ni->nf", Z, errors, optimize=True)
        bread = _inverse(gain)
        meat = scores_covariance([p for p in np.split(scores, list(equations.ends[:-1])) if len(p)])
        covariance = bread @ meat @ bread.T
        step = -bread @ scores.sum(axis=0)
        estimate = Estimate(equations, theta, errors, trusted.jacobian, weights, covariance, converged=False)
        size = np.abs(step) / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        if float(size.max(initial=0.0)) < SETTLED:
            estimate = replace(estimate, converged=True)
            break
        if rounds == ROUNDS:
            break
        theta, trusted = _moved(recipe, records, theta, step)
    return raised(estimate, Z, bread, recipe.errors(draws, theta), base), rounds


def _moved(recipe: Recipe, records: Sequence[Segment], theta: Array, step: Array) -> tuple[Array, _Instruments]:
    """Return *theta* moved by *step*, and the instruments there.

    The step is halved until the model can be simulated.
    """
    for halving in range(HALVINGS):
        there = theta.copy()
        there[: len(step)] += step * 0.5**halving
        try:
            return there, _simulated(recipe, records, there)
        except NotInformative:
            if halving == HALVINGS - 1:
                raise
    raise NotInformative(f"no step from '{recipe.form.name}' leads to a model that can be simulated")


def _inverse(A: Array) -> Array:
    """Return the inverse of a square matrix, scaled against badly chosen units."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(A)), math.sqrt(1e-300)))
    inverse: Array = np.linalg.pinv(A / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)
    return inverse


fit_axis_by_instruments = for_axis(lambda case: refusing_runaways(fit_by_instruments(case)))
"""Function that fits one degree of freedom by instrumental variables.

It rejects models that diverge on their own runs.
"""


METHOD = Method(
    "instrumental-variables",
    "least squares with simulated instruments, which remove the noise bias",
    axis=fit_axis_by_instruments,
    coupled=fit_by_instruments,
    options=OPTIONS,
    bears=frozenset({"stamps"}),
)
