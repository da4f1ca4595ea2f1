"""``aboard`` on ArduPilot's own firmware, on our hull: its scripting flies the relay, and its log is identified."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from firmware_process import KINDS, binary_of
from tuning import free_ports

from benchmarks.rivals.firmware_loop import FirmwareLoop
from sitl import load_vehicle

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(2000)]

WARM_UP = 120.0
"""Seconds before the first command: the estimator's heading drifts until the gyro biases are estimated."""
TRUTH = {"alpha_r": 16.361, "beta_r": 4.909}
"""Charlie at 80 % throttle."""


def test_a_script_aboard_identifies_a_boat_and_leaves_nothing_behind(tmp_path: Path) -> None:
    data = load_vehicle("charlie")
    if binary_of(KINDS[data.firmware]) is None:
        pytest.skip(f"{KINDS[data.firmware].variable} is not set")
    data = replace(data, parameters={**data.parameters, "SCR_ENABLE": 1})
    run, output = tmp_path / "run", tmp_path / "output.txt"
    sea = FirmwareLoop(data, instance=int(os.environ.get("ARDUPILOT_INSTANCE", "10")), ports=free_ports(3))
    try:
        sea.run(WARM_UP)
        words = ["aboard", "heading", "--connect", sea.tuner_uri, "--yes", "--out", str(run)]
        words += ["--silence", "60"]  # of vehicle time, on a machine that may be busy
        status = sea.host(
            words, output, while_running=lambda pid: None
        )  # scripts have no lock step: at the wall's pace
        assert status == 0, output.read_text()[-2000:]
        sea.run(5.0)
        assert not sea.armed
        assert all(abs(share) < 0.01 for share in sea.physics.shares.values())
        assert list((Path(sea._folder.name) / "scripts").iterdir()) == []
    finally:
        sea.close()
    found = {name: p["value"] for name, p in json.loads((run / "fit.json").read_text())["parameters"].items()}
    for name, truth in TRUTH.items():
        assert found[name] == pytest.approx(truth, rel=0.02)
