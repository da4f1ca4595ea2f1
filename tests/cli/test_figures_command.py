"""``gcs-autotune figures`` as typed."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.logs import load_runs
from gcs_autotune.seatrials import ship_figures


@pytest.fixture
def zigzag(tmp_path):
    """A 20/20 zig-zag of 4 r' + r = 0.25 delta, exact between samples, in degrees."""
    dt, psi, r, delta, rows = 0.1, 0.0, 0.0, 0.0, []
    for k in range(1200):
        if k >= 100:
            delta = delta or 20.0
            delta = -20.0 if psi >= 20.0 else 20.0 if psi <= -20.0 else delta
        rows.append(f"{k * dt:.1f},{psi:.3f},{delta:.1f}")
        steady, decay = 0.25 * delta, math.exp(-dt / 4.0)
        psi += steady * dt + (r - steady) * 4.0 * (1.0 - decay)
        r = steady + (r - steady) * decay
    path = tmp_path / "zz.csv"
    path.write_text("t[s],psi[deg],delta[deg]\n" + "\n".join(rows) + "\n")
    return path


def test_figures_prints_a_table_with_the_criterion(capsys, zigzag):
    assert main(["figures", str(zigzag), "--length", "7", "--speed", "1"]) == 0
    out = capsys.readouterr().out
    assert "20/20 zig-zag" in out
    row = next(line for line in out.splitlines() if "first overshoot" in line)
    assert "25" in row
    assert "met" in row


def test_figures_prints_json_without_nan(capsys, zigzag):
    assert main(["figures", str(zigzag), "--json"]) == 0
    (sheet,) = json.loads(capsys.readouterr().out)["sheets"]
    values = {f["slug"]: f["value"] for f in sheet["figures"]}
    assert values["K"] == pytest.approx(0.25, rel=0.01)
    assert values["T"] == pytest.approx(4.0, rel=0.01)


def test_a_page_has_the_diagram_with_the_overshoots_at_their_extremes(capsys, tmp_path, zigzag):
    page = tmp_path / "zigzag.html"
    assert main(["figures", str(zigzag), "--page", str(page)]) == 0
    capsys.readouterr()
    (sheet,) = ship_figures(load_runs(zigzag)[0])
    text = page.read_text()
    assert "Heading change and helm over the time" in text
    assert len(sheet.shape.points) == sum("overshoot" in figure.slug for figure in sheet.figures)
    _, t, psi = sheet.shape.lines[0]
    for reported, when, value in sheet.shape.points:
        assert reported in text
        assert value == pytest.approx(float(np.interp(when, t, psi)), abs=math.radians(0.2))
        assert abs(value) == pytest.approx(
            math.radians(20.0) + math.radians(float(reported[:-1])), abs=math.radians(1.0)
        )


@pytest.mark.parametrize("others", [(), ("other.csv",)])
def test_a_run_passed_as_the_page_file_is_reported_and_kept(capsys, zigzag, others):
    before = zigzag.read_bytes()
    assert main(["figures", "--page", str(zigzag), *others]) == 2
    printed = capsys.readouterr().err
    assert f"{zigzag} exists and is not a report of this program" in printed
    assert "report.html" in printed
    assert zigzag.read_bytes() == before


@pytest.mark.parametrize("text", ["<!DOCTYPE html>\n<title>my own page</title>\n", "<mission/>\n", "<svg></svg>\n"])
def test_a_page_not_written_by_this_program_is_kept(capsys, tmp_path, zigzag, text):
    page = tmp_path / "own.html"
    page.write_text(text)
    assert main(["figures", str(zigzag), "--page", str(page)]) == 2
    assert "is not a report of this program" in capsys.readouterr().err
    assert page.read_text() == text


def test_a_page_of_an_earlier_call_is_replaced_and_a_folder_is_not(capsys, tmp_path, zigzag):
    page = tmp_path / "zigzag.html"
    for note in ("", " (replaced an earlier file)"):
        assert main(["figures", str(zigzag), "--page", str(page)]) == 0
        assert capsys.readouterr().out.endswith(f"Report: {page}{note}\n")
    assert main(["figures", "--page", str(tmp_path), str(zigzag)]) == 2


def test_a_run_without_figures_exits_with_six_and_a_reason(capsys, tmp_path):
    path = tmp_path / "still.csv"
    path.write_text("t[s],psi[deg],delta[deg]\n" + "\n".join(f"{k},{k % 2},{k > 20:d}" for k in range(40)) + "\n")
    assert main(["figures", str(path)]) == 6
    assert "no zig-zag" in capsys.readouterr().err


def test_figures_rejects_a_negative_length(capsys, zigzag):
    assert main(["figures", str(zigzag), "--length", "-7"]) == 2
