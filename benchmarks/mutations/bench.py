"""A scratch copy of the tree, and forks of a process that has imported what takes long: one fault, one fork.

The work tree itself is never touched. Sources keep their time stamps, so that what Python and numba have compiled of
them in the work tree counts here too. Numba does not notice that a function compiled into another file's has changed;
files with compiled functions are therefore tried with numba switched off.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.mutations.mirror import mirroring
from benchmarks.mutations.mutant import Mutant

__all__ = ["Slot", "Verdict", "copy_tree"]

HEAVY = (
    "numpy",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "scipy.integrate",
    "scipy.linalg",
    "numba",
    "control",
)
HEAVY += ("matplotlib.figure", "jinja2", "rich.console", "pytest", "serial")
HEAVY += ("pymavlink.dialects.v20.ardupilotmega", "pymavlink.mavutil")
UNCOLLECTED = "it cannot even be collected"
UNSTARTED = "the tests cannot even be started"
BROKEN = 99
"""Exit code of a fork that pytest itself left by an exception: before its tests, or while clearing up after them, when
what a test left behind raises."""
WAITING = 20.0
"""Times the budget that a fault's tests may take by the wall while nobody else wants the processor: some sleep."""
NEAREST = 3
"""Test files that are collected first; three times as many next, and so on: most faults are noticed by the nearest."""
HANGING = 0.5
"""Share of the budget that one test alone may use up before it counts as hanging; it is tried without the fault then,
so that slowness is no notice."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a fault: the test that noticed it ("" if none did), after how many seconds, how many had run."""

    mutant: Mutant
    noticed_by: str
    seconds: float
    ran: int
    complete: bool


def copy_tree(root: Path, target: Path) -> Path:
    """Copy the work tree with its compiled caches and all time stamps; data beside it is linked.

    Asserts are rewritten once per tree: by the first fork that needs a file of tests, which leaves it in the cache.
    """
    tree = target / "tree"
    skipped = shutil.ignore_patterns(".git", ".mypy_cache", ".ruff_cache", ".pytest_cache", "*.egg-info", "build")
    shutil.copytree(root, tree, ignore=skipped, symlinks=True)
    beside = root.parent / "shared"
    if beside.is_dir():
        (target / "shared").symlink_to(beside)
    subprocess.run(
        [sys.executable, "-m", "compileall", "-q", "gcs_autotune", "sitl", "benchmarks"],
        cwd=tree,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},
        check=False,
        stdout=subprocess.DEVNULL,
    )
    return tree


def import_heavy() -> None:
    """Import what every test needs, once, before the first fork; nothing of the project."""
    for name in HEAVY:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


class Slot:
    """One scratch tree; one fault at a time is tried for *budget* processor seconds.

    By the wall for :data:`WAITING` times that, which is longer where the fork has to wait for a processor itself.
    """

    def __init__(self, tree: Path, budget: float) -> None:
        self.tree, self.budget = tree, budget
        self.mutant: Mutant | None = None
        self._pid = self._tried = 0
        self._began = 0.0
        self._stamp = 0.0
        self._again = ""
        self._log = tree.parent / "told.jsonl"

    def begin(self, mutant: Mutant) -> None:
        """Put the fault in and start its tests."""
        self.mutant, self._again = mutant, ""
        path = self.tree / mutant.path
        self._source, self._stamp = path.read_text(encoding="utf-8"), path.stat().st_mtime
        path.write_text(mutant.applied(self._source), encoding="utf-8")
        self._tried += 1  # what Python has compiled goes by whole seconds and size: never twice the same
        os.utime(path, (self._stamp + self._tried,) * 2)
        self._fork(mirroring(mutant.path, self.tree), has_compiled(path))

    def poll(self) -> Verdict | None:
        """Return the verdict when there is one; the fault is out again then."""
        if self.mutant is None:
            return None
        pid, status = os.waitpid(self._pid, os.WNOHANG)
        patience = WAITING * self.budget * crowding(self._pid)
        in_time = processor_time(self._pid) < self.budget and time.monotonic() - self._began < patience
        if not pid and in_time and not (self._again == UNSTARTED and self._told()):
            return None
        if not pid:
            os.killpg(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)
        told = self._told()
        ran = sum(t["outcome"] != "begun" for t in told)
        failed = next((t["test"] for t in told if t["outcome"] == "failed"), "")
        code = os.waitstatus_to_exitcode(status) if pid else None
        unstarted = not told and code not in (None, 0, 5)  # with -x a file that cannot be collected is a failure, too
        if self._again == UNSTARTED:  # the same tests without the fault: they do not start either, or it was the fault
            if unstarted:
                raise RuntimeError(f"the tests of {self.mutant.path} cannot be started, without any fault")
            return self._end(UNSTARTED, 0, complete=True)
        if self._again:  # the test that hung, without the fault
            was, self._again = self._again, ""
            return self._end(was if code == 0 else "", ran, bool(pid))
        if unstarted:
            self._restore()
            self._again = UNSTARTED
            self._fork(mirroring(self.mutant.path, self.tree), has_compiled(self.tree / self.mutant.path))
            return None
        if not pid and told and told[-1]["outcome"] == "begun" and told[-1]["at"] < (1.0 - HANGING) * self.budget:
            self._restore()
            self._again = told[-1]["test"]
            self._fork([self._again], has_compiled(self.tree / self.mutant.path))
            return None
        noticed = failed or (UNCOLLECTED if pid and code not in (0, 1, 5) else "")
        return self._end(noticed, ran, bool(pid))

    def failing(self, verdicts: Sequence[Verdict]) -> set[str]:
        """Return which of the tests that noticed something fail without any fault: what they noticed was none."""
        failed: set[str] = set()
        for compiled in (False, True):
            noticed = {
                v.noticed_by for v in verdicts if has_compiled(self.tree / v.mutant.path) is compiled and v.noticed_by
            } - {UNCOLLECTED, UNSTARTED}
            if noticed:
                self._fork(sorted(noticed), compiled, to_first=False)
                os.waitpid(self._pid, 0)
                failed |= {t["test"] for t in self._told() if t["outcome"] == "failed"}
        return failed

    def _end(self, noticed: str, ran: int, complete: bool) -> Verdict:
        mutant, self.mutant = self.mutant, None
        assert mutant is not None
        self._restore(mutant)
        return Verdict(mutant, noticed, time.monotonic() - self._began, ran, complete)

    def _restore(self, mutant: Mutant | None = None) -> None:
        path = self.tree / (mutant or self.mutant).path  # type: ignore[union-attr]
        path.write_text(self._source, encoding="utf-8")
        os.utime(path, (self._stamp, self._stamp))

    def _told(self) -> list[dict[str, Any]]:
        if not self._log.exists():
            return []
        lines = self._log.read_text(encoding="utf-8").splitlines()
        return [json.loads(line) for line in lines if line.endswith("}")]

    def _fork(self, tests: Sequence[str], compiled: bool, *, to_first: bool = True) -> None:
        self._log.unlink(missing_ok=True)
        self._began = time.monotonic()
        self._pid = os.fork()
        if self._pid == 0:
            code = BROKEN
            try:
                os.setpgid(0, 0)
                code = _run(self.tree, tests, self._log, compiled, to_first)
            finally:  # nothing of what the parent would clean up is the fork's
                os._exit(code)
        with contextlib.suppress(OSError):
            os.setpgid(self._pid, self._pid)


def processor_time(pid: int) -> float:
    """Return the processor seconds of a process and of the children it waited for; 0 where nobody tells."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(int(fields[i]) for i in (11, 12, 13, 14)) / os.sysconf("SC_CLK_TCK")


def crowding(pid: int) -> float:
    """Return how many times longer a process takes because others want the processor, too; 1 where nobody tells."""
    try:
        running, waiting = map(int, Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[:2])
    except (OSError, ValueError):
        return 1.0
    return 1.0 + waiting / running if running else 1.0


class _Telling:
    """A pytest plugin: only the tests that are *slow* or only those that are not, and a line for every one that ran."""

    def __init__(self, log: Path, slow: bool) -> None:
        self._log, self._slow = log, slow

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if (item.get_closest_marker("slow") is not None) is self._slow]

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._tell(nodeid, "begun")

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" or report.failed:
            self._tell(report.nodeid, report.outcome)

    def _tell(self, test: str, outcome: str) -> None:
        with self._log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"test": test, "outcome": outcome, "at": time.process_time()}) + "\n")


def has_compiled(path: Path) -> bool:
    """Whether a file has functions that numba compiles."""
    return "import njit" in path.read_text(encoding="utf-8")


def _run(tree: Path, tests: Sequence[str], log: Path, compiled: bool, to_first: bool) -> int:
    """Run *tests* in *tree*, slow ones last, *to_first* that fails or all; this process is a fork and ends with it."""
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(quiet, stream)
    os.chdir(tree)
    sys.dont_write_bytecode = False  # whatever the shell says: the budget is for tests, not for compiling them anew
    sys.path[:] = [str(tree), *(p for p in sys.path if p and Path(p).resolve() != Path(__file__).parents[2])]
    for name in [n for n in sys.modules if n.split(".")[0] in ("benchmarks", "gcs_autotune", "sitl", "tests")]:
        del sys.modules[name]
    if compiled:
        import numba

        numba.config.DISABLE_JIT = True
    import pytest

    options = [*(["-x"] if to_first else []), "-q", "-p", "no:cacheprovider", "-o", "timeout=0", "--rootdir", str(tree)]
    options += ["-c", str(tree / "pyproject.toml")]
    found = 0
    for slow in (False, True):
        for some in nearest_first(tests):
            code = int(pytest.main([*options, *some], plugins=[_Telling(log, slow)]))
            found = found if code in (0, 5) else code
            if found and to_first:
                return found
    return found


def nearest_first(tests: Sequence[str]) -> Iterator[Sequence[str]]:
    """Yield the tests, the first :data:`NEAREST`, then three times as many, and so on."""
    begin, count = 0, NEAREST
    while begin < len(tests):
        yield tests[begin : begin + count]
        begin, count = begin + count, 3 * count
