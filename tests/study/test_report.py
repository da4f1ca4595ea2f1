"""The report of a study."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from scipy.stats import beta

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile
from gcs_autotune.report import case_study_document, to_html, to_json
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.study import Store, case_study_of, progress_of
from gcs_autotune.study.names import words_of
from tests.study.test_run import TEN, Stopping
from tests.study.toys import ran, study_file

FUNCTIONS = """
import random
def work(seed, x, effect="none", shift=0.0):
    draw = random.Random(f"{seed} {x} {effect}")
    if x == 9:
        raise ValueError("no nine")
    told = "none" if effect == "none" or x == 0 else effect.partition(".")[0]
    return {"good": x >= 5, "error": draw.gauss(0.0, 0.1) + shift, "limit": 0.1, "told": told, "cost": float(x)}
"""
GRID = """
repeats = 4
[vary.argument]
x = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
effect = ["none", "dead-zone.width=0.1"]
[report]
success = "good"
map = ["argument.x", "argument.effect"]
measure = "cost"
truth = "argument.effect"
answer = "told"
bound = { error = "limit" }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ran(study_file(tmp_path, "work", GRID, FUNCTIONS), tmp_path / "out")
    return tmp_path / "out"


def test_rates_have_exact_intervals_and_failed_cases_count_against(folder: Path) -> None:
    found = case_study_of(folder)
    assert (found.done, found.failed, found.cases) == (72, 8, 80)
    assert found.success is not None
    assert (found.success.hits, found.success.total) == (32, 80)
    assert found.success.low == pytest.approx(beta.ppf(0.025, 32, 49))
    assert found.success.high == pytest.approx(beta.ppf(0.975, 33, 48))
    assert dict(found.by_value)["argument.x = 7"].hits == 8
    assert found.failures == {"ValueError: no nine": 8}


def test_the_report_puts_names_into_words_and_quotes_those_of_the_user(folder: Path) -> None:
    found = case_study_of(folder)
    text, page = render_text(case_study_document(found)), to_html(case_study_document(found))
    for shown in (text, page):
        assert "argument.x" not in shown
    assert "argument 'x' = 7" in text and "result 'cost' = 4" in text
    assert "ValueError: no nine" in text
    assert "argument.x" in json.dumps(to_json(case_study_document(found)))  # a program reads the names of the file


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("metrics.after.itae", "tracking error (ITAE per unit step) [s²], after the tune"),
        ("tune.speed", "speed [m/s]"),
        ("effect.dead-zone@N.width", "dead zone (N): width [input unit]"),
        ("effect.quadratic-actuator.share", "quadratic thrust curve: share [1]"),
        ("vehicle.yaw.beta.times", "factor on 'yaw.beta' of the vehicle file"),
        ("vehicle.yaw.beta2", "'yaw.beta2' of the vehicle file [N m s²]"),
        ("my_error", "result 'my_error'"),
    ],
)
def test_a_name_is_put_into_words_with_its_unit(name: str, words: str) -> None:
    assert words_of(name, "tune", {"yaw.beta2": "N m s^2"}.__getitem__) == words


@pytest.mark.parametrize(
    ("likes", "unit"),
    [
        (["blueboat"], " [N m s]"),
        (["blueboat", "bluerov2"], " [N m s]"),
        (["blueboat", "charlie"], ""),
        (["blueboat", "own.toml"], ""),
    ],
)
def test_a_number_of_a_vehicle_file_has_the_unit_that_the_vehicles_share(
    tmp_path: Path, likes: list[str], unit: str
) -> None:
    varied = f"like = {json.dumps(likes)}\nyaw.beta = [1.0, 2.0]\ngps.jump = [0.5, 1.0]\n"
    grid = f"[vary.vehicle]\n{varied}[report]\nsuccess = 'good'\n"
    ran(study_file(tmp_path, "known", grid, "def known(seed, uri):\n    return {'good': True}\n"), tmp_path / "out")
    text = " ".join(render_text(case_study_document(case_study_of(tmp_path / "out"))).split())
    assert f"'yaw.beta' of the vehicle file{unit} = 1" in text
    assert ("'gps.jump' of the vehicle file [SI]" in text) == ("own.toml" not in likes)


def test_the_map_counts_over_two_values(folder: Path) -> None:
    found = case_study_of(folder).map
    assert found is not None
    assert found.xs == tuple(map(str, range(10)))
    assert found.hits == ((0,) * 5 + (4,) * 4 + (0,),) * 2
    assert found.totals == ((4,) * 10,) * 2


def test_the_confusion_matrix_compares_names_of_effects(folder: Path) -> None:
    found = case_study_of(folder).confusion
    assert found is not None
    assert found.truths == ("dead-zone", "none")
    assert found.answers == ("dead-zone", "failed", "none")
    assert found.counts == ((32, 4, 4), (0, 4, 36))


def test_without_a_definition_a_correct_answer_is_a_success(tmp_path: Path) -> None:
    ran(study_file(tmp_path, "work", GRID.replace('success = "good"\n', ""), FUNCTIONS), tmp_path / "out")
    found = case_study_of(tmp_path / "out").success
    assert found is not None
    assert (found.of, found.hits) == ("reported as simulated", 68)


def test_errors_are_compared_with_their_bound(folder: Path) -> None:
    (check,) = case_study_of(folder).bounds
    assert check.low < check.ratio < check.high
    assert 60 <= check.within.hits <= 72


def test_errors_over_their_bound_are_a_histogram_with_all_cases(folder: Path) -> None:
    (check,) = case_study_of(folder).bounds
    assert sum(check.scaled) == 72
    assert sum(check.scaled[6:10]) > 36  # within one bound: 68 % of a normal distribution
    assert "error&#39; over its bound" in to_html(case_study_document(case_study_of(folder)))


def test_the_worst_cases_come_first_and_their_command_repeats_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    worst = case_study_of(folder).worst
    assert len(worst) == 10
    assert worst[0].outcome == "ValueError: no nine"
    assert worst[8].outcome == "cost = 4"  # without success, the largest cost first
    assert worst[8].command == f"gcs-autotune study replay {folder} {worst[8].case}"
    assert main(worst[8].command.split()[1:]) == 0
    assert "cost: 4.0" in capsys.readouterr().out
    assert main(["study", "replay", str(folder), worst[0].case]) == 1
    assert main(["study", "replay", str(folder), "zzz"]) == 2


def test_a_replay_by_another_version_runs_and_names_both_versions(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = case_study_of(folder).worst[8].command.split()[1:]
    assert main(command) == 0
    assert capsys.readouterr().err == ""
    head = (folder / "study.json").read_text()
    own = json.loads(head)["build"]["version"]
    (folder / "study.json").write_text(head.replace(own, "0.0.9+00000000"))
    assert main(command) == 0
    printed = capsys.readouterr()
    assert "may differ" in printed.err
    assert own in printed.err
    assert "0.0.9+00000000" in printed.err
    assert "cost: 4.0" in printed.out


def test_a_goal_is_a_limit_on_a_result(tmp_path: Path) -> None:
    text = GRID.replace('success = "good"', 'success = { of = "cost", least = 1.0, most = 2.5 }')
    ran(study_file(tmp_path, "work", text, FUNCTIONS), tmp_path / "out")
    found = case_study_of(tmp_path / "out").success
    assert found is not None
    assert (found.of, found.hits) == ("cost at least 1 and at most 2.5", 16)


def test_a_result_missing_in_all_cases_is_reported_with_file_and_key(tmp_path: Path) -> None:
    ran(study_file(tmp_path, "work", GRID.replace('"cost"', '"coast"'), FUNCTIONS), tmp_path / "out")
    with pytest.raises(BadFile, match=r"report.measure: no case has a result 'coast'. Did you mean cost"):
        case_study_of(tmp_path / "out")


def test_two_studies_are_compared_case_by_case(tmp_path: Path) -> None:
    later = FUNCTIONS.replace("x >= 5", "x >= 3").replace("float(x)", "float(x) - 1.0")
    for name, functions in (("old", FUNCTIONS), ("new", later)):
        (tmp_path / name).mkdir()
        path = study_file(tmp_path / name, "work", GRID, functions)
        for module in (tmp_path / name).glob("toys_*.py"):  # the same function, of another version
            module.rename(tmp_path / name / "versions.py")
            path.write_text(path.read_text().replace(module.stem, "versions"))
        sys.modules.pop("versions", None)
        ran(path, tmp_path / name / "out")
    found = case_study_of(tmp_path / "new" / "out", tmp_path / "old" / "out").against
    assert found is not None
    assert (found.pairs, found.gained, found.lost) == (80, 16, 0)
    assert found.p_success == pytest.approx(2.0**-15)
    assert found.change == -1.0
    assert found.p_measure < 1e-9


def test_studies_without_a_common_case_are_not_compared(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    ran(study_file(tmp_path / "b", "work", GRID, FUNCTIONS), tmp_path / "b" / "out")  # another module name
    with pytest.raises(BadFile, match="no case in common"):
        case_study_of(folder, tmp_path / "b" / "out")
    with pytest.raises(BadFile, match="b contains no study"):
        case_study_of(folder, tmp_path / "b")


def test_the_page_and_the_json_show_the_same_figures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "report", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["success"]["hits"] == 32
    page = to_html(case_study_document(case_study_of(folder)))
    assert "Success map" in page
    assert "32 of 80" in page
    assert main(["study", "report", str(folder)]) == 0
    assert "32 of 80" in (folder / "report.html").read_text()


def test_many_values_of_a_range_are_shown_in_groups(tmp_path: Path) -> None:
    text = 'design = "random"\ncases = 60\nvary.argument.x = { from = 0.0, to = 8.0 }\nreport.success = "good"'
    ran(study_file(tmp_path, "work", text, FUNCTIONS), tmp_path / "out")
    rates = [rate for _, rate in case_study_of(tmp_path / "out").by_value]
    assert [r.total for r in rates] == [10] * 6
    assert (rates[0].hits, rates[-1].hits) == (0, 10)


def test_a_map_of_two_ranges_is_shown_whole_on_80_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    functions = FUNCTIONS.replace("effect=", "y=0.0, effect=")
    spans = "x = { from = 0.1, to = 7.9 }\ny = { from = 0.00123, to = 0.0456 }"
    report = 'success = "good"\nmap = ["argument.x", "argument.y"]'
    text = f'design = "sobol"\ncases = 64\n[vary.argument]\n{spans}\n[report]\n{report}'
    ran(study_file(tmp_path, "work", text, functions), tmp_path / "out")
    found = case_study_of(tmp_path / "out").map
    assert found is not None
    assert main(["study", "report", str(tmp_path / "out")]) == 0
    output = capsys.readouterr().out.partition("Success by value")[0]
    assert "Rows: argument 'y'. Columns: argument 'x'." in output
    assert "…" not in output
    assert all(word in output.split() for label in (*found.xs, *found.ys) for word in label.split())


def test_the_state_of_a_stopped_study_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = study_file(tmp_path, "odd_fails", TEN)
    with pytest.raises(KeyboardInterrupt):
        ran(path, tmp_path / "out", lambda started: Stopping(4))
    found = progress_of(tmp_path / "out")
    assert (found.done, found.failed, found.cases, found.running) == (2, 2, 10, False)
    assert main(["study", "watch", str(tmp_path / "out")]) == 0
    assert "2 of 10 done, 2 failed, 0 given up; stopped" in capsys.readouterr().out
    with Store(tmp_path / "out").writing():
        assert progress_of(tmp_path / "out").running
        assert main(["study", "watch", str(tmp_path / "out")]) == 0
    assert "an hour, time left" in capsys.readouterr().out


def test_a_damaged_part_is_noted_and_the_rest_is_reported(folder: Path) -> None:
    (folder / "parts" / "part-000009.parquet").write_bytes(b"PAR1")
    found = case_study_of(folder)
    assert found.done == 72
    assert "part-000009.parquet cannot be read" in found.notes[0]


def test_a_study_without_rows_has_a_report(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        ran(study_file(tmp_path, "add", TEN), tmp_path / "out", lambda started: Stopping(0))
    assert case_study_of(tmp_path / "out").done == 0
