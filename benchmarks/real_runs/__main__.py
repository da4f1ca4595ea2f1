"""Print the comparison on real measured runs: ``python3 -m benchmarks.real_runs``; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import benchmarks.real_runs as package
from benchmarks.real_runs.methods.table import METHODS, PEERS
from benchmarks.real_runs.runs import CRAFTS, DATA
from benchmarks.results import Figure, headline

__all__ = ["main"]

SIGNALS = ("u", "v", "r", "psi")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every method on every craft and print a table per craft."""
    about = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("benchmarks.real_runs", description=package.__doc__, formatter_class=about)
    parser.add_argument("--craft", nargs="+", choices=list(CRAFTS), default=list(CRAFTS))
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=[n for n in METHODS if n not in PEERS])
    parser.add_argument("--peers", action="store_true", help=f"also run {', '.join(PEERS)} (pip install '.[bench]')")
    parser.add_argument("--python", default=sys.executable, help="Python interpreter with the other packages")
    parser.add_argument("--limit", type=float, default=1800.0, help="time limit of a method [s]")
    chosen = parser.parse_args(arguments)
    if not DATA.is_dir():
        print(f"no measured runs at {DATA}", file=sys.stderr)
        return 2
    methods = list(dict.fromkeys([*chosen.methods, *(PEERS if chosen.peers else ())]))
    figures = []
    for craft in chosen.craft:
        found = CRAFTS[craft]
        print(
            f"\n{craft}: trained on {', '.join(found.train)}; held out {', '.join(found.held)}; fit [%] of a free run"
        )
        heads = "".join(f"{h:>28}" for h in found.held)
        print(
            f"{'':14}{heads}{'mean':>8}{'CPU s':>8}{'MB':>7}\n{'':14}"
            + f"{'u     v     r   psi':>28}" * len(found.held)
        )
        for method in methods:
            python = chosen.python if method in PEERS else sys.executable
            answer = _run(python, craft, method, chosen.limit)
            print(f"{method:14}{_line(answer, found.held)}", flush=True)
            if not isinstance(answer, str):
                figures.append(Figure(f"{craft}, {method}, mean fit", _mean(answer, found.held), "%"))
    headline("real_runs", "simulation of held-out runs of real craft, compared with SciPy and five packages", figures)
    return 0


def _run(python: str, craft: str, method: str, limit: float) -> Mapping[str, Any] | str:
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    flags = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}
    environment = {**os.environ, **one, **flags}
    command = [python, "-m", "benchmarks.real_runs.worker", craft, method]
    root = Path(__file__).parents[2]
    try:
        done = subprocess.run(
            command, cwd=root, env=environment, capture_output=True, text=True, timeout=limit, check=False
        )
    except subprocess.TimeoutExpired:
        return f"given up after {limit:g} s"
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no message"])[-1]
    answer: Mapping[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


def _line(answer: Mapping[str, Any] | str, held: Sequence[str]) -> str:
    if isinstance(answer, str):
        return f"  {answer}"
    cells = ""
    for name in held:
        values = [float(answer["scores"][name][s]) for s in SIGNALS]
        cells += f"{'':4}" + "".join(_cell(v) for v in values)
    return f"{cells}{_mean(answer, held):8.1f}{answer['seconds']:8.1f}{answer['memory']:7.0f}"


def _mean(answer: Mapping[str, Any], held: Sequence[str]) -> float:
    """Return the mean fit [percent] over signals and runs; less than -100 counts as -100."""
    every = [max(float(answer["scores"][name][s]), -100.0) for name in held for s in SIGNALS]
    return sum(every) / len(every)


def _cell(value: float) -> str:
    return f"{value:6.1f}" if value > -999.0 else f"{'away':>6}"


if __name__ == "__main__":
    sys.exit(main())
