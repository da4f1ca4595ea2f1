"""A benchmark of whole tunes can be stopped and resumed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks import reach, studies
from gcs_autotune.axes import AXES
from gcs_autotune.study import open_study
from sitl.catalogue import VEHICLES


def test_a_stopped_run_is_resumed_and_its_rows_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flown: list[tuple[str, str, int]] = []

    def tune_once(vehicle: str, axis: str, seed: int) -> reach.Tuned:
        if len(flown) == 3:
            raise KeyboardInterrupt
        flown.append((vehicle, axis, seed))
        lost = (vehicle, seed) == ("videoray", 2)
        return reach.Tuned(
            vehicle, axis, seed, "aborted" if lost else "kept", 2.0, 1.1, math.nan if lost else 1.0, 0.9, 5.0
        )

    monkeypatch.setattr(reach, "tune_once", tune_once)
    monkeypatch.setattr(studies, "OUT", tmp_path)
    line = ["falcon/heading", "videoray/heading", "--seeds", "2"]
    with pytest.raises(KeyboardInterrupt):
        reach.main(line)
    (folder,) = tmp_path.iterdir()
    assert len(open_study(folder)) == 3
    assert math.isnan(json.loads(open_study(folder)["tuned"][2])["flown"])
    before, flown[:] = list(flown), []
    capsys.readouterr()
    reach.main(line)
    assert flown == [("falcon", "heading", 2)] and ("falcon", "heading", 2) not in before
    table = capsys.readouterr().out.splitlines()
    assert [row.split()[:6] for row in table[5:7]] == [
        ["videoray", "heading", "0.900", "1/2", "1/2", "2.000"],
        ["falcon", "heading", "0.900", "2/2", "2/2", "2.000"],
    ]


def test_every_vehicle_of_the_catalogue_is_tuned_on_every_axis_of_its_firmware() -> None:
    assert {vehicle for vehicle, _ in reach.CASES} == set(VEHICLES)
    assert {axis for vehicle, axis in reach.CASES if vehicle == "tugboat"} == {"heading", "yaw", "speed"}
    assert {axis for _, axis in reach.CASES} == set(AXES)


def test_a_craft_has_the_axes_that_its_thrusters_drive() -> None:
    lacking = {case for case in reach.CASES if not reach.has_axis(*case)}
    assert {("falcon", "roll"), ("bluerov2-standard", "pitch"), ("ies-rov", "roll")} <= lacking
    assert not {("bluerov2-6dof", "pitch"), ("bluerov2-standard", "roll"), ("tugboat", "speed")} & lacking


def test_a_rejected_axis_is_not_a_miss(capsys: pytest.CaptureFixture[str]) -> None:
    refused = reach.Tuned("falcon", "roll", 1, "refused", math.nan, math.nan, math.nan, math.nan, 1.0, "no roll")
    kept = reach.Tuned("falcon", "heading", 1, "kept", 2.0, 1.0, 1.0, math.nan, 5.0)
    figures = {figure.name: figure.shown for figure in reach._figures([refused, kept])}
    assert figures["tunes kept"] == "1 of 1" and figures["refused without the axis"] == "1 of 1"
    reach._show_table([refused, kept], iter([("falcon", "heading"), ("falcon", "roll")]))
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split()[:6] == ["falcon", "heading", "-", "1/1", "-", "2.000"]
    assert lines[2].split() == ["falcon", "roll", "refused", "1/1"]
