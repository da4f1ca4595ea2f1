"""Small faults put into the code one at a time: how many do the tests that mirror the file notice?

Run: ``python3 -m benchmarks.mutations [--count 110] [--seed 1] [--jobs 1] [--budget 20] [--only PART,..]``.

Faults (comparisons, signs, constants, dropped calls, ...: ``mutant.py``) are drawn by seed from the areas of
``areas.py``, equally from the files of an area, and put into a scratch copy of the tree. The tests that mirror the file
(``mirror.py``) run until the first failure, for at most ``--budget`` processor seconds. A run out of time counts as not
noticed and is listed apart. A change that is no fault (``EQUIVALENT``, judged by hand, with its reason) does not count.
Exit status 1 below the goal of 90 %.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.mutations.areas import EQUIVALENT, files_by_area  # noqa: E402
from benchmarks.mutations.bench import Slot, Verdict, copy_tree, import_heavy  # noqa: E402
from benchmarks.mutations.mutant import Mutant, mutants_of  # noqa: E402
from benchmarks.results import Figure, headline  # noqa: E402

ROOT = Path(__file__).parents[2]
GOAL = 0.9
UNNOTICED = ("not noticed", "out of time")


def drawn(seed: int, count: int, only: Sequence[str] = (), root: Path = ROOT) -> list[Mutant]:
    """Return *count* faults (fewer where there are no more), by turns of the areas and of the files in each."""
    draw = random.Random(seed)
    queues = []
    for files in files_by_area(root).values():
        shuffled = list(files)
        draw.shuffle(shuffled)
        pools = []
        for file in shuffled:
            pool = [m for m in mutants_of(root / file, root) if not only or any(part in m.key for part in only)]
            draw.shuffle(pool)
            pools.append(pool)
        queues.append(_by_turns(pools))
    found = []
    for mutant in _by_turns([list(q) for q in queues]):
        if len(found) == count:
            break
        if mutant.is_python((root / mutant.path).read_text(encoding="utf-8")):
            found.append(mutant)
    return found


def _by_turns(queues: Sequence[Sequence[Mutant]]) -> Iterator[Mutant]:
    for k in range(max(map(len, queues), default=0)):
        yield from (q[k] for q in queues if k < len(q))


def verdicts(mutants: Sequence[Mutant], jobs: int, budget: float) -> Iterator[Verdict | set[str]]:
    """Try them, in the order in which they are done; last the tests that fail without any fault, too."""
    import_heavy()
    with tempfile.TemporaryDirectory(prefix="mutations-") as scratch:
        slots = [Slot(copy_tree(ROOT, Path(scratch) / str(k)), budget) for k in range(jobs)]
        waiting, tried = iter(mutants), list[Verdict]()
        running = True
        while running:
            running = False
            for slot in slots:
                if slot.mutant is None and (following := next(waiting, None)) is not None:
                    slot.begin(following)
                verdict = slot.poll()
                if verdict is not None:
                    tried.append(verdict)
                    yield verdict
                running = running or slot.mutant is not None or verdict is not None
            time.sleep(0.02)
        yield slots[0].failing(tried)


def table(found: Sequence[Verdict]) -> str:
    """Return what was noticed, by area and by kind of fault, and every survivor with where to look."""
    area_of = {file: area for area, files in files_by_area(ROOT).items() for file in files}
    by_area: dict[str, Counter[str]] = defaultdict(Counter)
    by_kind: dict[str, Counter[str]] = defaultdict(Counter)
    for v in found:
        word = outcome(v)
        for count in (by_area[area_of.get(v.mutant.path, "else")], by_kind[v.mutant.kind], by_area["all"]):
            count[word] += 1
    lines = [f"{'':12s} {'faults':>7s} {'noticed':>8s} {'not':>5s} {'no time':>8s} {'none':>5s} {'share':>6s}"]
    total = by_area.pop("all", Counter())
    for name, count in [*by_area.items(), *sorted(by_kind.items()), ("all", total)]:
        lines.append(
            f"{name:12s} {count.total():7d} {count['noticed']:8d} {count['not noticed']:5d} {count['out of time']:8d} "
            f"{count['none']:5d} {share(count):6.0%}"
        )
    for v in found:
        if outcome(v) in UNNOTICED:
            lines.append(
                f"{outcome(v).upper()} line {v.mutant.line}, {v.mutant.kind} ({v.ran} tests): {v.mutant.key[:300]}"
            )
    lines += [f"none: {v.mutant.key}: {EQUIVALENT[v.mutant.key]}" for v in found if outcome(v) == "none"]
    return "\n".join(lines)


def outcome(verdict: Verdict) -> str:
    """Return ``noticed``, ``not noticed`` by any test, ``out of time``, or ``none`` for a change that is no fault."""
    if verdict.noticed_by:
        return "noticed"
    if verdict.mutant.key in EQUIVALENT:
        return "none"
    return UNNOTICED[not verdict.complete]


def share(count: Counter[str]) -> float:
    """Return the share of the true faults that was noticed; 1 of none."""
    true = count["noticed"] + sum(count[word] for word in UNNOTICED)
    return count["noticed"] / true if true else 1.0


def main(argv: Sequence[str] | None = None) -> int:
    """Draw, try, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=110)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--budget", type=float, default=20.0, help="processor seconds for one fault")
    parser.add_argument("--only", type=lambda t: t.split(","), default=(), help="parts of keys, as printed")
    parser.add_argument("--part", type=lambda t: tuple(map(int, t.split("/"))), default=(1, 1), help="2/3: every third")
    parser.add_argument("--save", type=Path, help="every verdict, one JSON a line")
    options = parser.parse_args(argv)
    found: list[Verdict] = []
    which, of = options.part
    wanted = drawn(options.seed, options.count, options.only)[which - 1 :: of]
    for verdict in verdicts(wanted, options.jobs, options.budget):
        if isinstance(verdict, set):
            found = [replace(v, noticed_by="") if v.noticed_by in verdict else v for v in found]
            print("".join(f"fails without any fault: {test}\n" for test in sorted(verdict)), end="")
            break
        found.append(verdict)
        print(
            f"{len(found):4d} {outcome(verdict):12s} {verdict.seconds:5.1f} s  {verdict.mutant.key}"[:180], flush=True
        )
        if options.save:
            with options.save.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(asdict(verdict)) + "\n")
    print(table(found))
    outcomes = Counter(outcome(v) for v in found)
    true = outcomes["noticed"] + sum(outcomes[word] for word in UNNOTICED)
    noticed = Figure("faults noticed", outcomes["noticed"], of=true, least=GOAL)
    headline("mutations", "small faults that the tests notice", [noticed])
    return 0 if share(outcomes) >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
