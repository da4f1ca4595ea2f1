"""M and D positive: checked, and held by the constrained fit."""

from __future__ import annotations

import numpy as np
import pytest
from regression_plants import TRUTH, coupled, velocity_run
from scipy.optimize import minimize

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import fit
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.regression.by_least_squares import solve_physical
from gcs_autotune.identify.regression.physical import check_physics, velocities_visited
from gcs_autotune.identify.regression.recipe import recipe_of
from gcs_autotune.identify.signals.preparation import prepare_form
from gcs_autotune.models.coupled import CoupledModel, Form

SPEEDS = np.array([[0.5, 0.1, 0.0, 0.0, 0.0, 0.6], [-0.4, 0.05, 0.0, 0.0, 0.0, -0.5]])


def verdicts(form: Form, **values: float) -> dict[str, bool]:
    model = CoupledModel(form, {**TRUTH, **values})
    return {c.what: c.holds for c in check_physics(model, SPEEDS)}


def test_the_papers_model_passes_every_check():
    assert verdicts(coupled()) == {"M symmetric": True, "M positive": True, "C skew": True, "D positive": True}


def test_each_physical_law_can_fail_alone():
    assert not verdicts(coupled("Y_rdot", "N_vdot"), Y_rdot=-0.1, N_vdot=0.2)["M symmetric"]
    assert not verdicts(coupled("Y_rdot"), Y_rdot=-1.0)["M positive"]
    assert not verdicts(coupled("X_vr"), X_vr=3.0)["C skew"]
    assert verdicts(coupled("X_vr", "Y_ur"), X_vr=3.0, Y_ur=-3.0)["C skew"]
    assert not verdicts(coupled("Y_r", "N_v"), Y_r=2.0, N_v=2.0)["D positive"]
    assert not verdicts(coupled("X_uu"), X_u=-1.0, X_uu=3.0)["D positive"]
    assert verdicts(coupled("X_uu"), X_u=-2.0, X_uu=3.0)["D positive"]


def weak() -> tuple[list, Form]:
    """Runs too short and noisy to see the damping's couplings."""
    trials = [velocity_run(3, 0.8, 0.02, 0.15, duration=12.0)]
    return trials, coupled("Y_r", "N_v", "X_uu")


def test_the_constrained_fit_is_physical_where_the_free_one_is_not():
    trials, form = weak()
    free = fit(trials, form, "least-squares")
    held = fit(trials, form, "least-squares", physical=True)
    assert any(d.slug == "not-physical" for d in free.doubts)
    assert not any(d.slug == "not-physical" for d in held.doubts)
    assert np.linalg.eigvalsh(held.model.inertia).min() > 0.0


def test_the_constrained_fit_equals_a_physical_free_fit():
    trials = [velocity_run(0, 2.0, 0.06, 0.01)]
    free, held = (fit(trials, coupled(), "least-squares", physical=p) for p in (False, True))
    assert set(held.parameters) >= set(TRUTH)
    for name in TRUTH:
        assert held.parameters[name].value == pytest.approx(free.parameters[name].value, rel=1e-3)


def test_the_barrier_method_agrees_with_sequential_quadratic_programming():
    trials, form = weak()
    records = tuple(r for t in trials for r in prepare_form(t, form))
    case = Case(form=form, records=records, delay=0.0, names=("weak",))
    _, motions, first, _ = recipe_of(case)
    visited = velocities_visited(motions)
    held = solve_physical(first.equations, first.theta, visited)
    weights = held.weights[0]
    scale = np.maximum(np.abs(held.theta), 1e-3)

    def cost(z: np.ndarray) -> float:
        found = held.equations.errors(z * scale)
        return 1e9 if found is None else float(np.sum(weights * found[0] ** 2))

    def minors(z: np.ndarray) -> np.ndarray:
        model = CoupledModel(form, dict(zip(form.free, z * scale, strict=True)))
        rows = []
        for nu in visited:
            D = model.linear_damping.copy()
            D[0, 0] -= model["X_uu"] * abs(nu[0])
            S = 0.5 * (D + D.T)
            rows += [S[0, 0], S[1, 1], S[2, 2], S[1, 1] * S[2, 2] - S[1, 2] ** 2]
        return np.array([*rows, *np.diag(model.inertia)])

    answer = minimize(
        cost, held.theta / scale, method="SLSQP", constraints={"type": "ineq", "fun": minors},
        options={"maxiter": 300, "ftol": 1e-9},
    )  # fmt: skip
    assert cost(held.theta / scale) <= float(answer.fun) * (1.0 + 2e-3)
    assert minors(held.theta / scale).min() > -1e-9


def test_known_values_that_are_not_physical_are_rejected():
    trials = [velocity_run(0, 2.0, 0.06, 0.01)]
    with pytest.raises(UsageError, match="positive definite"):
        fit(trials, coupled().fixing({"Y_v": 5.0}), "least-squares", physical=True)
