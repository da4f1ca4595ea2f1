"""Rover's motors: two thrusters mixed as the firmware mixes them, throttle lifted and then bent."""

from __future__ import annotations

import pytest

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.rover_parameters import ROVER_PARAMETERS
from sitl.autopilot.servo_rail import ServoRail


def outputs(throttle: float, steering: float, speed: float = 0.5, **values: float) -> tuple[list[float], RoverMotors]:
    """Fractions of outputs 1 and 3 (left and right) after the slew limit has been passed."""
    store = ParameterStore(ROVER_PARAMETERS)
    for name, value in {"SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74, "MOT_SLEWRATE": 0, **values}.items():
        store.preset(name, value)
    motors, rail = RoverMotors(store, 0.02), ServoRail(store)
    motors.set_throttle(100.0 * throttle)
    motors.set_steering(steering, scaled=True)
    motors.output(rail, speed, armed=True)
    low, high = (store.values[f"SERVO1_{end}"] for end in ("MIN", "MAX"))
    return [(rail.pwm[i] - 1500) / ((high - low) / 2.0) for i in (0, 2)], motors


def test_left_and_right_are_sum_and_difference_at_any_speed() -> None:
    for speed in (0.0, 0.5, 5.0, -1.0):
        pair, motors = outputs(0.4, 0.2, speed)
        assert pair == pytest.approx([0.6, 0.2], abs=2e-3)
        assert not motors.limit_steer


@pytest.mark.parametrize(
    ("mix", "expected"),
    [(0.5, (1.0, 1.0 - 2.0 * 0.8 / 1.6)), (1.0, (1.0, 1.0 - 2.0 * 0.8)), (0.0, (1.0, 0.6))],
)
def test_saturated_outputs_are_distributed_by_the_mix(mix: float, expected: tuple[float, float]) -> None:
    """Throttle 0.8 and steering 0.8 need 1.6: distributed evenly, all to the steering, or all to the throttle."""
    pair, motors = outputs(0.8, 0.8, MOT_STR_THR_MIX=mix)
    assert pair == pytest.approx(expected, abs=2e-3)
    assert motors.limit_steer is (mix < 1.0)


def test_a_thruster_weaker_astern_gets_more_output_astern() -> None:
    pair, _ = outputs(0.0, 0.3, MOT_THST_ASYM=2.0)
    assert pair == pytest.approx([0.3, -0.6], abs=2e-3)


def test_throttle_is_raised_above_the_minimum_before_the_thrust_curve() -> None:
    pair, _ = outputs(0.25, 0.0, MOT_THR_MIN=10, MOT_THST_EXPO=1.0)
    assert pair == pytest.approx([(0.1 + 0.9 * 0.25) ** 0.5] * 2, abs=2e-3)


def test_a_slow_slew_rate_is_kept_below_one_percent_a_loop() -> None:
    pair, _ = outputs(0.5, 0.0, MOT_SLEWRATE=25)
    assert pair == pytest.approx([0.005, 0.005], abs=2e-3)


def test_a_floor_above_twenty_percent_counts_as_twenty() -> None:
    assert outputs(0.5, 0.0, MOT_THR_MIN=60)[0] == pytest.approx(outputs(0.5, 0.0, MOT_THR_MIN=20)[0], abs=2e-3)
