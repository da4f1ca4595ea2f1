"""A dead zone hidden in our hull under the real firmware, corrected by the firmware's own motor parameters."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from firmware_process import KINDS, binary_of
from tuning import free_ports, summary_of

from benchmarks.rivals.firmware_loop import FirmwareLoop
from sitl import load_vehicle
from sitl.effects import parse_effect

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(2000)]

WARM_UP = 120.0


def test_thrust_follows_the_command_after_tune_actuators(tmp_path: Path) -> None:
    if binary_of(KINDS["rover"]) is None:
        pytest.skip(f"{KINDS['rover'].variable} is not set")
    run, output = tmp_path / "run", tmp_path / "output.txt"
    instance = int(os.environ.get("ARDUPILOT_INSTANCE", "10"))
    effects = [parse_effect("dead-zone@X.width=0.1")]
    sea = FirmwareLoop(load_vehicle("blueboat"), instance=instance, ports=free_ports(3), effects=effects)
    try:
        sea.run(WARM_UP)
        line = ["tune", "actuators", "--connect", sea.tuner_uri, "--yes", "--out", str(run)]
        assert sea.host(line, output) == 0, output.read_text()[-2000:]
    finally:
        sea.close()
    summary = summary_of(run)
    assert summary["ending"] == "kept"
    assert summary["thrust"]["after"]["departure"] < 0.2 * summary["thrust"]["before"]["departure"]
    assert summary["gains"]["MOT_THR_MIN"][1] == pytest.approx(10.0, abs=2.0)
    assert summary["gains"]["MOT_THST_ASYM"][1] == pytest.approx(2.0, rel=0.1)
