"""Print the diagnosis of every real craft and of the published tables; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Sequence

import benchmarks.real_diagnosis as package
from benchmarks.real_diagnosis.answers import answer_of, keep
from benchmarks.real_diagnosis.by_hand import ALL, by_hand, lines_by_hand
from benchmarks.real_diagnosis.cases import CASES, DATA
from benchmarks.real_diagnosis.published import lines_of, tables_of
from benchmarks.results import RECORD, Figure, headline
from gcs_autotune.diagnose import Diagnosis, diagnose
from gcs_autotune.errors import AutotuneError
from gcs_autotune.report import hint_notes, hint_title, lead_sentence
from gcs_autotune.trial import Trial

__all__ = ["lines_of_diagnosis", "main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the cases, print the results, and return 0."""
    about = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("benchmarks.real_diagnosis", description=package.__doc__, formatter_class=about)
    parser.add_argument("--case", nargs="*", choices=list(CASES), default=list(CASES))
    parser.add_argument("--no-tables", action="store_true")
    parser.add_argument("--max-seconds", type=float, default=math.inf, help="time limit of a case (none)")
    parser.add_argument(
        "--page", action="store_true", help="only write docs/measured-data.md from the recorded results"
    )
    chosen = parser.parse_args(arguments)
    if chosen.page:
        keep({})
        return 0
    figures = []
    for name in chosen.case:
        case = CASES[name]
        if case.lacking:
            print(f"\n{name} ({case.dof}): skipped: {case.lacking} does not exist", flush=True)
            continue
        unseen_words = ", ".join(case.unseen) or "each in turn"
        print(f"\n{name} ({case.dof}): {', '.join(case.runs)}; held out: {unseen_words}", flush=True)
        runs, unseen = case.load()
        diagnosis = None
        try:
            diagnosis = diagnose(runs, unseen=unseen, dof=case.dof, max_seconds=chosen.max_seconds)
            lines, answer = lines_of_diagnosis(diagnosis), answer_of(diagnosis)
            if diagnosis.causes:
                figures += [Figure(f"{name}, error of {g.signal}, ratio with causes", g.ratio) for g in diagnosis.gains]
        except AutotuneError as error:
            lines, answer = [f"rejected: {error}"], answer_of(str(error))
        if case.dof == "yaw":
            lines += comparison([*runs, *unseen], diagnosis)
        print("\n".join(f"  {line}" for line in lines), flush=True)
        if os.environ.get(RECORD):
            keep({name: answer})
    if set(chosen.case) == set(CASES):
        headline("real_diagnosis", "effects of real craft that a plain simulation lacks, on held-out runs", figures)
    if not chosen.no_tables and DATA.is_dir():
        published = json.loads((DATA / "published_tables.json").read_text(encoding="utf-8"))
        for table in tables_of(published):
            print("\n" + "\n".join(lines_of(table)))
    return 0


AHEAD = 5.0
"""Prediction horizon [s] of the fit by hand, if the diagnosis has none."""


def comparison(runs: Sequence[Trial], diagnosis: Diagnosis | None) -> list[str]:
    """Return the prediction errors of a fit by hand on each held-out run, with those of the diagnosis."""
    gains = [] if diagnosis is None else [g for g in diagnosis.gains if g.signal == "psi"]
    both = {run: pair for g in gains for run, pair in {**g.each, ALL: (g.before, g.after)}.items()}
    ours = {run: (math.degrees(a), math.degrees(b)) for run, (a, b) in both.items()}
    words = gains[0].metric.split() if gains else []
    seconds = next((float(w) for w in words if w.replace(".", "").isdigit()), AHEAD)
    return lines_by_hand(by_hand(runs, seconds), ours)


def lines_of_diagnosis(diagnosis: Diagnosis) -> list[str]:
    """Return the summary of a diagnosis."""
    lines = [lead_sentence(diagnosis)]
    lines.append(f"{diagnosis.verdict}, {diagnosis.seconds:.0f} s, {diagnosis.tried} candidates")
    for cause in diagnosis.causes:
        numbers = ", ".join(f"{n} = {v.value:.3g} +- {v.std:.1g} {v.unit}" for n, v in cause.parameters.items())
        lines.append(f"{cause.effect.slug} at {cause.effect.place}: {numbers}")
    lines += ["indistinguishable: " + ", ".join(group) for group in diagnosis.indistinguishable]
    for g in diagnosis.gains:
        low, high = g.ci95
        lines.append(
            f"{g.signal}: {g.before:.3g} -> {g.after:.3g} {g.unit}, ratio {g.ratio:.2f} [{low:.2f}, {high:.2f}]"
        )
    if diagnosis.gains:
        lines.append(diagnosis.gains[0].held_out)
    for hint in diagnosis.hints:
        lines.append(f"hint: {hint_title(hint)}")
        lines += [f"  {note.label}: {note.text}" for note in hint_notes(diagnosis, hint)]
    lines += [f"left: {words}" for words in diagnosis.left.findings]
    lines += [] if not diagnosis.next_manoeuvre else [f"next: {diagnosis.next_manoeuvre}"]
    lines += [f"doubt: {d.cause}" for d in diagnosis.doubts]
    return lines


if __name__ == "__main__":
    sys.exit(main())
