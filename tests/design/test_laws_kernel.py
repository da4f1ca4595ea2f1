"""The pieces of the simulated loops one by one, uncompiled, against what they are documented to do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter

from gcs_autotune.design import Actuator, Scenario
from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.laws import kernel
from gcs_autotune.models import SingleDof

CRAFT = SingleDof("yaw", "1", 0.4, 0.3, 0.2, 0.05, 0.12)


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """What pieces call of each other has no entry from Python once compiled."""
    for name in ("clip", "bent"):
        monkeypatch.setattr(kernel, name, getattr(kernel, f"_{name}"))


@pytest.mark.parametrize(("value", "clipped"), [(-2.0, -1.0), (-1.0, -1.0), (0.3, 0.3), (1.5, 1.5), (1.6, 1.5)])
def test_clip_keeps_a_value_between_both_ends(value: float, clipped: float) -> None:
    assert kernel._clip(value, -1.0, 1.5) == clipped


def test_wrap_takes_the_angle_between_minus_and_plus_half_a_turn() -> None:
    for angle in (-7.0, -3.2, -3.1, -1.0, 0.0, 1.0, 3.1, 3.2, 7.0, 20.0):
        assert kernel._wrap(angle) == pytest.approx(math.remainder(angle, 2.0 * math.pi))
    assert kernel._wrap(math.pi) == pytest.approx(-math.pi)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_square_root_controller_is_linear_near_zero_and_smooth_where_the_root_begins(sign: float) -> None:
    p, limit = 2.0, 3.0
    edge = limit / p**2
    assert kernel._sqrt_control(sign * 0.5 * edge, p, limit) == pytest.approx(sign * p * 0.5 * edge)
    assert kernel._sqrt_control(sign * edge, p, limit) == pytest.approx(sign * p * edge)
    for error in (1.1 * edge, 4.0 * edge):
        speed = kernel._sqrt_control(sign * error, p, limit)
        assert speed == pytest.approx(sign * math.sqrt(2.0 * limit * (error - 0.5 * edge)))
    assert kernel._sqrt_control(sign, 0.4, 0.1) == pytest.approx(sign * math.sqrt(0.2 * (1.0 - 0.3125)))
    for no_p, no_limit in ((p, 0.0), (0.0, limit), (p, -1.0), (-1.0, limit)):
        assert kernel._sqrt_control(sign * 9.0, no_p, no_limit) == sign * 9.0 * no_p


def test_a_low_pass_weights_each_new_sample() -> None:
    assert kernel._smoothing(0.0, 0.01) == kernel._smoothing(-1.0, 0.01) == 1.0
    assert kernel._smoothing(5.0, 0.02) == pytest.approx(0.02 / (0.02 + 1.0 / (2.0 * math.pi * 5.0)))


def plant(dt: float, substeps: int) -> kernel.LoopPlant:
    return kernel.plant_of(CRAFT, Scenario(1.0, 5.0), dt, 0.0)._replace(substeps=substeps)


@pytest.mark.parametrize("velocity", [0.8, -0.8])
@pytest.mark.parametrize("force", [0.4, -0.4])
def test_the_craft_moves_by_its_equation(velocity: float, force: float) -> None:
    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], (force + 0.05 - (0.3 + 0.2 * abs(y[1])) * y[1]) / 0.4]

    exact = solve_ivp(rate, (0.0, 0.2), [0.1, velocity], rtol=1e-10, atol=1e-12).y[:, -1]
    assert kernel._advance(0.1, velocity, force, plant(0.2, 50)) == pytest.approx(tuple(exact), abs=2e-6)
    halves = kernel._advance(0.1, velocity, force, plant(0.1, 1))
    halves = kernel._advance(*halves, force, plant(0.1, 1))
    assert kernel._advance(0.1, velocity, force, plant(0.2, 2)) == pytest.approx(halves, abs=1e-12)


def test_the_craft_and_the_scenario_are_converted_to_loop_cycles() -> None:
    scenario = Scenario(step=0.5, duration=9.0, push=0.07, push_at=2.0, lead=0.5, back_at=4.0)
    found = kernel.plant_of(CRAFT, scenario, 0.02, 0.05)
    assert found == pytest.approx(
        kernel.LoopPlant(
            alpha=0.4, beta=0.3, beta_quadratic=0.2, delta=0.05, dt=0.02, substeps=1, late=8.0,
            step=0.5, push=0.07, push_at=100.0, step_at=25, settled=0.0, back_at=200,
        )
    )  # fmt: skip
    settled = kernel.plant_of(CRAFT, Scenario(step=0.5, duration=9.0), 0.02, 0.05, Actuator(ahead=2.0, astern=0.5))
    assert (settled.push, settled.push_at, settled.step_at, settled.back_at) == (0.0, 1e12, 0.0, 1e12)
    assert settled.settled == pytest.approx(0.1), "its constant force is worked off, astern"
    assert kernel.plant_of(CRAFT, scenario, 0.02, -0.5).late == 0.0, "no output acts before it is sent"


@pytest.mark.parametrize(
    ("alpha", "beta", "dt", "substeps"),
    [(0.4, 0.3, 0.02, 1), (0.4, 4.0, 0.1, 11), (0.4, -4.0, 0.1, 10), (1e-4, 4.0, 0.1, 50)],
)
def test_fast_craft_are_simulated_in_more_substeps(alpha: float, beta: float, dt: float, substeps: int) -> None:
    quadratic = 0.2 if beta == 4.0 else 0.0
    craft = SingleDof("yaw", "1", alpha, beta, quadratic)
    assert kernel.plant_of(craft, Scenario(1.0, 5.0), dt, 0.0).substeps == substeps


@pytest.mark.parametrize(("quadratic", "delta"), [(1.0, 0.0), (5.0, 0.2), (5.0, -0.2), (20.0, 0.0)])
def test_quadratic_drag_is_evaluated_at_the_speed_of_full_output(quadratic: float, delta: float) -> None:
    top = (-0.3 + math.sqrt(0.09 + 4.0 * quadratic)) / (2.0 * quadratic)  # of which the constant force is a part
    rate = (0.3 + 2.0 * quadratic * top) / 0.4
    found = kernel.plant_of(SingleDof("yaw", "1", 0.4, 0.3, quadratic, delta), Scenario(1.0, 5.0), 0.17, 0.0)
    assert found.substeps == math.ceil(0.17 * rate / 0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_thrusters_share_steering_and_throttle_beyond_full_output(sign: float) -> None:
    shared = [kernel._mixed(sign * 0.8, throttle) for throttle in (0.0, 0.1, 0.2, 0.7)]
    assert shared == pytest.approx([sign * u for u in (0.8, 0.8, 0.8, 0.8 / 1.5)])
    assert kernel._mixed(sign * 1.5, 0.0) == sign * 1.5, "nobody to share with"
    assert kernel._mixed(0.0, 0.7) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("least", [0.0, 0.2])
@pytest.mark.parametrize("expo", [-1.0, -0.5, 0.0, 0.4, 1.0])
def test_a_pulse_gives_the_requested_thrust_by_the_thrust_curve(sign: float, least: float, expo: float) -> None:
    for throttle in (0.01, 0.3, 0.8, 1.0):
        pulse = sign * kernel.shaped_throttle(sign * throttle, least, expo)
        assert (1.0 - expo) * pulse + expo * pulse**2 == pytest.approx(least + (1.0 - least) * throttle)
        assert 0.0 < pulse <= 1.0
    assert kernel.shaped_throttle(0.0, least, expo) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_thrust_curve_out_of_range_is_ignored_and_its_output_is_limited(sign: float) -> None:
    assert kernel.shaped_throttle(sign * 0.4, 0.0, 1.01) == kernel.shaped_throttle(sign * 0.4, 0.0, -1.01) == sign * 0.4
    assert kernel.shaped_throttle(sign * 1.2, 0.0, -1.0) == sign


def moved(**shape: float) -> ActuatorStep:
    """Return an actuator as the kernel reads it: perfect but for *shape*."""
    return ActuatorStep(1.0, 1e9, 1e9, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0)._replace(**shape)


def acted(outputs: list[float], **shape: float) -> list[float]:
    memory = np.zeros(4)
    return [kernel._actuate(u, moved(**shape), memory) for u in outputs]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("outputs", "shape", "forces"),
    [
        ([0.5, 2.0], {"acts": 0.0, "limit": 0.1}, [0.5, 2.0]),
        ([0.5, 2.0, 0.7], {"limit": 0.6}, [0.5, 0.6, 0.6]),
        ([0.0, 1.0, 1.0, 0.5, 0.5], {"rate": 0.4}, [0.0, 0.4, 0.8, 0.5, 0.5]),
        ([0.9, 1.5, 0.2], {"rate": 0.4}, [0.9, 1.3, 0.9]),
        ([0.2, 1.0, 1.0], {"lag": 0.5}, [0.2, 0.6, 0.8]),
        ([0.5, 0.6, 0.4, 0.1, 0.2], {"backlash": 0.1}, [0.4, 0.5, 0.5, 0.2, 0.2]),
        ([0.05, 0.5], {"backlash": 0.1}, [0.0, 0.4]),
        ([0.05, 0.1, 0.3], {"dead_zone": 0.1, "lost": 0.1}, [0.0, 0.0, 0.2]),
        ([0.05, 0.1, 0.3], {"dead_zone": 0.1, "lost": 0.04}, [0.0, 0.0, 0.26]),
        ([0.5, 1.0], {"square": 1.0}, [0.25, 1.0]),
        ([0.5], {"square": 0.4, "reference": 0.8}, [0.5 * (0.6 + 0.4 * 0.5 / 0.8)]),
        ([0.5], {"dead_zone": 0.1, "lost": 0.1, "square": 1.0}, [0.16]),
    ],
    ids=[
        "none",
        "limit",
        "rate",
        "rate from where it was",
        "lag",
        "backlash",
        "inside backlash",
        "dead zone",
        "dead zone stepped over",
        "square",
        "part square",
        "dead and square",
    ],
)
def test_each_actuator_fault_acts_equally_in_both_directions(
    sign: float, outputs: list[float], shape: dict[str, float], forces: list[float]
) -> None:
    found = acted([sign * u for u in outputs], **shape)
    assert found == pytest.approx([sign * f for f in forces], abs=1e-12)


def test_an_actuator_has_its_own_gain_in_each_direction() -> None:
    assert acted([0.5, 0.0, -0.5], ahead=2.0, astern=3.0) == [1.0, 0.0, -1.5]


def test_a_delay_of_a_partial_loop_cycle_averages_two_outputs() -> None:
    sent = np.array([1.0, 3.0, 7.0])
    assert [kernel._delayed(sent, k, 0.0, -1.0) for k in range(3)] == [1.0, 3.0, 7.0]
    assert [kernel._delayed(sent, k, 1.0, -1.0) for k in range(3)] == [-1.0, 1.0, 3.0]
    assert [kernel._delayed(sent, k, 0.25, -1.0) for k in range(3)] == [0.5, 2.5, 6.0]
    assert [kernel._delayed(sent, k, 1.25, -1.0) for k in range(3)] == [-1.0, 0.5, 2.5]


def test_a_gyro_filter_is_a_butterworth_low_pass_below_half_the_rate() -> None:
    for cutoff, rate in ((20.0, 400.0), (0.5, 50.0), (10.0, 50.0), (22.4, 50.0)):
        b, a = butter(2, cutoff, fs=rate)
        assert kernel.gyro_coefficients(cutoff, rate) == pytest.approx([*b, *a[1:]])
    for cutoff in (0.0, -1.0, 22.5, 30.0):
        assert kernel.gyro_coefficients(cutoff, 50.0) == (1.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("u", [0.0, 0.03, 0.056, 0.07, -0.06, 0.1, 0.5])
@pytest.mark.parametrize("noise", [0.005, 0.015])
def test_noise_on_an_output_gives_the_mean_force_over_it(u: float, noise: float) -> None:
    shape = {"dead_zone": 0.056, "lost": 0.056, "square": 0.3, "reference": 0.3}
    n = np.linspace(-6.0, 6.0, 1201)
    weight = np.exp(-0.5 * n * n) / np.sum(np.exp(-0.5 * n * n))
    forces = [acted([u + noise * float(v)], **shape)[0] for v in n]
    found = acted([u], **shape, dither=noise)[0]
    assert found == pytest.approx(float(weight @ np.array(forces)), abs=0.08 * noise)
    assert acted([u], **shape, dither=0.0) == acted([u], **shape)
