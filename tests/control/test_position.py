"""Sliding mode beside PID laws from (2, 2, 2, pi/2) to the origin: Gomes2003, figures 2 to 4."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.control import (
    STRUCTURES,
    FeedbackLaw,
    IntegralSlidingMode,
    PidPosition,
    Pose,
    PositionTarget,
    RigidModel,
    SlidingMode,
)
from gcs_autotune.control.position import PositionController

CRAFT = RigidModel((100.0, 150.0, 150.0, 20.0), (20.0, 40.0, 40.0, 10.0), (80.0, 150.0, 150.0, 30.0))
"""An ROV of the size of the paper's, which prints no parameters."""
MOST = (200.0, 100.0, 100.0, 60.0)
SLIDING = SlidingMode(CRAFT, (0.5,) * 4, (50.0, 75.0, 75.0, 10.0), (0.05,) * 4, 0.3, (5.0, 5.0, 5.0, 1.0), MOST)
ORIGIN = PositionTarget((0.0, 0.0, 0.0, 0.0))


def heavier(craft: RigidModel, factor: float) -> RigidModel:
    def scaled(values: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        a, b, c, d = (factor * value for value in values)
        return a, b, c, d

    return RigidModel(scaled(craft.mass), scaled(craft.drag), scaled(craft.drag_quadratic))


def pid() -> PidPosition:
    return PidPosition(
        [
            FeedbackLaw(STRUCTURES["PI-D"], K_P=0.36 * m, K_I=0.05 * m, K_D=0.9 * m, limits=(-most, most))
            for m, most in zip(CRAFT.mass, MOST, strict=True)
        ]
    )


def fly(controller: PositionController, craft: RigidModel, *, seconds: float = 60.0) -> NDArray[np.float64]:
    """Return (t, x, y, z, psi, X, Y, Z, N) at 20 Hz."""
    position, velocity, rows, dt = np.array([2.0, 2.0, 2.0, math.pi / 2]), np.zeros(4), [], 0.05
    for k in range(round(seconds / dt)):
        x, y, z, psi = (float(value) for value in position)
        u, v, w, r = (float(value) for value in velocity)
        force = controller.update(ORIGIN, Pose((x, y, z, psi), (u, v, w, r)), k * dt)
        rows.append((k * dt, *position, *force))
        for _ in range(5):
            velocity = velocity + dt / 5 * craft.acceleration(velocity, np.array(force))
            c, s = math.cos(position[3]), math.sin(position[3])
            rate = [c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2], velocity[3]]
            position = position + dt / 5 * np.array(rate)
    return np.array(rows)


def saturated(flown: NDArray[np.float64]) -> float:
    """Return the seconds in which an actuator is at its limit, summed over the axes."""
    return float(np.sum(np.abs(flown[:, 5:]) >= np.array(MOST) - 1e-9)) * 0.05


@pytest.mark.parametrize("factor", [1.0, 1.5, 0.5])
def test_sliding_mode_reaches_the_target_although_its_model_is_wrong_by_half(factor: float) -> None:
    flown = fly(SLIDING, heavier(CRAFT, factor))
    assert np.abs(flown[-1, 1:5]).max() < 0.01
    assert np.abs(flown[flown[:, 0] > 15.0, 1:5]).max() < 0.05


def test_pid_laws_correct_the_sideways_error_much_later() -> None:
    late = [np.abs(flown[flown[:, 0] > 15.0, 2]).max() for flown in (fly(SLIDING, CRAFT), fly(pid(), CRAFT))]
    assert late[1] > 10.0 * late[0]


def test_a_heavier_craft_saturates_its_thrusters_for_longer() -> None:
    nominal, heavy = saturated(fly(SLIDING, CRAFT)), saturated(fly(SLIDING, heavier(CRAFT, 1.5)))
    assert 0.0 < nominal < heavy < 6.0


def test_the_boundary_layer_keeps_the_thrusters_from_chattering() -> None:
    smooth = fly(SLIDING, heavier(CRAFT, 1.5))
    sharp = fly(replace(SLIDING, layer=(1e-6,) * 4), heavier(CRAFT, 1.5))
    travel = [float(np.sum(np.abs(np.diff(flown[400:, 5:], axis=0)))) for flown in (smooth, sharp)]
    assert travel[0] < 0.05 * travel[1]


def test_a_constant_force_in_the_model_leaves_no_error() -> None:
    pushed = replace(CRAFT, constant=(10.0, -8.0, 5.0, 0.5))
    assert np.abs(fly(replace(SLIDING, model=pushed), pushed)[-1, 1:5]).max() < 0.01


def test_an_unmodelled_constant_force_leaves_no_error_with_the_integral() -> None:
    pushed = replace(CRAFT, constant=(30.0, -24.0, 15.0, 2.0))
    plain, held = fly(SLIDING, pushed, seconds=90.0), fly(IntegralSlidingMode(SLIDING), pushed, seconds=90.0)
    assert np.abs(plain[-1, 1:5]).max() > 0.02
    assert np.abs(held[-1, 1:5]).max() < 0.005
