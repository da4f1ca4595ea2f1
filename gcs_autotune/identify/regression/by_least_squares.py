"""The method ``least-squares``: linear regression of the equations of motion, for any form."""

from __future__ import annotations

from typing import Any

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.free_run import RUNS_AWAY
from gcs_autotune.identify.regression.barrier import solve_physical
from gcs_autotune.identify.regression.collinearity import collinearity_doubts, inflation_factors
from gcs_autotune.identify.regression.noise_bias import noise_bias, noise_bias_doubt, with_bias
from gcs_autotune.identify.regression.outcome import fit_of, model_of
from gcs_autotune.identify.regression.physical import check_physics, physics_doubts, velocities_visited
from gcs_autotune.identify.regression.recipe import OPTIONS as RECIPE_OPTIONS
from gcs_autotune.identify.regression.recipe import recipe_of
from gcs_autotune.identify.regression.spread import excess_doubt
from gcs_autotune.identify.result import Doubt, Fit
from gcs_autotune.identify.settled_stamps import on_settled_stamps

__all__ = ["OPTIONS", "fit_axis_by_least_squares", "fit_by_least_squares", "refusing_runaways"]

OPTIONS = (*RECIPE_OPTIONS, ("physical", "True: M and D(nu) held positive definite (constrained least squares)"))
"""Options of ``fit`` read by this method."""


@on_settled_stamps
def fit_by_least_squares(case: CoupledCase) -> Fit:
    """Fit *case* by least squares; Miskovic2010, eq. (4.10)-(4.22), Miskovic2007 (5)-(11), ZhaoUSV (19)-(26).

    Raises
    ------
    UsageError
        The form has a free delay, lag or current, or an option cannot have its value.
    MissingChannel, NotInformative
        Not all velocities of the form can be had from the runs, or too little of them.
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
        "physics": [check.told for check in checks],
        "converged": estimate.converged,
    }
    return fit_of(case, with_bias(estimate, bias), motions, "least-squares", doubts, extra)


def refusing_runaways(fit: Fit) -> Fit:
    """Return *fit*; for a choice between structures a model that cannot be simulated is none.

    Raises
    ------
    NotInformative
        The model found runs away on its own runs.
    """
    for doubt in fit.doubts:
        if doubt.slug == RUNS_AWAY:
            raise NotInformative(f"{doubt.cause}; {doubt.cure}")
    return fit


fit_axis_by_least_squares = for_axis(lambda case: refusing_runaways(fit_by_least_squares(case)))
"""Least squares for one degree of freedom, drag ``linear`` (4.20), ``nonlinear`` (4.22) or ``affine``."""
