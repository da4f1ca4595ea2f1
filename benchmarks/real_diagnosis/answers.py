"""Recorded diagnoses of real craft: a JSON file, and the blocks of ``docs/measured-data.md`` generated from it.

With ``BENCHMARKS_RECORD=1`` in the environment ``python3 -m benchmarks.real_diagnosis`` records the results and writes
the page. ``python3 -m benchmarks.real_diagnosis --page`` only writes the page. The text between the blocks is written
by hand; the numbers of a case are in its block.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping
from pathlib import Path

import msgspec

from benchmarks.real_diagnosis.cases import CASES, Case
from benchmarks.results import commit
from gcs_autotune.diagnose import Diagnosis, ErrorReduction, Value
from gcs_autotune.report import hint_notes, lead_sentence
from gcs_autotune.rounding import format_number, format_value
from gcs_autotune.sname import DOFS
from gcs_autotune_files import conform, read

__all__ = ["FILE", "PAGE", "Answer", "Finding", "answer_of", "keep", "load", "page"]

FILE = Path(__file__).with_name("answers.json")
PAGE = Path(__file__).parents[2] / "docs" / "measured-data.md"
BLOCK = re.compile(
    r"<!-- case (?P<name>[\w-]+): made by python3 -m benchmarks\.real_diagnosis -->\n.*?<!-- end -->\n", re.S
)


class Finding(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Texts on a cause or hint: its parameters, its evidence, and the error reduction."""

    what: str
    evidence: str
    gain: str = ""


class Answer(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A recorded diagnosis of one case. ``refused``: the reason if there is none."""

    lead: str = ""
    verdict: str = ""
    plain: str = ""
    error: str = ""
    causes: tuple[Finding, ...] = ()
    alike: tuple[str, ...] = ()
    hints: tuple[Finding, ...] = ()
    left: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    next: str = ""
    samples: float = 0.0
    refused: str = ""
    origin: str = ""
    """Source, if the benchmark did not write it."""
    date: str = ""
    commit: str = ""


def answer_of(diagnosis: Diagnosis | str) -> Answer:
    """Return the record of a diagnosis, or of the reason why there is none."""
    when = {"date": datetime.datetime.now(datetime.UTC).date().isoformat(), "commit": commit()}
    if isinstance(diagnosis, str):
        return Answer(refused=diagnosis, **when)
    evidence = {
        (r.cause, r.place): f"{0.5 * r.evidence:+.0f} in log-likelihood"
        + (f" on held-out data ({', '.join(f'{v:+.0f}' for v in r.unseen)})" if r.unseen else "")
        for r in diagnosis.ranking
    }
    return Answer(
        lead_sentence(diagnosis),
        diagnosis.verdict,
        _plain(diagnosis),
        "; ".join(map(_gain, diagnosis.gains)),
        tuple(
            Finding(
                f"`{c.effect.slug}` ({c.effect.place}{', slight' * c.is_slight}): {_numbers(c.parameters)}",
                evidence.get((c.effect.slug, c.effect.place), ""),
                "" if c.gain is None else _gain(c.gain),
            )
            for c in diagnosis.causes
        ),
        tuple(" or ".join(f"`{s}`" for s in group) for group in diagnosis.indistinguishable),
        tuple(
            Finding(
                f"`{h.cause}` ({h.place}): {_numbers(h.parameters)}",
                next(note.text for note in hint_notes(diagnosis, h) if note.label == "Evidence"),
            )
            for h in diagnosis.hints
        ),
        diagnosis.left.findings[:2],
        tuple(dict.fromkeys(d.slug for d in diagnosis.doubts)),
        diagnosis.next_manoeuvre,
        diagnosis.work,
        **when,
    )


def _numbers(values: Mapping[str, Value]) -> str:
    return ", ".join(
        f"{n} {format_value(v.value, v.std)} {'' if v.unit == '1' else v.unit}".rstrip() for n, v in values.items()
    )


def _plain(diagnosis: Diagnosis) -> str:
    """Return the title and time constants of the plain model."""
    model, found = diagnosis.base_model.base, []
    for i, dof in enumerate(model.form.dofs):
        damping = f"{DOFS[dof].force}_{DOFS[dof].velocity}"
        if damping in model.form.parameters and model[damping]:
            found.append(
                f"time constant {format_number(abs(float(model.inertia[i, i]) / model[damping]), 2)} s in {dof}"
            )
    return "; ".join([model.form.title, *found])


def _gain(gain: ErrorReduction) -> str:
    unit, factor = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}.get(
        gain.unit, (gain.unit, 1.0)
    )
    ahead = f" {gain.metric.removeprefix('error ')}" if gain.metric.endswith(" s ahead") else ""
    low, high = gain.ci95
    before, after = (format_number(factor * v, 3) for v in (gain.before, gain.after))
    return f"{gain.signal}{ahead}: {before} to {after} {unit}, ratio {gain.ratio:.2f} ({low:.2f} to {high:.2f})"


# -- the file and the page


def load() -> dict[str, Answer]:
    """Return the recorded answers by case."""
    return conform(read(FILE), dict[str, Answer]) if FILE.exists() else {}


def keep(answers: Mapping[str, Answer]) -> None:
    """Add *answers* to the recorded ones, and write the page."""
    every = {**load(), **answers}
    ordered = {name: every[name] for name in CASES if name in every}
    FILE.write_bytes(msgspec.json.format(msgspec.json.encode(ordered), indent=1) + b"\n")
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return :data:`PAGE` with the blocks of the recorded answers."""
    kept = load()

    def block(found: re.Match[str]) -> str:
        name = found["name"]
        head = f"<!-- case {name}: made by python3 -m benchmarks.real_diagnosis -->\n"
        return head + _block(name, CASES[name], kept.get(name)) + "<!-- end -->\n"

    return BLOCK.sub(block, PAGE.read_text(encoding="utf-8"))


def _block(name: str, case: Case, answer: Answer | None) -> str:
    """Return the lead sentence, a table of figures, and a list of notes."""
    command = f"`BENCHMARKS_RECORD=1 python3 -m benchmarks.real_diagnosis --case {name}`"
    if answer is None:
        return f"Not recorded yet: {command}.\n"
    if answer.refused:
        return f"Refused: {answer.refused}\n\n{answer.date}, `{answer.commit}`. {command}\n"
    unseen = ", ".join(case.unseen) or "each in turn"
    rows = [
        ("runs", f"{', '.join(case.runs)}; held out: {unseen}; `--dof {case.dof}`"),
        *([("plain model", answer.plain)] if answer.plain else []),
        ("verdict", f"`{answer.verdict}`"),
    ]
    for k, cause in enumerate(answer.causes, start=1):
        rows.append((f"cause {k}" if len(answer.causes) > 1 else "cause", cause.what))
        rows += [("evidence", cause.evidence)] if cause.evidence else []
        rows += [("error reduction", cause.gain)] if len(answer.causes) > 1 and cause.gain else []
    rows += [("not distinguished", group) for group in answer.alike]
    rows += [("error on held-out data", answer.error)] if answer.error else []
    rows += [("doubts", ", ".join(f"`{d}`" for d in answer.doubts))] if answer.doubts else []
    work = f"{answer.samples / 1e6:.0f} million samples" if answer.samples else answer.origin
    rows.append(("measured", f"{answer.date}, `{answer.commit}`, {work}"))
    table = "".join(f"| {label} | {' '.join(text.replace('|', chr(92) + '|').split())} |\n" for label, text in rows)
    notes = [("Hint", f"{h.what}. {h.evidence}") for h in answer.hints]
    notes += [("Residual", words) for words in answer.left]
    notes += [("Fly next", answer.next)] if answer.next else []
    listed = "".join(f"* {label}: {' '.join(text.split()).removesuffix('.')}.\n" for label, text in notes)
    lead = f"**{answer.lead}**\n\n" if answer.lead else ""
    return f"{lead}| | |\n|---|---|\n{table}\n{listed}{chr(10) * bool(listed)}{command}\n"
