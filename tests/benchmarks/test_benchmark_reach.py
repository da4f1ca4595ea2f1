"""A benchmark of whole tunes that is stopped goes on where it was."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks import reach, studies
from gcs_autotune.study import open_study


def test_a_run_that_was_stopped_goes_on_and_its_lines_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flown: list[tuple[str, str, int]] = []

    def tune_once(vehicle: str, axis: str, seed: int) -> reach.Tuned:
        if len(flown) == 3:
            raise KeyboardInterrupt
        flown.append((vehicle, axis, seed))
        lost = (vehicle, seed) == ("falcon", 2)
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
    assert flown == [("videoray", "heading", 2)] and ("videoray", "heading", 2) not in before
    table = capsys.readouterr().out.splitlines()
    assert [row.split()[:6] for row in table[5:7]] == [
        ["falcon", "heading", "0.900", "1/2", "1/2", "2.000"],
        ["videoray", "heading", "0.900", "2/2", "2/2", "2.000"],
    ]
