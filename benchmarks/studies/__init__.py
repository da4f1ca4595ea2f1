"""Benchmarks as studies: their files, and the function that runs one and returns its rows.

The results folder belongs to one version of the code. A stopped benchmark continues with the same command.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from gcs_autotune.executor import DaskExecutor, Executor, SerialExecutor
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.study import Started, cluster_of, given_up, load_plan, open_study, run_study, unsuited
from gcs_autotune.study.plan import Axis

__all__ = ["FOLDER", "rows_of"]

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
