"""The search with process noise alone: seconds per case instead of tens for a whole diagnosis.

``python3 -m benchmarks.blind.beneath [--kind weather|mild|rough] [--seeds 101 102] [--only SLUG,..] [--whole]
[--oracle] [--save F]`` draws from every seed the first case of each effect and three clean ones; ``rough`` adds three
pairs. It prints how often the true cause is first (in its group): of all effects, of those worth ten in log-likelihood,
and of those in noise up to 40 % of full command. It also prints wrong causes and causes on clean craft; the first hint,
if no cause is reported and the effect is worth three to ten; hints on clean craft beside the number that chance
implies; pairs; and the same by circumstances. If the heading lags, the causes of :data:`.rough.EXCUSED` are counted
apart. The worth of an effect is that found by the search; ``--oracle`` adds its worth with the disturbance known
(:mod:`.oracle`).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blind.case import Case, NoCase, draw_case
from benchmarks.blind.oracle import visible
from benchmarks.blind.rough import CIRCUMSTANCES, EXCUSED, PAIR
from benchmarks.blind.scoring import bounds
from benchmarks.blind.weather import CALM, HIDDEN, MILD_HIDDEN
from benchmarks.results import Figure, count, headline
from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.evidence import FAINT, chance_of, weak_among
from gcs_autotune.diagnose.process_noise import NoiseSearch, search_with_process_noise, supported
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded

__all__ = ["main", "marked"]

OFTEN = {CALM: 3, PAIR: 3}
"""Cases of every seed, where they are not one."""

WORTH, MILD = 10.0, 0.4
"""Log-likelihood above which an effect should be named; weather, in shares of full command, that is mild."""

Row = dict[str, Any]


def _cases(kind: str, seeds: Sequence[int], only: Sequence[str]) -> Iterator[tuple[str, int, int, str]]:
    for seed in seeds:
        hidden = MILD_HIDDEN if kind == "mild" else HIDDEN
        for slug in (*hidden, CALM, *([PAIR] if kind == "rough" else [])):
            if not only or slug in only:
                yield from ((kind, seed, index, slug) for index in range(OFTEN.get(slug, 1)))


def _searched(case: Case, slugs: Sequence[str]) -> NoiseSearch | None:
    form = plain_form(case.runs)
    held = prepare_as_recorded(case.unseen, form)[0] if case.unseen else []
    problem, base = fit_base(form, prepare_as_recorded(case.runs, form)[0])
    return search_with_process_noise(problem, base, slugs, held, lambda *_: None)


def _gain(found: NoiseSearch | None, slug: str) -> float | None:
    """Return what *slug* gained in the first step, None where it did not come so far."""
    judged = found.steps[0].judged if found is not None and found.steps else ()
    return max((a.gained for a in judged if a.effect.slug == slug), default=None)


def _answer(found: NoiseSearch | None) -> Row:
    """Return names, groups and hints of a search, as a diagnosis gives them, and how often chance gives a hint."""
    if found is None:
        return {"named": [], "groups": [], "hints": [], "chance": 0.0}
    told = supported(found)
    return {
        "named": [a.effect.slug for a in told.accepted],
        "groups": [list(g) for g in told.alike()],
        "hints": [w.one.effect.slug for w in weak_among(told)],
        "chance": chance_of(FAINT, 1, found.tried),
    }


def _asked(kind: str, seed: int, index: int, slug: str, *, whole: bool) -> Row:
    """Return what the search, or the *whole* diagnosis, says of one case."""
    case = draw_case(kind, seed, index, slug)
    begun = time.process_time()
    found: NoiseSearch | None = None
    if whole:
        told = diagnose(list(case.runs), unseen=list(case.unseen))
        answer: Row = {
            "verdict": told.verdict,
            "named": [c.effect.slug for c in told.causes],
            "groups": [list(g) for g in told.indistinguishable],
            "hints": [h.cause for h in told.hints],
            "chance": chance_of(FAINT, 1, told.tried),
        }
    else:
        found = _searched(case, list(EFFECTS))
        answer = _answer(found)
    seconds = time.process_time() - begun
    worth = []
    for true in case.slugs:
        gain = _gain(found, true)
        # One that is left behind by others in the rough is worth something all the same.
        worth.append(gain if gain is not None else _gain(_searched(case, [true]), true) or 0.0)
    row = {
        "kind": kind,
        "slug": slug,
        "seed": seed,
        "index": index,
        "truth": list(case.slugs),
        "circumstances": list(case.circumstances),
        "weather": case.ratio,
        "worth": min(worth, default=0.0),
        "seconds": seconds,
        **answer,
    }
    return {**row, **marked(row)}


def marked(row: Row) -> Row:
    """Return how a row counts: ``right``, ``wrong`` (a wrong name first; of a pair anywhere), ``beside`` (a wrong name
    after the right one), ``both`` and ``excused`` (names that a heading that lags accounts for).
    """
    truth, named = row["truth"], row["named"]
    alike = [set(g) for g in row["groups"]]
    lagging = [n for n in named if n in EXCUSED or any(n in g and g & set(EXCUSED) for g in alike)]
    hit = {n for n in named if n in truth or any(n in g and g & set(truth) for g in alike)}
    excused = [n for n in lagging if "lag" in row["circumstances"] and n not in hit]
    left = [n for n in named if n not in excused]
    true = [any(n == t or any({n, t} <= g for g in alike) for t in truth) for n in left]
    told = sum(t in left or any(t in g and g & set(left) for g in alike) for t in truth)
    pair = len(truth) > 1
    return {
        "right": told == len(truth) and all(true) if pair else bool(true) and true[0],
        "one": pair and told == 1 and all(true),
        "wrong": not all(true) if pair else bool(true) and not true[0],
        "beside": not pair and bool(true) and true[0] and not all(true),
        "excused": excused,
    }


def _told(what: str, hits: int, of: int, goal: str = "-") -> str:
    low, high = bounds(hits, of)
    return f"{what:58} {hits:4d} of {of:4d}  ({100 * low:.0f} to {100 * high:.0f} %)  goal {goal}"


def _count(rows: Sequence[Row], what: str) -> int:
    return sum(bool(r[what]) for r in rows)


def report(rows: Sequence[Row]) -> Iterator[str]:
    """Tell the rates, all together and by circumstances."""
    single = [r for r in rows if len(r["truth"]) == 1]
    clean, pairs = ([r for r in rows if len(r["truth"]) == n] for n in (0, 2))
    large, mild = [r for r in single if r["worth"] >= WORTH], [r for r in single if r["weather"] <= MILD]
    for what, some, goal in (
        ("the right name first (in its group)", single, "-"),
        (f"  where it is worth {WORTH:g} in log-likelihood", large, "85 %"),
        (f"  in weather of up to {100 * MILD:.0f} % of full command", mild, "50 %"),
    ):
        yield _told(what, _count(some, "right"), len(some), goal)
    if known := [r for r in single if r.get("visible") is not None]:
        seen = [r for r in known if r["visible"] >= WORTH]
        yield f"worth {WORTH:g} to who knows the weather and the true numbers: {len(seen)} of {len(known)} effects"
        yield _told("  of them the right name first", _count(seen, "right"), len(seen), "85 %")
        calm = [r for r in seen if r["weather"] <= MILD]
        yield _told(f"  of those in weather of up to {100 * MILD:.0f} %", _count(calm, "right"), len(calm))
    yield _told("a wrong name first", _count(single, "wrong"), len(single))
    yield _told("a wrong name after the right one", _count(single, "beside"), len(single))
    yield _told("a name on a clean craft", _count(clean, "wrong"), len(clean), "at most 3 %")
    yield from _hints(single, clean)
    if pairs:
        seen = [r for r in pairs if r["worth"] >= WORTH]
        yield _told("of two both, and nothing else", _count(pairs, "right"), len(pairs))
        yield _told(f"  where each is worth {WORTH:g}", _count(seen, "right"), len(seen))
        yield _told("of two one, and nothing else", _count(pairs, "one"), len(pairs))
        yield _told("of two a wrong name", _count(pairs, "wrong"), len(pairs))
    lagging = [r for r in rows if "lag" in r["circumstances"]]
    if lagging:
        yield _told("a lagging heading told as lagging commands", _count(lagging, "excused"), len(lagging))
    if not any(r["circumstances"] for r in rows):
        return
    yield f"\n{'':10} worth {WORTH:g}: right  single: wrong  clean: named  pairs: both, one, wrong"
    for name in (*CIRCUMSTANCES, "none"):
        one, two, none, pair = (
            [r for r in some if name in r["circumstances"] or (name == "none" and not r["circumstances"])]
            for some in (large, single, clean, pairs)
        )
        both = ", ".join(str(_count(pair, w)) for w in ("right", "one", "wrong"))
        yield (
            f"{name:10} {_count(one, 'right'):8d} of {len(one):<4d} {_count(two, 'wrong'):6d} of {len(two):<4d} "
            f"{_count(none, 'wrong'):5d} of {len(none):<4d}  {both} of {len(pair)}"
        )


def _hints(single: Sequence[Row], clean: Sequence[Row]) -> Iterator[str]:
    """Tell how often the first hint is right where the effect is too weak to be named, and hints on clean craft."""
    weak = [r for r in single if FAINT <= r["worth"] < WORTH and not r["named"]]
    given, silent = [r for r in weak if r["hints"]], [r for r in clean if not r["named"]]
    right = sum(r["hints"][0] in r["truth"] for r in given)
    yield _told(f"worth {FAINT:g} to {WORTH:g} and not named: a hint is given", len(given), len(weak))
    yield _told("  of these the first hint right", right, len(given), "90 %")
    yield _told("a hint on a clean craft", sum(bool(r["hints"]) for r in silent), len(silent))
    yield f"  by chance alone at most {sum(r['chance'] for r in silent):.1f} would have one"


def _line(row: Row) -> str:
    mark = next((m for m in ("wrong", "right", "one") if row[m]), "-")
    sight = f" to be seen {row['visible']:6.1f}" if row.get("visible") is not None else ""
    return (
        f"{mark:5} {'+'.join(row['truth']) or CALM:32} {row['seed']:4d}.{row['index']} x{row['weather']:.2f} "
        f"worth {row['worth']:6.1f}{sight} {','.join(row['circumstances']):24} "
        f"-> {_outcome(row):30} {row['seconds']:5.1f} s"
    )


def _outcome(row: Row) -> str:
    hint = f"hint {row['hints'][0]}" if row["hints"] else "nothing"
    return ", ".join(row["named"]) or hint


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line per case, then the rates."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind.beneath", description=__doc__)
    parser.add_argument("--kind", choices=("weather", "mild", "rough"), default="weather")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    parser.add_argument("--only", default="", help=f"slugs, joined by commas; {CALM} for none hidden, {PAIR} for two")
    parser.add_argument("--whole", action="store_true", help="whole diagnoses, tens of seconds each")
    parser.add_argument("--oracle", action="store_true", help="what effects are worth to who knows the weather besides")
    parser.add_argument(
        "--save", type=Path, help="a line per case, the last one counts; cases already in it are not asked again"
    )
    asked = parser.parse_args(arguments)
    lines = asked.save.read_text(encoding="utf-8").splitlines() if asked.save and asked.save.exists() else []
    known = {(r["kind"], r["seed"], r["index"], r["slug"]): r for r in map(json.loads, lines)}
    rows = []
    for key in _cases(asked.kind, asked.seeds, [s for s in asked.only.split(",") if s]):
        before = known.get(key)
        try:
            row = before or _asked(*key, whole=asked.whole)
            if asked.oracle and "visible" not in row:
                row = {**row, "visible": visible(draw_case(*key))}
        except NoCase:
            continue
        if row is not before:
            known[key] = row
            if asked.save:
                with asked.save.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(known[key]) + "\n")
        rows.append({**known[key], **marked(known[key])})
        print(_line(rows[-1]), flush=True)
    print("\n".join(report(rows)))
    if not asked.only and not asked.whole:
        headline(f"blind.beneath-{asked.kind}", MEASURES[asked.kind], _figures(rows))
    return 0


MEASURES = {
    "weather": "the search with process noise alone",
    "mild": "hints: a drifting moment of 25 to 35 % of full command",
    "rough": "the search with process noise alone, in rough water",
}


def _figures(rows: Sequence[Row]) -> list[Figure]:
    single, clean = ([r for r in rows if len(r["truth"]) == n] for n in (1, 0))
    large, mild = [r for r in single if r["worth"] >= WORTH], [r for r in single if r["weather"] <= MILD]
    return [
        count(f"effects worth {WORTH:g} nats found first", _count(large, "right"), len(large), least=0.85),
        count(f"effects in noise up to {MILD:.0%} found first", _count(mild, "right"), len(mild), least=0.5),
        count("wrong causes first", _count(single, "wrong"), len(single), most=0.03),
        count("clean craft with a cause", _count(clean, "wrong"), len(clean), most=0.03),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
