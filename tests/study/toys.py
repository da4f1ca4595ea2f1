"""Study files and functions for the tests."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

from gcs_autotune.executor import Executor, SerialExecutor
from gcs_autotune.study import Plan, Started, load_plan, run_study

FUNCTIONS = """
import os, signal
from pathlib import Path

def add(seed, x, y=0):
    return {"sum": x + y, "even": x % 2 == 0, "word": f"x{x}", "seed used": seed}

def odd_fails(seed, x):
    if x % 2:
        raise ValueError(f"{x} is odd")
    return {"half": x / 2}

def kills_at_three(seed, x):
    with (Path(__file__).parent / "tried.txt").open("a") as file:
        file.write(f"{x}\\n")
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"x": x}

def counted(seed, x):
    with (Path(__file__).parent / "tried.txt").open("a") as file:
        file.write(f"{x}\\n")
    return {"x": x}
"""
_NUMBERS = itertools.count()


def study_file(folder: Path, do: str, text: str, functions: str = FUNCTIONS) -> Path:
    """Write a study of a function *do* below *folder*, and its module under a unique name."""
    name = f"toys_{folder.name}_{next(_NUMBERS)}"
    (folder / f"{name}.py").write_text(functions)
    path = folder / "study.toml"
    path.write_text(f'title = "a toy"\ndo = "{name}:{do}"\n{text}')
    return path


def serial(started: Started) -> Executor:
    return SerialExecutor()


def ran(path: Path, out: Path, executor: Callable[[Started], Executor] = serial) -> Plan:
    """Run a study into *out* and return its plan."""
    plan = load_plan(path)
    run_study(plan, out, executor)
    return plan


def tried(folder: Path) -> list[str]:
    """Return the x of every case that was begun, in order."""
    file = folder / "tried.txt"
    return file.read_text().split() if file.exists() else []
