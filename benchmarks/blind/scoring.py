"""Summary of many outcomes: confusion matrix, rates with confidence bounds, parameters, processor time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import beta

from benchmarks.blind.case import WITH_MODEL
from benchmarks.blind.referee import NEAR, Outcome
from benchmarks.results import Figure, count

__all__ = ["bounds", "headlines", "recovered", "report", "tally"]

KINDS = ("single", "environment", "clean", "double", "foreign", "track", "clean-track", "process-noise", *WITH_MODEL)

VISIBLE = 10.0
"""Improvement of the log-likelihood by the true effect above which it should be reported. Project choice."""


def bounds(hits: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact (Clopper1934) confidence bounds of a rate."""
    tail = 0.5 * (1.0 - level)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, of - hits + 1))
    high = 1.0 if hits == of else float(beta.ppf(1.0 - tail, hits + 1, of - hits))
    return low, high


def recovered(true: float, estimate: float, std: float) -> bool | None:
    """Whether a parameter is within :data:`NEAR` standard errors; one that was not fitted (error 0) must be equal.

    None if the standard error is not known.
    """
    if std is None or not math.isfinite(std):
        return None
    if std == 0.0:
        return math.isclose(true, estimate, rel_tol=1e-3)
    return abs(estimate - true) <= NEAR * std


def _rate(outcomes: Sequence[Outcome], *, strict: bool) -> str:
    of = len(outcomes)
    if not of:
        return "-"
    hits = sum(o.strictly_right if strict else o.right for o in outcomes)
    low, high = bounds(hits, of)
    return f"{100.0 * hits / of:5.1f} %  ({hits}/{of}; {100.0 * low:.0f} to {100.0 * high:.0f})"


def _pulls(outcomes: Iterable[Outcome]) -> list[tuple[str, bool | None]]:
    return [(name, recovered(*pull)) for o in outcomes for name, pull in o.pulls.items()]


def tally(outcomes: Sequence[Outcome]) -> str:
    """Return the numbers of right results by kind, in one line."""
    parts = []
    for kind in KINDS:
        some = [o for o in outcomes if o.kind == kind and o.verdict != "no-case"]
        if some:
            parts.append(f"{kind} {sum(o.strictly_right for o in some)}~{sum(o.right for o in some)}/{len(some)}")
    return "  ".join(parts)


HEADLINES: Mapping[str, tuple[str, float | None]] = {
    "single": ("diagnosis of runs with one hidden effect", 0.97),
    "environment": ("diagnosis of runs with one hidden effect of the surroundings", None),
    "clean": ("diagnosis of runs without a hidden effect", 0.99),
    "double": ("diagnosis of runs with two hidden effects", 0.85),
    "foreign": ("diagnosis of runs with a hidden effect that is not in the catalogue", 0.95),
    "track": ("diagnosis from positions and heading only, with a hidden effect", None),
    "clean-track": ("diagnosis from positions and heading only, without a hidden effect", None),
    "wrong-numbers": ("diagnosis with a model that has one or two wrong parameters", 0.97),
    "wrong-numbers-and-effect": ("diagnosis with a model that has a wrong parameter, and a hidden effect", 0.85),
    "correct-model": ("diagnosis with a correct model", 0.99),
    "correct-model-and-effect": ("diagnosis with a correct model, and a hidden effect", 0.97),
    "simulation": ("diagnosis with the output of a simulator that has wrong parameters", 0.97),
    "correct-simulation": ("diagnosis with the output of a correct simulator", 0.99),
}
"""Kind of case -> what it measures, and the required fraction of right results; None without a goal."""


def headlines(outcomes: Sequence[Outcome]) -> dict[str, tuple[str, list[Figure]]]:
    """Return, by kind of case, what it measures and its headline figures."""
    figures_of: dict[str, tuple[str, list[Figure]]] = {}
    for kind, (measures, goal) in HEADLINES.items():
        some = [o for o in outcomes if o.kind == kind and o.verdict != "no-case"]
        if some:
            pulls = [inside for _, inside in _pulls(some) if inside is not None]
            figures = [count("right, in a group", sum(o.right for o in some), len(some), least=goal)]
            figures.append(count("right, first cause", sum(o.strictly_right for o in some), len(some)))
            if pulls:
                figures.append(count("parameters within 3 standard errors", sum(pulls), len(pulls), least=0.8))
            figures_of[kind] = measures, figures
    some = [o for o in outcomes if o.kind == "process-noise" and o.verdict != "no-case"]
    hidden, clean = [o for o in some if o.truth], [o for o in some if not o.truth]
    if some:
        visible, mild = [o for o in hidden if o.improvement > VISIBLE], [o for o in hidden if o.ratio <= 0.4]
        wrong = sum(bool(o.causes) and not o.right for o in hidden)
        figures_of["process-noise"] = (
            "diagnosis of runs with process noise and a hidden effect",
            [
                count(
                    "effects that improve the log-likelihood by ten nats, found",
                    sum(o.right for o in visible),
                    len(visible),
                    least=0.85,
                ),
                count("effects in noise up to 40 %, found", sum(o.right for o in mild), len(mild), least=0.5),
                count("wrong causes", wrong, len(hidden), most=0.03),
                count(
                    "craft without a hidden effect, no false finding",
                    sum(not o.causes for o in clean),
                    len(clean),
                    least=0.97,
                ),
            ],
        )
    return figures_of


def report(outcomes: Sequence[Outcome]) -> str:
    """Return the whole report."""
    completed = [o for o in outcomes if o.verdict != "no-case"]
    lines = ["rates with 95 % bounds; 'in group': one of an indistinguishable group counts as its members"]
    for kind, what in (
        ("single", "right cause first"),
        ("environment", "right cause first, environment"),
        ("clean", "no finding without an effect"),
        ("double", "both of two effects found"),
        ("foreign", "no confident cause: effect not in the catalogue"),
        ("track", "right cause first, positions and heading only"),
        ("clean-track", "no finding, positions and heading only"),
        ("wrong-numbers", "exactly the wrong parameters found"),
        ("wrong-numbers-and-effect", "wrong parameter and effect found"),
        ("correct-model", "no finding, correct model"),
        ("correct-model-and-effect", "only the effect found, correct model"),
        ("simulation", "exactly the wrong parameters of a simulator"),
        ("correct-simulation", "no finding, correct simulator"),
    ):
        some = [o for o in completed if o.kind == kind]
        if some:
            lines.append(f"  {what:48} {_rate(some, strict=True)}   in group {_rate(some, strict=False)}")
    lines += _with_process_noise([o for o in completed if o.kind == "process-noise"])
    singles = [o for o in completed if o.kind in ("single", "environment")]
    if singles:
        lines += [
            "",
            "per effect                 strict                        in group      error ratio   reported instead",
        ]
        lines += [_line(slug, singles) for slug in dict.fromkeys(sorted(o.slug for o in singles))]
        lines += ["", *_matrix(singles)]
    for kind in KINDS[1:]:
        lines += _missed([o for o in completed if o.kind == kind], kind)
    lines += _parameters(completed)
    lines += _seconds(completed)
    lines += [f"not drawn: {o.slug}: {o.error}" for o in outcomes if o.verdict == "no-case"]
    crashed = [o for o in completed if o.verdict == "error"]
    lines += [f"error in {o.kind} {o.slug} {o.index}: {o.error.strip().splitlines()[-1]}" for o in crashed]
    return "\n".join(lines)


def _with_process_noise(some: Sequence[Outcome]) -> list[str]:
    """Return the rates with process noise; ``ratio`` is the size of the noise as a fraction of full command."""
    hidden, clean = [o for o in some if o.truth], [o for o in some if not o.truth]
    visible = [o for o in hidden if o.improvement > VISIBLE]
    mild = [o for o in hidden if o.ratio <= 0.4]
    reported = sum(bool(o.causes) for o in clean)
    lines = []
    if hidden:
        lines.append(f"  {f'process noise: right cause first, {VISIBLE:g} nats':48} {_rate(visible, strict=True)}")
        lines.append(f"  {'process noise up to 40 %: right cause first':48} {_rate(mild, strict=True)}")
        lines.append(f"  {'process noise: wrong cause first, of all hidden':48} {_wrongly(hidden)}")
    if clean:
        low, high = bounds(reported, len(clean))
        rate = f"{100.0 * reported / len(clean):5.1f} %"
        detail = f"({reported}/{len(clean)}; {100.0 * low:.0f} to {100.0 * high:.0f})"
        lines.append(f"  {'process noise without an effect: a cause':48} {rate}  {detail}")
    return lines


def _wrongly(some: Sequence[Outcome]) -> str:
    wrong = [o for o in some if o.causes and not o.right]
    return f"{100.0 * len(wrong) / len(some):5.1f} %  ({len(wrong)}/{len(some)})"


def _line(slug: str, singles: Sequence[Outcome]) -> str:
    some = [o for o in singles if o.slug == slug]
    wrong = Counter(o.first for o in some if not o.right)
    hits = sum(o.right for o in some)
    ratio = float(np.median([o.ratio for o in some]))
    taken = ", ".join(f"{name} {n}" for name, n in wrong.most_common(4))
    return f"  {slug:24} {_rate(some, strict=True):31} {hits:3d}/{len(some):<3d}      {ratio:5.1f}        {taken}"


def _matrix(singles: Sequence[Outcome]) -> list[str]:
    """Return the confusion matrix: true effects as rows, first causes as columns, only the columns that occur."""
    counts = Counter((o.slug, o.first) for o in singles)
    truths = sorted({o.slug for o in singles})
    columns = sorted({o.first for o in singles})
    marks = [chr(97 + i) if i < 26 else chr(65 + i - 26) for i in range(len(columns))]
    lines = ["confusion matrix: rows are true effects, columns are first causes or verdicts"]
    lines += [f"  {mark} = {name}" for mark, name in zip(marks, columns, strict=True)]
    lines.append(f"  {'':24} " + " ".join(f"{m:>2}" for m in marks))
    for truth in truths:
        cells = [counts[truth, name] for name in columns]
        lines.append(f"  {truth:24} " + " ".join(f"{c:2d}" if c else " ." for c in cells))
    return lines


def _missed(some: Sequence[Outcome], kind: str) -> list[str]:
    wrong = [o for o in some if not o.right]
    if not some:
        return []
    lines = ["", f"{kind}: {len(wrong)} of {len(some)} missed; verdicts " + _counted(o.verdict for o in some)]
    if kind == "foreign":
        for slug in sorted({o.slug for o in some}):
            own = [o for o in some if o.slug == slug]
            lines.append(
                f"  {slug:20} {_counted(o.verdict for o in own)}; causes {_counted(c for o in own for c in o.causes)}"
            )
        return lines
    lines += [
        f"  {o.index:4d} {'+'.join([*o.wrong_numbers, *o.truth]) or 'nothing'}: "
        f"{o.verdict} {'+'.join([*o.reported_numbers, *o.causes])}"
        for o in wrong
    ]
    return lines


def _counted(names: Iterable[str]) -> str:
    return ", ".join(f"{name} {n}" for name, n in Counter(names).most_common()) or "nothing"


def _parameters(completed: Sequence[Outcome]) -> list[str]:
    pulls = _pulls(completed)
    known = [(name, ok) for name, ok in pulls if ok is not None]
    if not pulls:
        return []
    good = sum(bool(ok) for _, ok in known)
    lines = [
        "",
        f"parameters of effects found, within {NEAR:g} standard errors: {good}/{len(known)}"
        + (f" = {100.0 * good / len(known):.1f} %" if known else "")
        + f"; without a standard error {len(pulls) - len(known)}",
    ]
    for name in sorted({n for n, _ in pulls}):
        some = [ok for n, ok in known if n == name]
        lacking = sum(n == name for n, _ in pulls) - len(some)
        lines.append(f"  {name:36} {sum(map(bool, some))}/{len(some)}" + (f", unknown {lacking}" if lacking else ""))
    return lines


def _seconds(completed: Sequence[Outcome]) -> list[str]:
    lines = ["", "processor time of a diagnosis, s (median, 95 %, longest)"]
    for craft in sorted({o.craft for o in completed}):
        s = np.array([o.seconds for o in completed if o.craft == craft])
        lines.append(f"  {craft:8} {np.median(s):6.1f} {np.quantile(s, 0.95):6.1f} {s.max():6.1f}   of {len(s)}")
    return lines
