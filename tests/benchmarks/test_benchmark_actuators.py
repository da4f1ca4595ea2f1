"""The table of actuator tunes: what is kept, what is worse; a stored tune is not flown again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks import actuator_tunes

KEPT = {"ending": "kept", "reason": "", "departure": [0.2, 0.01], "itae": [2.0, 1.0], "proposed": {"A": 1}, "left": {}}


def test_a_tune_that_leaves_a_boat_worse_is_counted_and_stored_tunes_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flown: list[int] = []

    def fly(boat: str, case: str, seed: int) -> dict[str, Any]:
        flown.append(seed)
        return {**KEPT, "itae": [2.0, 2.3]} if seed == 2 and case == "curve" else KEPT

    monkeypatch.setattr(actuator_tunes, "fly", fly)
    monkeypatch.chdir(tmp_path)
    line = ["charlie", "--seeds", "2"]
    actuator_tunes.main(line)
    first = capsys.readouterr().out
    actuator_tunes.main(line)
    assert capsys.readouterr().out == first
    assert flown == [1] * 4 + [2] * 4
    rows = {row[:28].strip(): row[28:].split() for row in first.splitlines()[1:5]}
    assert rows["charlie, dead zone"] == ["2", "2", "2", "2", "0", "20.0", "1.0", "0.50"]
    assert rows["charlie, curve"][4] == "1"
    assert "7 of 8" in first


def test_a_restored_boat_with_a_changed_parameter_is_worse() -> None:
    assert not actuator_tunes.is_worse({"ending": "restored", "left": {}})
    assert actuator_tunes.is_worse({"ending": "aborted", "left": {"MOT_THR_MIN": 10.0}})
