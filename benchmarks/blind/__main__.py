"""Hide random effects in simulated runs, and diagnose the runs.

This is the study ``benchmarks/studies/blind.toml``. A stopped run continues with the same command.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from typing import Any

for _parameter_name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_parameter_name, "1")

from benchmarks.blind.case import TRACK, WITH_MODEL, WITH_MODEL_EFFECTS  # noqa: E402
from benchmarks.blind.foreign import FOREIGN  # noqa: E402
from benchmarks.blind.process_noise import CALM, HIDDEN  # noqa: E402
from benchmarks.blind.recipes import ENVIRONMENT, RECIPES  # noqa: E402
from benchmarks.blind.referee import LONGEST, Outcome, run_case  # noqa: E402
from benchmarks.blind.scoring import headlines, report, tally  # noqa: E402
from benchmarks.results import headline  # noqa: E402
from benchmarks.studies import rows_of  # noqa: E402

FRACTIONS = {"single": 0.6, "clean": 0.2, "double": 0.1, "foreign": 0.1}
"""Kind -> fraction of the cases of ``--kind all``. All kinds of ``--kind numbers`` have a supplied model."""

Task = tuple[str, int, int, str]


def counts_of(kind: str, cases: int) -> dict[str, int]:
    """Return the number of cases of each kind. *kind* can be ``all`` or ``numbers``, which consist of several."""
    if kind == "all":
        return {k: round(share * cases) for k, share in FRACTIONS.items()}
    return dict.fromkeys(WITH_MODEL, max(1, cases // len(WITH_MODEL))) if kind == "numbers" else {kind: cases}


def slugs_of(kind: str, only: Sequence[str]) -> list[str]:
    """Return the effects that the cases of *kind* hide in turn; an empty text for kinds that draw their own."""
    own: dict[str, Sequence[str]] = {
        "single": list(RECIPES),
        "environment": list(ENVIRONMENT),
        "foreign": list(FOREIGN),
        "track": TRACK,
        "process-noise": [*HIDDEN, *[CALM] * len(HIDDEN)],
    }
    beside = list(WITH_MODEL_EFFECTS) if kind.endswith("-and-effect") else [""]
    return [s for s in own.get(kind, beside) if not only or s in only or not s]


def task_of(kind: str, number: int, seed: int, only: Sequence[str]) -> Task:
    """Return (kind, seed, index, slug) of case *number* (from 0). Every effect comes equally often."""
    chosen = slugs_of(kind, only)
    slug = chosen[number % len(chosen)]
    return kind, seed, number if slug == CALM else number // len(chosen), slug


def tasks(kind: str, cases: int, seed: int, only: Sequence[str]) -> list[Task]:
    """Return *cases* cases of *kind*."""
    counts = {k: n for k, n in counts_of(kind, cases).items() if slugs_of(k, only)}
    return [task_of(k, number, seed, only) for k, n in counts.items() for number in range(n)]


def run_row(seed: int, kind: str, draw: int, only: str, among: str, longest: float) -> dict[str, Any]:
    """Run case number *seed* of *kind*; *draw* is the seed of all random numbers.

    among : effects that the diagnosis tries; empty: all. longest : its time limit [s]; 0: none. Return the outcome
    as a row of the study.
    """
    outcome = run_case(*task_of(kind, seed, draw, _split(only)), longest or LONGEST, _split(among) or None)
    return {"outcome": outcome.to_json(), "right": outcome.right, "verdict": outcome.verdict, "slug": outcome.slug}


def _split(only: str) -> list[str]:
    return [s for s in only.split(",") if s]


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind", description=__doc__)
    parser.add_argument("--cases", type=int, default=340, help="number of cases (340)")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--only", default="", help="hide only these effects; slugs, separated by commas")
    kinds = ("all", "numbers", *FRACTIONS, "environment", "track", "clean-track", "process-noise", *WITH_MODEL)
    parser.add_argument(
        "--among", default="", help="effects that the diagnosis tries; slugs, separated by commas (all)"
    )
    parser.add_argument("--kind", choices=kinds, default="all")
    text = "time limit of a diagnosis (none); it reports nothing after that"
    parser.add_argument("--max-seconds", type=float, default=LONGEST, help=text)
    parser.add_argument("--quiet", action="store_true", help="print only the report")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, print the report, and return 0."""
    options = _parsed(arguments)
    only = _split(options.only)
    unknown = [s for s in only if s not in RECIPES and s not in ENVIRONMENT and s not in FOREIGN and s != CALM]
    if unknown:
        print(f"unknown effect: {', '.join(unknown)}", file=sys.stderr)
        return 2
    longest = options.max_seconds if math.isfinite(options.max_seconds) else 0.0
    own = {"draw": options.seed, "only": options.only, "among": options.among, "longest": longest}
    fixed = {f"argument.{name}": value for name, value in own.items()}
    done: list[Outcome] = []
    for kind, cases in counts_of(options.kind, options.cases).items():
        if cases and slugs_of(kind, only):
            rows = rows_of("blind", options.jobs, only={"argument.kind": (kind,)}, fixed=fixed, repeats=cases)
            done += [Outcome.from_json(row["outcome"]) for row in rows]
    if not options.quiet:
        print("\n".join(map(_line, done)), tally(done), sep="\n")
    print(report(done))
    if not only and not options.among:
        for kind, (measures, figures) in headlines(done).items():
            headline(f"blind-{kind}", measures, figures)
    return 0


def _line(o: Outcome) -> str:
    mark = "right" if o.strictly_right else "group" if o.right else "WRONG"
    truth = "+".join([*o.wrong_numbers, *(f"{t}@{p}" for t, p in zip(o.truth, o.places, strict=False))]) or "nothing"
    answer = "+".join([*o.reported_numbers, *(f"{c}@{p}" for c, p in zip(o.causes, o.found_at, strict=True))])
    head = f"{mark} {o.kind} {o.index} {o.craft} T={o.pace:.2g} s x{o.ratio:.2f}"
    return f"{head}: {truth} -> {o.verdict} {answer} {o.seconds:.1f} s"


if __name__ == "__main__":
    sys.exit(main())
