"""ArduRover's motor library: the simulator's law, its parameters from thrust, and what counts as proportional."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.design import Linearity, MotorFit, MotorLaw, fit_motor_law, is_more_linear, linearity, motor_changes
from gcs_autotune.design.motor_law import law_of_effects
from gcs_autotune.errors import NotInformative
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.rover_parameters import ROVER_PARAMETERS
from sitl.autopilot.servo_rail import ServoRail

COMMANDS = np.array([-1.0, -0.75, -0.5, -0.25, 0.12, 0.25, 0.5, 0.75, 1.0])
NOISE = 0.005


def thrust(dead: float, curve: float, astern: float) -> NDArray[np.float64]:
    p = np.abs(COMMANDS)
    beyond = np.maximum(p - dead, 0.0)
    size = (1.0 - curve) * beyond + curve * beyond**2
    return np.sign(COMMANDS) * size * np.where(COMMANDS < 0.0, astern, 1.0)


def seen(*numbers: float, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    stds = np.full(len(COMMANDS), NOISE)
    return thrust(*numbers) + np.random.default_rng(seed).normal(0.0, stds), stds


@pytest.mark.parametrize("law", [MotorLaw(), MotorLaw(0.1), MotorLaw(0.0, 0.7), MotorLaw(0.05, -0.4, 2.0)])
def test_outputs_match_the_simulated_motor_library(law: MotorLaw) -> None:
    values: dict[str, Any] = {
        "SERVO1_FUNCTION": 73.0,
        "SERVO3_FUNCTION": 74.0,
        "MOT_SLEWRATE": 0.0,
        "MOT_THR_MIN": 100.0 * law.floor,
        "MOT_THST_EXPO": law.expo,
        "MOT_THST_ASYM": law.asymmetry,
    }
    parameters = ParameterStore(ROVER_PARAMETERS)
    parameters.values.update(values)
    motors, rail = RoverMotors(parameters, 0.02), ServoRail(parameters)
    sent = []
    for command in COMMANDS:
        motors.set_throttle(100.0 * command)
        motors.output(rail, 0.0, armed=True)
        sent.append((rail.pwm[0] - 1500) / 500)
    assert sent == pytest.approx(law.outputs(COMMANDS), abs=2.1e-3)


@pytest.mark.parametrize("law", [MotorLaw(0.1), MotorLaw(0.0, 0.7), MotorLaw(0.05, -0.4, 2.0)])
def test_the_thrust_of_a_matching_law_is_proportional_to_the_command(law: MotorLaw) -> None:
    assert law.thrust(law.outputs(COMMANDS)) == pytest.approx(law.reachable(COMMANDS), abs=1e-9)


@pytest.mark.parametrize(("dead", "curve", "astern"), [(0.1, 0.0, 1.0), (0.0, 0.6, 1.0), (0.08, 0.5, 0.5), (0, 1, 0.7)])
def test_dead_zone_curve_and_weak_astern_become_parameters(dead: float, curve: float, astern: float) -> None:
    for seed in range(5):
        forces, stds = seen(dead, curve, astern, seed=seed)
        law = fit_motor_law(COMMANDS, forces, stds, skid=True).law
        wanted = law_of_effects(dead, curve)
        assert law.floor == pytest.approx(wanted.floor, abs=0.03)
        assert law.expo == pytest.approx(wanted.expo, abs=0.12)
        assert law.asymmetry == pytest.approx(1.0 / astern, rel=0.08)
        before = linearity(MotorLaw(), COMMANDS, forces, stds, skid=True)
        stored = law.stored
        after = linearity(stored, COMMANDS, thrust_at(stored, dead, curve, astern), stds, skid=True)
        assert is_more_linear(before, after)
        assert after.departure < 0.02


def thrust_at(law: MotorLaw, dead: float, curve: float, astern: float) -> NDArray[np.float64]:
    p = law.outputs(COMMANDS)
    beyond = np.maximum(np.abs(p) - dead, 0.0)
    return np.sign(p) * ((1.0 - curve) * beyond + curve * beyond**2) * np.where(p < 0.0, astern, 1.0)


def test_an_ideal_thruster_gets_no_parameter() -> None:
    for seed in range(20):
        forces, stds = seen(0.0, 0.0, 1.0, seed=seed)
        assert fit_motor_law(COMMANDS, forces, stds, skid=True).law == MotorLaw()


def test_one_thruster_has_no_parameter_for_weak_thrust_astern() -> None:
    forces, stds = seen(0.0, 0.0, 0.5)
    assert fit_motor_law(COMMANDS, forces, stds, skid=False).law == MotorLaw()
    found = linearity(MotorLaw(), COMMANDS, forces, stds, skid=False)
    assert found.departure < 0.03
    assert found.astern == pytest.approx(0.5, abs=0.03)


def test_a_thrust_that_falls_with_the_output_is_rejected() -> None:
    forces, stds = seen(0.0, 0.0, 1.0)
    with pytest.raises(NotInformative, match="does not rise"):
        fit_motor_law(COMMANDS, -forces, stds, skid=True)


def test_the_cruise_and_maximum_throttle_keep_their_thrust() -> None:
    present = {
        "MOT_THR_MIN": 0.0,
        "MOT_THST_EXPO": 0.0,
        "MOT_THST_ASYM": 1.0,
        "CRUISE_THROTTLE": 50.0,
        "MOT_THR_MAX": 80.0,
    }
    found = MotorFit(MotorLaw(0.0, 1.0), MotorLaw(0.0, 1.0), 0.01)
    changes = {c.parameter: c.new for c in motor_changes(found, present, skid=True)}
    assert changes == {"MOT_THST_EXPO": 1.0, "CRUISE_THROTTLE": 25.0, "MOT_THR_MAX": 64.0}


@pytest.mark.parametrize(("throttle", "factor"), [(25.0, 0.5), (50.0, 1.0), (80.0, 1.6)])
def test_the_loop_gain_at_cruise_is_kept(throttle: float, factor: float) -> None:
    present = {
        "MOT_THR_MIN": 0.0,
        "MOT_THST_EXPO": 0.0,
        "CRUISE_THROTTLE": throttle,
        "ATC_SPEED_P": 0.2,
        "ATC_SPEED_I": 0.3,
        "ATC_STR_RAT_P": 0.4,
    }
    found = MotorFit(MotorLaw(0.0, 1.0), MotorLaw(0.0, 1.0), 0.01)  # thrust goes with the square
    for skid in (False, True):
        changes = {c.parameter: c.new for c in motor_changes(found, present, skid=skid)}
        assert changes.get("ATC_SPEED_P", 0.2) == pytest.approx(0.2 * factor, rel=0.01)
        assert changes.get("ATC_SPEED_I", 0.3) == pytest.approx(0.3 * factor, rel=0.01)
        assert changes.get("ATC_STR_RAT_P", 0.4) == pytest.approx(0.4 * (factor if skid else 1.0), rel=0.01)


def test_a_missing_parameter_is_left_out() -> None:
    found = MotorFit(MotorLaw(0.0, 0.0, 2.0), MotorLaw(0.0, 0.0, 2.0), 0.01)
    assert not motor_changes(found, {"MOT_THR_MIN": 0.0, "MOT_THST_EXPO": 0.0}, skid=True)


def test_a_difference_within_the_noise_is_not_an_improvement() -> None:
    old, new = (Linearity(tuple(COMMANDS), tuple(COMMANDS), d, 0.02, 1.0) for d in (0.03, 0.02))
    assert not is_more_linear(old, new)
