"""The report of a step flown with a controller of our own."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.axes import axis_kind
from gcs_autotune.control import Line, OwnDesign, wanted_step
from gcs_autotune.design import StepMetrics
from gcs_autotune.report.toolkit.canvas import AFTER, INK, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.document import Document, Figure, Section, Table, Verdict
from gcs_autotune.report.toolkit.figures import finite, thin
from gcs_autotune.report.toolkit.wording import NOTHING_WRITTEN, UNKNOWN, format_moment, format_number, to_people
from gcs_autotune.sname import SIGNALS, wrap
from gcs_autotune.trial import Mark, Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = [
    "DistanceFigures",
    "Held",
    "HeldDistance",
    "HeldLine",
    "HeldLoop",
    "HeldPosition",
    "LineFigures",
    "PositionFigures",
    "distance_figures",
    "figures_on",
    "gains_of_own",
    "hold_document",
    "position_figures",
]

Array = NDArray[np.float64]

AT_DISTANCE = 0.1
"""Largest rms error of a craft that keeps a distance [m]. Chosen: an inspection camera stays in focus."""
AT_HEADING = math.radians(3.0)
"""Largest rms heading error of a craft that holds a position [rad]. Project choice: more than a good compass' noise."""
ON_LINE = 1.0
"""Largest rms distance of a craft that follows a line [m]. Chosen: a lane between two berths."""

FOLLOWS = 0.05
"""Largest overshoot beyond the model function's, and largest steady error, of a loop that follows it [of the step]."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldLoop:
    """A controller of our own on one axis: its design, the record of its step, and how it followed."""

    axis: str
    design: OwnDesign
    trial: Trial
    metrics: StepMetrics

    @property
    def promised(self) -> float:
        """Overshoot of the model function [fraction of the step]."""
        wanted = self.design.wanted
        return float(wanted_step(wanted, np.linspace(0.0, 20.0 / wanted.omega_0, 2000)).position.max()) - 1.0

    @property
    def follows(self) -> bool:
        """Whether the step went as the model function, within :data:`FOLLOWS`."""
        return self.metrics.overshoot - self.promised <= FOLLOWS and self.metrics.steady_error <= FOLLOWS

    def to_dict(self) -> dict[str, object]:
        """Return plain data; unknown numbers are None."""
        design, metrics = self.design, self.metrics
        law = design.law

        def known(value: float) -> float | None:
            return value if math.isfinite(value) else None

        return {
            "schema": 1,
            "axis": self.axis,
            "follows": self.follows,
            "controller": {
                "structure": law.structure.name,
                "K_P": law.K_P,
                "K_I": law.K_I,
                "K_D": law.K_D,
                "drag": law.drag,
                "drag_speed": known(law.drag_speed),
                "disturbance": law.disturbance,
                "limits": [known(limit) for limit in law.limits],
            },
            "model_function": {"kind": design.wanted.kind, "omega_0": design.wanted.omega_0},
            "margins": {
                "gain": known(design.margins.gain),
                "phase": known(design.margins.phase),
                "vector": known(design.margins.vector),
            },
            "stability": {"left": known(design.bound[0]), "right": known(design.bound[1])},
            "limited_by": design.limited_by,
            "step": {
                name: known(getattr(metrics, name))
                for name in ("overshoot", "rise", "settling", "steady_error", "travel")
            },
        }


@dataclass(frozen=True, slots=True)
class LineFigures:
    """How a line was followed.

    ``rms``: distance to the line in the second half [m]; ``mean``: its mean there; ``overshoot``: furthest beyond the
    line [m]; ``approach``: largest angle to it [rad]; ``activity``: standard deviation of the output in the second
    half [normalised].
    """

    rms: float
    mean: float
    overshoot: float
    approach: float
    activity: float


def figures_on(trial: Trial) -> LineFigures:
    """Return the figures of a followed line."""
    line = Line(*(float(trial.meta[f"line_{name}"]) for name in ("x", "y", "gamma")))
    offset = float(trial.meta["offset"])
    t, d, along, angle = distances(trial, line)
    late = along > 0.5 * float(trial.meta["length"])
    output = trial["N"].between(float(t[late][0]), trial.end).values if late.any() else np.zeros(1)
    beyond = d * math.copysign(1.0, offset)  # begins negative: the line is to the side of the offset
    return LineFigures(
        rms=float(np.sqrt(np.mean(d[late] ** 2))) if late.any() else math.nan,
        mean=float(np.mean(d[late])) if late.any() else math.nan,
        overshoot=max(float(beyond.max()), 0.0),
        approach=float(np.abs(angle).max()),
        activity=float(np.std(output)),
    )


def distances(trial: Trial, line: Line) -> tuple[Array, Array, Array, Array]:
    """Return (t, d, along, angle) (n,) of a followed *line*: [s], [m], [m], [rad]."""
    t = trial["x"].t
    x, y, psi = (np.interp(t, trial[name].t, trial[name].values) for name in ("x", "y", "psi"))
    states = [line.state(*place, 0.0, (0.0, 0.0)) for place in zip(x, y, psi, strict=True)]
    d, along, angle = (np.array([getattr(state, name) for state in states]) for name in ("d", "along", "heading"))
    return t, d, along, angle


@dataclass(frozen=True, slots=True, eq=False)
class HeldLine:
    """A line followed by a controller of our own: the heading loop's design, the law, the record and its figures."""

    guidance: str
    design: OwnDesign
    trial: Trial
    figures: LineFigures

    @property
    def follows(self) -> bool:
        """Whether it stays on the line, within :data:`ON_LINE`."""
        return self.figures.rms <= ON_LINE

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "schema": 1,
            "guidance": self.guidance,
            "follows": self.follows,
            "heading_loop": {"kind": self.design.wanted.kind, "omega_0": self.design.wanted.omega_0},
            "line": {name: value for name, value in asdict(self.figures).items() if math.isfinite(value)},
        }


@dataclass(frozen=True, slots=True)
class DistanceFigures:
    """How a distance was kept, in the last half of each leg: ``mean`` and ``rms`` error [m]; ``overshoot`` [m]."""

    mean: float
    rms: float
    overshoot: float


def distance_figures(trial: Trial) -> DistanceFigures:
    """Return the figures of a kept distance."""
    targets = [(m.t, float(m.detail["value"])) for m in trial.marks if m.kind == "target"]
    ends = [t for t, _ in targets[1:]] + [trial.end]
    errors, beyond, before = [], [0.0], targets[0][1]
    for (start, wanted), end in zip(targets, ends, strict=True):
        whole = trial["d"].between(start, end).values - wanted
        errors.append(trial["d"].between(0.5 * (start + end), end).values - wanted)
        if wanted != before and len(whole):
            beyond.append(float(np.nanmax(whole * math.copysign(1.0, wanted - before))))
        before = wanted
    late = np.concatenate(errors)
    return DistanceFigures(float(np.nanmean(late)), float(np.sqrt(np.nanmean(late**2))), max(beyond))


@dataclass(frozen=True, slots=True, eq=False)
class HeldDistance:
    """A distance kept by controllers of our own: their designs ahead and in yaw, the record and its figures."""

    design: OwnDesign
    yaw: OwnDesign
    trial: Trial
    figures: DistanceFigures

    @property
    def follows(self) -> bool:
        """Whether it keeps the distance, within :data:`AT_DISTANCE`."""
        return self.figures.rms <= AT_DISTANCE

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "schema": 1,
            "follows": self.follows,
            "omega_0": {"distance": self.design.wanted.omega_0, "angle": self.yaw.wanted.omega_0},
            "distance": asdict(self.figures),
        }


@dataclass(frozen=True, slots=True)
class PositionFigures:
    """How a position was held, in the last third of each leg: ``rms`` distance from it [m], ``heading`` error [rad];
    ``furthest``: greatest distance beyond a target [m].
    """

    rms: float
    heading: float
    furthest: float


def position_figures(trial: Trial) -> PositionFigures:
    """Return the figures of a held position."""
    legs = [m for m in trial.marks if m.kind == "target"]
    ends = [m.t for m in legs[1:]] + [trial.end]
    away, turned, beyond = [], [], [0.0]
    t = trial["x"].t
    x, y, psi = (np.interp(t, trial[name].t, trial[name].values) for name in ("x", "y", "psi"))
    before = _place(legs[0])
    for mark, end in zip(legs, ends, strict=True):
        at = _place(mark)
        late = (t >= mark.t + (end - mark.t) * 2.0 / 3.0) & (t <= end)
        away.append(np.hypot(x[late] - at[0], y[late] - at[1]))
        turned.append(np.array([wrap(float(value) - at[2]) for value in psi[late]]))
        north, east = at[0] - before[0], at[1] - before[1]
        size, leg = math.hypot(north, east), (t >= mark.t) & (t <= end)
        if size > 0.0:
            beyond.append(float(np.max(((x[leg] - at[0]) * north + (y[leg] - at[1]) * east) / size)))
        before = at
    rms = float(np.sqrt(np.mean(np.concatenate(away) ** 2)))
    return PositionFigures(rms, float(np.sqrt(np.mean(np.concatenate(turned) ** 2))), max(beyond))


def _place(mark: Mark) -> tuple[float, float, float]:
    return float(mark.detail["x"]), float(mark.detail["y"]), float(mark.detail["psi"])


@dataclass(frozen=True, slots=True, eq=False)
class HeldPosition:
    """A position held by a law of our own: the designs of surge, sway and yaw, the record and its figures."""

    law: str
    designs: tuple[OwnDesign, OwnDesign, OwnDesign]
    trial: Trial
    figures: PositionFigures

    @property
    def follows(self) -> bool:
        """Whether it holds position and heading, within :data:`AT_DISTANCE` and :data:`AT_HEADING`."""
        return self.figures.rms <= AT_DISTANCE and self.figures.heading <= AT_HEADING

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        names = ("surge", "sway", "yaw")
        return {
            "schema": 1,
            "law": self.law,
            "follows": self.follows,
            "omega_0": {name: d.wanted.omega_0 for name, d in zip(names, self.designs, strict=True)},
            "position": asdict(self.figures),
        }


_Story = tuple[str, tuple[str, ...], tuple[Section, ...]]
"""Headline, further sentences and sections of a report."""

Held = HeldLoop | HeldLine | HeldDistance | HeldPosition


def hold_document(held: Held, heading: str = "", when: str = "") -> Document:
    """Return the report: does the craft follow, the gains, the margins, the flight."""
    if isinstance(held, HeldPosition):
        text, sentences, sections = _of_position(held)
    elif isinstance(held, HeldDistance):
        text, sentences, sections = _of_distance(held)
    elif isinstance(held, HeldLine):
        text, sentences, sections = _of_line(held)
    else:
        text, sentences, sections = _of_loop(held)
    return Document(
        title=heading,
        when=format_moment(when),
        verdict=Verdict(text, "good" if held.follows else "bad", (*sentences, NOTHING_WRITTEN)),
        sections=sections,
        facts=held.to_dict(),
    )


def _of_position(held: HeldPosition) -> _Story:
    figures = held.figures
    text = (
        f"The craft holds its position within {100.0 * figures.rms:.1f} cm and its heading within "
        f"{math.degrees(figures.heading):.1f} degrees rms."
        if held.follows
        else f"The craft does not hold its position: {100.0 * figures.rms:.1f} cm and "
        f"{math.degrees(figures.heading):.1f} degrees rms."
    )
    rows = (
        ("distance from the target, rms", f"{100.0 * figures.rms:.1f}", "cm"),
        ("heading error, rms", f"{math.degrees(figures.heading):.1f}", "deg"),
        ("overshoot", f"{100.0 * figures.furthest:.1f}", "cm"),
    )
    loops = tuple(
        (name, format_number(d.wanted.omega_0, 3), f"{d.margins.vector:.2f}")
        for name, d in zip(("surge", "sway", "yaw"), held.designs, strict=True)
    )
    heads = ("motion", "fastest loop [rad/s]", "vector margin")
    return (
        text,
        (f"{held.law.capitalize()} control.",),
        (
            Section("position", "Position", (Table(("figure", "flown", "unit"), "lrl", rows), _position_plot(held))),
            Section("loops", "What each motion allows", (Table(heads, "lrr", loops),)),
        ),
    )


def _of_distance(held: HeldDistance) -> _Story:
    figures = held.figures
    text = (
        f"The craft keeps its distance to the wall within {100.0 * figures.rms:.1f} cm rms."
        if held.follows
        else f"The craft does not keep its distance to the wall: {100.0 * figures.rms:.1f} cm rms."
    )
    rows = (
        ("steady error, mean", f"{100.0 * figures.mean:+.1f}", "cm"),
        ("steady error, rms", f"{100.0 * figures.rms:.1f}", "cm"),
        ("overshoot", f"{100.0 * figures.overshoot:.1f}", "cm"),
    )
    return (
        text,
        (),
        (
            Section("distance", "Distance", (Table(("figure", "flown", "unit"), "lrl", rows), _distance_plot(held))),
            Section("controller", "Distance loop", (gains_of_own(held.design), _margins(held.design))),
            Section("angle", "Angle loop", (gains_of_own(held.yaw), _margins(held.yaw))),
        ),
    )


def _of_line(held: HeldLine) -> _Story:
    figures = held.figures
    text = (
        f"The craft follows the line within {figures.rms:.2f} m rms."
        if held.follows
        else f"The craft does not stay on the line: {figures.rms:.2f} m rms."
    )
    rows = (
        ("distance, second half, rms", f"{figures.rms:.2f}", "m"),
        ("distance, second half, mean", f"{figures.mean:+.2f}", "m"),
        ("overshoot beyond the line", f"{figures.overshoot:.2f}", "m"),
        ("largest angle to the line", f"{math.degrees(figures.approach):.0f}", "deg"),
        ("output, second half, standard deviation", f"{100.0 * figures.activity:.1f}", "% of full"),
    )
    return (
        text,
        (f"{held.guidance.capitalize()} control.",),
        (
            Section("line", "Line", (Table(("figure", "flown", "unit"), "lrl", rows), _line_plot(held))),
            Section("controller", "Heading loop", (gains_of_own(held.design),)),
            Section("margins", "Margins of the heading loop", (_margins(held.design),)),
        ),
    )


def _of_loop(held: HeldLoop) -> _Story:
    metrics = held.metrics
    text = (
        f"The step in {held.axis} follows the model function."
        if held.follows
        else f"The step in {held.axis} does not follow the model function."
    )
    sentences = (
        f"Overshoot {100.0 * metrics.overshoot:.1f} % of the step (model function {100.0 * held.promised:.1f} %), "
        f"steady error {100.0 * metrics.steady_error:.1f} %.",
        f"No faster loop was chosen: {held.design.limited_by}.",
    )
    return (
        text,
        sentences,
        (
            Section("controller", "Controller", (gains_of_own(held.design),)),
            Section("margins", "Margins", (_margins(held.design),)),
            Section("step", "Step", (_figures(held), _step_plot(held))),
        ),
    )


def gains_of_own(design: OwnDesign) -> Table:
    """Return the gains of a controller of our own."""
    law, wanted, unit = design.law, design.wanted, design.model.axis.position_unit
    rows = [
        ("structure", law.structure.name, ""),
        ("K_P", format_number(law.K_P, 4), f"input per {unit}"),
        ("K_I", format_number(law.K_I, 4), f"input per {unit} s"),
        ("K_D", format_number(law.K_D, 4), f"input per {unit}/s"),
        ("compensated quadratic drag", format_number(law.drag, 3) if law.drag else "", f"input per ({unit}/s)²"),
        ("compensated constant disturbance", format_number(law.disturbance, 3) if law.disturbance else "", "input"),
        (f"model function: {wanted.kind.capitalize()}, third order", format_number(wanted.omega_0, 3), "rad/s"),
    ]
    return Table(("quantity", "value", "unit"), "lrl", tuple(row for row in rows if row[1]))


def _margins(design: OwnDesign) -> Table:
    margins, (left, right) = design.margins, design.bound
    rows = (
        (
            "gain margin",
            f"{20.0 * math.log10(margins.gain):.1f} dB (factor {margins.gain:.2f})"
            if math.isfinite(margins.gain)
            else "unlimited",
        ),
        ("phase margin", f"{math.degrees(margins.phase):.0f}°"),
        ("vector margin", f"{margins.vector:.2f}"),
        (
            "stable for every model within its uncertainty",
            f"{'yes' if left < right else 'no'} (bound {format_number(left, 3)}, limit {format_number(right, 3)})",
        ),
    )
    return Table(("margin", "value"), "ll", rows)


def _figures(held: HeldLoop) -> Table:
    metrics = held.metrics
    rows = (
        ("overshoot", "%", 100.0 * metrics.overshoot),
        ("rise time, 10 to 90 %", "s", metrics.rise),
        ("settling time, to 5 %", "s", metrics.settling),
        ("steady error", "%", 100.0 * metrics.steady_error),
        ("actuator travel", "of full output per s", metrics.travel),
    )
    never = f"not in {metrics.span:.1f}" if math.isfinite(metrics.span) else UNKNOWN
    shown = (
        (name, format_number(value, 3) if math.isfinite(value) else never if unit == "s" else UNKNOWN, unit)
        for name, unit, value in rows
    )
    return Table(("figure", "flown", "unit"), "lrl", tuple(shown))


# --- figures: one or more signals with their commands, and the output ------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Panel:
    """One signal against time: (t, value) as flown and as commanded.

    ``called``: name of the command. ``steps``: the command is held until its next time. ``down``: it grows downwards.
    """

    label: str
    flown: tuple[Array, Array]
    wanted: tuple[Array, Array]
    called: str = "commanded"
    steps: bool = False
    down: bool = False


def _draw(trial: Trial, panels: tuple[_Panel, ...], force: str = "") -> Drawing:
    """Return the figure of *panels*, with the output of *force* in the last panel if it is recorded."""
    drives = force in trial
    heights = (2.4,) if len(panels) == 1 else (1.5,) * len(panels)
    figure, axes = new_axes((*heights, 1.4) if drives else heights)
    for panel, ax in zip(panels, axes, strict=False):
        curve = thin(finite(panel.flown[0] - trial.start, panel.flown[1]))
        ax.plot(curve.t, curve.y, color=AFTER, lw=1.2, label="flown")
        style = "steps-post" if panel.steps else "default"
        ax.plot(panel.wanted[0] - trial.start, panel.wanted[1], ds=style, color=WANTED, lw=1.0, label=panel.called)
        ax.set_ylabel(panel.label)
        if panel.down:
            ax.invert_yaxis()
    legend(axes[0], 2)
    if drives:
        out = thin(finite(trial[force].t - trial.start, 100.0 * trial[force].values))
        axes[-1].plot(out.t, out.y, color=INK, lw=0.9)
        axes[-1].set_ylabel("output [%]")
    axes[-1].set_xlabel("time [s]")
    return figure


def _targets(trial: Trial, name: str = "value") -> tuple[Array, Array]:
    """Return the commands (t, value) of the marks, the last one also at the end of the record."""
    marks = [m for m in trial.marks if m.kind == "target"]
    values = [float(m.detail[name]) for m in marks]
    return np.array([*(m.t for m in marks), trial.end]), np.array([*values, values[-1]])


def _position_plot(held: HeldPosition) -> Figure:
    trial = held.trial
    panels = []
    for name, label, factor in (
        ("x", "north [m]", 1.0),
        ("y", "east [m]", 1.0),
        ("psi", "heading [deg]", math.degrees(1.0)),
    ):
        t, wanted = _targets(trial, name)
        panels.append(_Panel(label, (trial[name].t, factor * trial[name].values), (t, factor * wanted), steps=True))
    caption = "Position and heading against time, and the targets."
    return Figure("own-position", caption, partial(_draw, trial, tuple(panels)))


def _distance_plot(held: HeldDistance) -> Figure:
    trial = held.trial
    panel = _Panel("distance [m]", (trial["d"].t, trial["d"].values), _targets(trial), steps=True)
    return Figure("own-distance", "Distance to the wall, and output.", partial(_draw, trial, (panel,), "X"))


def _line_plot(held: HeldLine) -> Figure:
    trial = held.trial
    line = Line(*(float(trial.meta[f"line_{name}"]) for name in ("x", "y", "gamma")))
    t, d, _, _ = distances(trial, line)
    panel = _Panel("to starboard [m]", (t, d), (t[[0, -1]], np.zeros(2)), called="line")
    return Figure("own-line", "Distance to the line, and output.", partial(_draw, trial, (panel,), "N"))


def _step_plot(held: HeldLoop) -> Figure:
    trial, kind = held.trial, axis_kind(held.axis)
    signal = kind.stepped
    unit, factor = to_people(trial[signal].unit)
    times, values = _targets(trial)
    down = SIGNALS[signal].down
    base = 0.0 if down else values[0]
    t = np.linspace(times[0], trial.end, 800)
    required = np.full(len(t), values[0])
    for (before, after), start in zip(itertools.pairwise(values[:-1]), times[1:-1], strict=True):
        required += (after - before) * wanted_step(held.design.wanted, t - start).position
    panel = _Panel(
        f"{held.axis} [{unit}]",
        (trial[signal].t, factor * (trial[signal].values - base)),
        (t, factor * (required - base)),
        called="model function",
        down=down,
    )
    caption = "The step as flown, the model function, and the output."
    return Figure("own-step", caption, partial(_draw, trial, (panel,), kind.names.force))
