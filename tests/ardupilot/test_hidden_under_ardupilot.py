"""An effect hidden in our hull under the real firmware, identified from every record of one session over MAVLink.

The record of the experiment itself, the telemetry log beside it, and the firmware's own log on board.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from firmware_process import KINDS, binary_of
from tuning import command_line, free_ports

from benchmarks.rivals.firmware_loop import FirmwareLoop
from sitl import load_vehicle
from sitl.effects import parse_effect

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(2000)]

HIDDEN, DELAY = "input-delay", 0.8
PATIENCE = 900.0
"""Wall seconds for a diagnosis, which takes one minute of a processor that has nothing else to do."""
WARM_UP = 120.0
"""Seconds before the first command: the estimator's heading drifts until the gyro biases are estimated."""


@dataclass(frozen=True)
class Session:
    """The files of one flight: the run directory and the onboard log."""

    run: Path
    onboard: Path


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    if binary_of(KINDS["rover"]) is None:
        pytest.skip(f"{KINDS['rover'].variable} is not set")
    folder = tmp_path_factory.mktemp("hidden")
    run, onboard = folder / "run", folder / "onboard.bin"
    effect = parse_effect(f"{HIDDEN}.delay={DELAY:g}")
    instance = int(os.environ.get("ARDUPILOT_INSTANCE", "10"))
    sea = FirmwareLoop(load_vehicle("charlie"), instance=instance, ports=free_ports(3), effects=[effect])
    try:
        sea.run(WARM_UP)
        flown = sea.host(
            ["experiment", "heading", "--connect", sea.tuner_uri, "--yes", "--out", str(run)], folder / "output.txt"
        )
        assert flown == 0, (folder / "output.txt").read_text()[-2000:]
        (log,) = Path(sea._folder.name).glob("logs/*.BIN")
        shutil.copy(log, onboard)
    finally:
        sea.close()
    yield Session(run, onboard)


def run_json(*arguments: str | Path) -> Any:
    done = command_line(*map(str, arguments), "--json", timeout=PATIENCE)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def identifies_it(diagnosis: dict[str, Any]) -> bool:
    """Whether the effect is among the causes, or in a group that this record cannot distinguish from one of them."""
    causes = set(diagnosis["causes"])
    return HIDDEN in causes or any(HIDDEN in group and causes & set(group) for group in diagnosis["indistinguishable"])


def test_a_hidden_delay_is_identified_from_the_recorded_experiment(session: Session) -> None:
    diagnosis = run_json("diagnose", session.run)
    assert identifies_it(diagnosis), diagnosis["causes"]


def test_both_logs_of_the_session_give_the_same_model_with_the_same_delay(session: Session, tmp_path: Path) -> None:
    found = []
    for log in (session.run / "telemetry.tlog", session.onboard):
        folder = tmp_path / log.stem
        imported = command_line("logs", "import", str(log), "--out", str(folder))
        assert imported.returncode == 0, imported.stderr[-2000:]
        manual = [p for p in sorted(folder.glob("*.csv")) if _mode(p) == "MANUAL"]
        longest = max(manual, key=lambda p: p.stat().st_size)
        found.append(run_json("identify", longest, "--dof", "yaw", "--structure", "linear")["parameters"])
    link, board = found
    assert link["delay"]["value"] == pytest.approx(DELAY, abs=0.15)
    for name in ("alpha_r", "beta_r", "delay"):
        assert board[name]["value"] == pytest.approx(link[name]["value"], rel=0.1), name


def _mode(path: Path) -> str:
    return str(json.loads(path.with_suffix(".json").read_text())["meta"].get("mode", ""))


def test_a_hidden_delay_is_identified_from_the_onboard_log_alone(session: Session) -> None:
    diagnosis = run_json("diagnose", session.onboard, "--dof", "yaw")
    assert identifies_it(diagnosis), diagnosis["causes"]
