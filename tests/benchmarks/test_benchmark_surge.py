"""The table of surge flights: errors, in units of the reported standard error, what is saved is not flown again."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import surge_accuracy


def test_errors_are_counted_in_standard_errors_and_saved_flights_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flown: list[int] = []

    def fly(boat: str, seed: int) -> dict[str, tuple[float, float, float]]:
        flown.append(seed)
        return {"alpha_u": (4.0 + (0.3 if seed == 1 else -0.1), 0.1, 4.0), "beta_u": (0.0, 0.0, 0.2)}  # decided away

    monkeypatch.setattr(surge_accuracy, "fly", fly)
    line = ["charlie", "--seeds", "2", "--save", str(tmp_path / "flights.jsonl")]
    surge_accuracy.main(line)
    first = capsys.readouterr().out
    surge_accuracy.main(line)
    assert capsys.readouterr().out == first
    assert flown == [1, 2]
    rows = {row.split()[0]: row.split()[1:] for row in first.splitlines()[2:4]}
    assert rows["alpha_u"] == ["4", "+1.00", "2.24", "1", "of", "2", "0.1"]
    assert " 2 of 2 " in first.splitlines()[3], "decided away is no answer"
    assert "charlie, beta_u, rms error / standard error: not finite" in first
