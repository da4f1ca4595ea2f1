"""Benchmarks as studies: their files, and the function that runs one and returns its rows.

The results folder belongs to one version of the code. A stopped benchmark continues with the same command.
"""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from gcs_autotune.executor import DaskExecutor, Executor, SerialExecutor
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.study import Started, cluster_of, given_up, load_plan, open_study, run_study, unsuited
from gcs_autotune.study.plan import Axis

__all__ = ["FOLDER", "in_main_thread", "rows_of", "serve_calls"]

FOLDER = Path(__file__).parent
OUT = Path("runs") / "studies"
PLANTS = Path(__file__).parents[2] / "tests" / "plants"
"""Simulators of the tests that some benchmarks use; their rows depend on them too."""


def rows_of(
    name: str,
    workers: int,
    *,
    only: Mapping[str, tuple[Any, ...]] | None = None,
    fixed: Mapping[str, Any] | None = None,
    **changes: Any,
) -> list[dict[str, Any]]:
    """Run the study *name* and return its rows, each a dict of its values and results.

    workers : processes; 1: this process. only : values of varied names, instead of all in the file. fixed : values of
    fixed names, instead of those in the file. changes : other fields of the plan, as ``repeats``.

    Raises
    ------
    RuntimeError
        A case failed; the message is its reason.
    """
    plan = load_plan(FOLDER / f"{name}.toml", Path.cwd())
    vary = {**plan.vary, **{n: Axis(values) for n, values in (only or {}).items()}}
    points = math.prod(len(axis.values) for axis in vary.values())
    plan = replace(plan, vary=vary, points=points, fixed={**plan.fixed, **(fixed or {})}, **changes)
    build = Started.of(plan).build
    plants = "".join(path.read_text(encoding="utf-8") for path in sorted(PLANTS.glob("*.py")))
    out = OUT / f"{name}-{fingerprint(build.version, build.function, plants, plan.settings)[:8]}"

    def report(text: str) -> None:
        sys.stderr.write(f"{text}\n")

    with cluster_of(workers) if workers > 1 else nullcontext() as client:

        def executor(started: Started) -> Executor:
            own = {"lost": partial(given_up, started), "unsuited": partial(unsuited, started)}
            return DaskExecutor(client, in_order=False, reports=report, **own) if client else SerialExecutor()

        run_study(plan, out, executor, reports=report)
    rows = [row for row in open_study(out).to_dict("records") if row["index"] < len(plan)]
    failed = [row for row in rows if row["status"] != "done"]
    if failed:
        raise RuntimeError(f"{len(failed)} of {len(rows)} cases of {out} failed, the first: {failed[0]['reason']}")
    return rows


def in_main_thread(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what *function* returns, computed in the main thread of a process: it may use signals and limits.

    A Dask worker runs its cases in another thread. It then keeps a process for them, which ends with the worker.

    Raises
    ------
    EOFError
        The process has ended. An exception of the function is raised here.
    """
    if threading.current_thread() is threading.main_thread():
        return function(*arguments)
    child = _child()
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        pickle.dump((function, arguments), child.stdin)
        child.stdin.flush()
        is_result, found = pickle.load(child.stdout)
    except (OSError, EOFError) as error:
        _child.cache_clear()
        raise EOFError(f"the process of {function.__name__} has ended") from error
    if not is_result:
        raise found
    return found


@cache
def _child() -> subprocess.Popen[bytes]:
    code = "from benchmarks.studies import serve_calls; serve_calls()"
    return subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def serve_calls() -> None:
    """Answer the calls of :func:`in_main_thread` from standard input, until it ends."""
    answers, sys.stdout = sys.stdout.buffer, sys.stderr
    while True:
        try:
            function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        answer: tuple[bool, Any]
        try:
            answer = True, function(*arguments)
        except Exception as error:  # noqa: BLE001  it is raised again in the worker
            answer = False, error
        pickle.dump(answer, answers)
        answers.flush()
