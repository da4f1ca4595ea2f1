"""The faults that are put in, the tests that are asked, and what is counted: without running any."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutations import Mutant, mirroring, mutants_of
from benchmarks.mutations.__main__ import ROOT, drawn, table
from benchmarks.mutations.areas import AREAS, EQUIVALENT
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
        changed = mutant.effect(SOURCE)
        assert changed != SOURCE
        assert mutant.is_python(SOURCE)
        before, after = SOURCE.splitlines(), changed.splitlines()
        assert before[: mutant.line - 1] == after[: mutant.line - 1]
        assert before[mutant.end_line :] == after[len(after) - (len(before) - mutant.end_line) :]
        assert after[-1] == "    return µ"


def test_the_same_seed_draws_the_same_faults_from_every_area() -> None:
    first = drawn(3, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "backlash"))
    assert first == drawn(3, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "backlash"))
    assert first != drawn(4, 24, ("envelope", "parameter_transaction", "watchdog", "margins", "colour", "backlash"))
    assert len(set(first)) == 24
    assert len({m.path for m in first}) >= 6


@pytest.mark.parametrize("path", [file for files in AREAS.values() for file in files])
def test_every_file_that_matters_is_there(path: str) -> None:
    assert (ROOT / path).is_file()


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
    ]
    lines = table(verdicts).splitlines()
    total = next(line for line in lines if line.startswith("all"))
    assert total.split() == ["all", "3", "1", "1", "1", "50%"]
    assert any(line.startswith("NOT NOTICED line 1, sign (5 tests, out of time)") for line in lines)
    assert lines[-1] == f"none: {none}: {EQUIVALENT[none]}"
    assert all((ROOT / key.partition("::")[0]).is_file() for key in EQUIVALENT)
