"""Insert small faults into the code one at a time, and count those that the tests of the file detect.

Run: ``python3 -m benchmarks.mutations [--count 30] [--seed 1] [--budget 20] [--only PART,..]``; whole: ``--count 110``.

The faults are those of cosmic-ray, drawn by seed from the areas of ``areas.py``, equally from the files of an area, and
the physical ones of ``mutant.py``, all of them. Each is put into a scratch copy of the tree, and the tests that mirror
its file (``mirror.py``) run until the first failure. Tests that take several times as long as without the fault have
noticed it, too. A change without a fault (``NO_FAULT``, judged by hand, with its reason) does not count. Exit status 1
below the goal of 90 %.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.mutations.areas import NO_FAULT, files_by_area
from benchmarks.mutations.bench import Bench, TestsFail, Verdict
from benchmarks.mutations.mutant import Mutant, mutants_of, physical_mutants
from benchmarks.results import Figure, headline

ROOT = Path(__file__).parents[2]
GOAL = 0.9


def drawn(seed: int, count: int, only: Sequence[str] = (), root: Path = ROOT) -> list[Mutant]:
    """Return *count* faults, or all if there are fewer, evenly from the areas and their files."""
    draw = random.Random(seed)
    queues = []
    for files in files_by_area(root).values():
        shuffled = [file for file in files if not only or any(part in file for part in only)]
        draw.shuffle(shuffled)
        queues.append(_by_turns([mutants_of(file, root, draw) for file in shuffled]))
    found = []
    for mutant in _by_turns(queues):
        if len(found) == count:
            break
        found.append(mutant)
    return found


def _by_turns(queues: Sequence[Iterator[Mutant]]) -> Iterator[Mutant]:
    left = list(queues)
    while left:
        for queue in list(left):
            mutant = next(queue, None)
            if mutant is None:
                left.remove(queue)
            else:
                yield mutant


def word(verdict: Verdict) -> str:
    """Return ``noticed``, ``not noticed``, or ``no fault`` for a change without an effect."""
    if verdict.noticed_by:
        return "noticed"
    return "no fault" if verdict.mutant.key in NO_FAULT else "not noticed"


def table(found: Sequence[Verdict]) -> str:
    """Return the detected faults by area and by kind, and every undetected one."""
    area_of = {file: area for area, files in files_by_area(ROOT).items() for file in files}
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for v in found:
        physical = v.mutant.kind == "physical"
        for name in ("physical" if physical else area_of[v.mutant.path], "all"):
            counts[name][word(v)] += 1
    lines = [f"{'':12s} {'noticed':>8s} {'not':>5s} {'no fault':>9s} {'share':>6s}"]
    for name, count in sorted(counts.items(), key=lambda row: row[0] == "all"):
        true = count["noticed"] + count["not noticed"]
        rate = count["noticed"] / true if true else 1.0
        lines.append(f"{name:12s} {count['noticed']:8d} {count['not noticed']:5d} {count['no fault']:9d} {rate:6.0%}")
    lines += [f"NOT NOTICED line {v.mutant.line}: {v.mutant.key}" for v in found if word(v) == "not noticed"]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw faults, run the tests, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--budget", type=float, default=20.0, help="processor seconds for the tests of one file")
    parser.add_argument("--only", type=lambda t: t.split(","), default=(), help="parts of file names")
    options = parser.parse_args(argv)
    found: list[Verdict] = []
    mutants = [*physical_mutants(ROOT), *drawn(options.seed, options.count, options.only)]
    with tempfile.TemporaryDirectory(prefix="mutations-") as scratch:
        bench = Bench(ROOT, Path(scratch), options.budget)
        for mutant in mutants:
            try:
                verdict = bench.judge(mutant)
            except TestsFail as error:
                print(f"{error}", flush=True)
                return 2
            found.append(verdict)
            print(f"{len(found):4d} {word(verdict):11s} {verdict.seconds:5.1f} s  {mutant.key[:120]}", flush=True)
            print(f"        {verdict.noticed_by}", flush=True)
    print(table(found))
    outcomes = Counter(map(word, found))
    true = outcomes["noticed"] + outcomes["not noticed"]
    noticed = Figure("faults noticed", outcomes["noticed"], of=true, least=GOAL)
    headline("mutations", "small faults in the code that the tests detect", [noticed])
    return 0 if outcomes["noticed"] >= GOAL * true else 1


if __name__ == "__main__":
    sys.exit(main())
