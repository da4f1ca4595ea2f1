"""Distance keeping in front of a wall: Miskovic2010, section 8.2, figures 8.16 and 8.17."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.control import WallReading, design_distance, reference_model
from gcs_autotune.models import SingleDof

SURGE = SingleDof("surge", "N", 8.2372, 0.0, 8.0)
YAW = SingleDof("yaw", "N m", 0.030772, 0.0, 0.0693)
COMPASS = math.radians(2.0)
LAW = design_distance(SURGE, YAW, reference_model("bessel", 0.35), reference_model("bessel", 0.8)).with_limits(
    X=(-8.0, 8.0), N=(-0.17, 0.17)
)
T, TARGET, D, PHI, D_EST, UNSEEN = range(6)


def keep(
    target: Callable[[float], float],
    *,
    seconds: float,
    unseen: Sequence[tuple[float, float]] = (),
    tether: tuple[float, float] = (0.0, 0.0),
    seed: int = 1,
) -> NDArray[np.float64]:
    """Return (t, target, d, phi, estimated d, unseen) at 10 Hz; the laser sees the wall at 2 Hz."""
    noise, controller, rows, dt = np.random.default_rng(seed), LAW.started(), [], 0.1
    u, r, psi, phi, d = 0.0, 0.0, 0.3, math.radians(15.0), 1.5
    for k in range(round(seconds / dt)):
        t = k * dt
        compass = round((psi + noise.normal(0.0, 0.004)) / COMPASS) * COMPASS
        laser = (d + noise.normal(0.0, 0.01), phi + noise.normal(0.0, math.radians(0.5)))
        sees = k % 5 == 0 and not any(start <= t < end for start, end in unseen)
        reading = WallReading(compass, *laser) if sees else WallReading(compass)
        X, N = controller.update(target(t), reading, t)
        rows.append((t, target(t), d, phi, controller.estimate.d, controller.unseen(t)))
        for _ in range(10):
            u += dt / 10 * (X + tether[0] - SURGE.beta_quadratic * abs(u) * u) / SURGE.alpha
            r += dt / 10 * (N + tether[1] - YAW.beta_quadratic * abs(r) * r) / YAW.alpha
            psi, phi = psi + dt / 10 * r, phi + dt / 10 * r
            d -= dt / 10 * u * math.cos(phi)
    return np.array(rows)


def step_then_ramp(t: float) -> float:
    if t < 100.0:
        return 1.5
    return 2.0 if t < 200.0 else 2.0 + min((t - 200.0) * 0.01, 1.0)


@pytest.mark.parametrize("tether", [(0.0, 0.0), (0.2, 0.002)])
def test_a_step_and_a_ramp_of_the_distance_end_without_a_steady_error(tether: tuple[float, float]) -> None:
    flown = keep(step_then_ramp, seconds=420.0, tether=tether)
    for start, end in ((170.0, 200.0), (370.0, 420.0)):
        late = (flown[:, T] > start) & (flown[:, T] < end)
        assert abs(float(np.mean(flown[late, D] - flown[late, TARGET]))) < 0.02
        assert abs(float(np.mean(flown[late, PHI]))) < math.radians(3.0)


def test_the_distance_is_held_through_two_losses_of_the_wall() -> None:
    """The drop-outs of figure 8.17."""
    flown = keep(lambda t: 1.5, seconds=480.0, unseen=((435.0, 440.0), (455.0, 460.0)))
    gone = (flown[:, T] > 435.0) & (flown[:, T] < 470.0)
    assert flown[gone, UNSEEN].max() > 4.5
    assert np.abs(flown[gone, D] - 1.5).max() < 0.1


def test_the_filter_estimates_the_distance_between_two_measurements() -> None:
    flown = keep(step_then_ramp, seconds=200.0)
    moving = (flown[:, T] > 100.0) & (flown[:, T] < 120.0)
    error = flown[moving, D_EST] - flown[moving, D]
    between = np.diff(flown[moving, D_EST])[np.arange(moving.sum() - 1) % 5 != 4]
    assert np.sqrt(np.mean(error**2)) < 0.025
    assert np.abs(between).max() > 0.004


def test_distance_and_angle_follow_from_two_beams() -> None:
    facing = WallReading.of_two(0.3, 0.5, 0.5, 0.2)
    assert (facing.d, facing.phi) == (0.5, 0.0)
    turned = WallReading.of_two(0.3, 0.4, 0.6, 0.2)
    assert turned.phi == pytest.approx(math.pi / 4.0)
    assert turned.d == pytest.approx(0.5 * math.cos(math.pi / 4.0))


def test_nothing_is_commanded_before_the_wall_is_seen() -> None:
    controller = LAW.started(X=0.4, N=0.01)
    assert controller.update(2.0, WallReading(0.3), 0.0) == (0.4, 0.01)
    assert math.isinf(controller.unseen(0.0))
