"""``tune speed`` and ``tune yaw`` on unmodified ArduPilot with its stock physics, rudder, skid and vectored."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from firmware_process import KINDS, ArduPilot, binary_of

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(900)]

SKID = {"SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74, "CRUISE_SPEED": 3, "CRUISE_THROTTLE": 75, "WP_SPEED": 3}
SPACE = ("--max-speed", "12", "--max-distance", "2000")


def process(kind: str, **options: Any) -> Iterator[ArduPilot]:
    """Yield a firmware just started; skip when the environment names no binary."""
    binary = binary_of(KINDS[kind])
    if binary is None:
        pytest.skip(f"{KINDS[kind].variable} is not set: set it to ArduPilot's binary")
    with ArduPilot(KINDS[kind], binary, **options) as firmware:
        yield firmware


@pytest.fixture
def motorboat() -> Iterator[ArduPilot]:
    yield from process("rover", speedup=5.0)


@pytest.fixture
def skid_boat() -> Iterator[ArduPilot]:
    yield from process("rover", speedup=5.0, model="motorboat-skid", extra=SKID)


@pytest.fixture
def vectored() -> Iterator[ArduPilot]:
    yield from process("sub", speedup=1.0)


def tuned(firmware: ArduPilot, axis: str, run: Path, *options: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tune as a user does; return summary and fit, after checking the gains that the vehicle holds."""
    command = [
        sys.executable,
        "-m",
        "gcs_autotune",
        "tune",
        axis,
        "--connect",
        firmware.uri,
        "--yes",
        "--out",
        str(run),
    ]
    done = subprocess.run(
        [*command, *options],
        capture_output=True,
        text=True,
        timeout=800.0,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    summary = json.loads((run / "summary.json").read_text())
    witness = firmware.witness()
    try:
        for name, (_, new) in summary["gains"].items():
            assert witness.parameter(name) == pytest.approx(new, rel=1e-6)
        assert not witness.mode_and_armed()[1]
    finally:
        witness.close()
    return summary, json.loads((run / "fit.json").read_text())


def test_the_stock_boats_surge_and_cruise_pair_are_identified_and_its_speed_loop_improves(motorboat, tmp_path) -> None:
    """``V' = 25 u - 0.25 V|V|`` (SIM_Sailboat): at 30 % throttle 5.48 m/s."""
    summary, fit = tuned(motorboat, "speed", tmp_path / "run", *SPACE)
    assert summary["ending"] == "kept"
    assert summary["metrics"]["after"]["itae"] < 0.9 * summary["metrics"]["before"]["itae"]
    assert summary["gains"]["CRUISE_SPEED"][1] == pytest.approx(math.sqrt(0.3 / 0.01), rel=0.02)
    assert fit["parameters"]["alpha_u"]["value"] == pytest.approx(1.0 / 25.0, rel=0.15)
    assert fit["parameters"]["beta_uu"]["value"] == pytest.approx(0.25 / 25.0, rel=0.15)
    assert abs(fit["thrust_curve"]["square"]) < 0.25


def test_a_skid_boat_with_a_wrong_cruise_pair_follows_speeds_after_the_tune(skid_boat, tmp_path) -> None:
    """It keeps 3 m/s at 9 % throttle; the parameter is 75 %."""
    summary, _ = tuned(skid_boat, "speed", tmp_path / "run", *SPACE)
    assert summary["ending"] == "kept"
    assert summary["metrics"]["after"]["itae"] < 0.5 * summary["metrics"]["before"]["itae"]
    assert summary["gains"]["CRUISE_THROTTLE"][1] == pytest.approx(9.0, abs=2.0)


def test_the_stock_rov_follows_turn_rates_better_after_the_tune(vectored, tmp_path) -> None:
    summary, _ = tuned(vectored, "yaw", tmp_path / "run", "--control-rate", "40", "--relay-output", "0.25")
    assert summary["ending"] == "kept"
    assert summary["metrics"]["after"]["itae"] < 0.7 * summary["metrics"]["before"]["itae"]
    assert summary["metrics"]["after"]["steady_error"] < 0.1
