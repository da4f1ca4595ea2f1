"""Outputs of firmware before SERVOn_FUNCTION, from the parameters of that time."""

from __future__ import annotations

import pytest

from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import FIRMWARE, ServoMap, read_servo_map, with_outputs
from gcs_autotune.logs.sample_store import RecordedParameters

ROVER = FIRMWARE["ardurover"]
LIMITS = {
    "RC1_MIN": 1000.0,
    "RC1_TRIM": 1480.0,
    "RC1_MAX": 2000.0,
    "RC3_MIN": 1100.0,
    "RC3_TRIM": 1500.0,
    "RC3_MAX": 1900.0,
}
OLD = {**LIMITS, "RC1_REV": 1.0, "RC3_REV": -1.0}


def wired(values: dict[str, float], version: str = "") -> ServoMap:
    return read_servo_map(RecordedParameters(with_outputs(values, ROVER, version).values), ROVER)


def test_steering_is_on_output_1_and_throttle_on_output_3() -> None:
    found = wired(OLD)
    assert found.forces([1480.0, 0.0, 1500.0]) == {"X": 0.0, "N": 0.0}
    assert found.forces([2000.0, 0.0, 1500.0]) == {"X": 0.0, "N": 1.0}
    assert found.forces([1240.0, 0.0, 1900.0]) == {"X": -1.0, "N": -0.5}, "RC3_REV -1 reverses the throttle"


def test_skid_steer_out_puts_the_left_thruster_on_1_and_the_right_one_on_3() -> None:
    found = wired({**{n.replace("1480", "1500"): v for n, v in OLD.items()}, "RC3_REV": 1.0, "SKID_STEER_OUT": 1.0})
    assert found.skid
    assert found.forces([2000.0, 0.0, 1900.0]) == {"X": 1.0, "N": 0.0}
    assert found.forces([2000.0, 0.0, 1100.0]) == {"X": 0.0, "N": 1.0}


def test_rcmap_moves_the_output_with_its_channel() -> None:
    moved = {"RCMAP_ROLL": 1.0, "RCMAP_THROTTLE": 2.0, "RC2_MIN": 1000.0, "RC2_TRIM": 1500.0, "RC2_MAX": 2000.0}
    assert wired({**OLD, **moved}).forces([1480.0, 2000.0, 1500.0]) == {"X": 1.0, "N": 0.0}


@pytest.mark.parametrize("version", ["ArduRover v2.46 (00000000)", "APM:Rover v3.1", "APM:Rover v3.2.0"])
def test_an_early_version_is_identified_by_its_version_text_and_missing_limits_are_assumed(version: str) -> None:
    outputs = with_outputs({"RC1_TRIM": 1490.0}, ROVER, version)
    assert outputs.values["SERVO3_FUNCTION"] == 70.0
    assert outputs.values["SERVO1_TRIM"] == 1490.0
    assert outputs.assumed["RC3_MAX"] == 1900.0
    assert "RC1_TRIM" not in outputs.assumed


@pytest.mark.parametrize(
    ("values", "version"),
    [
        (LIMITS, "ArduRover V4.5.7 (abcdef01)"),
        (LIMITS, ""),
        ({**OLD, "SERVO1_FUNCTION": 26.0}, "ArduRover V4.5.7"),
        ({}, "ArduRover v2.46"),
    ],
)
def test_incomplete_parameters_do_not_make_a_vehicle_an_early_version(values: dict[str, float], version: str) -> None:
    assert with_outputs(values, ROVER, version).values == values


def test_limits_out_of_order_are_reported_by_the_vehicles_own_parameter_names() -> None:
    outputs = with_outputs({**OLD, "RC1_TRIM": 2100.0}, ROVER)
    with pytest.raises(PreconditionFailed) as error:
        read_servo_map(RecordedParameters(outputs.values), ROVER)
    assert "RC1_MIN 1000" in outputs.names.worded(str(error.value))


def test_an_impossible_channel_is_refused_with_its_parameter_name() -> None:
    with pytest.raises(PreconditionFailed, match="RCMAP_ROLL"):
        with_outputs({**OLD, "RCMAP_ROLL": 1e30}, ROVER)
