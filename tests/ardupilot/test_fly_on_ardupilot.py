"""``fly`` and ``recheck`` on ArduPilot's own firmware, on our hulls: figures and model against the true values."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import pytest
from firmware_process import KINDS, binary_of
from tuning import free_ports

from benchmarks.rivals.firmware_loop import FirmwareLoop
from benchmarks.zig_zag_accuracy import truth
from sitl import load_vehicle

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(2000)]

WARM_UP = 120.0
"""Seconds before the first command: the estimator's heading drifts until the gyro biases are estimated."""


def flown(vehicle: str, folder: Path, *words: str) -> tuple[Path, str]:
    """Fly as a user would; check on another link that the vehicle is unchanged; return the run and the output."""
    data = load_vehicle(vehicle)
    if binary_of(KINDS[data.firmware]) is None:
        pytest.skip(f"{KINDS[data.firmware].variable} is not set")
    run, output = folder / "run", folder / "output.txt"
    sea = FirmwareLoop(data, instance=int(os.environ.get("ARDUPILOT_INSTANCE", "10")), ports=free_ports(3))
    try:
        sea.run(WARM_UP)
        found, ready = (sea.armed, sea.mode), sea.armed_seconds
        status = sea.host([*words, "--connect", sea.tuner_uri, "--yes", "--out", str(run)], output)
        text = output.read_text()
        assert status == 0, text[-2000:]
        sea.run(5.0)
        assert (sea.armed, sea.mode) == found
        assert sea.armed_seconds > ready
        assert all(abs(share) < 0.01 for share in sea.physics.shares.values())
    finally:
        sea.close()
    return run, text


def figures_of(run: Path) -> dict[str, Any]:
    (sheet,) = json.loads((run / "figures.json").read_text())["sheets"]
    return {figure["slug"]: figure["value"] for figure in sheet["figures"]}


@pytest.mark.parametrize("steering", [0.3, 0.67])
def test_a_zig_zag_of_a_boat_gives_its_nomoto_constants(tmp_path: Path, steering: float) -> None:
    run, _ = flown("charlie", tmp_path, "fly", "zig-zag", "--steering", f"{steering:g}")
    figures = figures_of(run)
    K, T = truth("charlie", steering)
    parameters = {name: p["value"] for name, p in json.loads((run / "fit.json").read_text())["parameters"].items()}
    assert 1.0 / parameters["beta_r"] == pytest.approx(K, rel=0.03)
    assert parameters["alpha_r"] / parameters["beta_r"] == pytest.approx(T, rel=0.05)
    assert math.radians(0.5) < figures["first-overshoot"] < math.radians(20.0)


def test_an_rov_flies_a_zig_zag_with_its_yaw_moment(tmp_path: Path) -> None:
    run, _ = flown("bluerov2", tmp_path, "fly", "zig-zag")
    assert figures_of(run)["first-overshoot"] > 0.0
    assert (run / "report.html").stat().st_size > 10_000


def test_recheck_evaluates_the_heading_loop_of_a_boat(tmp_path: Path) -> None:
    run, _ = flown("charlie", tmp_path, "recheck", "heading")
    assert figures_of(run)["explained"] > 0.5
