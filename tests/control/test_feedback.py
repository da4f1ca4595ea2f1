"""Controllers of one motion: table 8.1, anti-windup, drag compensation and the take-over, Miskovic2010, 8.1."""

from __future__ import annotations

import math
from dataclasses import replace

import control as python_control
import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.control import (
    REFERENCE_MODELS,
    STRUCTURES,
    FeedbackLaw,
    SetPointLoop,
    Uncertainty,
    design_ipd,
    drag_speed_limit,
    least_inertia_ratio,
    reference_coefficients,
    reference_model,
)
from gcs_autotune.craft import Actuate, HeadingTarget, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.models import SingleDof
from gcs_autotune.sname import DOFS

CHARLIE = SingleDof("yaw", "rad", 8.2, 2.465)
RUDDER = math.radians(30.0)
FALCON_YAW, FALCON_YAW_FOUND = SingleDof("yaw", "N m", 80.0, 300.0, 10.0), SingleDof("yaw", "N m", 78.97, 298.48)
FALCON_HEAVE = SingleDof("heave", "N", 130.0, 200.0, 20.0, delta=10.0)
FALCON_HEAVE_FOUND = SingleDof("heave", "N", 127.79, 205.75, delta=10.0)
QUADRATIC = SingleDof("yaw", "N m", 1.018, 0.0, 1.257)


def fly(
    law: FeedbackLaw, craft: SingleDof, step: float, *, seconds: float = 60.0, dt: float = 0.1
) -> NDArray[np.float64]:
    """Return (t, position, velocity, command) per tick of a step at the second tick, with a simulation of our own."""
    controller, eta, nu, rows = law.started(), 0.0, 0.0, []
    for k in range(round(seconds / dt)):
        command = controller.update(step if k else 0.0, eta, nu, k * dt)
        rows.append((k * dt, eta, nu, command))
        for _ in range(20):
            drag = (craft.beta + craft.beta_quadratic * abs(nu)) * nu
            nu += dt / 20 * (command + craft.delta - drag) / craft.alpha
            eta += dt / 20 * nu
    return np.array(rows)


def overshoot(flown: NDArray[np.float64], step: float) -> float:
    return float(flown[:, 1].max() / step - 1.0)


def gains_of(name: str) -> FeedbackLaw:
    return FeedbackLaw(STRUCTURES[name], K_P=4.0, K_I=0.7, K_D=6.0)


@pytest.mark.parametrize("name", STRUCTURES)
def test_the_closed_loop_of_each_structure_matches_python_control(name: str) -> None:
    """Against python-control, which closes the loop from the channels."""
    law, s = gains_of(name), python_control.tf("s")
    plant = 1.0 / (CHARLIE.alpha * s**2 + CHARLIE.beta * s)
    structure = law.structure
    K_I = law.K_I if structure.integral else 0.0
    K_D = law.K_D if structure.derivative else 0.0
    on_error = K_I / s + (law.K_P if structure.proportional == "error" else 0.0)
    on_error = on_error + (K_D * s if structure.derivative == "error" else 0.0)
    feedback = K_I / s + law.K_P + K_D * s
    expected = plant * on_error / (1.0 + plant * feedback)
    omega = np.geomspace(0.01, 10.0, 7)
    assert law.closed_loop(CHARLIE).response(omega) == pytest.approx(expected(1j * omega), rel=1e-9)


@pytest.mark.parametrize("name", STRUCTURES)
def test_the_controller_that_runs_follows_its_transfer_function(name: str) -> None:
    law = gains_of(name)
    flown = fly(law, CHARLIE, 0.1, dt=0.01)
    _, expected = python_control.step_response(law.closed_loop(CHARLIE).to_control(), T=flown[:, 0])
    assert flown[:, 1] == pytest.approx(0.1 * np.asarray(expected), abs=0.1 * 0.02)


def test_the_reference_model_of_charlie_matches_the_published_one() -> None:
    wanted = reference_model("bessel", 0.45)
    assert (wanted.a3, wanted.a2, wanted.a1) == pytest.approx((10.97, 12.01, 5.48), abs=0.006)


@pytest.mark.parametrize(("kind", "ratio"), [("butterworth", 0.25), ("bessel", 0.1667)])
def test_the_least_allowed_inertia_ratio_matches_the_published_one(kind: str, ratio: float) -> None:
    assert least_inertia_ratio(reference_model(kind, 0.7)) == pytest.approx(ratio, abs=5e-5)


@pytest.mark.parametrize("degrees", [60.0, 90.0, 150.0])
def test_anti_windup_limits_the_overshoot_of_a_saturated_rudder_to_the_model(degrees: float) -> None:
    step = math.radians(degrees)
    law = design_ipd(CHARLIE, reference_model("bessel", 0.45))
    free = overshoot(fly(law, CHARLIE, step), step)
    limited = law.with_limits(-RUDDER, RUDDER)
    held = fly(limited, CHARLIE, step)
    wound_up = fly(replace(limited, tracking_time=1e9), CHARLIE, step)
    assert np.abs(held[:, 3]).max() == pytest.approx(RUDDER)
    assert overshoot(held, step) <= free + 0.001
    assert overshoot(wound_up, step) > free + 0.01
    assert held[-1, 1] == pytest.approx(step, rel=1e-3)


def test_a_falcon_turns_and_dives_by_its_reference_model() -> None:
    for true, found, omega, step in (
        (FALCON_YAW, FALCON_YAW_FOUND, 1.5, math.pi / 2),
        (FALCON_HEAVE, FALCON_HEAVE_FOUND, 0.8, 3.0),
    ):
        wanted = reference_model("bessel", omega)
        flown = fly(design_ipd(found, wanted), true, step, seconds=20.0, dt=0.02)
        _, expected = python_control.step_response(wanted.transfer_function().to_control(), T=flown[:, 0])
        assert flown[:, 1] == pytest.approx(step * np.asarray(expected), abs=0.05 * step)


def test_drag_is_compensated_up_to_the_speed_allowed_by_the_uncertainty() -> None:
    wanted = reference_model("bessel", 1.5)
    law = design_ipd(QUADRATIC, wanted, Uncertainty(0.1, 0.2))
    assert law.drag_speed == pytest.approx(drag_speed_limit(QUADRATIC, wanted, Uncertainty(0.1, 0.2)))
    flown = fly(law, QUADRATIC, math.pi / 2, seconds=15.0, dt=0.02)
    assert np.abs(flown[:, 2]).max() < law.drag_speed
    assert flown[-1, 1] == pytest.approx(math.pi / 2, rel=1e-3)


def test_a_controller_takes_over_without_a_jump() -> None:
    controller = design_ipd(CHARLIE, reference_model("bessel", 0.45)).started(command=0.2)
    assert controller.update(1.0, 0.4, 0.05, 10.0) == pytest.approx(0.2)


def test_an_angle_error_uses_the_shorter_direction() -> None:
    controller = gains_of("P-D")
    angle = replace(controller, is_angle=True).started()
    assert angle.update(math.radians(-170.0), math.radians(170.0), 0.0, 0.0) == pytest.approx(4.0 * math.radians(20.0))


def test_limits_in_the_wrong_order_are_rejected() -> None:
    with pytest.raises(UsageError, match="must rise"):
        gains_of("PI").with_limits(1.0, -1.0)


@pytest.mark.parametrize("kind", REFERENCE_MODELS)
@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_reference_models_of_any_order_are_stable_and_scale_with_their_frequency(kind: str, order: int) -> None:
    slow, fast = (reference_coefficients(kind, omega, order) for omega in (1.0, 2.0))
    assert slow[-1] == pytest.approx(1.0)
    assert fast == pytest.approx([a / 2.0 ** (k + 1) for k, a in enumerate(slow)])
    assert np.all(np.roots([*slow[::-1], 1.0]).real < 0.0)


def test_a_lost_signal_gives_zero_output_and_does_not_corrupt_the_state() -> None:
    loop = SetPointLoop(gains_of("PI-D"), DOFS["yaw"], throttle=0.3)
    loop.update(HeadingTarget(1.0), Observation(t=0.0, psi=0.0, r=0.0))
    assert loop.update(HeadingTarget(1.0), Observation(t=0.1, psi=math.nan)) == Actuate(X=0.3)
    assert math.isfinite(loop.update(HeadingTarget(1.0), Observation(t=0.2, psi=0.0, r=0.0)).N)
