"""The figures of a study's report, from its stored rows."""

from __future__ import annotations

import math
import shlex
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gcs_autotune.errors import BadFile
from gcs_autotune.registry import nearest_of
from gcs_autotune.report import (
    BOUND_CLASSES,
    BoundCheck,
    CaseStudy,
    Confusion,
    Rate,
    Spread,
    StudyComparison,
    SuccessMap,
    WorstCase,
)
from gcs_autotune.rounding import HALF_WIDTH
from gcs_autotune.slow_imports import scipy_stats
from gcs_autotune.study.craft import NONE, unit_in
from gcs_autotune.study.jobs import JOBS, Job
from gcs_autotune.study.names import words_of
from gcs_autotune.study.plan import Goal, Plan, load_plan
from gcs_autotune.study.store import DONE, FAILED, GIVEN_UP, Store, frame_of, open_study

__all__ = ["StudyProgress", "case_study_of", "plan_of", "progress_of", "success_map"]

_MOST_VALUES = 24
"""Largest number of values of a name for which rates are shown one by one; more are shown in groups. Project choice."""
_GROUPS = 6
"""Number of equally full groups of a continuous value. Project choice."""
_LIKE = "vehicle.like"
_WORST = 10
_RECENT = 200
"""Number of the last cases from which the rate is computed. Project choice."""


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """How far a study is. ``rate``: cases per second, lately; ``running``: whether a `study run` writes to it."""

    title: str
    cases: int
    done: int
    failed: int
    given_up: int
    rate: float
    running: bool
    dashboard: str

    @property
    def left(self) -> float:
        """Time left [s]; infinite without a rate."""
        missing = self.cases - self.done - self.failed - self.given_up
        return missing / self.rate if self.rate > 0.0 else (math.inf if missing else 0.0)


def progress_of(folder: Path) -> StudyProgress:
    """Return how far the study in *folder* is.

    Raises
    ------
    BadFile
        The folder contains no study.
    """
    store = Store(folder)
    head, ended, counts = store.head, list[float](), Counter[str]()
    seen: set[str] = set()
    for table in store.tables(["case", "status", "ended"], damaged=lambda path: None):
        for case, status, at in zip(*(table.column(n).to_pylist() for n in table.column_names), strict=True):
            if case not in seen:
                seen.add(case)
                counts[status] += 1
                ended.append(at)
    recent = sorted(ended)[-_RECENT:]
    running = store.is_being_written
    spent = (time.time() if running else recent[-1]) - recent[0] if recent else 0.0
    rate = (len(recent) - 1) / spent if spent > 0.0 else 0.0
    done, failed, given_up = (counts[status] for status in (DONE, FAILED, GIVEN_UP))
    return StudyProgress(head["title"], head["cases"], done, failed, given_up, rate, running, head["dashboard"])


def plan_of(store: Store) -> Plan:
    """Return the study that *store* contains the results of."""
    return load_plan(store.plan_file, Path(store.head["home"]))


def case_study_of(folder: Path, against: Path | None = None) -> CaseStudy:
    """Return the report's figures of the study in *folder*, compared with that in *against*.

    Raises
    ------
    BadFile
        A folder contains no study, or the study file names a result that no case has.
    """
    store = Store(folder)
    plan, head = plan_of(store), store.head
    damaged: list[Path] = []
    frame = frame_of(store.table(damaged.append))
    notes = tuple(
        f"{path} cannot be read: it is cut short or damaged. `study run` repeats its cases" for path in damaged
    )
    job = JOBS.get(plan.do, Job(()))
    spec, build = plan.report, head["build"]
    counts = Counter(frame["status"])
    code = f"gcs_autotune {build['version']}"
    base: dict[str, Any] = {
        "title": plan.title,
        "code": code,
        "cases": len(plan),
        "done": counts[DONE],
        "failed": counts[FAILED],
        "given_up": counts[GIVEN_UP],
        "notes": notes,
    }
    if frame.empty:
        return CaseStudy(**base)
    goal, hit = _successes(plan, job, frame)
    measure = spec.measure or (job.measure if job.measure in frame else "")
    if measure:
        _verify_result(plan, frame, "measure", measure)
    found: dict[str, Any] = {}
    if hit is not None:
        found["success"] = rate_of(goal, hit)
        found["by_value"] = tuple(_by_value(plan, frame, hit))
        if spec.map:
            found["map"] = success_map(spec.map, frame, hit)
    if measure:
        found["spreads"] = (_spread(measure, frame[measure]),)
    aim = spec.success.of if isinstance(spec.success, Goal) else spec.success or job.success
    named = filter(None, (*plan.vary, "seed", *spec.map, *spec.bound, measure, aim))
    words = {name: words_of(name, plan.do, partial(_vehicle_unit, plan)) for name in named}
    if aim == spec.success and aim != job.success:
        words[aim] += " true"
    return CaseStudy(
        **base,
        **found,
        words=words,
        bounds=tuple(_bound(plan, frame, error, bound) for error, bound in spec.bound.items()),
        confusion=_confusion(plan, job, frame),
        failures=dict(Counter(frame["reason"][frame["status"] != DONE]).most_common()),
        worst=tuple(_worst(plan, frame, hit, measure, folder)),
        against=None if against is None else _against(plan, job, frame, hit, measure, against),
    )


def _vehicle_unit(plan: Plan, number: str) -> str:
    """Return the unit of a *number* in the vehicle files of the study."""
    axis = plan.vary.get(_LIKE)
    likes = (plan.fixed.get(_LIKE),) if axis is None else axis.values
    return unit_in([like for like in likes if isinstance(like, str)], number, plan.home)


def rate_of(of: str, hits: Sequence[bool]) -> Rate:
    """Return the rate of true *hits*, with the exact 95 % interval of Clopper and Pearson."""
    k, n = int(sum(hits)), len(hits)
    if not n:
        return Rate(of, 0, 0, 0.0, 1.0)
    interval = scipy_stats().binomtest(k, n).proportion_ci(0.95, "exact")
    return Rate(of, k, n, float(interval.low), float(interval.high))


def _verify_result(plan: Plan, frame: Any, key: str, name: str) -> None:
    if name not in frame.columns:
        hint = nearest_of(name, [str(c) for c in frame.columns])[1]
        raise BadFile(f"{plan.file}: report.{key}: no case has a result '{name}'.{hint}")


def _successes(plan: Plan, job: Job, frame: Any) -> tuple[str, Any]:
    """Return what success means, and whether each case succeeded (n,); None if nothing defines it.

    Without a definition, a case succeeds if its answer is the truth.
    """
    spec, done = plan.report.success, (frame["status"] == DONE).to_numpy()
    if not spec and job.success not in frame:
        compared = _compared(plan, job, frame)
        right = [true == reported for true, reported in compared]
        return ("reported as simulated", done & np.array(right)) if compared else ("", None)
    goal = spec if isinstance(spec, Goal) else Goal(spec or job.success, least=0.5)
    _verify_result(plan, frame, "success", goal.of)
    values = frame[goal.of].to_numpy(dtype=float, na_value=np.nan)
    both = (("least", goal.least), ("most", goal.most))
    limits = [f"at {word} {limit:g}" for word, limit in both if math.isfinite(limit)]
    name = f"{goal.of} {' and '.join(limits)}" if isinstance(spec, Goal) else goal.of
    return name, done & (values >= goal.least) & (values <= goal.most)


def _groups(values: Any) -> list[tuple[str, Any]]:
    """Return (name, mask) of each value, or of equally full groups of many numbers."""
    distinct = values.dropna().unique()
    if len(distinct) <= _MOST_VALUES:
        return [(_shown(v), (values == v).to_numpy()) for v in sorted(distinct, key=lambda v: (isinstance(v, str), v))]
    if isinstance(distinct[0], str):
        return []
    numbers = values.to_numpy(dtype=float)
    edges = np.quantile(numbers, np.linspace(0.0, 1.0, _GROUPS + 1))
    inside = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, _GROUPS - 1)
    return [(f"{edges[k]:.3g} to {edges[k + 1]:.3g}", inside == k) for k in range(_GROUPS)]


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _by_value(plan: Plan, frame: Any, hit: Any) -> list[tuple[str, Rate]]:
    found = []
    for name in plan.vary:
        groups = _groups(frame[name])
        if len(groups) > 1:
            found += [(f"{name} = {value}", rate_of(value, hit[mask])) for value, mask in groups if mask.any()]
    return found


def success_map(names: Sequence[str], frame: Any, hit: Any) -> SuccessMap:
    """Return the map of *hit* (true or false for each row of the DataFrame *frame*) over two of its columns."""
    xs, ys = (_groups(frame[name]) for name in names)
    hits = tuple(tuple(int(hit[x & y].sum()) for _, x in xs) for _, y in ys)
    totals = tuple(tuple(int((x & y).sum()) for _, x in xs) for _, y in ys)
    return SuccessMap(names[0], names[1], tuple(n for n, _ in xs), tuple(n for n, _ in ys), hits, totals)


def _spread(name: str, values: Any) -> Spread:
    numbers = values.to_numpy(dtype=float, na_value=np.nan)
    numbers = numbers[np.isfinite(numbers)]
    quantiles = np.quantile(numbers, (0.05, 0.25, 0.5, 0.75, 0.95)) if len(numbers) else np.full(5, np.nan)
    return Spread(name, len(numbers), tuple(map(float, quantiles)))


def _bound(plan: Plan, frame: Any, error: str, bound: str) -> BoundCheck:
    for name in (error, bound):
        _verify_result(plan, frame, "bound", name)
    errors, bounds = (frame[name].to_numpy(dtype=float, na_value=np.nan) for name in (error, bound))
    known = np.isfinite(errors) & np.isfinite(bounds)
    errors, bounds = errors[known], bounds[known]
    n = max(len(errors), 1)
    low, high = (math.sqrt(float(scipy_stats().chi2.ppf(p, n)) / n) for p in (0.025, 0.975))
    ratio = math.sqrt(float(np.mean(errors**2) / np.mean(bounds**2))) if len(errors) else math.nan
    scaled = np.clip(errors[bounds > 0.0] / bounds[bounds > 0.0], BOUND_CLASSES[0], BOUND_CLASSES[-1])
    counts = tuple(map(int, np.histogram(scaled, BOUND_CLASSES)[0]))
    return BoundCheck(
        error, ratio, low, high, rate_of("within 1.96 bounds", np.abs(errors) <= HALF_WIDTH * bounds), counts
    )


def _compared(plan: Plan, job: Job, frame: Any) -> list[tuple[str, str]]:
    """Return (truth, answer) of every case; empty if the study compares nothing."""
    truth, answer = plan.report.truth or job.truth, plan.report.answer or job.answer
    if truth not in frame or not answer:
        return []
    if plan.report.answer:
        _verify_result(plan, frame, "answer", answer)
    answers = frame[answer] if answer in frame else [None] * len(frame)
    return [
        (_label(true), _label(reported) if status == DONE else status)
        for true, reported, status in zip(frame[truth], answers, frame["status"], strict=True)
    ]


def _confusion(plan: Plan, job: Job, frame: Any) -> Confusion | None:
    pairs = Counter(_compared(plan, job, frame))
    if not pairs:
        return None
    truths, answers = (tuple(sorted({pair[k] for pair in pairs})) for k in (0, 1))
    return Confusion(truths, answers, tuple(tuple(pairs[t, a] for a in answers) for t in truths))


def _label(value: Any) -> str:
    """Return the name of a value: of effects the slugs, without places and numbers; of nothing 'none'."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if not isinstance(value, str):
        return _shown(value)
    return "+".join(part.partition("=")[0].partition("@")[0].partition(".")[0] for part in value.split("+"))


def _worst(plan: Plan, frame: Any, hit: Any, measure: str, folder: Path) -> list[WorstCase]:
    """Return the worst cases: given up, failed, without success, then by the measure."""
    order = {GIVEN_UP: 0, FAILED: 1, DONE: 2}
    sign = 1.0 if plan.report.higher_is_better else -1.0
    numbers = frame[measure].to_numpy(dtype=float, na_value=np.nan) if measure else np.zeros(len(frame))

    succeeded = np.zeros(len(frame), dtype=bool) if hit is None else hit

    def badness(k: int) -> tuple[float, ...]:
        value = -math.inf if np.isnan(numbers[k]) else sign * numbers[k]
        return order[frame["status"][k]], float(succeeded[k]), value

    ranked = bool(measure) or hit is not None
    bad = [k for k in range(len(frame)) if frame["status"][k] != DONE or (ranked and (measure or not succeeded[k]))]
    found = []
    for k in sorted(bad, key=badness)[:_WORST]:
        row = frame.iloc[k]
        values = ", ".join(f"{name} = {_shown(row[name])}" for name in (*plan.vary, "seed") if name in row)
        outcome = row["reason"] or (f"{measure} = {row[measure]:.4g}" if measure else "without success")
        case = str(row["case"])[:12]
        found.append(WorstCase(case, values, outcome, f"gcs-autotune study replay {shlex.quote(str(folder))} {case}"))
    return found


def _against(plan: Plan, job: Job, frame: Any, hit: Any, measure: str, folder: Path) -> StudyComparison:
    """Compare with an earlier study, by cases with equal values."""
    old = open_study(folder).drop_duplicates("point")
    if not set(old["point"]) & set(frame["point"]):
        raise BadFile(f"{folder} and this study have no case in common. Compare results of the same study file")
    before = _successes(plan, job, old)[1]
    now = dict(zip(frame["point"], range(len(frame)), strict=True))
    pairs = [(now[point], k) for k, point in enumerate(old["point"]) if point in now]
    stats = scipy_stats()
    gained = lost = 0
    if hit is not None and before is not None:
        gained = sum(bool(hit[i]) and not before[k] for i, k in pairs)
        lost = sum(bool(before[k]) and not hit[i] for i, k in pairs)
    p = float(stats.binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0
    base = (str(folder), len(pairs), gained, lost, p)
    if not measure or measure not in old:
        return StudyComparison(*base)
    new, former = (f[measure].to_numpy(dtype=float, na_value=np.nan) for f in (frame, old))
    changes = np.array([new[i] - former[k] for i, k in pairs])
    changes = changes[np.isfinite(changes)]
    p_measure = float(stats.wilcoxon(changes).pvalue) if np.any(changes) else 1.0
    return StudyComparison(*base, measure, float(np.median(changes)) if len(changes) else math.nan, p_measure)
