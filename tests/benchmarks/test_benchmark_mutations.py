"""The inserted faults, the tests that run, and the counts: without a whole run."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from benchmarks.mutations import areas
from benchmarks.mutations.__main__ import ROOT, drawn, table
from benchmarks.mutations.areas import AREAS, NO_FAULT, files_by_area
from benchmarks.mutations.bench import HANGS, Bench, TestsFail, Verdict
from benchmarks.mutations.mirror import mirroring
from benchmarks.mutations.mutant import PHYSICAL, Mutant, mutants_of, physical_mutants

SOURCE = '''"""A docstring of 3 words."""
LIMIT = 2.5
def far(a, b, *, both=True):
    """Whether 1 < 2."""
    for x in a:
        if x is None:
            continue
        b.append(x)
    if a[0] < LIMIT and not both:
        raise ValueError(f"{a[0] + 1} is too much")
    return a[0] - b[0]
'''


def test_faults_are_placed_in_code_and_not_in_text(tmp_path: Path) -> None:
    pytest.importorskip("cosmic_ray")
    (tmp_path / "far.py").write_text(SOURCE, encoding="utf-8")
    found = list(mutants_of("far.py", tmp_path, random.Random(1)))
    assert {m.line for m in found} == {2, 3, 5, 6, 7, 9, 11}
    keys = {m.key for m in found}
    for key in (
        "far: if x is None: -> if x is not None:",
        "far: continue -> break",
        "far: if a[0] < LIMIT and not both: -> if a[0] <= LIMIT and not both:",
        "far: if a[0] < LIMIT and not both: -> if a[0] < LIMIT or not both:",
        "far: return a[0] - b[0] -> return a[0] + b[0]",
        "far: for x in a: -> for x in []:",
    ):
        assert f"far.py::{key}" in keys
    for mutant in found:
        before, after = SOURCE.splitlines(), mutant.source.splitlines()
        assert [k for k, (a, b) in enumerate(zip(before, after, strict=True), start=1) if a != b] == [mutant.line]


def test_every_physical_fault_can_be_inserted() -> None:
    found = list(physical_mutants(ROOT))
    assert len(found) == len(PHYSICAL) >= 12
    assert all(m.before != m.after and (ROOT / m.path).read_text(encoding="utf-8") != m.source for m in found)


@pytest.mark.slow
def test_the_same_seed_draws_the_same_faults_from_several_files() -> None:
    pytest.importorskip("cosmic_ray")
    only = ("watchdog", "margins", "whiteness", "journal")
    first = drawn(3, 12, only)
    assert first == drawn(3, 12, only)
    assert first != drawn(4, 12, only)
    assert len({m.path for m in first}) >= 4


def test_every_area_has_files_and_no_file_two_areas() -> None:
    found = files_by_area(ROOT)
    files = [file for of_area in found.values() for file in of_area]
    assert set(found) == set(AREAS)
    assert len(files) == len(set(files)) > 50
    assert all((ROOT / file).is_file() for file in files)
    assert "import njit" in (ROOT / found["kernels"][0]).read_text(encoding="utf-8")


def test_a_moved_file_is_found_and_a_renamed_one_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    with pytest.raises(LookupError, match=r"no file .*b\.py"):
        areas.files_by_area(tmp_path)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A bench for a tree of one file with one test."""
    root = tmp_path / "root"
    (root / "tests").mkdir(parents=True)
    (root / "a.py").write_text("def one():\n    return 1\n", encoding="utf-8")
    (root / "tests" / "test_a.py").write_text(
        "from a import one\n\ndef test_one():\n    assert one() == 1\n", encoding="utf-8"
    )
    (root / "pyproject.toml").write_text("[tool.pytest.ini_options]\nmarkers = ['slow']\n", encoding="utf-8")
    monkeypatch.setattr("benchmarks.mutations.bench.mirroring", lambda path, tree: ["tests/test_a.py"])
    (tmp_path / "scratch").mkdir()
    return Bench(root, tmp_path / "scratch", 20.0)


def fault(after: str) -> Mutant:
    return Mutant("a.py", "one", "sign", 2, "return 1", after, f"def one():\n    {after}\n")


@pytest.mark.slow
def test_a_fault_is_detected_by_the_first_failing_or_hanging_test_and_removed(bench: Bench) -> None:
    assert bench.judge(fault("return 2")).noticed_by == "tests/test_a.py::test_one"
    assert bench.judge(fault("return 1 + 0")).noticed_by == ""
    assert bench.judge(fault("while True: pass")).noticed_by == HANGS
    assert (bench.tree / "a.py").read_text(encoding="utf-8") == "def one():\n    return 1\n"


@pytest.mark.slow
def test_tests_that_fail_without_a_fault_are_an_error(bench: Bench) -> None:
    (bench.tree / "tests" / "test_a.py").write_text("def test_one():\n    assert False\n", encoding="utf-8")
    with pytest.raises(TestsFail, match="test_one fails without any fault"):
        bench.judge(fault("return 2"))


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
def test_the_tests_named_after_a_file_run_first(path: str, first: str) -> None:
    assert mirroring(path, ROOT)[0] == first


def test_equivalent_faults_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    none, real = (Mutant("gcs_autotune/sname.py", name, "sign", 1, "a", "b", "") for name in ("none", "real"))
    monkeypatch.setitem(NO_FAULT, none.key, "it is the same")
    lines = table([Verdict(none, "", 1.0), Verdict(real, "tests/test_sname.py::test_it", 1.0), Verdict(real, "", 1.0)])
    assert next(line for line in lines.splitlines() if line.startswith("all")).split() == ["all", "1", "1", "1", "50%"]
    assert lines.splitlines()[-1] == f"NOT NOTICED line 1: {real.key}"
