"""The report of a recheck of the gains of an earlier tune."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.axes import axis_kind
from gcs_autotune.identify import Doubt
from gcs_autotune.report.toolkit.canvas import AFTER, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    Note,
    Section,
    Table,
    Tone,
    Verdict,
    cautions,
)
from gcs_autotune.report.toolkit.figures import finite, thin
from gcs_autotune.report.toolkit.wording import (
    format_moment,
    format_number,
    format_value,
    remarks,
    to_people,
)
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = ["LoopCheck", "LoopNumbers", "recheck_document"]


@dataclass(frozen=True, slots=True)
class LoopNumbers:
    """Metrics of a closed loop; NaN: unknown.

    ``overshoot``: of a step, as a fraction of the step; ``overshoot_std``: its standard error.
    ``rise`` (10 to 90 %), ``settling`` (to 5 %): times [s].
    ``damping``: damping ratio.
    ``itae`` [s^2]: integral of time times absolute error, per unit step. ``span`` [s]: time over which the step was
    recorded. Both are only of a flown step.
    ``oscillation``: amplitude with a constant command [SI, rad]; ``period``: its period [s].
    """

    overshoot: float = math.nan
    rise: float = math.nan
    settling: float = math.nan
    damping: float = math.nan
    oscillation: float = math.nan
    period: float = math.nan
    overshoot_std: float = math.nan
    itae: float = math.nan
    span: float = math.nan


@dataclass(frozen=True, slots=True)
class LoopCheck:
    """The verdict on the loop of ``axis``.

    ``kind``: good, degraded, poorly damped, oscillates, not identifiable.
    ``text``: the verdict as a sentence; ``tone``: its colour; ``notes``: further sentences.
    ``now``: the present metrics.
    ``then``: the metrics of the last tune, at ``when``.
    ``again``: the command that checks a simulated vehicle with the gains of that tune; empty without one.
    """

    axis: str
    kind: str
    text: str
    tone: Tone
    notes: tuple[str, ...]
    now: LoopNumbers
    then: LoopNumbers | None = None
    when: str = ""
    doubts: tuple[Doubt, ...] = ()
    remarks: tuple[str, ...] = ()
    again: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return the verdict and the metrics as plain data for JSON; unknown numbers are None."""

        def plain(numbers: LoopNumbers) -> dict[str, float | None]:
            return {name: value if math.isfinite(value) else None for name, value in asdict(numbers).items()}

        return {
            "schema": 1,
            "axis": self.axis,
            "verdict": self.kind,
            "text": self.text,
            "notes": list(self.notes),
            "now": plain(self.now),
            "tune": None if self.then is None else {"when": self.when, **plain(self.then)},
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }


def recheck_document(check: LoopCheck, heading: str = "", when: str = "", run: Trial | None = None) -> Document:
    """Return the report of a recheck: the verdict, the metrics now and after the last tune, and the plot of *run*."""
    return Document(
        title=heading,
        when=format_moment(when),
        verdict=Verdict(check.text, check.tone, check.notes),
        doubts=(*remarks(check.doubts), *cautions(check.remarks)) or None,
        doubted="loop",
        sections=tuple(section for make in SECTIONS for section in make(check, run)),
        facts=check.to_dict(),
    )


def _metrics(check: LoopCheck, run: Trial | None) -> Iterator[Section]:
    heading = "Now" if check.then is None else "Now and after the last tune"
    yield Section("figures", heading, (_numbers(check),), facts=IN_RESULT)


def _next(check: LoopCheck, run: Trial | None) -> Iterator[Section]:
    if check.again:
        why = "A new simulated vehicle starts with its original gains, so these were checked. To check the tuned ones:"
        yield Section("next", "What next", (Note(check.again, why, kind="command"),), facts=IN_RESULT)


def _record(check: LoopCheck, run: Trial | None) -> Iterator[Section]:
    figures = () if run is None else tuple(_response(check.axis, run))
    yield Section("record", "Command and response", figures, facts=IN_RESULT)


SECTIONS = (_metrics, _record, _next)
"""Functions that return the sections of the report, in their order. To add a section, add its function here."""


def _numbers(check: LoopCheck) -> Table:
    now, then = check.now, check.then
    unit, factor = to_people(SIGNALS[axis_kind(check.axis).stepped][0])
    rows = [
        _row("step overshoot", "%", 100.0, "overshoot", now, then),
        _row("rise time (10 to 90 %)", "s", 1.0, "rise", now, then),
        _row("settling time (to within 5 %)", "s", 1.0, "settling", now, then),
        _row("ITAE per unit step", "s²", 1.0, "itae", now, then),
        _row("damping ratio", "", 1.0, "damping", now, None),
        _row("oscillation at constant command", unit, factor, "oscillation", now, None),
        _row("period of this oscillation", "s", 1.0, "period", now, None),
    ]
    heads = ("figure", "now", f"tune of {format_moment(check.when)}" if then is not None else "", "unit")
    return Table(heads, "lrrl", tuple(row for row in rows if any(row[1:3])))


def _row(name: str, unit: str, factor: float, slug: str, now: LoopNumbers, then: LoopNumbers | None) -> tuple[str, ...]:
    """Return one row of the table. A value that only one of the two loops has is named as missing."""
    pair = [math.nan if numbers is None else factor * getattr(numbers, slug) for numbers in (now, then)]
    shown = [format_number(value, 3) if math.isfinite(value) else "" for value in pair]
    if slug == "overshoot" and shown[0] and math.isfinite(now.overshoot_std):
        shown[0] = format_value(pair[0], factor * now.overshoot_std)
    if any(shown) and not all(shown) and then is not None:
        k = shown.index("")
        span = (now, then)[k].span
        shown[k] = f"not in {span:.0f} s" if math.isfinite(span) else "not identified" * (k == 0)
    return (name, *shown, unit)


def _response(axis: str, run: Trial) -> Iterator[Figure]:
    """Yield the plot of command and response, relative to the initial course."""
    signal = axis_kind(axis).stepped
    commanded = [(m.t, float(m.detail[f"{signal}_ref"])) for m in run.marks if f"{signal}_ref" in m.detail]
    commanded += [(m.t, float(m.detail["value"])) for m in run.marks if m.kind == "target"]
    if signal in run and commanded:
        caption = f"Commanded and measured {axis}. A well damped loop follows quickly, without oscillation."
        yield Figure("recheck", caption, partial(_draw_response, axis, run, commanded))


def _draw_response(axis: str, run: Trial, commanded: Sequence[tuple[float, float]]) -> Drawing:
    signal = axis_kind(axis).stepped
    unit, factor = to_people(run[signal].unit)
    t, wanted = (np.array(column, dtype=np.float64) for column in zip(*commanded, strict=True))
    middle = 0.5 * float(wanted.max() + wanted.min()) if SIGNALS[signal].wraps else 0.0
    figure, (axes,) = new_axes((2.8,))
    curve = thin(finite(run[signal].t - run.start, factor * (run[signal].values - middle)))
    axes.plot(curve.t, curve.y, color=AFTER, lw=1.2, label="flown")
    steps = np.append(t, run.end) - run.start
    axes.step(steps, factor * (np.append(wanted, wanted[-1]) - middle), where="post", color=WANTED, lw=1.0)
    axes.lines[-1].set_label("commanded")
    if SIGNALS[signal].down:
        axes.invert_yaxis()
    axes.set_ylabel(f"{axis} [{unit}]" if not SIGNALS[signal].wraps else f"{axis} relative to its course [{unit}]")
    axes.set_xlabel("time [s]")
    legend(axes, 2)
    return figure
