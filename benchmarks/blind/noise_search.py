"""Run blind cases through the search with process noise alone, at about three seconds per case.

Run: ``python3 -m benchmarks.blind.noise_search [--kind process-noise|mild|rough] [--seeds 101 102] [--only SLUG,..]
[--whole] [--oracle] [--save F]``. Each seed has one case of each effect and three cases without an effect. With
``--kind rough`` each seed also has three cases with two effects. It prints these counts:

* true causes reported first (alone or in a group): of all effects, of those that improve the log-likelihood by ten,
  and of those in noise up to 40 % of full command;
* wrong causes, and causes reported on craft without an effect;
* first hints that are right, or name the right cause as indistinct, if no cause is reported and the improvement is
  three to ten (a lag or delay is right if the heading lags);
* hints on craft without an effect, and the number expected by chance;
* cases with two effects, and all counts for each of :data:`.rough_water.CIRCUMSTANCES`.

If the heading lags, the causes of :data:`.rough_water.EXCUSED` are counted separately. The
improvement by an effect is that of the search. ``--oracle`` also computes it with the disturbance known
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
from benchmarks.blind.process_noise import CALM, HIDDEN, MILD_HIDDEN
from benchmarks.blind.rough_water import CIRCUMSTANCES, EXCUSED, PAIR
from benchmarks.blind.scoring import bounds
from benchmarks.results import Figure, count, headline
from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.evidence import FAINT, chance_of, weak_among
from gcs_autotune.diagnose.process_noise import NoiseSearch, search_with_process_noise, supported
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded

__all__ = ["main", "marked"]

OFTEN = {CALM: 3, PAIR: 3}
"""Kind of case -> number of cases per seed; one for all others. Project choice."""

LARGE, MILD = 10.0, 0.4
"""Improvement of the log-likelihood above which an effect should be reported; process noise, as a fraction of full
command, up to which it is called mild. Project choices.
"""

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
    """Return the improvement of the log-likelihood by *slug* in the first step; None if it was not scored."""
    judged = found.steps[0].judged if found is not None and found.steps else ()
    return max((a.gained for a in judged if a.effect.slug == slug), default=None)


def _answer(found: NoiseSearch | None) -> Row:
    """Return causes, groups and hints of a search as in a diagnosis, and the probability of a hint by chance."""
    if found is None:
        return {"named": [], "groups": [], "hints": [], "chance": 0.0}
    causes = supported(found)
    return {
        "named": [a.effect.slug for a in causes.accepted],
        "groups": [list(g) for g in causes.alike()],
        "hints": [[w.one.effect.slug, *w.alike] for w in weak_among(causes)],
        "chance": chance_of(FAINT, 1, found.tried),
    }


def _run_case(kind: str, seed: int, index: int, slug: str, *, whole: bool) -> Row:
    """Return the result row of one case, by the search with process noise or by a *whole* diagnosis."""
    case = draw_case(kind, seed, index, slug)
    begun = time.process_time()
    found: NoiseSearch | None = None
    if whole:
        diagnosis = diagnose(list(case.runs), unseen=list(case.unseen))
        answer: Row = {
            "verdict": diagnosis.verdict,
            "named": [c.effect.slug for c in diagnosis.causes],
            "groups": [list(g) for g in diagnosis.indistinguishable],
            "hints": [[h.cause, *h.alike] for h in diagnosis.hints],
            "chance": chance_of(FAINT, 1, diagnosis.tried),
        }
    else:
        found = _searched(case, list(EFFECTS))
        answer = _answer(found)
    seconds = time.process_time() - begun
    improvements = []
    for true in case.slugs:
        gain = _gain(found, true)
        # An effect that was not scored in the first step is searched alone.
        improvements.append(gain if gain is not None else _gain(_searched(case, [true]), true) or 0.0)
    row = {
        "kind": kind,
        "slug": slug,
        "seed": seed,
        "index": index,
        "truth": list(case.slugs),
        "circumstances": list(case.circumstances),
        "noise_share": case.ratio,
        "improvement": min(improvements, default=0.0),
        "seconds": seconds,
        **answer,
    }
    return {**row, **marked(row)}


def marked(row: Row) -> Row:
    """Return how a row counts, by key.

    ``right``: the true cause is first, or both causes of a pair are reported. ``one``: one of a pair is reported.
    ``wrong``: a wrong cause is first, or anywhere for a pair. ``beside``: a wrong cause follows the right one.
    ``excused``: the causes that a lagging heading explains.
    """
    truth, named = row["truth"], row["named"]
    alike = [set(g) for g in row["groups"]]
    lagging = [n for n in named if n in EXCUSED or any(n in g and g & set(EXCUSED) for g in alike)]
    hit = {n for n in named if n in truth or any(n in g and g & set(truth) for g in alike)}
    excused = [n for n in lagging if "lag" in row["circumstances"] and n not in hit]
    left = [n for n in named if n not in excused]
    true = [any(n == t or any({n, t} <= g for g in alike) for t in truth) for n in left]
    reported = sum(t in left or any(t in g and g & set(left) for g in alike) for t in truth)
    pair = len(truth) > 1
    return {
        "right": reported == len(truth) and all(true) if pair else bool(true) and true[0],
        "one": pair and reported == 1 and all(true),
        "wrong": not all(true) if pair else bool(true) and not true[0],
        "beside": not pair and bool(true) and true[0] and not all(true),
        "excused": excused,
    }


def _rate(what: str, hits: int, of: int, goal: str = "-") -> str:
    low, high = bounds(hits, of)
    return f"{what:58} {hits:4d} of {of:4d}  ({100 * low:.0f} to {100 * high:.0f} %)  goal {goal}"


def _count(rows: Sequence[Row], what: str) -> int:
    return sum(bool(r[what]) for r in rows)


def report(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of the report: the counts of all *rows*, then by circumstances."""
    single = [r for r in rows if len(r["truth"]) == 1]
    clean, pairs = ([r for r in rows if len(r["truth"]) == n] for n in (0, 2))
    large, mild = [r for r in single if r["improvement"] >= LARGE], [r for r in single if r["noise_share"] <= MILD]
    for what, some, goal in (
        ("right cause first (alone or in a group)", single, "-"),
        (f"  improvement of the log-likelihood by {LARGE:g} or more", large, "85 %"),
        (f"  process noise up to {100 * MILD:.0f} % of full command", mild, "50 %"),
    ):
        yield _rate(what, _count(some, "right"), len(some), goal)
    if known := [r for r in single if r.get("visible") is not None]:
        seen = [r for r in known if r["visible"] >= LARGE]
        yield f"visible with known disturbance (improvement by {LARGE:g}): {len(seen)} of {len(known)} effects"
        yield _rate("  visible effects, right cause first", _count(seen, "right"), len(seen), "85 %")
        mild_seen = [r for r in seen if r["noise_share"] <= MILD]
        yield _rate(f"  visible effects in noise up to {100 * MILD:.0f} %", _count(mild_seen, "right"), len(mild_seen))
    yield _rate("wrong cause first", _count(single, "wrong"), len(single))
    yield _rate("wrong cause after the right one", _count(single, "beside"), len(single))
    yield _rate("cause reported without an effect", _count(clean, "wrong"), len(clean), "at most 3 %")
    yield from _hints(single, clean)
    if pairs:
        seen = [r for r in pairs if r["improvement"] >= LARGE]
        yield _rate("two effects: both reported, and nothing else", _count(pairs, "right"), len(pairs))
        yield _rate(f"  two effects that each improve it by {LARGE:g}: both reported", _count(seen, "right"), len(seen))
        yield _rate("two effects: one reported, and nothing else", _count(pairs, "one"), len(pairs))
        yield _rate("two effects: a wrong cause reported", _count(pairs, "wrong"), len(pairs))
    lagging = [r for r in rows if "lag" in r["circumstances"]]
    if lagging:
        yield _rate("lagging heading reported as lagging commands", _count(lagging, "excused"), len(lagging))
    if not any(r["circumstances"] for r in rows):
        return
    yield f"\n{'':10} gain {LARGE:g}: right  single: wrong  clean: cause  pairs: both, one, wrong"
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
    """Yield lines with the count of right first hints for weak effects, and of hints on craft without an effect."""
    weak = [r for r in single if FAINT <= r["improvement"] < LARGE and not r["named"]]
    hinted, silent = [r for r in weak if r["hints"]], [r for r in clean if not r["named"]]
    right = sum(r["hints"][0][0] in r["truth"] for r in hinted)
    contained = sum(
        bool(set(r["hints"][0]) & {*r["truth"], *(EXCUSED if "lag" in r["circumstances"] else ())}) for r in hinted
    )
    yield _rate(f"improvement by {FAINT:g} to {LARGE:g}, no cause: hint reported", len(hinted), len(weak))
    yield _rate("  of these, first hint right", right, len(hinted))
    yield _rate("  of these, right or reported as indistinct from it", contained, len(hinted), "90 %")
    yield _rate("hint reported without an effect", sum(bool(r["hints"]) for r in silent), len(silent))
    yield f"  expected by chance: at most {sum(r['chance'] for r in silent):.1f}"


def _line(row: Row) -> str:
    mark = next((m for m in ("wrong", "right", "one") if row[m]), "-")
    visible_gain = f" visible {row['visible']:6.1f}" if row.get("visible") is not None else ""
    return (
        f"{mark:5} {'+'.join(row['truth']) or CALM:32} {row['seed']:4d}.{row['index']} x{row['noise_share']:.2f} "
        f"gain {row['improvement']:6.1f}{visible_gain} {','.join(row['circumstances']):24} "
        f"-> {_outcome(row):30} {row['seconds']:5.1f} s"
    )


def _outcome(row: Row) -> str:
    hint = f"hint {' or '.join(row['hints'][0])}" if row["hints"] else "nothing"
    return ", ".join(row["named"]) or hint


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases, print a line per case and the report, and return 0."""
    parser = argparse.ArgumentParser(prog="python3 -m benchmarks.blind.noise_search", description=__doc__)
    parser.add_argument("--kind", choices=("process-noise", "mild", "rough"), default="process-noise")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102])
    parser.add_argument(
        "--only", default="", help=f"only these effects, separated by commas; {CALM}: none hidden, {PAIR}: two"
    )
    parser.add_argument("--whole", action="store_true", help="run whole diagnoses, tens of seconds each")
    parser.add_argument(
        "--oracle", action="store_true", help="also compute the gain of each effect with known disturbance"
    )
    parser.add_argument("--save", type=Path, help="write a line per case; cases already in the file are not run again")
    options = parser.parse_args(arguments)
    lines = options.save.read_text(encoding="utf-8").splitlines() if options.save and options.save.exists() else []
    known = {(r["kind"], r["seed"], r["index"], r["slug"]): r for r in map(json.loads, lines)}
    rows = []
    for key in _cases(options.kind, options.seeds, [s for s in options.only.split(",") if s]):
        before = known.get(key)
        try:
            row = before or _run_case(*key, whole=options.whole)
            if options.oracle and "visible" not in row:
                row = {**row, "visible": visible(draw_case(*key))}
        except NoCase:
            continue
        if row is not before:
            known[key] = row
            if options.save:
                with options.save.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(known[key]) + "\n")
        rows.append({**known[key], **marked(known[key])})
        print(_line(rows[-1]), flush=True)
    print("\n".join(report(rows)))
    if not options.only and not options.whole:
        headline(f"blind.noise_search-{options.kind}", MEASURES[options.kind], _figures(rows))
    return 0


MEASURES = {
    "process-noise": "the part of the diagnosis that models process noise, run alone",
    "mild": "hints: a drifting moment of 25 to 35 % of full command",
    "rough": "the part of the diagnosis that models process noise, in rough water",
}


def _figures(rows: Sequence[Row]) -> list[Figure]:
    single, clean = ([r for r in rows if len(r["truth"]) == n] for n in (1, 0))
    large, mild = [r for r in single if r["improvement"] >= LARGE], [r for r in single if r["noise_share"] <= MILD]
    return [
        count(
            f"effects that improve the log-likelihood by {LARGE:g} nats, reported first",
            _count(large, "right"),
            len(large),
            least=0.85,
        ),
        count(f"effects in noise up to {MILD:.0%}, reported first", _count(mild, "right"), len(mild), least=0.5),
        count("wrong causes reported first", _count(single, "wrong"), len(single), most=0.03),
        count("clean craft with a cause", _count(clean, "wrong"), len(clean), most=0.03),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
