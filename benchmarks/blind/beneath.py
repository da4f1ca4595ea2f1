"""The search under process noise alone, on the cases of kind ``weather``: seconds a case where a diagnosis takes tens.

``python3 -m benchmarks.blind.beneath [--seeds 101 102] [--only SLUG,..] [--save FILE]`` draws from every seed the first
case of each effect and three clean ones. Told are: the right name first (in its group), of all effects, of those worth
ten in log-likelihood, of those in weather of up to 40 % of full command; and names on clean craft.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blind.case import NoCase, draw_case
from benchmarks.blind.scoring import bounds
from benchmarks.blind.weather import CALM, HIDDEN
from gcs_autotune.diagnose.process_noise import search_under_process_noise
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify import fit_base, plain_form, prepare_as_recorded

__all__ = ["main"]

CLEAN = 3
"""Clean cases of every seed."""

WORTH, MILD = 10.0, 0.4
"""Log-likelihood above which an effect should be named; weather, in shares of full command, that is mild."""


def _cases(seeds: Sequence[int], only: Sequence[str]) -> Iterator[tuple[int, int, str]]:
    for seed in seeds:
        yield from ((seed, 0, slug) for slug in HIDDEN if not only or slug in only)
        yield from ((seed, index, CALM) for index in range(CLEAN) if not only or CALM in only)


def _asked(seed: int, index: int, slug: str) -> dict[str, Any]:
    """Return what the search says of one case."""
    case = draw_case("weather", seed, index, slug)
    begun = time.process_time()
    form = plain_form(case.runs)
    held = prepare_as_recorded(case.unseen, form)[0] if case.unseen else []
    problem, base = fit_base(form, prepare_as_recorded(case.runs, form)[0])
    found = search_under_process_noise(problem, base, list(EFFECTS), held, lambda *_: None)
    named = [] if found is None else [a.effect.slug for a in found.named]
    first = [] if found is None else [a for a in found.judged if a.step == 1]
    groups = [] if found is None else found.alike
    return {
        "slug": slug,
        "seed": seed,
        "index": index,
        "weather": case.ratio,
        "named": named,
        "right": bool(named) and (named[0] == slug or any({named[0], slug} <= set(g) for g in groups)),
        "worth": max((a.gain for a in first if a.effect.slug == slug), default=0.0),
        "seconds": time.process_time() - begun,
    }


def _told(what: str, hits: int, of: int, goal: str) -> str:
    low, high = bounds(hits, of)
    return f"{what:58} {hits:4d} of {of:4d}  ({100 * low:.0f} to {100 * high:.0f} %)  goal {goal}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line per case, then the rates."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind.beneath", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    parser.add_argument("--only", default="", help=f"slugs, joined by commas; {CALM} for none hidden")
    parser.add_argument("--save", type=Path, help="one line per case; cases already in it are not asked again")
    asked = parser.parse_args(arguments)
    lines = asked.save.read_text(encoding="utf-8").splitlines() if asked.save and asked.save.exists() else []
    known = {(r["seed"], r["index"], r["slug"]): r for r in map(json.loads, lines)}
    rows = []
    for key in _cases(asked.seeds, [s for s in asked.only.split(",") if s]):
        if key not in known:
            try:
                known[key] = _asked(*key)
            except NoCase:
                continue
            if asked.save:
                with asked.save.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(known[key]) + "\n")
        row = known[key]
        rows.append(row)
        print(
            f"{'right' if row['right'] else 'named' if row['named'] else '-':5} {row['slug']:18} {row['seed']:4d} "
            f"x{row['weather']:.2f} worth {row['worth']:6.1f} -> {', '.join(row['named']) or 'nothing':30} "
            f"{row['seconds']:5.1f} s",
            flush=True,
        )
    hidden, clean = ([r for r in rows if (r["slug"] == CALM) == calm] for calm in (False, True))
    large, mild = [r for r in hidden if r["worth"] >= WORTH], [r for r in hidden if r["weather"] <= MILD]
    for what, some, goal in (
        ("the right name first (in its group)", hidden, "-"),
        (f"  where it is worth {WORTH:g} in log-likelihood", large, "85 %"),
        (f"  in weather of up to {100 * MILD:.0f} % of full command", mild, "50 %"),
    ):
        print(_told(what, sum(r["right"] for r in some), len(some), goal))
    print(_told("a wrong name first", sum(bool(r["named"]) and not r["right"] for r in hidden), len(hidden), "-"))
    print(_told("a name on a clean craft", sum(bool(r["named"]) for r in clean), len(clean), "at most 3 %"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
