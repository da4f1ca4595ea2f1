"""Complete jobs on ArduPilot's own firmware: on the command line, and in this process to be stopped."""

from __future__ import annotations

import json
import math
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from firmware_process import ArduPilot, Witness

from gcs_autotune.models import SingleDof
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Connection, TuneSettings, tune

__all__ = [
    "QUICK",
    "Stopper",
    "assert_left_alone",
    "command_line",
    "free_ports",
    "steady_velocity",
    "summary_of",
    "tune_until",
]

QUICK = ("--step-duration", "8")
"""Options that make a tune of a lively craft short."""
_DISARMED_PULSES = (0, 1500)
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}


def command_line(*arguments: str, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run ``gcs-autotune`` with these arguments."""
    command = [sys.executable, "-m", "gcs_autotune", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False, env=ENVIRONMENT)


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run."""
    summary: dict[str, Any] = json.loads((run / "summary.json").read_text())
    return summary


def steady_velocity(run: Path, output: float) -> float:
    """Return the velocity [rad/s or m/s] that *output* [fraction of full] sustains in the model that a run identified.

    Whichever law its model is of: with thrust that grows with the square of the output, and a dead zone, if there.
    """
    found = json.loads((run / "fit.json").read_text())["parameters"].items()
    beta, beta_quadratic, delta = (
        next(p["value"] for name, p in found if re.fullmatch(pattern, name))
        for pattern in ("beta_.", "beta_..", "delta")
    )
    for effect in json.loads((run / "model.json").read_text()).get("effects", ()):
        values, size = {**effect["constants"], **effect["values"]}, abs(output)
        if effect["slug"] == "dead-zone":
            size = max(size - values["width"], 0.0)
        elif effect["slug"] == "quadratic-actuator":
            size *= 1.0 - values["share"] + values["share"] * size / values["u_ref"]
        else:
            raise AssertionError(f"unexpected {effect['slug']} for a stock craft")
        output = math.copysign(size, output)
    return SingleDof("yaw", "1", 1.0, beta, beta_quadratic, delta).steady_velocity(output)


def free_ports(count: int) -> list[int]:
    """Return *count* free UDP ports."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [int(s.getsockname()[1]) for s in sockets]
    for s in sockets:
        s.close()
    return ports


class Stopper(SilentObserver):
    """Operator and observer in one: presses Ctrl-C at the first announcement that begins with *stage*."""

    def __init__(self, stage: str) -> None:
        self._stage = stage
        self.announced: list[str] = []
        self.pressed = False

    def say(self, text: str) -> None:
        self.announced.append(text)
        self.pressed |= text.startswith(self._stage)

    def stop_requested(self) -> bool:
        return self.pressed

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        return True


def tune_until(firmware: ArduPilot, axis: str, stage: str, directory: Path, **changes: Any) -> Stopper:
    """Tune *axis* and stop as soon as *stage* is announced; raises what the tune raises."""
    stopper = Stopper(stage)
    settings = TuneSettings(Connection(firmware.uri, system_id=1), directory, axis=axis, step_duration=5.0, **changes)
    tune(settings, stopper, stopper, "2026-11-21T12:00:00")
    return stopper


def assert_left_alone(witness: Witness, before: dict[str, float], mode: int) -> None:
    """Assert on another ground station that the vehicle is unchanged: neutral, disarmed, mode and parameters."""
    assert all(pwm in _DISARMED_PULSES for pwm in witness.outputs()), witness.outputs()
    assert witness.mode_and_armed() == (mode, False)
    assert witness.parameters(list(before)) == before


def gains_of(axis: Any) -> Sequence[str]:
    """Return the names of the parameters that a tune of *axis* may write."""
    return [gain.parameter for gain in axis.gains]
