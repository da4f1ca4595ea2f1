"""One file outside the package and one line in a table: a method, an axis, a control law, a firmware, then used by
the command line. docs/how-to-add.md tells these tests in prose.
"""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from gcs_autotune.axes import AXES
from gcs_autotune.cli import main
from gcs_autotune.design.laws import LAWS
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import METHODS


def added(folder: Path, name: str, text: str) -> ModuleType:
    """Write a file and import it."""
    path = folder / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


METHOD = '''
import numpy as np

from gcs_autotune.identify.method import Method
from gcs_autotune.identify.open_loop.answer import axis_answer


def fit_by_balance(case):
    """Inertia and linear drag from the forward differences of the velocity."""
    rows, forces = [], []
    for record in case.records:
        t, r = record.velocity.t, record.velocity.values
        tau = record.tau[np.searchsorted(record.t_in, t[:-1], side="right") - 1]
        rows.append(np.column_stack([np.diff(r) / np.diff(t), 0.5 * (r[1:] + r[:-1])]))
        forces.append(tau)
    A, b = np.vstack(rows), np.concatenate(forces)
    (alpha, beta), *_ = np.linalg.lstsq(A, b, rcond=None)
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = np.linalg.inv(A.T @ A) * np.var(b - A @ [alpha, beta])
    fitted = (True, True, False, False)
    return axis_answer(case, "balance", "linear", np.array([alpha, beta, 0.0, 0.0]), covariance, fitted, (), {})


METHOD = Method("balance", "forward differences of the velocity against the input", axis=fit_by_balance)
'''


def test_a_method_is_listed_and_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    method = added(tmp_path, "by_balance", METHOD).METHOD
    monkeypatch.setitem(METHODS, method.name, method)  # type: ignore[arg-type]
    rows, psi, r = [], 0.0, 0.0
    for k in range(600):  # 0.04 r' + 0.02 r = N, exact between samples
        N = 0.06 if k % 80 < 40 else -0.06
        rows.append(f"{0.1 * k:.1f},{psi:.9f},{r:.9f},{N}")
        steady, decay = N / 0.02, math.exp(-0.05)
        psi += 0.1 * steady + (r - steady) * 2.0 * (1.0 - decay)
        r = steady + (r - steady) * decay
    run = tmp_path / "run.csv"
    run.write_text("t[s],psi[rad],r[rad/s],N[N m]\n" + "\n".join(rows) + "\n")
    assert main(["identify", "--method", "list", str(run)]) == 0
    assert "forward differences" in capsys.readouterr().out
    assert main(["identify", str(run), "--method", "balance", "--no-check", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["method"] == "balance"
    assert found["parameters"]["alpha_r"]["value"] == pytest.approx(0.04, rel=0.05)
    assert found["parameters"]["beta_r"]["value"] == pytest.approx(0.02, rel=0.05)


LAW = '''
from gcs_autotune.design.laws.rover_heading import RoverHeading


class GentleHeading(RoverHeading):
    """ArduRover's heading loop, with a word of its own."""

    name = "gentle-heading"

    def notes(self, model, settings, speed):
        return ["designed for a gentle helm", *super().notes(model, settings, speed)]


LAW = GentleHeading()
'''

AXIS = """
import math

from gcs_autotune.axes import AxisKind

AXIS = AxisKind("course", "yaw", "psi", math.radians(20.0), 25.0)
"""

PROFILE = """
from dataclasses import replace

from gcs_autotune.firmware.ardurover import FIRMWARE as ROVER

COURSE = replace(ROVER.axes["heading"], name="course", law="gentle-heading")
MODES = {"STEERED" if name == "GUIDED" else name: number for name, number in ROVER.modes.items()}
FIRMWARE = replace(ROVER, name="gentlerover", modes=MODES, hold_mode="STEERED", axes={**ROVER.axes, "course": COURSE})
"""


@pytest.mark.slow
def test_an_axis_a_control_law_and_a_firmware_tune_a_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    law = added(tmp_path, "gentle_heading", LAW).LAW
    monkeypatch.setitem(LAWS, law.name, law)  # type: ignore[arg-type]
    axis = added(tmp_path, "course", AXIS).AXIS
    monkeypatch.setitem(AXES, axis.name, axis)  # type: ignore[arg-type]
    firmware: Any = added(tmp_path, "gentlerover", PROFILE).FIRMWARE
    monkeypatch.delitem(FIRMWARE, "ardurover")  # type: ignore[arg-type]  # the simulated boat is to be taken for ours
    monkeypatch.setitem(FIRMWARE, firmware.name, firmware)  # type: ignore[arg-type]
    out = tmp_path / "run"
    assert main(["tune", "course", "--connect", "sitl:charlie", "--dry-run", "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "use the modes STEERED and MANUAL" in said
    assert "20 deg steps in heading" in said
    assert "designed for a gentle helm" in (out / "report.html").read_text(encoding="utf-8")
    assert not json.loads((out / "summary.json").read_text(encoding="utf-8"))["differences"]
