"""Descending to a minimum: the step, its limits, what ends it, and the inverse of an information matrix."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.identify.problems import Local, descend, inverse_of
from gcs_autotune.identify.problems.least_squares import Rules, step_of

A = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]])
BEST = np.array([1.0, -2.0, 0.5])
FREE = np.full(3, np.inf)


def bowl(x: np.ndarray) -> Local:
    """A quadratic cost of 5 at its best."""
    off = x - BEST
    return Local(float(off @ A @ off) + 5.0, A @ off, A)


def test_a_quadratic_converges_in_a_few_steps() -> None:
    found = descend(bowl, np.array([30.0, 30.0, -30.0]), -FREE, FREE)
    assert found is not None
    assert found.x == pytest.approx(BEST, abs=1e-6)
    assert found.cost == pytest.approx(5.0)
    assert found.converged
    assert found.iterations <= 4


def test_a_step_solves_the_damped_normal_equations_and_predicts_its_gain() -> None:
    x = np.array([2.0, 1.0, 1.0])
    here = bowl(x)
    step, expected = step_of(here, x, -FREE, FREE, 0.3)
    assert step == pytest.approx(np.linalg.solve(A + 0.3 * np.diag(np.diag(A)), -here.gradient))
    assert expected == pytest.approx(here.cost - bowl(x + step).cost)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_parameter_on_its_bound_is_held_only_while_the_gradient_points_outwards(side: float) -> None:
    x = np.array([1.0 + side, -2.0, 0.5])  # the best is further in by one
    low, high = (-FREE, FREE)
    outward = np.where(side > 0.0, x, high), np.where(side > 0.0, low, x)
    bound_high, bound_low = (outward[0], low) if side > 0.0 else (high, outward[1])
    inward, _ = step_of(bowl(x), x, bound_low, bound_high, 0.0)
    assert inward[0] == pytest.approx(-side)
    beyond = np.array([1.0 - 0.5 * side, -2.0, 0.5])
    limits = (np.array([0.5 + 1.0 * (side < 0.0), -9.0, -9.0]), np.array([0.5 + 1.0 * (side < 0.0), 9.0, 9.0]))
    held, promised = step_of(bowl(beyond), beyond, *limits, 0.0)
    assert held[0] == 0.0 or np.clip(beyond + held, *limits)[0] == beyond[0]
    assert promised >= 0.0


@pytest.mark.parametrize(("low", "high", "best"), [(1.5, 9.0, 1.5), (-9.0, 0.5, 0.5)])
def test_the_minimum_within_limits_is_found_for_the_other_parameters(low: float, high: float, best: float) -> None:
    found = descend(bowl, np.zeros(3), np.array([low, -9.0, -9.0]), np.array([high, 9.0, 9.0]))
    assert found is not None
    assert found.converged
    assert found.x[0] == best
    rest = np.linalg.solve(A[1:, 1:], A[1:, 1:] @ BEST[1:] - A[1:, 0] * (best - BEST[0]))
    assert found.x[1:] == pytest.approx(rest, abs=1e-6)


def test_a_start_without_a_value_fails_and_a_start_outside_is_clipped() -> None:
    assert descend(lambda x: None, np.zeros(3), -FREE, FREE) is None
    seen: list[np.ndarray] = []

    def watching(x: np.ndarray) -> Local:
        seen.append(x)
        return bowl(x)

    descend(watching, np.full(3, 99.0), -np.ones(3), np.ones(3))
    assert seen[0].tolist() == [1.0, 1.0, 1.0]
    assert np.abs(seen).max() <= 1.0


def test_steps_into_a_region_without_a_value_are_shortened() -> None:
    def walled(x: np.ndarray) -> Local | None:
        return bowl(x) if x[0] > 1.0 - 1e-9 and abs(x[1]) < 50.0 else None

    steep = np.array([40.0, 40.0, 0.0])
    found = descend(walled, steep, -FREE, FREE)
    assert found is not None
    assert found.cost < 5.5


def test_a_curvature_that_is_too_small_is_damped_until_the_cost_falls() -> None:
    calls = 0

    def flat(x: np.ndarray) -> Local:
        nonlocal calls
        calls += 1
        return Local(float(x[0] ** 2) + 1.0, np.array([x[0]]), np.array([[0.1]]))  # ten times too flat

    found = descend(flat, np.array([8.0]), np.array([-np.inf]), np.array([np.inf]))
    assert found is not None
    assert abs(found.x[0]) < 1e-3
    assert found.converged
    assert calls <= 61


@pytest.mark.parametrize("trials", [1, 2, 7])
def test_the_search_stops_after_the_allowed_trials(trials: int) -> None:
    def valley(x: np.ndarray) -> Local:
        e = np.array([1.0 - x[0], 10.0 * (x[1] - x[0] ** 2)])
        J = np.array([[-1.0, 0.0], [-20.0 * x[0], 10.0]])
        return Local(float(e @ e), J.T @ e, J.T @ J)

    found = descend(valley, np.array([-1.2, 1.0]), -FREE[:2], FREE[:2], trials=trials)
    assert found is not None
    assert found.iterations == trials
    assert not found.converged
    whole = descend(valley, np.array([-1.2, 1.0]), -FREE[:2], FREE[:2])
    assert whole is not None
    assert whole.x == pytest.approx([1.0, 1.0], abs=1e-6)
    assert whole.converged


def test_a_coarse_tolerance_converges_sooner() -> None:
    def quartic(x: np.ndarray) -> Local:
        return Local(float(x[0] ** 4) + 1.0, 2.0 * x**3, np.array([[6.0 * x[0] ** 2]]))

    fine, coarse = (
        descend(quartic, np.array([3.0]), np.array([-9.0]), np.array([9.0]), rules=Rules(t)) for t in (1e-12, 1e-2)
    )
    assert fine is not None
    assert coarse is not None
    assert coarse.converged
    assert coarse.iterations < fine.iterations
    assert abs(fine.x[0]) < abs(coarse.x[0])


def test_the_inverse_of_an_information_is_exact_and_large_without_information() -> None:
    scale = np.diag([1e6, 1.0, 1e-7])
    assert inverse_of(scale @ A @ scale) == pytest.approx(np.linalg.inv(scale @ A @ scale), rel=1e-9)
    blind = inverse_of(np.array([[4.0, 4.0], [4.0, 4.0]]))
    assert blind[0, 0] == pytest.approx(0.5 * 1e13 / 4.0, rel=0.01)
    assert np.isfinite(inverse_of(np.diag([1.0, 0.0]))).all()
    assert inverse_of(np.diag([1.0, 0.0]))[0, 0] == pytest.approx(1.0)
