"""A scratch copy of the tree, in which one fault at a time is tested; the work tree stays unchanged."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.mutations.mirror import mirroring
from benchmarks.mutations.mutant import Mutant

__all__ = ["Bench", "TestsFail", "Verdict"]

NEAREST = (9, 3, 1)
"""Largest number of test files per fault; fewer if they exceed the budget."""
SLOWER = 3.0
"""Tests hang if they take this many times as long as without the fault, plus :data:`STARTING`."""
STARTING = 5.0
"""Processor time [s] for the start of Python, numpy and pytest."""
ASLEEP = 20.0
"""Largest ratio of wall time to processor time of a run: some tests wait for a link."""
NONE_FOUND = 5
"""Pytest's exit code without tests."""
HANGS = "tests that hang"


class TestsFail(Exception):
    """Tests fail without a fault, or exceed the budget."""

    __test__ = False


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a fault: the test that detected it ("" for none), and the processor time [s]."""

    mutant: Mutant
    noticed_by: str
    seconds: float


class Bench:
    """One scratch tree. *budget*: processor seconds that the tests of a file may take without a fault."""

    def __init__(self, root: Path, scratch: Path, budget: float) -> None:
        self.tree, self.budget = scratch / "tree", budget
        skipped = shutil.ignore_patterns(".git", ".mypy_cache", ".ruff_cache", ".pytest_cache", "*.egg-info", "runs")
        shutil.copytree(root, self.tree, ignore=skipped, symlinks=True)
        if (root.parent / "shared").is_dir():
            (scratch / "shared").symlink_to(root.parent / "shared")
        self.without_fault = cache(self._without_fault)

    def judge(self, mutant: Mutant) -> Verdict:
        """Insert the fault, run its tests (the slow ones only if the others pass), and remove it."""
        path = self.tree / mutant.path
        source, stamp = path.read_text(encoding="utf-8"), path.stat()
        spent = 0.0
        for slow in (False, True):
            tests, usual = self.without_fault(mutant.path, slow)
            if not tests:
                continue
            try:
                path.write_text(mutant.source, encoding="utf-8")
                code, seconds, failed = self._run(mutant.path, tests, slow, SLOWER * usual + STARTING)
            finally:
                path.write_text(source, encoding="utf-8")
                os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # its compiled functions are valid again
            spent += seconds
            if code not in (0, NONE_FOUND):
                return Verdict(mutant, failed if code is not None else HANGS, spent)
        return Verdict(mutant, "", spent)

    def _without_fault(self, path: str, slow: bool) -> tuple[tuple[str, ...], float]:
        """Return the tests that mirror a file and fit into the budget, and the seconds they take.

        Raises
        ------
        TestsFail
            They fail although there is no fault.
        """
        mirrors = mirroring(path, self.tree)
        for most in NEAREST:
            tests = tuple(mirrors[:most])
            code, seconds, failed = self._run(path, tests, slow, self.budget)
            if code == NONE_FOUND:
                return (), 0.0
            if code == 0:
                return tests, seconds
            if code is not None:
                raise TestsFail(f"{failed} fails without any fault in {path}")
        return (), 0.0

    def _run(self, path: str, tests: Sequence[str], slow: bool, budget: float) -> tuple[int | None, float, str]:
        """Return pytest's exit code, None of tests that used up their budget, processor seconds, and what failed.

        The limit is on processor time, so that a busy machine has no effect.
        """
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(self.tree)}
        if "import njit" in (self.tree / path).read_text(encoding="utf-8"):
            # Numba does not notice that a function compiled into another file's has changed.
            environment["NUMBA_DISABLE_JIT"] = "1"
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-o", "timeout=0"]
        command += ["-rfE"]
        most = int(budget) + 1
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            done = subprocess.run(
                [*command, "-m", f"{'' if slow else 'not '}slow and not browser and not ardupilot", *tests],
                cwd=self.tree,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=ASLEEP * most,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None, budget, HANGS
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        failures = [line for line in done.stdout.splitlines() if line.startswith(("FAILED ", "ERROR "))]
        failed = failures[0].split()[1] if failures else f"pytest's exit code {done.returncode}"
        return (done.returncode if done.returncode >= 0 else None), seconds, failed
