"""Effects hidden at random in simulated runs, and diagnosed: ``python3 -m benchmarks.blind``; see ``--help``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.blind.case import BESIDE, GIVEN, TRACK  # noqa: E402
from benchmarks.blind.foreign import FOREIGN  # noqa: E402
from benchmarks.blind.process_noise import CALM, HIDDEN  # noqa: E402
from benchmarks.blind.referee import LONGEST, Outcome, play  # noqa: E402
from benchmarks.blind.scoring import headlines, report, tally  # noqa: E402
from benchmarks.blind.sizes import RECIPES, SURROUNDINGS  # noqa: E402
from benchmarks.results import headline  # noqa: E402
from gcs_autotune.executor import executor_for  # noqa: E402

SHARES = {"single": 0.6, "clean": 0.2, "double": 0.1, "foreign": 0.1}
"""Of all cases when every kind without a given model is played; ``numbers``: all with one."""

Task = tuple[str, int, int, str]


def tasks(kind: str, cases: int, seed: int, only: Sequence[str]) -> list[Task]:
    """Return (kind, seed, index, slug) of *cases* cases; effects by turns, so that each comes equally often."""
    counts = {kind: cases}
    if kind == "all":
        counts = {k: round(share * cases) for k, share in SHARES.items()}
    elif kind == "numbers":
        counts = dict.fromkeys(GIVEN, max(1, cases // len(GIVEN)))
    found: list[Task] = []
    for each, count in counts.items():
        beside = list(BESIDE) if each.endswith("-and-effect") else [""]
        own: dict[str, Sequence[str]] = {
            "single": list(RECIPES),
            "environment": list(SURROUNDINGS),
            "foreign": list(FOREIGN),
            "track": TRACK,
            "process-noise": [*HIDDEN, *[CALM] * len(HIDDEN)],
        }
        table: Sequence[str] = own.get(each, beside)
        chosen = [s for s in table if not only or s in only or not s]
        if chosen:
            turns = [(chosen[i % len(chosen)], i) for i in range(count)]
            found += [(each, seed, i if s == CALM else i // len(chosen), s) for s, i in turns]
    return found


def outcomes(
    todo: Sequence[Task], jobs: int, longest: float = LONGEST, among: Sequence[str] | None = None
) -> Iterator[Outcome]:
    """Play *todo*, *jobs* at a time."""
    return executor_for(jobs).map(partial(_play, longest, among), todo)


def _play(longest: float, among: Sequence[str] | None, task: Task) -> Outcome:
    return play(*task, longest, among)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind", description=__doc__)
    parser.add_argument("--cases", type=int, default=340, help="how many (340)")
    parser.add_argument("--seed", type=int, default=1, help="of everything drawn (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--only", default="", help="slugs, joined by commas")
    kinds = ("all", "numbers", *SHARES, "environment", "track", "clean-track", "process-noise", *GIVEN)
    parser.add_argument("--among", default="", help="slugs that the diagnosis tries, joined by commas (all)")
    parser.add_argument("--kind", choices=kinds, default="all")
    parser.add_argument("--save", type=Path, help="one line per case; cases already in it are not played again")
    text = "stop a diagnosis after so long (no limit); it then names nothing"
    parser.add_argument("--max-seconds", type=float, default=LONGEST, help=text)
    parser.add_argument("--quiet", action="store_true", help="the report only")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Play, print, and return 0."""
    asked = _parsed(arguments)
    only = [s for s in asked.only.split(",") if s]
    strange = [s for s in only if s not in RECIPES and s not in SURROUNDINGS and s not in FOREIGN and s != CALM]
    if strange:
        print(f"no effect called {', '.join(strange)}", file=sys.stderr)
        return 2
    todo = tasks(asked.kind, asked.cases, asked.seed, only)
    old: list[Outcome] = []
    if asked.save and asked.save.exists():
        old = [Outcome.from_json(line) for line in asked.save.read_text(encoding="utf-8").splitlines() if line]
    known = {(o.kind, o.seed, o.index, o.slug): o for o in old}
    done = [known[task] for task in todo if task in known]
    among = [s for s in asked.among.split(",") if s] or None
    for outcome in outcomes([task for task in todo if task not in known], asked.jobs, asked.max_seconds, among):
        done.append(outcome)
        if asked.save:
            with asked.save.open("a", encoding="utf-8") as stream:
                stream.write(outcome.to_json() + "\n")
        if not asked.quiet:
            print(_said(outcome), "|", len(done), "of", len(todo), "|", tally(done), flush=True)
    print(report(done))
    if not only and not among:
        for kind, (measures, figures) in headlines(done).items():
            headline(f"blind-{kind}", measures, figures)
    return 0


def _said(o: Outcome) -> str:
    mark = "right" if o.strictly_right else "group" if o.right else "WRONG"
    truth = "+".join([*o.numbers, *(f"{t}@{p}" for t, p in zip(o.truth, o.places, strict=False))]) or "nothing"
    answer = "+".join([*o.doubted, *(f"{c}@{p}" for c, p in zip(o.causes, o.found_at, strict=True))])
    head = f"{mark} {o.kind} {o.index} {o.craft} T={o.pace:.2g} s x{o.ratio:.2f}"
    return f"{head}: {truth} -> {o.verdict} {answer} {o.seconds:.1f} s"


if __name__ == "__main__":
    sys.exit(main())
