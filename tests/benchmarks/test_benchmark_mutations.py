"""The faults that are put in, the tests that are asked, and what is counted: without running any."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutations import Mutant, areas, bench, mirroring, mutants_of
from benchmarks.mutations.__main__ import ROOT, drawn, table
from benchmarks.mutations.areas import AREAS, EQUIVALENT, files_by_area
from benchmarks.mutations.bench import Verdict
from benchmarks.mutations.mutant import KINDS

SOURCE = '''"""A docstring of 3 words."""
LIMIT = 2.5
def far(a, b, *, both=True):
    """Whether 1 < 2."""
    for x in a:
        if x is None:
            continue
        b.append(x)
    if abs(a[0]) < LIMIT and not both:
        raise ValueError(f"{a[0] + 1} is too much")
    watcher.say("1 + 1")
    µ = -a[0] if b else max(b[0] - LIMIT, pow(a[0], b[0]))
    b.count += 1
    b = zip(a, b, strict=True)
    return µ
'''


@pytest.fixture
def found(tmp_path: Path) -> list[Mutant]:
    (tmp_path / "far.py").write_text(SOURCE, encoding="utf-8")
    return mutants_of(tmp_path / "far.py", tmp_path)


def test_every_kind_of_fault_is_found_and_words_are_left_alone(found: list[Mutant]) -> None:
    assert {m.kind for m in found} == set(KINDS) - {"operator"}
    assert {m.line for m in found} == {2, 3, 6, 7, 8, 9, 12, 13}
    keys = {m.key for m in found}
    assert len(set(found)) == len(found)
    for key in (
        "module: 2.5 -> 5.0 in LIMIT = 2.5",
        "far: x is None -> x is not None",
        "far: continue -> break",
        "far: b.append(x) -> pass",
        "far: abs(a[0]) < LIMIT -> abs(a[0]) <= LIMIT",
        "far: abs(a[0]) < LIMIT and not both -> ((abs(a[0]) < LIMIT) or (not both))",
        "far: not both -> (both)",
        "far: abs(a[0]) -> (a[0]) in if abs(a[0]) < LIMIT and not both:",
        "far: max -> min in µ = -a[0] if b else max(b[0] - LIMIT, pow(a[0], b[0]))",
        "far: -a[0] -> (a[0])",
        "far: pow(a[0], b[0]) -> pow(b[0], a[0])",
        "far: b.count += 1 -> b.count -= 1",
    ):
        assert f"far.py::{key}" in keys


def test_a_fault_changes_one_place_and_the_rest_stays_byte_for_byte(found: list[Mutant]) -> None:
    assert found
    for mutant in found:
        changed = mutant.applied(SOURCE)
        assert changed != SOURCE
        assert mutant.is_python(SOURCE)
        before, after = SOURCE.splitlines(), changed.splitlines()
        assert before[: mutant.line - 1] == after[: mutant.line - 1]
        assert before[mutant.end_line :] == after[len(after) - (len(before) - mutant.end_line) :]
        assert after[-1] == "    return µ"


@pytest.mark.slow
def test_the_same_seed_draws_the_same_faults_from_every_area() -> None:
    first = drawn(3, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "narrow_band"))
    assert first == drawn(3, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "narrow_band"))
    assert first != drawn(4, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "narrow_band"))
    assert len(set(first)) == 24
    assert len({m.path for m in first}) >= 6


def test_every_area_has_files_and_no_file_two_areas() -> None:
    areas = files_by_area(ROOT)
    files = [file for found in areas.values() for file in found]
    assert set(areas) == set(AREAS)
    assert len(files) == len(set(files)) > 50
    assert all((ROOT / file).is_file() for file in files)
    assert "import njit" in (ROOT / areas["kernels"][0]).read_text(encoding="utf-8")


def test_a_file_that_moves_is_found_and_one_that_is_renamed_is_missed_loudly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "gcs_autotune"
    for name in ("here/a.py", "here/b.py", "here/words.py", "there/c.py"):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text("import njit" if name == "there/c.py" else "", encoding="utf-8")
    monkeypatch.setattr(areas, "AREAS", {"kernels": ("**/*.py",), "one": ("**/b.py",), "other": ("here/*.py",)})
    monkeypatch.setattr(areas, "WITHOUT", ("here/words.py",))
    assert areas.files_by_area(tmp_path) == {
        "kernels": ["gcs_autotune/there/c.py"],
        "one": ["gcs_autotune/here/b.py"],
        "other": ["gcs_autotune/here/a.py"],
    }
    (package / "here/b.py").rename(package / "there/b.py")
    assert areas.files_by_area(tmp_path)["one"] == ["gcs_autotune/there/b.py"]
    (package / "there/b.py").rename(package / "there/d.py")
    with pytest.raises(LookupError, match=r"b\.py any more"):
        areas.files_by_area(tmp_path)
    (package / "there/d.py").rename(package / "there/b.py")
    (package / "there/c.py").write_text("", encoding="utf-8")
    with pytest.raises(LookupError, match="kernels"):
        areas.files_by_area(tmp_path)


class Ended:
    """A slot whose fork has ended with *code* after the tests *told*; what it forks next ends with *then*."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: int, told: str, then: int = 0) -> None:
        path = tmp_path / "tree" / "gcs_autotune" / "a.py"
        path.parent.mkdir(parents=True)
        path.write_text("x = 1\n", encoding="utf-8")
        self.codes = [code, then]
        slot = bench.Slot(tmp_path / "tree", 20.0)
        log = tmp_path / "told.jsonl"

        def fork(tests: object, compiled: bool, *, to_first: bool = True) -> None:
            log.write_text(told if len(self.codes) == 2 else "", encoding="utf-8")

        monkeypatch.setattr(slot, "_fork", fork)
        monkeypatch.setattr(bench, "mirroring", lambda path, root: ["tests/test_a.py"])
        monkeypatch.setattr(bench.os, "waitpid", lambda pid, options: (1, self.codes.pop(0) << 8))
        slot.begin(Mutant("gcs_autotune/a.py", "module", "constant", 1, 4, 1, 5, "1", "2"))
        self.slot, self.path = slot, path


FAILED = '{"test": "t", "outcome": "begun", "at": 0.1}\n{"test": "t", "outcome": "failed", "at": 0.2}\n'


def test_a_fork_that_breaks_while_clearing_up_after_a_test_that_failed_has_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdict = Ended(monkeypatch, tmp_path, bench.BROKEN, FAILED).slot.poll()
    assert verdict is not None and verdict.noticed_by == "t"


@pytest.mark.parametrize("code", [bench.BROKEN, 1, 2])
def test_tests_that_a_fault_keeps_from_starting_have_noticed_and_those_that_never_start_are_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    ended = Ended(monkeypatch, tmp_path / "fault", code, "")
    assert "2" in ended.path.read_text(encoding="utf-8")
    assert ended.slot.poll() is None
    assert ended.path.read_text(encoding="utf-8") == "x = 1\n"
    verdict = ended.slot.poll()
    assert verdict is not None and verdict.noticed_by == bench.UNSTARTED
    never = Ended(monkeypatch, tmp_path / "never", code, "", then=code).slot
    assert never.poll() is None
    with pytest.raises(RuntimeError, match="without any fault"):
        never.poll()


@pytest.mark.parametrize(
    ("processor", "waited", "elapsed", "ended"),
    [
        (21.0, 0.0, 30.0, True),
        (19.0, 0.0, 399.0, False),
        (19.0, 0.0, 401.0, True),
        (19.0, 9.0, 3999.0, False),  # it waited nine times as long for a processor as it had one
        (19.0, 9.0, 4001.0, True),
    ],
)
def test_a_busy_machine_takes_no_time_from_the_tests_of_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processor: float, waited: float, elapsed: float, ended: bool
) -> None:
    slot = Ended(monkeypatch, tmp_path, 0, FAILED.replace("failed", "passed")).slot
    killed: list[int] = []
    monkeypatch.setattr(bench.os, "waitpid", lambda pid, options: (0, 0))
    monkeypatch.setattr(bench.os, "killpg", lambda pid, signal: killed.append(pid))
    monkeypatch.setattr(bench, "processor_time", lambda pid: processor)
    monkeypatch.setattr(bench, "crowding", lambda pid: 1.0 + waited)
    now = slot._began + elapsed
    monkeypatch.setattr(bench.time, "monotonic", lambda: now)
    verdict = slot.poll()
    assert (verdict is not None, bool(killed)) == (ended, ended)
    if verdict is not None:
        assert not (verdict.noticed_by or verdict.complete)


def test_how_crowded_it_is_is_read_where_the_system_tells_it_and_not_guessed_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "schedstat").write_text("2000 6000 17\n", encoding="ascii")
    monkeypatch.setattr(bench, "Path", lambda text: tmp_path / Path(text).name)
    assert bench.crowding(1) == 4.0
    for text in ("0 0 0\n", "", "no\n"):
        (tmp_path / "schedstat").write_text(text, encoding="ascii")
        assert bench.crowding(1) == 1.0
    (tmp_path / "schedstat").unlink()
    assert bench.crowding(1) == 1.0


def test_the_nearest_tests_are_collected_first_and_every_one_once() -> None:
    tests = [f"test_{k}" for k in range(50)]
    parts = list(bench.nearest_first(tests))
    assert [len(part) for part in parts] == [3, 9, 27, 11]
    assert [test for part in parts for test in part] == tests
    assert list(bench.nearest_first([])) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "first"),
    [
        ("gcs_autotune/link/vehicle/rc_monitor.py", "tests/link/test_rc_monitor.py"),
        ("gcs_autotune/sname.py", "tests/test_sname.py"),
        ("gcs_autotune/effects/kernels.py", "tests/effects/test_motion_kernels.py"),
        ("gcs_autotune/manoeuvres/envelope.py", "tests/manoeuvres/test_envelope.py"),
    ],
)
def test_the_tests_called_after_a_file_are_asked_first(path: str, first: str) -> None:
    assert mirroring(path, ROOT)[0] == first


def test_what_is_no_fault_counts_for_neither_side_and_every_one_names_a_file() -> None:
    none = next(iter(EQUIVALENT))
    path, _, rest = none.partition("::")
    function, _, change = rest.partition(": ")
    before, _, after = change.partition(" -> ")
    change_of_nothing = Mutant(path, function, "dropped", 1, 0, 1, 1, before, after)
    real = Mutant("gcs_autotune/sname.py", "wrap", "sign", 1, 0, 1, 1, "a", "b")
    verdicts = [
        Verdict(change_of_nothing, "", 1.0, 3, complete=True),
        Verdict(real, "tests/test_sname.py::test_it", 1.0, 1, complete=True),
        Verdict(real, "", 1.0, 5, complete=False),
        Verdict(real, "", 1.0, 7, complete=True),
    ]
    lines = table(verdicts).splitlines()
    total = next(line for line in lines if line.startswith("all"))
    assert total.split() == ["all", "4", "1", "1", "1", "1", "33%"]
    assert any(line.startswith("OUT OF TIME line 1, sign (5 tests)") for line in lines)
    assert any(line.startswith("NOT NOTICED line 1, sign (7 tests)") for line in lines)
    assert lines[-1] == f"none: {none}: {EQUIVALENT[none]}"
    there = {m.key for path in {key.partition("::")[0] for key in EQUIVALENT} for m in mutants_of(ROOT / path, ROOT)}
    assert sorted(set(EQUIVALENT) - there) == [], "these faults cannot be put in any more: take them out"
