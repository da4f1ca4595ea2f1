"""Miskovic2010, examples 8.1-8.3: bounds as published, and the closed loops simulated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gcs_autotune.control import (
    FeedbackLaw,
    Uncertainty,
    design_ipd,
    reference_model,
    stability_bound,
    uncertainty_of,
    wanted_step,
)
from gcs_autotune.models import SingleDof

PUBLISHED = Uncertainty(p_alpha=0.1, p_beta=0.2)

FALCON_YAW = SingleDof("yaw", "N m", 80.0, 300.0, 10.0)
FALCON_YAW_FOUND = SingleDof("yaw", "N m", 78.97, 298.48)
FALCON_HEAVE = SingleDof("heave", "N", 130.0, 200.0, 20.0, delta=10.0)
FALCON_HEAVE_FOUND = SingleDof("heave", "N", 127.79, 205.75, delta=10.0)
NONLINEAR_YAW = SingleDof("yaw", "N m", 1.018, 0.0, 1.257)
NONLINEAR_YAW_FOUND = SingleDof("yaw", "N m", 0.98, 0.0, 1.305)


def fly(
    true: SingleDof, gains: FeedbackLaw, step: float, compensated: float, t: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Simulate law (8.2) on *true*; returns (2, n): position, velocity."""

    def slope(_: float, x: NDArray[np.float64]) -> list[float]:
        integral, eta, nu = x
        force = gains.K_I * integral - gains.K_P * eta - (gains.K_D - gains.drag * abs(nu)) * nu - compensated
        drag = (true.beta + true.beta_quadratic * abs(nu)) * nu
        return [step - eta, nu, (force + true.delta - drag) / true.alpha]

    states: NDArray[np.float64] = solve_ivp(slope, (0.0, t[-1]), [0.0] * 3, t_eval=t, rtol=1e-8, atol=1e-10).y[1:]
    return states


def test_example_8_1_has_the_published_falcon_yaw_bound() -> None:
    left, right = stability_bound(FALCON_YAW_FOUND, reference_model("bessel", 1.5), PUBLISHED, 0.0)
    assert left == pytest.approx(3.78, abs=0.005)
    assert right == pytest.approx(17.84, abs=0.005)


def test_example_8_2_has_the_published_falcon_heave_bound() -> None:
    left, right = stability_bound(FALCON_HEAVE_FOUND, reference_model("bessel", 0.8), PUBLISHED, 0.0)
    assert left == pytest.approx(1.61, abs=0.005)
    assert right == pytest.approx(9.5153, abs=0.0005)


def test_example_8_3_has_the_published_yaw_rate_limit() -> None:
    left, right = stability_bound(NONLINEAR_YAW_FOUND, reference_model("bessel", 1.5), PUBLISHED, 1.2)
    assert left == 1.2
    assert right == pytest.approx(13.4, abs=0.05)


@pytest.mark.parametrize(
    ("true", "found", "omega", "step"),
    [
        (FALCON_YAW, FALCON_YAW_FOUND, 1.5, math.pi / 2.0),
        (FALCON_HEAVE, FALCON_HEAVE_FOUND, 0.8, 3.0),
        (NONLINEAR_YAW, NONLINEAR_YAW_FOUND, 1.5, math.pi / 2.0),
    ],
    ids=["8.1", "8.2", "8.3"],
)
def test_the_examples_follow_their_reference_model(
    true: SingleDof, found: SingleDof, omega: float, step: float
) -> None:
    wanted = reference_model("bessel", omega)
    t = np.linspace(0.0, 15.0 / omega, 300)
    position, velocity = fly(true, design_ipd(found, wanted), step, found.delta, t)
    assert position / step == pytest.approx(wanted_step(wanted, t).position, abs=0.03)
    left, right = stability_bound(found, wanted, PUBLISHED, float(np.max(np.abs(velocity))))
    assert left < right


def test_the_closed_loop_with_the_true_model_equals_the_reference_model() -> None:
    wanted = reference_model("butterworth", 1.1)
    t = np.linspace(0.0, 12.0, 200)
    position, _ = fly(FALCON_HEAVE, design_ipd(FALCON_HEAVE, wanted), 3.0, 10.0, t)
    assert position / 3.0 == pytest.approx(wanted_step(wanted, t).position, abs=2e-3)


def test_a_loop_at_its_bound_is_at_the_edge_of_stability() -> None:
    """Set the error exactly at the stability limit of (8.22), and check the poles."""
    wanted = reference_model("bessel", 1.5)
    p = Uncertainty(0.1, 0.6)
    _, right = stability_bound(FALCON_YAW_FOUND, wanted, p, 0.0)
    for factor, stable in ((0.99, True), (1.01, False)):
        found = SingleDof("yaw", "N m", 100.0, 100.0 * right * factor)
        gains = design_ipd(found, wanted)
        alpha, beta = found.alpha / (1.0 - p.p_alpha), found.beta / (1.0 + p.p_beta)
        poles = np.roots([alpha, beta + gains.K_D, gains.K_P, gains.K_I])
        assert bool(np.all(poles.real < 0.0)) is stable


def test_uncertainty_follows_from_the_covariance_and_is_never_zero() -> None:
    covariance = np.diag([(0.05 * 80.0) ** 2, (0.1 * 300.0) ** 2, 0.0, 0.0, 0.0])
    p = uncertainty_of(FALCON_YAW_FOUND, covariance)
    assert p.p_alpha == pytest.approx(1.96 * 4.0 / 78.97)
    assert p.p_beta == pytest.approx(1.96 * 30.0 / 298.48)
    nothing = uncertainty_of(FALCON_YAW_FOUND, np.zeros((5, 5)))
    assert nothing == Uncertainty(0.01, 0.01)
    hopeless = uncertainty_of(NONLINEAR_YAW_FOUND, np.diag([0.0, 0.0, 100.0, 0.0, 0.0]))
    assert hopeless.p_beta == 0.95
