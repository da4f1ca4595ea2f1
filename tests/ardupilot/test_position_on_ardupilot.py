"""`tune position` and `hold` on ArduPilot's own firmware with our hulls, in lock step."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from firmware_process import KINDS, binary_of
from tuning import free_ports, summary_of

from benchmarks.rivals.firmware_loop import FirmwareLoop
from sitl import load_vehicle

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(900)]

WARM_UP = {"sub": 90.0, "rover": 240.0}
"""Seconds before the first command: the estimator needs a position, a boat's also a steady heading."""


def fly(name: str, folder: Path, *words: str) -> tuple[int, str]:
    """Run a command on our hull under the firmware; return its exit code and what it printed."""
    data = load_vehicle(name)
    kind = "rover" if data.is_boat else "sub"
    if binary_of(KINDS[kind]) is None:
        pytest.skip(f"{KINDS[kind].variable} is not set")
    sea = FirmwareLoop(data, instance=int(os.environ.get("ARDUPILOT_INSTANCE", "10")), ports=free_ports(3))
    try:
        sea.run(WARM_UP[kind])
        command = [*words, "--connect", sea.tuner_uri, "--yes", "--quiet", "--out", str(folder / "run")]
        code = sea.host(command, folder / "output.txt")
    finally:
        sea.close()
    return code, (folder / "output.txt").read_text()


def test_the_position_loop_of_an_rov_is_tuned_and_kept(tmp_path: Path) -> None:
    code, output = fly("bluerov2-sway", tmp_path, "tune", "position")
    assert code == 0, output[-2000:]
    summary = summary_of(tmp_path / "run")
    assert summary["ending"] == "kept"
    before, after = summary["position"]["before"], summary["position"]["after"]
    assert after["itae"] < before["itae"]
    assert after["push"] < before["push"]


HELD = [("bluerov2-sway", "position"), ("bluerov2", "heading"), ("bluerov2", "depth"), ("blueboat", "heading")]


@pytest.mark.parametrize(("name", "what"), HELD)
def test_our_own_loop_holds_the_setpoint(name: str, what: str, tmp_path: Path) -> None:
    code, output = fly(name, tmp_path, "hold", what)
    assert code == 0, output[-2000:]
    assert "mode and armed state restored" in output
