"""Overhead, memory and robustness of the study engine.

Run: ``python3 -m benchmarks.study_engine [--cases 20000] [--kill-cases 10000] [--kills 10] [--speedup]``.

* Overhead: cases that do nothing, with one worker; time of the whole run over the number of cases.
* Memory: largest resident memory of program, scheduler and workers in the second half of that run over the first
  half. The first 5,000 cases (or a quarter) are left out: until then Python, Dask and pyarrow load what they need.
* Kills: a study with a scheduler and workers in processes of their own. One of them or `study run`, drawn at random,
  is killed by ``kill -9`` after a random time, and started again. This is repeated until the study is complete. Every
  case must then be one row.
* ``--speedup``: a study of diagnoses with one and two workers. It needs two free cores.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmarks.results import Figure, count, headline

NOTHING = "def nothing(seed, x):\n    return {'x': x}\n"
STUDY = """
title = "cases that do nothing"
do = "engine_toys:nothing"
design = "random"
cases = {cases}
[vary.argument]
x = {{ from = 0.0, to = 1.0 }}
"""
DIAGNOSES = """
title = "diagnoses"
do = "engine_toys:diagnosed"
repeats = {cases}
"""
DIAGNOSED = """
def diagnosed(seed):
    from gcs_autotune.api import diagnose, example_run
    return {"verdict": diagnose(example_run(seed=seed), dof="yaw").verdict}
"""
PAGE = os.sysconf("SC_PAGE_SIZE")
WARM = 5_000
"""Number of the first cases whose memory is not compared."""
ENVIRONMENT = {
    **os.environ,
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0",
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s",
    "OPENBLAS_NUM_THREADS": "1",
}


def memory_below(pid: int) -> float:
    """Return the resident memory [MB] of a process and of all processes below it."""
    total, todo = 0.0, [pid]
    while todo:
        each = todo.pop()
        try:
            total += int(Path(f"/proc/{each}/statm").read_text().split()[1]) * PAGE / 1e6
            todo += [int(c) for t in Path(f"/proc/{each}/task").iterdir() for c in (t / "children").read_text().split()]
        except OSError:
            continue
    return total


def study_in(folder: Path, text: str) -> Path:
    """Write a study and its functions into *folder*."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "engine_toys.py").write_text(NOTHING + DIAGNOSED)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def started(file: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start `study run`."""
    command = [sys.executable, "-m", "gcs_autotune", "study", "run", str(file), "--out", str(out), *options]
    return subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def rows_in(out: Path) -> list[str]:
    """Return the key of every stored row, from the files themselves."""
    import pyarrow.parquet as pq

    files = sorted((out / "parts").glob("part-*.parquet"))
    return [key for file in files for key in pq.read_table(file, columns=["case"]).column("case").to_pylist()]


def rows_of_part(part: Path) -> int:
    """Return the number of rows of a part, 0 if it has been merged with others."""
    import pyarrow.parquet as pq

    try:
        return int(pq.read_metadata(part).num_rows)
    except OSError:
        return 0


def overhead(folder: Path, cases: int) -> list[Figure]:
    """Run cases that do nothing with one worker; return time per case and growth of the memory."""
    file, out = study_in(folder, STUDY.format(cases=cases)), folder / "out"
    started(study_in(folder / "warm", STUDY.format(cases=1)), folder / "warm" / "out", "--workers", "1").wait()
    begun = time.monotonic()
    run = started(file, out, "--workers", "1")
    taken: list[tuple[int, float]] = []
    first, rows, counted = None, 0, set[Path]()
    while run.poll() is None:
        time.sleep(0.5)
        for part in set((out / "parts").glob("part-*.parquet")) - counted:
            rows, counted = rows + rows_of_part(part), counted | {part}
        if first is None and rows:
            first = time.monotonic(), rows  # the cluster has started
        taken.append((rows, memory_below(run.pid)))
    began, before = first or (begun, 0)
    spent = time.monotonic() - began
    warm = min(WARM, cases // 4)
    middle = (warm + cases) / 2
    early, late = ([m for n, m in taken if low <= n < high] for low, high in ((warm, middle), (middle, math.inf)))
    growth = max(late) / max(early) if early and late else math.nan
    return [
        count("rows of cases that do nothing", len(set(rows_in(out))), cases, least=1.0),
        Figure("overhead of a case, one worker [ms]", 1e3 * spent / max(1, cases - before), most=20.0),
        Figure("largest memory, second half of the run over the first", growth, most=1.1),
    ]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Cluster:
    """A scheduler and two workers as processes that are killed and started again."""

    def __init__(self) -> None:
        self.address = f"tcp://127.0.0.1:{free_port()}"
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        for name in ("scheduler", "worker 1", "worker 2"):
            self.start(name)

    def start(self, name: str) -> None:
        port = self.address.rpartition(":")[2]
        scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
        worker = ["dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        module, *options = scheduler if name == "scheduler" else [*worker, "--death-timeout", "60"]
        command = [sys.executable, "-m", f"distributed.cli.{module}", *options]
        self._processes[name] = subprocess.Popen(
            command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def kill(self, name: str) -> None:
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes[name].wait()

    def mend(self) -> None:
        """Start what has ended: a worker also ends when its scheduler is gone for long."""
        for name, process in list(self._processes.items()):
            if process.poll() is not None:
                self.start(name)

    def close(self) -> None:
        for name in self._processes:
            self.kill(name)


def kills(folder: Path, cases: int, times: int, seed: int) -> list[Figure]:
    """Kill a scheduler, a worker or the program at random; return how many rows the study ends with."""
    file, out = study_in(folder, STUDY.format(cases=cases)), folder / "out"
    draw, killed, repeated = random.Random(seed), Counter[str](), 0
    cluster = Cluster()
    try:
        run = started(file, out, "--scheduler", cluster.address)
        while True:
            if sum(killed.values()) < times:
                before = len(set(rows_in(out)))
                wait = time.monotonic() + 120.0
                while run.poll() is None and len(set(rows_in(out))) == before and time.monotonic() < wait:
                    time.sleep(0.5)  # a kill counts once it interrupts something
                    cluster.mend()
                time.sleep(draw.uniform(0.0, 0.5))
                name = draw.choice(("scheduler", "worker 1", "worker 2", "study run"))
                if name == "study run":
                    run.kill()
                else:
                    cluster.kill(name)
                killed[name] += 1
            cluster.mend()
            if run.poll() is None and sum(killed.values()) < times:
                continue
            code = run.wait()
            if code == 0:
                break
            repeated += 1
            cluster.mend()
            run = started(file, out, "--scheduler", cluster.address)
    finally:
        run.kill()
        cluster.close()
    keys = rows_in(out)
    print(
        f"killed: {', '.join(f'{n} times {name}' for name, n in killed.items())}; `study run` repeated {repeated} times"
    )
    times = sum(killed.values())
    return [
        count(f"different rows after {times} kills", len(set(keys)), cases, least=1.0),
        Figure(f"rows that appear twice after {times} kills", len(keys) - len(set(keys)), most=0.0),
    ]


def speedup(folder: Path, cases: int) -> list[Figure]:
    """Run diagnoses with one and with two workers."""
    spent = []
    for workers in ("1", "1", "2"):  # the first time compiles
        file, out = study_in(folder, DIAGNOSES.format(cases=cases)), folder / f"out{len(spent)}"
        run = started(file, out, "--workers", workers)
        run.wait()
        import pyarrow.parquet as pq

        ended = [t for f in (out / "parts").glob("*.parquet") for r in pq.read_table(f).to_pylist()
                 for t in (r["ended"] - r["seconds"], r["ended"])]  # fmt: skip
        spent.append(max(ended) - min(ended))
    return [Figure("diagnoses, speed with two workers over one", spent[1] / spent[2], least=1.8)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.study_engine", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000, help="cases of the run for overhead and memory; 0: none")
    parser.add_argument("--kill-cases", type=int, default=10_000, help="cases of the run with kills; 0: none")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1, help="seed of the kills")
    parser.add_argument("--speedup", action="store_true", help="compare one and two workers; needs two free cores")
    parser.add_argument("--diagnoses", type=int, default=12, help="diagnoses of the comparison of one and two workers")
    options = parser.parse_args(arguments)
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.kill_cases:
            figures += kills(folder / "kills", options.kill_cases, options.kills, options.seed)
        if options.cases:
            figures += overhead(folder / "overhead", options.cases)
        if options.speedup:
            figures += speedup(folder / "speedup", options.diagnoses)
    headline("study_engine", "the study engine: overhead, memory, rows after kills", figures)


if __name__ == "__main__":
    main()
