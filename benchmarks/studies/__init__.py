"""Benchmarks as studies: their files, and the function that runs one and returns its rows.

The results folder belongs to one version of the code. A stopped benchmark continues with the same command.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from gcs_autotune.executor import DaskExecutor, Executor
from gcs_autotune.kept_results import fingerprint
from gcs_autotune.study import Started, cluster_of, given_up, load_plan, open_study, run_study, unsuited
from gcs_autotune.study.plan import Axis

__all__ = ["FOLDER", "rows_of"]

FOLDER = Path(__file__).parent
OUT = Path("runs") / "studies"


def rows_of(
    name: str, workers: int, *, only: Mapping[str, tuple[Any, ...]] | None = None, **changes: Any
) -> list[dict[str, Any]]:
    """Run the study *name* and return its rows, each a dict of its values and results.

    only : values of varied names, instead of all in the file. changes : other fields of the plan, as ``repeats``.

    Raises
    ------
    RuntimeError
        A case failed; the message is its reason.
    """
    plan = load_plan(FOLDER / f"{name}.toml", Path.cwd())
    vary = {**plan.vary, **{n: Axis(values) for n, values in (only or {}).items()}}
    plan = replace(plan, vary=vary, points=math.prod(len(axis.values) for axis in vary.values()), **changes)
    started = Started.of(plan)
    out = OUT / f"{name}-{fingerprint(started.build.version, started.build.function, plan.settings)[:8]}"

    def report(text: str) -> None:
        sys.stderr.write(f"{text}\n")

    with cluster_of(workers) as client:

        def executor(started: Started) -> Executor:
            own = {"lost": partial(given_up, started), "unsuited": partial(unsuited, started)}
            return DaskExecutor(client, in_order=False, reports=report, **own)

        run_study(plan, out, executor, reports=report)
    rows: list[dict[str, Any]] = open_study(out).to_dict("records")
    failed = [row for row in rows if row["status"] != "done"]
    if failed:
        raise RuntimeError(f"{len(failed)} of {len(rows)} cases of {out} failed, the first: {failed[0]['reason']}")
    return rows
