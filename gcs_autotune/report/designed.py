"""The report of ``design``: gains of a loop with its analysis, or the limit cycle of a relay."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import DirectLine, LineOfHeading, OwnDesign
from gcs_autotune.design import (
    Change,
    DiskMargin,
    LoopAnalysis,
    LoopResponse,
    Margins,
    OpenLoop,
    Proposal,
    style_number,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.report.flight.held import gains_of_own
from gcs_autotune.report.toolkit.canvas import AFTER, BAND, BEFORE, FAINT, INK, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.document import IN_RESULT, Document, Figure, Note, Section, Table, Verdict, notes
from gcs_autotune.report.toolkit.goldfarb import goldfarb_figure
from gcs_autotune.report.toolkit.wording import (
    format_factor,
    format_moment,
    format_number,
    format_quantity,
    format_seconds,
    sentence,
)
from gcs_autotune.report.tune.bode import draw_bode, loop_margins
from gcs_autotune.report.tune.tables import gains_table, metrics_table
from gcs_autotune.report.tune.wording import follows, safety

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from gcs_autotune.identify.relay import PredictedCycle

__all__ = ["DesignedGains", "DesignedOwn", "DesignedRelay", "designed_document", "styles_compared"]

MOST_POLES = 6
"""Most poles shown, the slowest first. The others are those of filters and of the approximated delay."""
MOST_POINTS = 300
"""Number of points of a step that a page plots, about one per pixel. Project choice."""
NEAR = 2.5
"""Range of the Nyquist plot around the origin."""


@dataclass(frozen=True, slots=True, eq=False)
class DesignedGains:
    """Gains for a loop of the autopilot, not written to any vehicle.

    ``source``: name of the model; ``speed`` [m/s] of a boat. ``gains``: all of the loop, changed or not, and
    ``present_from`` where the present ones come from. ``before`` and ``after``: the loop
    with the present and the new gains. ``notes``: what the data do not determine.
    """

    firmware: str
    source: str
    speed: float | None
    gains: tuple[Change, ...]
    present_from: str
    proposal: Proposal
    before: LoopAnalysis
    after: LoopAnalysis
    notes: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """All gains of the loop by the vehicle's parameter names."""
        return {gain.parameter: gain.new for gain in self.gains}

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "schema": 1,
            "designed": "autopilot",
            "firmware": self.firmware,
            "model": self.source,
            "present": self.present_from,
            "gains": self.values,
            "proposal": self.proposal.to_dict(),
            "before": _plain(self.before),
            "after": _plain(self.after),
        }


@dataclass(frozen=True, slots=True, eq=False)
class DesignedOwn:
    """A controller of our own for *axis*, and for a line the law above it (``guidance``, ``line``)."""

    axis: str
    source: str
    design: OwnDesign
    analysis: LoopAnalysis
    guidance: str = ""
    line: DirectLine | LineOfHeading | None = None
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        law, wanted = self.design.law, self.design.wanted
        return {
            "schema": 1,
            "designed": "own",
            "axis": self.axis,
            "model": self.source,
            "structure": law.structure.name,
            "gains": {"K_P": law.K_P, "K_I": law.K_I, "K_D": law.K_D},
            "wanted": {"kind": wanted.kind, "omega_0": wanted.omega_0},
            "loop": _plain(self.analysis),
            **({"guidance": self.guidance, "line": dict(_numbers(self.line))} if self.line is not None else {}),
        }


@dataclass(frozen=True, slots=True, eq=False)
class DesignedRelay:
    """The limit cycle that a relay switched at *rate* [Hz] causes on *model* with normalised input."""

    source: str
    model: SingleDof
    rate: float
    cycle: PredictedCycle

    def to_dict(self) -> dict[str, Any]:
        """Return plain data: amplitude and mean in rad or m, period in s."""
        return {
            "schema": 1,
            "designed": "relay",
            "model": self.source,
            "dof": self.model.dof,
            **asdict(self.cycle),
            "period": self.cycle.period,
        }


Designed = DesignedGains | DesignedOwn | DesignedRelay


def designed_document(designed: Designed, when: str = "") -> Document:
    """Return the report of a design."""
    if isinstance(designed, DesignedRelay):
        return _relay_document(designed, when)
    return _own_document(designed, when) if isinstance(designed, DesignedOwn) else _gains_document(designed, when)


# --- the autopilot's loop -----------------------------------------------------------------------------------------


def _gains_document(d: DesignedGains, when: str) -> Document:
    proposal = d.proposal
    text = (
        f"New gains for the {proposal.axis} loop; nothing was written."
        if proposal.changes
        else f"The present gains of the {proposal.axis} loop stay: the design found none better."
    )
    at = f" at {d.speed:.2g} m/s" if d.speed else ""
    labels = ("present", "new") if proposal.changes else ("present",)
    analyses = (d.before, d.after)[: len(labels)]
    return Document(
        title=f"Design: {proposal.axis} loop of {d.firmware} from '{d.source}'{at}",
        when=format_moment(when),
        verdict=Verdict(text, "good" if d.after.worst_margins.stable else "bad", (safety(proposal),)),
        sections=(
            Section(
                "gains",
                "Gains",
                (
                    Note(f"Old values: {d.present_from}."),
                    gains_table(d.gains),
                    Note(follows(proposal)),
                    *_remarks(d),
                ),
                facts=IN_RESULT,
            ),
            Section(
                "step",
                "Predicted step",
                (metrics_table(proposal.before.metrics, proposal.after.metrics),),
                facts=IN_RESULT,
            ),
            *_loop_sections(dict(zip(labels, analyses, strict=True)), proposal.axis),
        ),
        facts=d.to_dict(),
    )


def _remarks(d: DesignedGains) -> Iterator[Note]:
    yield from notes(tuple(map(sentence, d.notes)))
    for text in d.proposal.notes:
        yield Note(sentence(text), detail=True)


# --- our own ------------------------------------------------------------------------------------------------------


def _own_document(d: DesignedOwn, when: str) -> Document:
    what = "line" if d.line is not None else d.axis
    analysis = d.analysis
    line: tuple[Section, ...] = ()
    if d.line is not None:
        rows = tuple((name, format_number(value, 4)) for name, value in _numbers(d.line))
        line = (
            Section(
                "line", f"Line: {d.guidance} control", (Table(("quantity", "value [SI]"), "lr", rows),), facts=IN_RESULT
            ),
        )
    return Document(
        title=f"Design: controller of our own for {what} from '{d.source}'",
        when=format_moment(when),
        verdict=Verdict(
            f"A {d.design.wanted.kind.capitalize()} loop of {format_number(d.design.wanted.omega_0, 3)} rad/s.",
            "good" if analysis.worst_margins.stable else "bad",
            (f"No faster loop was chosen: {d.design.limited_by}.",),
        ),
        sections=(
            Section(
                "controller",
                "Controller",
                (gains_of_own(d.design), *notes(tuple(map(sentence, d.notes)))),
                facts=IN_RESULT,
            ),
            *line,
            *_loop_sections({"loop": analysis}, d.axis),
        ),
        facts=d.to_dict(),
    )


def _numbers(law: object) -> list[tuple[str, float]]:
    """Return the numbers of a line law by name; those of its turn-rate loop too."""
    numbers = [(name, getattr(law, name)) for name in getattr(law, "__slots__", ())]
    inner = [(f"turn rate {n}", getattr(v, n)) for _, v in numbers for n in ("K_P", "K_I") if hasattr(v, "K_P")]
    return [(name, value) for name, value in (*numbers, *inner) if isinstance(value, float)]


# --- what both have -----------------------------------------------------------------------------------------------


def _loop_sections(analyses: Mapping[str, LoopAnalysis], axis: str) -> tuple[Section, ...]:
    """Return poles, margins and responses of a loop with each set of gains; the last set is the proposed one."""
    last = list(analyses.values())[-1]
    several = len(analyses) > 1
    return (
        Section(
            "responses",
            "Step and disturbance",
            (_disturbance_table(analyses), Figure("responses", _RESPONSES, partial(_draw_responses, analyses, axis))),
            facts=IN_RESULT,
        ),
        Section(
            "margins",
            "Margins",
            (_margins_table(analyses), Note(_DISK, kind="quiet"), *_frequency(analyses)),
            facts=IN_RESULT,
        ),
        Section(
            "poles",
            "Poles of the closed loop" + (", new gains" if several else ""),
            (_poles_table(last.poles),),
            facts=IN_RESULT,
        ),
    )


_RESPONSES = (
    "A step, then a constant force of 5 % of full output. Band: range over the 95 % region of the model. Below: the "
    "output."
)
_DISK = (
    "Disk margins: gain and phase may change by this much at the same time. The worst case is the worst model in the "
    "95 % region."
)


def _margins_table(analyses: Mapping[str, LoopAnalysis]) -> Table:
    columns = [(label, analysis.margins, analysis.disk) for label, analysis in analyses.items()]
    label, last = list(analyses.items())[-1]
    columns.append((f"{label}, worst case", last.worst_margins, last.worst_disk))
    cells = [_margin_cells(margins, disk) for _, margins, disk in columns]
    rows = tuple((name, *row) for name, *row in zip(_MARGINS, *cells, strict=True))
    return Table(("margin", *(name for name, *_ in columns)), "l" + "r" * len(columns), rows)


_MARGINS = ("stable", "gain margin", "phase margin", "delay margin", "disk margin, gain", "disk margin, phase")


def _margin_cells(margins: Margins, disk: DiskMargin) -> tuple[str, ...]:
    if not margins.stable:
        return ("NO", *[""] * (len(_MARGINS) - 1))
    return (
        "yes",
        _ratio(margins.gain),
        format_quantity(margins.phase, "rad"),
        format_seconds(margins.delay),
        _ratio(disk.gain),
        format_quantity(disk.phase, "rad"),
    )


def _ratio(factor: float) -> str:
    return f"{format_factor(factor)} ({20.0 * math.log10(factor):.1f} dB)" if factor <= 100.0 else format_factor(factor)


def _poles_table(poles: NDArray[np.complex128]) -> Table:
    slowest = sorted((p for p in poles if p.imag >= 0.0), key=abs)[:MOST_POLES]
    rows = tuple(
        (
            f"{format_number(p.real, 3)}" + (f" ± {format_number(p.imag, 3)} j" if p.imag > 0.0 else ""),
            format_number(abs(p), 3),
            format_number(-p.real / abs(p), 2) if abs(p) > 0.0 else "",
        )
        for p in slowest
    )
    return Table(("pole [rad/s]", "frequency [rad/s]", "damping ratio"), "rrr", rows, "The slowest ones are shown.")


def _disturbance_table(analyses: Mapping[str, LoopAnalysis]) -> Table:
    rows = []
    for label, analysis in analyses.items():
        r = analysis.response
        rows.append((label, *(_percent(deviation, r.step) for deviation in _deviations(r))))
    heads = ("deviation by 5 % of full output", "model [% of step]", "worst case [% of step]")
    return Table(heads, "lrr", tuple(rows))


def _deviations(r: LoopResponse) -> tuple[float, float]:
    """Return the largest deviation by the push: of the model, and of the worst one in its region."""
    pushed = r.t >= r.push_at
    start = float(r.position[pushed][0])
    worst = max(float(np.max(r.high[pushed])) - start, start - float(np.min(r.low[pushed])))
    return float(np.max(np.abs(r.position[pushed] - start))), worst


def _percent(value: float, step: float) -> str:
    return format_number(100.0 * value / abs(step), 3) if math.isfinite(value) else "diverges"


def _draw_responses(analyses: Mapping[str, LoopAnalysis], axis: str) -> Drawing:
    figure, (upper, lower) = new_axes((2.4, 1.2))
    colours = (BEFORE, AFTER)[-len(analyses) :]
    for (label, analysis), colour in zip(analyses.items(), colours, strict=True):
        r = analysis.response
        if colour == AFTER:
            upper.fill_between(r.t, _shown(r, r.low), _shown(r, r.high), color=BAND, lw=0.0)
        upper.plot(r.t, _shown(r, r.position), color=colour, lw=1.3, label=label)
        lower.plot(r.t, 100.0 * np.clip(r.output, -1.0, 1.0), color=colour, lw=0.9)
    upper.axhline(100.0, color=WANTED, lw=1.0, label="target")
    upper.set_ylabel(f"{axis} [% of step]")
    lower.set_ylabel("output [%]")
    lower.set_xlabel("time [s]")
    legend(upper, 3)
    return figure


def _shown(r: LoopResponse, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions in percent of the step, limited to what a figure can show."""
    shown: NDArray[np.float64] = np.clip(100.0 * position / r.step, -100.0, 300.0)
    return shown


def _frequency(analyses: Mapping[str, LoopAnalysis]) -> Iterator[Figure]:
    loops = [(analysis.loop,) for analysis in analyses.values()]
    margins = [loop_margins(group) for group in loops]
    yield Figure("bode", "Bode plot of the open loop.", partial(draw_bode, loops, margins, tuple(analyses)))
    caption = "Nyquist plot of the open loop. The loop with the last gains stays outside the shaded disk."
    yield Figure("nyquist", caption, partial(_draw_nyquist, analyses))


def _draw_nyquist(analyses: Mapping[str, LoopAnalysis]) -> Drawing:
    from matplotlib.patches import Circle

    figure, (axes,) = new_axes((3.6,))
    disk = list(analyses.values())[-1].disk
    if disk.size > 0.0:
        centre, radius = -0.5 * (disk.gain + 1.0 / disk.gain), 0.5 * (disk.gain - 1.0 / disk.gain)
        axes.add_patch(Circle((centre, 0.0), radius, color=BAND, lw=0.0))
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=FAINT, lw=0.8))
    for (label, analysis), colour in zip(analyses.items(), (BEFORE, AFTER)[-len(analyses) :], strict=True):
        _curve(axes, analysis.loop, colour, label)
    _square(axes, NEAR)
    return figure


def _curve(axes: Axes, loop: OpenLoop, colour: str, label: str) -> None:
    value = loop.response(np.logspace(-3.0, 2.7, 2000))
    near = np.abs(value) < 3.0 * NEAR
    axes.plot(value.real[near], value.imag[near], color=colour, lw=1.3, label=label)


def _square(axes: Axes, reach: float) -> None:
    axes.plot([-1.0], [0.0], "+", color=INK, ms=8.0)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    legend(axes, 3)


def _plain(found: LoopAnalysis) -> dict[str, Any]:
    r = found.response
    of_model, worst = _deviations(r)
    return {
        "poles": [[float(p.real), float(p.imag)] for p in sorted(found.poles, key=abs)],
        **{
            name: {slot: getattr(thing, slot) for slot in thing.__slots__}
            for name, thing in (
                ("margins", found.margins),
                ("worst_margins", found.worst_margins),
                ("disk_margin", found.disk),
                ("worst_disk_margin", found.worst_disk),
            )
        },
        "response": {"step": r.step, "push": r.push, "push_at": r.push_at, "deviation": of_model, "worst": worst},
    }


# --- the styles side by side --------------------------------------------------------------------------------------


def styles_compared(designs: Mapping[str, DesignedGains | str]) -> dict[str, Any]:
    """Return the designs by style as plain data for a page: gains, margins and predicted step; SI and radians.

    ``at`` is the place of a style between gentle (0) and quick (100).
    """
    styles = [{"style": name, "at": style_number(name), **_compared(one)} for name, one in designs.items()]
    return {"schema": 2, "styles": styles}


def _compared(design: DesignedGains | str) -> dict[str, Any]:
    if isinstance(design, str):
        return {"error": design}
    before, after, margins = design.before.response, design.after.response, design.after.worst_margins
    until = int(np.searchsorted(after.t, after.push_at))
    t = after.t[: until : max(1, until // MOST_POINTS)]
    return {
        "gains": [{"parameter": g.parameter, "old": g.old, "new": g.new} for g in design.gains],
        "margins": {name: getattr(margins, name) for name in margins.__slots__},
        "metrics": design.proposal.to_dict()["predicted"],
        "step": {
            "size": after.step,
            "t": t.tolist(),
            "before": np.interp(t, before.t, before.position).tolist(),
            "after": np.interp(t, after.t, after.position).tolist(),
            "low": np.interp(t, after.t, after.low).tolist(),
            "high": np.interp(t, after.t, after.high).tolist(),
            "output": np.interp(t, after.t, after.output).tolist(),
        },
        "largest_output": float(np.max(np.abs(after.output[:until]))),
    }


# --- a relay ------------------------------------------------------------------------------------------------------


def _relay_document(d: DesignedRelay, when: str) -> Document:
    cycle, unit = d.cycle, d.model.axis.position_unit
    rows = (
        ("relay output", f"{100.0 * cycle.C:.0f} %"),
        ("hysteresis", format_quantity(cycle.x_a, unit)),
        ("switched at", f"{d.rate:g} Hz"),
        ("amplitude X_m", format_quantity(cycle.X_m, unit)),
        *((("mean deviation", format_quantity(cycle.x_0, unit)),) if cycle.x_0 else ()),
        ("period", format_seconds(cycle.period)),
        ("largest rate", format_quantity(cycle.X_m * cycle.omega, f"{unit}/s")),
    )
    text = (
        f"The relay causes a limit cycle with an amplitude of {format_quantity(cycle.X_m, unit)} and a period of "
        f"{format_seconds(cycle.period)}."
    )
    how = "Predicted from the first harmonic. The error is usually a few percent, and up to about 15 %."
    return Document(
        title=f"Design: relay on {d.model.dof} of '{d.source}'",
        when=format_moment(when),
        verdict=Verdict(text, "good", (how,)),
        sections=(
            Section(
                "relay",
                "Limit cycle",
                (Table(("quantity", "value"), "lr", rows), goldfarb_figure(d.model, d.cycle)),
                facts=IN_RESULT,
            ),
        ),
        facts=d.to_dict(),
    )
