"""The building blocks of the control loops."""

from __future__ import annotations

import math

import pytest

from sitl.autopilot.parameters import Definition, ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_parameters import ROVER_PARAMETERS
from sitl.autopilot.shaping import (
    TwoPoleLowPass,
    invert_sqrt_controller,
    low_pass_share,
    sqrt_controller,
    step_towards,
    wrap_pi,
)

DT = 0.02
NAMES = ("P", "I", "D", "FF", "D_FF", "IMAX", "FLTT", "FLTE", "FLTD", "PDMX")


def _pid(**gains: float) -> Pid:
    store = ParameterStore(Definition(f"X_{name}", 9, gains.get(name, 0.0)) for name in NAMES)
    return Pid(store, "X")


def test_each_part_of_the_pid_has_its_gain():
    pid = _pid(P=2.0, I=0.5, D=0.1, FF=3.0, IMAX=1.0)
    assert pid.update(0.4, 0.1, DT, False) == pytest.approx(2.0 * 0.3 + 0.5 * 0.3 * DT)
    assert pid.feed_forward == pytest.approx(1.2)
    out = pid.update(0.4, 0.05, DT, False)
    assert out == pytest.approx(2.0 * 0.35 + 0.5 * (0.3 + 0.35) * DT + 0.1 * 0.05 / DT, rel=1e-6)


def test_the_integral_stops_at_imax():
    pid = _pid(I=10.0, IMAX=0.25)
    for _ in range(1000):
        out = pid.update(1.0, 0.0, DT, False)
    assert out == 0.25


def test_while_limited_the_integral_only_shrinks():
    pid = _pid(I=1.0, IMAX=1.0)
    pid.update(1.0, 0.0, DT, False)
    grown = pid.integrator
    pid.update(1.0, 0.0, DT, True)
    assert pid.integrator == grown
    pid.update(-1.0, 0.0, DT, True)
    assert pid.integrator < grown


def test_without_i_gain_the_integral_is_forgotten():
    pid = _pid(I=0.0)
    pid.integrator = 0.7
    assert pid.update(0.0, 0.0, DT, False) == 0.0


def test_p_and_d_together_stay_within_pdmx():
    pid = _pid(P=5.0, D=1.0, PDMX=0.5)
    pid.update(1.0, 0.0, DT, False)
    pid.update(2.0, 0.0, DT, False)
    assert abs(pid.p_part + pid.d_part) == pytest.approx(0.5)


def test_the_error_filter_lags_with_its_time_constant():
    pid = _pid(P=1.0, FLTE=2.0)
    pid.update(0.0, 0.0, DT, False)
    steps = round(1.0 / (math.tau * 2.0) / DT)
    for _ in range(steps):
        out = pid.update(1.0, 0.0, DT, False)
    assert out == pytest.approx(1.0 - math.exp(-1.0), abs=0.05)


def test_the_gyro_filter_passes_half_the_power_at_its_cutoff():
    filtered, size = TwoPoleLowPass(), 0.0
    for k in range(2000):
        out = filtered.apply(math.sin(math.tau * 4.0 * k * DT), 4.0, DT)
        if k > 1000:
            size = max(size, abs(out))
    assert size == pytest.approx(math.sqrt(0.5), abs=0.02)


@pytest.mark.parametrize("cutoff", [4.0, 20.0, 60.0])
@pytest.mark.parametrize("dt", [0.02, 0.0025])
def test_the_gyro_filter_has_the_delay_of_the_autopilot_at_every_loop_rate(cutoff, dt):
    low_pass = TwoPoleLowPass()
    for k in range(round(1.0 / dt) + 1):
        out = low_pass.apply(3.0 * k * dt, cutoff, dt)
    assert 1.0 - out / 3.0 == pytest.approx(math.sqrt(2.0) / (math.tau * cutoff), rel=1e-6)


def test_the_gyro_filter_is_the_same_filter_at_every_loop_rate():
    slow, fast = TwoPoleLowPass(), TwoPoleLowPass()
    for k in range(50):
        wanted = slow.apply(float(k > 10), 20.0, 0.02)
        for j in range(20 if k else 1):
            share = (j + 1) / 20.0
            out = fast.apply(share if k == 11 else float(k > 10), 20.0, 0.001)
        assert out == pytest.approx(wanted, abs=1e-9)


def test_the_gyro_filter_starts_at_its_input_and_can_be_disabled():
    low_pass = TwoPoleLowPass()
    assert low_pass.apply(3.0, 4.0, DT) == pytest.approx(3.0)
    assert low_pass.apply(3.0, 4.0, DT) == pytest.approx(3.0)
    assert low_pass.apply(7.0, 0.0, DT) == 7.0


def test_the_square_root_law_is_linear_near_zero_and_can_always_brake():
    assert sqrt_controller(0.01, 6.0, 2.0, DT) == pytest.approx(0.06)
    far = sqrt_controller(1.0, 6.0, 2.0, DT)
    assert far == pytest.approx(math.sqrt(2 * 2.0 * (1.0 - 2.0 / 72)))
    assert sqrt_controller(-1.0, 6.0, 2.0, DT) == -far
    assert sqrt_controller(0.5, 6.0, 0.0, DT) == 3.0


def test_the_square_root_law_does_not_overshoot_in_one_step():
    assert sqrt_controller(0.001, 1000.0, 0.0, DT) == pytest.approx(0.05)


@pytest.mark.parametrize("error", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("p", [0.0, 3.0])
def test_the_square_root_law_is_inverted(error, p):
    assert invert_sqrt_controller(sqrt_controller(error, p, 2.0, 1e-6), p, 2.0) == pytest.approx(error)


def test_small_shapers():
    assert low_pass_share(0.0, DT) == 1.0
    assert step_towards(1.0, 5.0, 0.5) == 1.5
    assert wrap_pi(3.5 * math.pi) == pytest.approx(-0.5 * math.pi)


def _rover(**values: float) -> ParameterStore:
    store = ParameterStore(ROVER_PARAMETERS)
    for name, value in values.items():
        store.preset(name, value)
    return store


def test_the_heading_law_is_proportional_then_limited_by_the_braking_rate():
    steering = RoverSteering(_rover(ATC_STR_ANG_P=2, ATC_STR_ACC_MAX=90), DT)
    assert steering.rate_for_heading(0.1) == pytest.approx(0.2)
    assert steering.rate_for_heading(3.0) == pytest.approx(math.sqrt(2 * 3.0 * math.radians(90)))


def test_the_target_rate_is_slewed_and_limited():
    steering = RoverSteering(_rover(ATC_STR_ACC_MAX=100, ATC_STR_RAT_MAX=30), DT)
    steering.run(0, 2.0, 0.0, 1.0, False)
    assert steering.pid.target == pytest.approx(math.radians(100) * DT)
    for k in range(1, 60):
        steering.run(20 * k, 2.0, 0.0, 1.0, False)
    assert steering.pid.target == pytest.approx(math.radians(30))


def test_a_fast_boat_may_not_turn_harder_than_atc_turn_max_g():
    steering = RoverSteering(_rover(ATC_STR_ACC_MAX=0, ATC_TURN_MAX_G=0.6), DT)
    steering.run(0, 2.0, 0.0, 12.0, False)
    assert steering.pid.target == pytest.approx(0.6 * 9.81 / 12.0)


def test_the_measured_acro_example_is_reproduced():
    """Measured: V 4.16 m/s, 65.1 deg/s wanted, 63.3 achieved, FF part .852, P part .006 (P 0.2, FF 0.75)."""
    steering = RoverSteering(_rover(ATC_STR_ACC_MAX=0, ATC_STR_RAT_FF=0.75, ATC_STR_RAT_I=0), DT)
    out = steering.run(0, math.radians(65.1), math.radians(63.3), 4.16, False)
    assert steering.pid.feed_forward == pytest.approx(0.852, abs=1e-3)
    assert out == pytest.approx(0.852 + 0.006, abs=1e-3)


def test_a_loop_not_run_for_200_ms_is_reset():
    steering = RoverSteering(_rover(), DT)
    for k in range(50):
        steering.run(20 * k, 0.5, 0.0, 2.0, False)
    assert steering.pid.integrator > 0.0
    steering.run(20 * 50 + 300, 0.5, 0.5, 2.0, False)
    assert steering.pid.integrator == pytest.approx(0.0, abs=1e-9)


def test_the_speed_loop_uses_the_cruise_pair_as_feed_forward():
    speed = RoverSpeedController(_rover(CRUISE_SPEED=1.2, CRUISE_THROTTLE=80, ATC_ACCEL_MAX=0), DT)
    assert speed.run(0, 0.6, 0.6, False) == pytest.approx(0.4)


def test_the_target_speed_is_slewed_by_atc_accel_max():
    speed = RoverSpeedController(_rover(ATC_ACCEL_MAX=1.0), DT)
    for k in range(11):
        speed.run(20 * k, 1.2, 0.0, False)
    assert speed.pid.target == pytest.approx(0.22)


def test_stopped_is_zero_throttle():
    assert RoverSpeedController(_rover(), DT).run(0, 0.0, 0.05, False) == 0.0


def test_without_brakes_the_engine_does_not_reverse():
    quick = {"ATC_ACCEL_MAX": 0, "ATC_SPEED_P": 2}
    assert RoverSpeedController(_rover(**quick), DT).run(0, 0.3, 1.5, False) < 0.0
    assert RoverSpeedController(_rover(**quick, ATC_BRAKE=0), DT).run(0, 0.3, 1.5, False) == 0.0
