"""One file outside the package and one line in a table: a method, an axis, a control law, a firmware, then used by
the command line. The files are those of docs/how-to-add.md.
"""

from __future__ import annotations

import importlib.util
import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import report_stories

from gcs_autotune.axes import AXES
from gcs_autotune.cli import main
from gcs_autotune.design import LAWS
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs import formats, load_runs
from gcs_autotune.methods import METHOD_PLACES
from gcs_autotune.report import to_html, to_json
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.report.tune import document


def added(folder: Path, name: str) -> ModuleType:
    """Write a file as shown on the page and import it."""
    page = (Path(__file__).parents[1] / "docs" / "how-to-add.md").read_text(encoding="utf-8")
    (text,) = re.findall(rf"```python\n# {name}\.py\n(.*?)```", page, re.DOTALL)
    path = folder / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_kind_of_file_is_read_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    form = added(tmp_path, "paddle_log").FORMAT
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, form))
    log = tmp_path / "lake.txt"
    log.write_text("PADDLE 1\n0.0 10.0 0.5\n0.1 11.0 0.5\n")
    (run,) = load_runs(log)
    assert run["psi"].values == pytest.approx([math.radians(10.0), math.radians(11.0)])
    assert run["N"].values.tolist() == [0.5, 0.5]


def test_a_section_of_a_report_is_on_page_terminal_and_in_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    section = added(tmp_path, "energy_section").energy
    monkeypatch.setattr(document, "SECTIONS", (*document.SECTIONS, section))
    report = document.tune_document(replace(report_stories.never_started(), relays=(report_stories.relay_trial(),)))
    for shown in (to_html(report), render_text(report), json.dumps(to_json(report)["energy"])):
        assert "Longer runs take more of it." in shown and "relay-1" in shown


def test_a_method_is_listed_and_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "by_balance", added(tmp_path, "by_balance"))
    monkeypatch.setitem(METHOD_PLACES, "balance", "by_balance:METHOD")  # type: ignore[arg-type]
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


@pytest.mark.slow
@pytest.mark.usefixtures("briefly")
def test_an_axis_a_control_law_and_a_firmware_tune_a_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    law = added(tmp_path, "gentle_heading").LAW
    monkeypatch.setitem(LAWS, law.name, law)  # type: ignore[arg-type]
    axis = added(tmp_path, "course").AXIS
    monkeypatch.setitem(AXES, axis.name, axis)  # type: ignore[arg-type]
    firmware: Any = added(tmp_path, "gentlerover").FIRMWARE
    monkeypatch.delitem(FIRMWARE, "ardurover")  # type: ignore[arg-type]  # the simulated boat is to be taken for ours
    monkeypatch.setitem(FIRMWARE, firmware.name, firmware)  # type: ignore[arg-type]
    out = tmp_path / "run"
    assert main(["tune", "course", "--connect", "sitl:charlie", "--dry-run", "--out", str(out)]) == 0
    output = " ".join(capsys.readouterr().err.split())
    assert "STEERED and MANUAL; " in output
    assert "20° course steps" in output
    assert "Designed for a gentle helm" in (out / "report.html").read_text(encoding="utf-8")
    assert not json.loads((out / "summary.json").read_text(encoding="utf-8"))["differences"]
