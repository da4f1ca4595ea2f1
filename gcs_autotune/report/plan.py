"""A plan's result for the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType

from gcs_autotune.identify.plan import Agreement, PlanResult
from gcs_autotune.report.numbers import UNKNOWN, format_number, format_value, pretty_unit
from gcs_autotune.report.tables import Table
from gcs_autotune.report.terminal import doubts_shown, grid, paragraph, title
from gcs_autotune.report.wording import doubt_sentence

__all__ = ["plan_summary"]


def plan_summary(result: PlanResult) -> Group:
    """Return what a plan found: steps with their local validation, agreement, parameters, final validation, doubts."""
    parts: list[RenderableType] = [title(f"Plan {result.plan.name}: {result.plan.title}"), grid(_steps(result))]
    if result.agreements:
        parts += [title("Shared parameters, step against step"), grid(_agreements(result.agreements))]
    parts += [title("Parameters, all runs fitted at once"), grid(_parameters(result))]
    if result.final is not None:
        parts += [
            title("Final validation, on runs nothing was fitted to"),
            grid(_final(result)),
            paragraph(f"Fit {result.final.fit_percent:.1f} % on average."),
        ]
    step_doubts = [f"{s.step.name}: {doubt_sentence(d)}" for s in result.steps for d in s.fit.doubts]
    parts += doubts_shown([*(doubt_sentence(d) for d in result.doubts), *step_doubts])
    return Group(*parts)


def _steps(result: PlanResult) -> Table:
    rows = []
    for s in result.steps:
        checked = UNKNOWN if s.validation is None else f"{s.validation.fit_percent:.1f} %"
        remark = "" if s.unseen else "on its own run"
        rows.append((s.step.name, str(len(s.fit.used)), f"{s.fit.fit_percent:.1f} %", checked, remark))
    rows += [(name, "0", UNKNOWN, UNKNOWN, "no runs") for name in result.skipped]
    return Table(("step", "runs", "fit", "validation", "remark"), "lrrrl", tuple(rows))


def _agreements(found: tuple[Agreement, ...]) -> Table:
    rows = tuple(
        (
            a.name,
            ", ".join(format_value(v, s) for v, s in zip(a.values, a.stds, strict=True)),
            format_number(a.probability),
        )
        for a in found
    )
    return Table(("parameter", "by step", "chance"), "llr", rows)


def _parameters(result: PlanResult) -> Table:
    rows = tuple(
        (p.name, format_value(p.value, p.std), pretty_unit(p.unit) or "1", format_number(result.combined[p.name]))
        for p in result.parameters.values()
    )
    return Table(("parameter", "value ± std", "unit", "steps combined"), "lrlr", rows)


def _final(result: PlanResult) -> Table:
    assert result.final is not None
    rows = tuple(
        (t.run, t.signal, f"{format_number(s.rms)} {t.unit}", f"{s.fit_percent:.1f} %")
        for t, s in zip(result.final.traces, result.final.statistics, strict=True)
    )
    return Table(("run", "signal", "rms", "fit"), "llrr", rows)
