"""Every case of a study runs once, even after interruptions."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_autotune.errors import BadFile, PreconditionFailed, UsageError
from gcs_autotune.executor import ProcessExecutor
from gcs_autotune.study import Started, Store, check_plan, load_plan, open_study, run_study, store, unsuited
from gcs_autotune.study.build import build_of
from gcs_autotune.study.store import parquet
from tests.study.toys import FUNCTIONS, ran, serial, study_file, tried

TEN = "vary.argument.x = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]"
ROWS = ["case", "point", "index", "status", "given", "numbers", "texts", "reason"]


def rows(folder: Path) -> list[dict[str, object]]:
    return open_study(folder, arrow=True).select(ROWS).to_pylist()


def test_every_case_is_a_row_with_its_values_and_results(tmp_path: Path) -> None:
    ran(study_file(tmp_path, "add", "fixed.argument.y = 10\n" + TEN), tmp_path / "out")
    table = open_study(tmp_path / "out")
    assert table["sum"].tolist() == [10.0 + x for x in range(10)]
    assert table["even"].tolist() == [1.0, 0.0] * 5
    assert table["word"][3] == "x3"
    assert set(table["status"]) == {"done"}
    assert table["argument.y"].tolist() == [10] * 10


def test_rows_do_not_depend_on_the_number_of_processes(tmp_path: Path) -> None:
    path = study_file(tmp_path, "odd_fails", TEN)
    ran(path, tmp_path / "one")
    ran(path, tmp_path / "three", lambda started: ProcessExecutor(3))
    assert rows(tmp_path / "one") == rows(tmp_path / "three")


def test_a_failing_case_is_a_row_with_its_reason(tmp_path: Path) -> None:
    ran(study_file(tmp_path, "odd_fails", TEN), tmp_path / "out")
    table = open_study(tmp_path / "out")
    assert table["status"].tolist() == ["done", "failed"] * 5
    assert table["reason"][3] == "ValueError: 3 is odd"


class Stopping:
    """Runs the first cases only, as if the program were killed."""

    def __init__(self, most: int) -> None:
        self._most = most

    def map(self, function, tasks, progress=None):
        for k, task in enumerate(tasks):
            if k == self._most:
                raise KeyboardInterrupt
            yield function(task)


def test_a_stopped_study_continues_with_the_missing_cases(tmp_path: Path) -> None:
    path = study_file(tmp_path, "counted", TEN)
    with pytest.raises(KeyboardInterrupt):
        ran(path, tmp_path / "out", lambda started: Stopping(4))
    assert open_study(tmp_path / "out")["argument.x"].tolist() == [0, 1, 2, 3]
    ran(path, tmp_path / "out")
    assert tried(tmp_path) == [str(x) for x in range(10)]
    assert len(open_study(tmp_path / "out")) == 10


def test_a_study_with_more_repeats_runs_only_the_new_cases(tmp_path: Path) -> None:
    path = study_file(tmp_path, "counted", TEN)
    ran(path, tmp_path / "out")
    path.write_text(path.read_text().replace("vary", "repeats = 2\nvary", 1))
    ran(path, tmp_path / "out")
    assert len(tried(tmp_path)) == 20
    assert open_study(tmp_path / "out")["seed"].tolist() == [1] * 10 + [2] * 10


def test_a_truncated_part_is_reported_and_its_cases_are_repeated(tmp_path: Path) -> None:
    path = study_file(tmp_path, "counted", TEN)
    ran(path, tmp_path / "out")
    (part,) = Store(tmp_path / "out").parts()
    part.write_bytes(part.read_bytes()[:200])
    with pytest.raises(BadFile, match=f"{part.name} cannot be read: it is cut short"):
        open_study(tmp_path / "out")
    reported: list[str] = []
    run_study(load_plan(path), tmp_path / "out", serial, reports=reported.append)
    assert len(reported) == 1
    assert str(part) in reported[0]
    assert len(open_study(tmp_path / "out")) == 10
    assert len(tried(tmp_path)) == 20


def test_the_folder_of_another_study_is_rejected_with_the_differing_entry(tmp_path: Path) -> None:
    path = study_file(tmp_path, "add", TEN)
    ran(path, tmp_path / "out")
    path.write_text(path.read_text().replace("[0, 1,", "[0, 1, 77,"))
    with pytest.raises(BadFile, match=r"another study: .*study.toml differs from it in vary.argument.x"):
        ran(path, tmp_path / "out")


def test_results_of_another_version_are_rejected_with_both_versions(tmp_path: Path) -> None:
    path = study_file(tmp_path, "add", TEN)
    plan = ran(path, tmp_path / "out")
    own = Started.of(plan).build
    text = (tmp_path / "out" / "study.json").read_text()
    (tmp_path / "out" / "study.json").write_text(text.replace(own.version, "0.0.9+00000000"))
    with pytest.raises(BadFile, match=r"0\.0\.9") as refused:
        ran(path, tmp_path / "out")
    assert own.version in str(refused.value)


def test_a_worker_with_other_code_or_kernels_is_unsuited_and_both_are_shown(tmp_path: Path) -> None:
    started = Started.of(load_plan(study_file(tmp_path, "add", TEN)))
    assert unsuited(started) == ""
    for other in (replace(started.build, version="0.0.9"), replace(started.build, kernels="numba 0.1")):
        why = unsuited(replace(started, build=other))
        assert str(other) in why
        assert str(started.build) in why


def test_a_changed_function_is_other_code(tmp_path: Path) -> None:
    one, other = (
        Started.of(load_plan(study_file(tmp_path, "add", TEN, functions)))
        for functions in (FUNCTIONS, FUNCTIONS + "#\n")
    )
    assert one.build.function != other.build.function


def test_a_changed_file_of_the_functions_package_is_other_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    builds = []
    for package, more in (("toys_one", "a = 1\n"), ("toys_two", "a = 2\n")):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
        (tmp_path / package / "case.py").write_text(FUNCTIONS)
        (tmp_path / package / "other.py").write_text(more)
        builds.append(build_of(f"{package}.case:add").function)
    assert builds[0]
    assert builds[0] != builds[1]


def test_a_long_text_of_a_function_is_stored_whole(tmp_path: Path) -> None:
    ran(
        study_file(tmp_path, "f", "vary.argument.x = [900]", "def f(seed, x):\n    return {'t': 'a' * x}\n"),
        tmp_path / "out",
    )
    assert open_study(tmp_path / "out")["t"][0] == "a" * 900


def test_a_full_disk_is_reported_and_stored_rows_remain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = study_file(tmp_path, "counted", TEN)
    monkeypatch.setattr(store, "ROWS", 4)
    write, written = parquet().write_table, []

    def filling(table, where):
        written.append(where)
        if len(written) > 1:
            Path(where).write_bytes(b"half")
            raise OSError(errno.ENOSPC, "Error writing bytes. Detail: [errno 28] No space left on device")  # as pyarrow
        write(table, where)

    monkeypatch.setattr(parquet(), "write_table", filling)
    with pytest.raises(BadFile, match=r"part-000001\.parquet: No space left on device"):
        ran(path, tmp_path / "out")
    monkeypatch.undo()
    assert open_study(tmp_path / "out")["argument.x"].tolist() == [0, 1, 2, 3]
    assert not list((tmp_path / "out").rglob("*.tmp"))
    ran(path, tmp_path / "out")
    assert len(open_study(tmp_path / "out")) == 10


def test_rows_written_twice_count_once(tmp_path: Path) -> None:
    ran(study_file(tmp_path, "add", TEN), tmp_path / "out")
    (part,) = Store(tmp_path / "out").parts()
    part.with_name("part-000001.parquet").write_bytes(part.read_bytes())
    assert len(open_study(tmp_path / "out")) == 10


def test_many_small_parts_are_merged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "MOST_PARTS", 3)
    monkeypatch.setattr(store, "SECONDS", 0.0)
    ran(study_file(tmp_path, "add", TEN), tmp_path / "out")
    assert len(Store(tmp_path / "out").parts()) == 1
    assert open_study(tmp_path / "out")["argument.x"].tolist() == list(range(10))


def test_two_runs_do_not_write_to_one_folder(tmp_path: Path) -> None:
    path = study_file(tmp_path, "add", TEN)
    with Store(tmp_path / "out").writing(), pytest.raises(PreconditionFailed, match="is in use"):
        ran(path, tmp_path / "out")


def test_a_folder_without_a_study_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="contains no study"):
        open_study(tmp_path)


def test_a_function_that_cannot_be_imported_is_reported_with_file_and_key(tmp_path: Path) -> None:
    path = study_file(tmp_path, "missing", TEN)
    with pytest.raises(BadFile, match=r"study.toml: do: 'toys_.*:missing' cannot be imported"):
        check_plan(load_plan(path))
    with pytest.raises(UsageError, match="cannot be imported"):  # as on a worker
        ran(path, tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("vary.argument.z = [1]\nfixed.argument.x = 1", r"vary\.argument\.z: toys_.*:add has no argument 'z'"),
        ("vary.argument.y = [1]", r"argument\.x is missing: toys_.*:add needs it"),
        ("vary.argument.x = [1]\nfixed.vehicle.like = 'blueboat'", r"uri: toys_.*:add has no argument 'uri'"),
    ],
)
def test_unexpected_arguments_of_a_function_are_reported_before_it_runs(text: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=rf"study\.toml: {why}"):
        check_plan(load_plan(study_file(tmp_path, "add", text)))


def test_a_function_that_returns_no_results_fails_with_the_reason(tmp_path: Path) -> None:
    path = study_file(tmp_path, "f", "vary.argument.x = [1]", "def f(seed, x):\n    return x\n")
    ran(path, tmp_path / "out")
    assert "returned a int" in open_study(tmp_path / "out")["reason"][0]
