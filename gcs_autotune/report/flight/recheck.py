"""The verdict of a recheck of an old tune: its page and its terminal output."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Group

from gcs_autotune.axes import axis_kind
from gcs_autotune.identify import Doubt
from gcs_autotune.report.toolkit.canvas import AFTER, WANTED, legend, new_axes, pens, to_svg
from gcs_autotune.report.toolkit.figures import finite, thin
from gcs_autotune.report.toolkit.page import Picture, Table, render_page
from gcs_autotune.report.toolkit.terminal import STYLES, bullet, grid, paragraph, title
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    Headline,
    Tone,
    doubt_sentence,
    format_moment,
    format_number,
    format_value,
    to_people,
)
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Trial

__all__ = ["LoopCheck", "LoopNumbers", "recheck_summary", "render_recheck"]


@dataclass(frozen=True, slots=True)
class LoopNumbers:
    """Metrics of a closed loop; NaN: unknown.

    ``overshoot`` of a step as a fraction of it; ``rise`` (10 to 90 %) and ``settling`` (to 5 %) [s]; ``damping`` ratio;
    ``oscillation`` with a constant command [SI, rad] and its ``period`` [s]. ``overshoot_std``: its standard error.
    """

    overshoot: float = math.nan
    rise: float = math.nan
    settling: float = math.nan
    damping: float = math.nan
    oscillation: float = math.nan
    period: float = math.nan
    overshoot_std: float = math.nan


@dataclass(frozen=True, slots=True)
class LoopCheck:
    """The verdict on the loop of ``axis``.

    ``kind``: good, degraded, poorly damped, oscillates, not identifiable. ``text``: the verdict as a sentence;
    ``tone``: its colour; ``notes``: further sentences. ``now``: the metrics; ``then``: those of the last tune
    (``when``).
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

    def to_dict(self) -> dict[str, object]:
        """Return plain data; unknown numbers are None."""

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


def render_recheck(check: LoopCheck, heading: str, when: str, run: Trial) -> str:
    """Return the page: the verdict, the metrics now and after the last tune, and the plot of *run*."""
    numbers, of = _numbers(check), "Now" if check.then is None else "Now and after the last tune"
    return render_page(
        "flight/page.html",
        {
            "title": heading,
            "when": format_moment(when),
            "headline": Headline(check.text, check.tone, check.notes),
            "tiles": (),
            "doubts": _doubts(check),
            "runs": None,
            "story": None,
            "pictured": "Command and response",
            "sheets": [(of, numbers, "")] if numbers.rows else [],
            "models": [],
            "pictures": _picture(check.axis, run),
        },
    )


def recheck_summary(check: LoopCheck) -> Group:
    """Return the terminal output: verdict, metrics, doubts."""
    numbers = _numbers(check)
    parts = [title(check.text, STYLES[check.tone]), *(bullet(note) for note in check.notes)]
    parts += [grid(numbers)] if numbers.rows else []
    doubts = _doubts(check)
    if doubts:
        parts += [title("Doubts", "bold yellow"), *(bullet(text) for text in doubts)]
    return Group(*parts, paragraph(""))


def _doubts(check: LoopCheck) -> tuple[str, ...]:
    return (*(doubt_sentence(d) for d in check.doubts), *check.remarks)


def _numbers(check: LoopCheck) -> Table:
    now, then = check.now, check.then
    unit, factor = to_people(SIGNALS[axis_kind(check.axis).stepped][0])
    std = now.overshoot_std
    rows = [
        _row("step overshoot", "%", 100.0, now.overshoot, math.nan if then is None else then.overshoot, std),
        _row("rise time, 10 to 90 %", "s", 1.0, now.rise, math.nan if then is None else then.rise),
        _row("settling time, to 5 %", "s", 1.0, now.settling, math.nan if then is None else then.settling),
        _row("damping ratio", "", 1.0, now.damping, math.nan),
        _row("oscillation at constant command", f"{unit} amplitude", factor, now.oscillation, math.nan),
        _row("its period", "s", 1.0, now.period, math.nan),
    ]
    heads = ("figure", "now", f"tune of {format_moment(check.when)}" if then is not None else "", "unit")
    return Table(heads, "lrrl", tuple(row for row in rows if any(row[1:3])))


def _row(name: str, unit: str, factor: float, now: float, then: float, std: float = math.nan) -> tuple[str, ...]:
    values = [format_number(factor * value, 3) if math.isfinite(value) else "" for value in (now, then)]
    if values[0] and math.isfinite(std):
        values[0] = format_value(factor * now, factor * std)
    if values[1] and not values[0]:
        values[0] = UNKNOWN
    return (name, *values, unit)


def _picture(axis: str, run: Trial) -> Sequence[Picture]:
    """Plot command and response, relative to the course."""
    signal = axis_kind(axis).stepped
    commanded = [(m.t, m.detail[f"{signal}_ref"]) for m in run.marks if f"{signal}_ref" in m.detail]
    if signal not in run or not commanded:
        return ()
    unit, factor = to_people(run[signal].unit)
    t, wanted = (np.array(column, dtype=np.float64) for column in zip(*commanded, strict=True))
    middle = 0.5 * float(wanted.max() + wanted.min()) if signal != "z" else 0.0
    caption = f"Commanded and flown {axis}. A well damped loop follows quickly, without oscillation."
    with pens("recheck"):
        figure, (axes,) = new_axes((2.8,))
        seen = thin(finite(run[signal].t - run.start, factor * (run[signal].values - middle)))
        axes.plot(seen.t, seen.y, color=AFTER, lw=1.2, label="flown")
        steps = np.append(t, run.end) - run.start
        axes.step(steps, factor * (np.append(wanted, wanted[-1]) - middle), where="post", color=WANTED, lw=1.0)
        axes.lines[-1].set_label("commanded")
        if signal == "z":
            axes.invert_yaxis()
        axes.set_ylabel(f"{axis} [{unit}]" if signal != "psi" else f"{axis} relative to course [{unit}]")
        axes.set_xlabel("time [s]")
        legend(axes, 2)
        return (Picture("recheck", caption, to_svg(figure, "recheck", caption)),)
