"""Recorded figures: the page is generated from them, and a run saves its own only on request."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.results import Figure, Result, count, headline, load, page, save
from gcs_autotune_files import Refused

ROOT = Path(__file__).parents[2]
PROGRAM = re.compile(r'^if __name__ == "__main__":', re.MULTILINE)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of results and a page of this test's own."""
    monkeypatch.setattr(results, "FOLDER", tmp_path / "results")
    monkeypatch.setattr(results, "PAGE", tmp_path / "README.md")
    (tmp_path / "README.md").write_text(f"before\n{results.BEGIN}old\n{results.END}after\n")
    monkeypatch.delenv(results.RECORD, raising=False)
    return tmp_path


def test_the_page_is_generated_from_the_results():
    assert results.PAGE.read_text(encoding="utf-8") == page(), "run: python3 -m benchmarks.results"


def test_every_benchmark_has_a_result_and_calls_the_writer():
    programs = [p for p in (ROOT / "benchmarks").rglob("*.py") if PROGRAM.search(p.read_text(encoding="utf-8"))]
    names = {
        ".".join(p.relative_to(ROOT / "benchmarks").with_suffix("").parts).removesuffix(".__main__"): p
        for p in programs
    }
    names = {n: p for n, p in names.items() if n not in ("results", "real_runs.worker")}
    assert len(names) > 30
    recorded = {r.benchmark.partition("-")[0] for r in load()}
    assert recorded - set(names) == set()
    assert set(names) - recorded == set(), "save a Result without figures, or record a run"
    assert [n for n, p in names.items() if "headline(" not in p.read_text(encoding="utf-8")] == []


def test_every_result_names_its_command_and_where_it_comes_from():
    everything = load()
    assert len(everything) > 30
    for result in everything:
        module = result.benchmark.partition("-")[0]
        assert result.command.startswith(f"python3 -m benchmarks.{module}"), result.benchmark
        assert (result.date and result.commit and result.machine) or result.origin, result.benchmark
        assert all(figure.name for figure in result.figures)


def test_a_run_saves_its_figures_only_on_request(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    figures = [count("cases right", 19, 20, least=0.97), Figure("time", 1.25, "s", most=2.0)]
    headline("tried", "how often", figures)
    assert "cases right: 19 of 20 (goal: at least 97 %, missed)" in capsys.readouterr().out
    assert not (elsewhere / "results").exists()
    monkeypatch.setenv(results.RECORD, "1")
    headline("tried", "how often", figures)
    written = json.loads((elsewhere / "results" / "tried.json").read_text())
    assert written["figures"][1] == {"name": "time", "value": 1.25, "unit": "s", "most": 2.0}
    assert {"date", "commit", "machine", "command"} <= set(written)
    text = (elsewhere / "README.md").read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "| [tried](results/tried.json) | how often | cases right: **19 of 20** | 1 of 2 |" in text


@pytest.mark.parametrize(
    ("figure", "shown", "goal", "met"),
    [
        (count("c", 20, 20, least=1.0), "20 of 20", "all", True),
        (count("c", 19, 20, least=1.0), "19 of 20", "all", False),
        (count("c", 0, 0, least=0.5), "0 of 0", "at least 50 %", False),
        (count("c", 2, 208, most=0.03), "2 of 208", "at most 3 %", True),
        (Figure("f", 0.3, "s", most=0.25), "0.3 s", "at most 0.25 s", False),
        (Figure("f", 12.0, least=10.0), "12", "at least 10", True),
        (Figure("f", None, "s", most=1.0), "not finite", "at most 1 s", False),
        (Figure("f", 3.0), "3", "", None),
    ],
)
def test_a_figure_states_its_goal_and_whether_it_is_met(figure: Figure, shown: str, goal: str, met: bool | None):
    assert (figure.shown, figure.goal, figure.met) == (shown, goal, met)


def test_a_number_that_is_not_finite_is_saved_as_none(elsewhere: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(results.RECORD, "1")
    headline("tried", "how often", [Figure("worst", float("inf"), "s")])
    (found,) = load()
    assert found.figures == (Figure("worst", None, "s"),)


def test_a_misspelt_key_in_a_result_is_rejected(elsewhere: Path):
    path = save(Result("tried", "how often", "python3 -m benchmarks.tried"))
    path.write_text(path.read_text().replace("measures", "mesures"))
    with pytest.raises(Refused):
        load()
