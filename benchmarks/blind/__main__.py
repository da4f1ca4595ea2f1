"""Effects hidden at random in simulated runs, and diagnosed: ``python3 -m benchmarks.blind``; see ``--help``.

It is the study ``benchmarks/studies/blind.toml``; a stopped run continues with the same command.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.blind.case import BESIDE, GIVEN, TRACK  # noqa: E402
from benchmarks.blind.foreign import FOREIGN  # noqa: E402
from benchmarks.blind.process_noise import CALM, HIDDEN  # noqa: E402
from benchmarks.blind.referee import LONGEST, Outcome, play  # noqa: E402
from benchmarks.blind.scoring import headlines, report, tally  # noqa: E402
from benchmarks.blind.sizes import RECIPES, SURROUNDINGS  # noqa: E402
from benchmarks.results import headline  # noqa: E402
from benchmarks.studies import rows_of  # noqa: E402

SHARES = {"single": 0.6, "clean": 0.2, "double": 0.1, "foreign": 0.1}
"""Of all cases when every kind without a given model is played; ``numbers``: all with one."""

Task = tuple[str, int, int, str]


def counts_of(kind: str, cases: int) -> dict[str, int]:
    """Return the number of cases of each kind in *cases* cases of *kind*, which may stand for several."""
    if kind == "all":
        return {k: round(share * cases) for k, share in SHARES.items()}
    return dict.fromkeys(GIVEN, max(1, cases // len(GIVEN))) if kind == "numbers" else {kind: cases}


def slugs_of(kind: str, only: Sequence[str]) -> list[str]:
    """Return the effects that the cases of *kind* hide by turns; an empty text if it draws its own."""
    own: dict[str, Sequence[str]] = {
        "single": list(RECIPES),
        "environment": list(SURROUNDINGS),
        "foreign": list(FOREIGN),
        "track": TRACK,
        "process-noise": [*HIDDEN, *[CALM] * len(HIDDEN)],
    }
    beside = list(BESIDE) if kind.endswith("-and-effect") else [""]
    return [s for s in own.get(kind, beside) if not only or s in only or not s]


def task_of(kind: str, number: int, seed: int, only: Sequence[str]) -> Task:
    """Return (kind, seed, index, slug) of case *number* (from 0); effects by turns, so each comes equally often."""
    chosen = slugs_of(kind, only)
    slug = chosen[number % len(chosen)]
    return kind, seed, number if slug == CALM else number // len(chosen), slug


def tasks(kind: str, cases: int, seed: int, only: Sequence[str]) -> list[Task]:
    """Return *cases* cases of *kind*."""
    counts = {k: n for k, n in counts_of(kind, cases).items() if slugs_of(k, only)}
    return [task_of(k, number, seed, only) for k, n in counts.items() for number in range(n)]


def played(seed: int, kind: str, draw: int, only: str, among: str, longest: float) -> dict[str, Any]:
    """Play case number *seed* of *kind*; *draw* is the seed of everything drawn.

    among : the effects that the diagnosis tries; empty: all. longest : its time limit [s]; 0: none. Returns the outcome
    for a row.
    """
    found = play(*task_of(kind, seed, draw, _split(only)), longest or LONGEST, _split(among) or None)
    return {"outcome": found.to_json(), "right": found.right, "verdict": found.verdict, "slug": found.slug}


def _split(only: str) -> list[str]:
    return [s for s in only.split(",") if s]


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind", description=__doc__)
    parser.add_argument("--cases", type=int, default=340, help="how many (340)")
    parser.add_argument("--seed", type=int, default=1, help="of everything drawn (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--only", default="", help="slugs, joined by commas")
    kinds = ("all", "numbers", *SHARES, "environment", "track", "clean-track", "process-noise", *GIVEN)
    parser.add_argument("--among", default="", help="slugs that the diagnosis tries, joined by commas (all)")
    parser.add_argument("--kind", choices=kinds, default="all")
    text = "stop a diagnosis after so long (no limit); it then names nothing"
    parser.add_argument("--max-seconds", type=float, default=LONGEST, help=text)
    parser.add_argument("--quiet", action="store_true", help="the report only")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Play, print, and return 0."""
    asked = _parsed(arguments)
    only = _split(asked.only)
    strange = [s for s in only if s not in RECIPES and s not in SURROUNDINGS and s not in FOREIGN and s != CALM]
    if strange:
        print(f"no effect called {', '.join(strange)}", file=sys.stderr)
        return 2
    longest = asked.max_seconds if math.isfinite(asked.max_seconds) else 0.0
    own = {"draw": asked.seed, "only": asked.only, "among": asked.among, "longest": longest}
    fixed = {f"argument.{name}": value for name, value in own.items()}
    done: list[Outcome] = []
    for kind, cases in counts_of(asked.kind, asked.cases).items():
        if cases and slugs_of(kind, only):
            rows = rows_of("blind", asked.jobs, only={"argument.kind": (kind,)}, fixed=fixed, repeats=cases)
            done += [Outcome.from_json(row["outcome"]) for row in rows]
    if not asked.quiet:
        print("\n".join(map(_said, done)), tally(done), sep="\n")
    print(report(done))
    if not only and not asked.among:
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
