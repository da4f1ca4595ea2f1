"""The report of a comparison of several runs of one craft."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from gcs_autotune.axes import AXES
from gcs_autotune.diagnose import RUN_SPREAD, CraftComparison
from gcs_autotune.identify import AxisFit
from gcs_autotune.notebook import Display, Displayed
from gcs_autotune.notebook import Table as PlainTable
from gcs_autotune.report.toolkit.axis_fit import short_name, structure_words, with_effects
from gcs_autotune.report.toolkit.canvas import FAINT, legend, new_axes
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    Note,
    Part,
    Section,
    Table,
    Verdict,
    bullets,
    cautions,
)
from gcs_autotune.report.toolkit.figures import COLOURS
from gcs_autotune.report.toolkit.wording import (
    format_number,
    format_seconds,
    format_share,
    format_value,
    listed,
    pretty_unit,
)
from gcs_autotune.report.tune.figures import step_series
from gcs_autotune.report.tune.story import PLOTTED_SIGNALS
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = ["ComparedRun", "Comparison", "comparison_document", "reference_of"]


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """One run of a comparison.

    - ``name``: of its directory or file. ``title``, ``when``, ``ending``: as in its summary; empty for a plain log.
    - ``vehicle``: unique id of the vehicle, else its system id; empty if unknown.
    - ``axis``: the loop that was tuned or rechecked; empty without one.
    - ``gains``: the gains of that loop after the run.
    - ``metrics``: metrics of the step with these gains: name -> value; times in s, others as fractions.
    - ``step``: the trial with that step.
    - ``fits``: degree of freedom -> model. ``unfitted``: degree of freedom -> reason why there is none.
    - ``manoeuvres``: kinds of manoeuvre that the models are from; empty if the files do not state them.
    """

    name: str
    title: str = ""
    when: str = ""
    ending: str = ""
    vehicle: str = ""
    axis: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    step: Trial | None = None
    fits: Mapping[str, AxisFit] = field(default_factory=dict)
    unfitted: Mapping[str, str] = field(default_factory=dict)
    manoeuvres: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class Comparison(Displayed):
    """Runs in the order of their dates, and what changed. ``print`` shows it as text.

    - ``runs``: at least two, with different names.
    - ``changes``: name of a run -> comparison of its models with those of the first run that has such a model.
    - ``doubts``: why the comparison may mislead.
    """

    runs: tuple[ComparedRun, ...]
    changes: Mapping[str, tuple[CraftComparison, ...]] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Identifiers of the different vehicles, without those of logs that do not contain one."""
        return tuple(dict.fromkeys(run.vehicle for run in self.runs if run.vehicle))

    @property
    def changed(self) -> bool:
        """Whether any model changed by more than noise explains."""
        return any(row.changed for rows in self.changes.values() for row in rows)

    @property
    def told(self) -> str:
        """The result in a few sentences: the loops that a recheck found bad, then the craft."""
        loops = [f"The {r.axis} loop of run {_number(self, r)} {BAD_LOOPS[r.ending]}." for r in self.bad_loops]
        return " ".join((*loops, self._craft_sentence))

    @property
    def bad_loops(self) -> list[ComparedRun]:
        """The runs whose recheck found a bad loop."""
        return [run for run in self.runs if run.ending in BAD_LOOPS]

    @property
    def _craft_sentence(self) -> str:
        rows = [(run, row) for run in self.runs for row in self.changes.get(run.name, ())]
        if not rows and len(self.vehicles) > 1:
            return "The runs are of different vehicles, so their models are shown side by side and not compared."
        if not rows:
            return "The runs have no model in common, so only their loops are compared."
        if not self.changed:
            alone = list(dict.fromkeys(name for _, row in rows for name in row.outside))
            but = f" The difference in {listed(alone)} alone would be significant." if alone else ""
            return f"{UNCHANGED}{but}"
        changed = [(run, row.dof) for run, row in rows if row.changed]
        others = list(dict.fromkeys(_number(self, run) for run, _ in changed))
        one = f"The model of run {others[0]} differs"
        these = one if len(others) == 1 else f"The models of runs {listed(others)} differ"
        differs = f"{these} by more than the intervals"
        unlike = list(dict.fromkeys(u for run, dof in changed for u in _unlike(self, run, dof)))
        if not unlike:
            return f"{differs}: the craft or its conditions have changed, or the models lack a term."
        return f"{differs}. The runs have different {' and '.join(unlike)}, so this need not be a change of the craft."

    def _display(self) -> Display:
        parts = [part for section in _sections(self) for part in section.parts]
        tables = tuple(PlainTable(part.heads, part.rows) for part in parts if isinstance(part, Table) and part.rows)
        said = tuple(part.text for part in parts if isinstance(part, Note) and part.kind == "bullet")
        return Display(self.told, tables, (*said, *self.doubts))


def reference_of(runs: Sequence[ComparedRun], dof: str, run: ComparedRun) -> ComparedRun | None:
    """Return the first of *runs* with a model of *dof* and of the vehicle of *run*, with which *run* is compared; None
    if there is none. A run that does not identify its vehicle counts as one of the same vehicle.
    """
    return next((one for one in runs if dof in one.fits and len({one.vehicle, run.vehicle} - {""}) < 2), None)


def _unlike(found: Comparison, run: ComparedRun, dof: str) -> Iterator[str]:
    """Yield what else than the craft may explain a difference of the model of *dof* from its reference."""
    first = reference_of(found.runs, dof, run)
    if first is None:
        return
    if first.manoeuvres != run.manoeuvres:
        yield "manoeuvres"
    if first.fits[dof].structure != run.fits[dof].structure:
        yield "model structures"


def _number(found: Comparison, run: ComparedRun) -> str:
    """Return the number of *run* in the tables, from 1."""
    return str(1 + found.runs.index(run))


BAD_LOOPS = {
    "oscillates": "oscillates",
    "poorly damped": "is poorly damped",
    "degraded": "is worse than after its tune",
}
"""Ending of a recheck that found a bad loop -> what the loop does."""
UNCHANGED = (
    "No change of the craft was found: together, the differences of the models are within their standard errors and "
    f"the usual {100.0 * RUN_SPREAD:.0f} % from run to run."
)

NO_FIGURE = "unknown"
"""Text for a figure that a run did not determine."""

_METRICS: tuple[tuple[str, str, Callable[[float], str]], ...] = (
    ("itae", "ITAE [s²]", format_number),
    ("overshoot", "overshoot", lambda v: format_share(v) if math.isfinite(v) else NO_FIGURE),
    ("rise", "rise", lambda v: format_seconds(v, NO_FIGURE)),
    ("settling", "settling", lambda v: format_seconds(v, NO_FIGURE)),
    ("steady_error", "remaining", lambda v: format_share(v) if math.isfinite(v) else NO_FIGURE),
)
"""Key of ``ComparedRun.metrics`` -> label and format."""
SIDE_BY_SIDE = 3
"""Number of models with their standard errors that fit on a line of 80 characters."""

_ITAE = "ITAE is the tracking error per unit step. "


def comparison_document(found: Comparison, when: str = "") -> Document:
    """Return the report of *found*."""
    return Document(
        title=f"Comparison of {len(found.runs)} runs",
        when=when,
        verdict=Verdict(found.told, "bad" if found.changed or found.bad_loops else "neutral"),
        doubts=cautions(found.doubts) or None,
        doubted="comparison",
        sections=tuple(_sections(found)),
        facts=_facts(found),
    )


def _sections(found: Comparison) -> Iterator[Section]:
    runs = found.runs
    rows = tuple(
        (_number(found, run), run.name, run.when[:16].replace("T", " "), run.title or "log", run.ending) for run in runs
    )
    yield Section("runs", "Runs", (Table(("run", "name", "date", "what", "ending"), "rllll", rows),), facts=IN_RESULT)
    told = tuple(
        f"run {_number(found, run)} against run {_number(found, first)}, {row.dof}: {row.summary}"
        for run in runs
        for row in found.changes.get(run.name, ())
        if (first := reference_of(found.runs, row.dof, run)) is not None
    )
    yield Section("changes", "What changed", tuple(bullets(told)), facts=IN_RESULT)
    for dof in dict.fromkeys(dof for run in runs for dof in run.fits):
        yield Section(f"model-{dof}", f"Model of {dof}", tuple(_models(found, dof)), facts=IN_RESULT)
    for axis in dict.fromkeys(run.axis for run in runs if run.metrics or run.gains):
        yield Section(f"loop-{axis}", f"Loop of {axis}", tuple(_loop(found, axis)), facts=IN_RESULT)


def _models(found: Comparison, dof: str) -> Iterator[Part]:
    runs = [run for run in found.runs if dof in run.fits]
    if len(runs) < 2:
        return
    parameters = {p.name: p.unit for run in runs for p in run.fits[dof].parameters.values() if _value(run, dof, p.name)}
    outside = {run.name: _outside(found, run, dof) for run in runs}
    units = ["of full" if u == "1" and "share" not in name else pretty_unit(u) for name, u in parameters.items()]
    fits = [run.fits[dof] for run in runs]
    structures = {structure_words(fit.structure) + with_effects(fit.effects) for fit in fits}
    spread = f"the interval contains {100.0 * RUN_SPREAD:.0f} % for usual differences between runs"
    notes = [f"* Outside its interval of 99 %; {spread}."] if any(outside.values()) else []
    if len(structures) == 1:
        notes.append(f"All models shown here have {structures.pop()}. A run's own report may use another structure.")
    for first in range(0, len(runs), SIDE_BY_SIDE):
        shown = runs[first : first + SIDE_BY_SIDE]
        columns = [
            [_value(run, dof, name) + " *" * (_number_of(name) in outside[run.name]) for name in parameters]
            for run in shown
        ]
        yield Table(
            ("parameter", *(f"run {_number(found, run)}" for run in shown), "unit"),
            "l" + "r" * len(shown) + "l",
            tuple(zip(map(short_name, parameters), *columns, units, strict=True)),
            " ".join(notes) if shown[-1] is runs[-1] else "",
        )


def _outside(found: Comparison, run: ComparedRun, dof: str) -> frozenset[str]:
    changes = found.changes.get(run.name, ())
    return frozenset(name for row in changes if row.dof == dof for name in row.outside)


def _number_of(parameter: str) -> str:
    return _NUMBER_OF.get(parameter.partition("_")[0], "")


_NUMBER_OF = {"alpha": "inertia", "beta": "drag", "delta": "trim"}
"""First part of a parameter's name -> its name in :class:`CraftComparison`."""


def _value(run: ComparedRun, dof: str, name: str) -> str:
    parameter = run.fits[dof].parameters.get(name)
    return "" if parameter is None or parameter.status == "absent" else format_value(parameter.value, parameter.std)


def _loop(found: Comparison, axis: str) -> Iterator[Part]:
    runs = [run for run in found.runs if run.axis == axis and (run.metrics or run.gains)]
    heads, align = tuple(f"run {_number(found, run)}" for run in runs), "l" + "r" * len(runs)
    names = dict.fromkeys(name for run in runs for name in run.gains)
    gains = tuple((n, *(format_number(run.gains[n]) if n in run.gains else NO_FIGURE for run in runs)) for n in names)
    yield Table(("gain after the run", *heads), align, gains)
    itae = _ITAE if any("itae" in run.metrics for run in runs) else ""
    shown = [row for row in _METRICS if any(row[0] in run.metrics for run in runs)]
    rows = tuple(
        (head, *(show(run.metrics[key]) if key in run.metrics else "" for key, _, show in shown))
        for head, run in zip(heads, runs, strict=True)
    )
    yield Table(
        ("", *(label for _, label, _ in shown)),
        "l" + "r" * len(shown),
        rows,
        f"Figures of the step with these gains. {itae}Lower is better for all.",
    )
    if any(run.step is not None for run in runs):
        caption = "Measured steps with the gains that each run left on the vehicle, as fractions of the step."
        yield Figure(f"steps-{axis}", caption, partial(_draw_steps, [(_number(found, run), run) for run in runs], axis))


def _draw_steps(runs: Sequence[tuple[str, ComparedRun]], axis: str) -> Drawing | None:
    kind = AXES.get(axis)
    watched = PLOTTED_SIGNALS.get(kind.stepped) if kind is not None else None
    if watched is None:
        return None
    drawn = [
        (f"run {number}", series) for number, run in runs if (series := step_series(run.step, watched)) is not None
    ]
    if not drawn:
        return None
    figure, (axes,) = new_axes((2.6,))
    longest = max(float(series.legs[0].target.t[-1]) for _, series in drawn)
    axes.step([-2.0, 0.0, longest], [0.0, 1.0, 1.0], where="post", color=FAINT, lw=1.0, ls="--", label="command")
    for (name, series), colour in zip(drawn, COLOURS * (1 + len(drawn) // len(COLOURS)), strict=False):
        position = series.legs[0].position
        axes.plot(position.t, position.y / series.size, color=colour, label=name)
    axes.set_xlabel("time since the step [s]")
    axes.set_ylabel("fraction of the step")
    legend(axes, 2)
    return figure


def _facts(found: Comparison) -> dict[str, object]:
    return {
        "changed": found.changed,
        "told": found.told,
        "runs": [
            {
                "name": run.name,
                "title": run.title,
                "when": run.when,
                "ending": run.ending,
                "vehicle": run.vehicle,
                "axis": run.axis,
                "gains": dict(run.gains),
                "metrics": dict(run.metrics),
                "models": {
                    dof: {p.name: {"value": p.value, "std": p.std, "unit": p.unit} for p in fit.parameters.values()}
                    for dof, fit in run.fits.items()
                },
                "not_identified": dict(run.unfitted),
                "changes": [row.to_dict() for row in found.changes.get(run.name, ())],
            }
            for run in found.runs
        ],
    }
