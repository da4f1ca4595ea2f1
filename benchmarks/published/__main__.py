"""Compare published numbers with ours: ``python3 -m benchmarks.published``. Exit status 1: a goal is missed."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.published.section import Section
from benchmarks.published.sections import SECTIONS
from benchmarks.results import Figure, count, headline

__all__ = ["TABLES", "main"]

TABLES = Path(__file__).parents[3] / "shared" / "data" / "published_tables.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute and print the tables, and return the exit status."""
    parser = argparse.ArgumentParser(prog="benchmarks.published", description=__doc__)
    parser.add_argument("--tables", type=Path, default=TABLES, help="the JSON file of published tables")
    parser.add_argument("--only", nargs="+", choices=list(SECTIONS), metavar="NAME", help=", ".join(SECTIONS))
    parser.add_argument("--brief", action="store_true", help="print one line per table")
    chosen = parser.parse_args(arguments)
    if not chosen.tables.is_file():
        print(f"{chosen.tables} does not exist: set the file of published tables with --tables", file=sys.stderr)
        return 2
    tables = json.loads(chosen.tables.read_text(encoding="utf-8"))
    found: list[Section] = []
    for name in chosen.only or SECTIONS:
        for section in SECTIONS[name](tables):
            if not chosen.brief:
                _print(section)
            found.append(section)
    print(f"\n{'table':62} {'numbers':>7} {'worst':>9}  goal        verdict")
    for s in found:
        print(
            f"{s.title:62} {sum(r.counts for r in s.rows):7d} {s.worst.difference:8.2f}%  {_goal(s):11} {_verdict(s)}"
        )
    missed = [s.title for s in found if not s.met]
    total = sum(r.counts for s in found for r in s.rows)
    print(f"{total} numbers in {len(found)} tables; goals missed: {', '.join(missed) or 'none'}")
    within = sum(r.counts for s in found if s.met for r in s.rows)
    if not chosen.only:
        figures = [count("published numbers within their goal", within, total, least=1.0)]
        figures += [Figure(f"{s.title}, worst", abs(s.worst.difference), "%") for s in found]
        headline("published", "published numbers compared with ours", figures)
    return 1 if missed else 0


def _print(section: Section) -> None:
    print(f"\n{section.title}\n  {section.basis}")
    print(f"  {'':38} {'published':>12} {'ours':>12} {'difference':>11}")
    for row in section.rows:
        mark = "" if row.counts else "  (does not count)"
        print(f"  {row.name:38} {row.published:12.5g} {row.ours:12.5g} {row.difference:+10.2f}%{mark}")
    print(
        f"  worst: {section.worst.name} {section.worst.difference:+.2f} %; goal {_goal(section)}: {_verdict(section)}"
    )


def _goal(section: Section) -> str:
    if section.exact:
        return "equal"
    if section.below:
        return "not above"
    return "compared" if math.isinf(section.goal) else f"{section.goal:g} %"


def _verdict(section: Section) -> str:
    return "met" if section.met else "MISSED"


if __name__ == "__main__":
    sys.exit(main())
