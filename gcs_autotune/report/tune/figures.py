"""The figures of a tune: step before and after, relay experiments, limit cycles, model and measurement.

A figure is empty if the tune did not reach its stage. Matplotlib is imported with the first plot. Only this module uses
angles in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.design import Prediction
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.report.toolkit.canvas import (
    AFTER,
    BAND,
    BEFORE,
    FAINT,
    INK,
    PAPER,
    WANTED,
    legend,
    new_axes,
    new_columns,
)
from gcs_autotune.report.toolkit.document import Figure
from gcs_autotune.report.toolkit.figures import (
    COLOURS,
    INTERVALS_CAPTION,
    Curve,
    draw_fit,
    draw_intervals,
    draw_thrust,
    draw_track,
    finite,
    inputs_of,
    is_bent,
    thin,
)
from gcs_autotune.report.toolkit.wording import format_number, format_quantity, pretty_unit, to_people
from gcs_autotune.report.tune.bode import LoopMargins, draw_bode, loop_margins
from gcs_autotune.report.tune.story import PLOTTED_SIGNALS, PlottedSignals, TuneStory
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Mark, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

__all__ = [
    "MOST_RELAYS",
    "RelaySeries",
    "StepLeg",
    "StepSeries",
    "bode_figure",
    "fit_figures",
    "model_figures",
    "relay_figures",
    "relay_series",
    "route_figure",
    "stays_figure",
    "step_figure",
    "step_series",
    "track_figure",
]


MOST_PERIODS = 60
"""Largest number of periods plotted of a relay experiment: twice the number that an experiment may have.
Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class StepLeg:
    """One leg of a step trial: times since its command [s], positions relative to the start of the step [rad or m]."""

    position: Curve
    target: Curve
    output: Curve | None


@dataclass(frozen=True, slots=True, eq=False)
class StepSeries:
    """The completed legs of a step trial: the step of ``size`` [rad or m] and the step back."""

    legs: tuple[StepLeg, ...]
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class RelaySeries:
    """A relay experiment: times since its start [s], positions relative to the relay's reference [rad or m].

    ``switches``: times at which the relay switched; ``last_from``: start of the last ``periods``; ``signals``: the
    signals plotted.
    """

    name: str
    signals: PlottedSignals
    position: Curve
    rate: Curve | None
    output: Curve | None
    switches: Curve
    hysteresis: float
    last_from: float


def step_series(trial: Trial | None, watched: PlottedSignals, windows: Sequence[float] = ()) -> StepSeries | None:
    """Return the step in *trial*; None if it contains no step, because none was flown or the trial ended before it.

    The marks ``target`` with ``value`` [rad or m] and ``phase`` (``hold``, ``step``, ``back``) locate it.
    windows : seconds of each leg to plot; without one, the whole leg.
    """
    if trial is None or watched.position not in trial:
        return None
    targets = [m for m in trial.marks if m.kind == "target" and "value" in m.detail]
    step = next((i for i, m in enumerate(targets) if m.detail.get("phase") == "step"), None)
    if step is None:
        return None
    base = _value_before(targets, step, trial[watched.position])
    values = [0.0, *(float(m.detail["value"]) - base for m in targets[step:])]
    ends = [*(m.t for m in targets[step + 1 :]), trial.end]
    legs = []
    for k, (mark, end) in enumerate(zip(targets[step:], ends, strict=True)):
        window = windows[k] if k < len(windows) else end - mark.t
        leg = _leg(trial, watched, mark.t, min(window, end - mark.t), base, (values[k], values[k + 1]))
        if leg is not None:
            legs.append(leg)
    return StepSeries(tuple(legs), values[1]) if legs else None


def _leg(
    trial: Trial, watched: PlottedSignals, start: float, window: float, base: float, target: tuple[float, float]
) -> StepLeg | None:
    """Return *window* [s] of *trial* from *start* [s], with two seconds before it. None for fewer than two samples.

    target : the reference before and from *start*, relative to the *base* [rad or m].
    """
    begin, end = max(start - LEAD, trial.start), start + window
    position = _from(trial[watched.position].between(begin, end), start, base)
    if len(position) < 2 or not window > 0.0:
        return None
    output = trial[watched.force].between(begin, end) if watched.force in trial else None
    times, values = np.array([begin - start, 0.0, window]), np.array([target[0], target[1], target[1]])
    return StepLeg(position, Curve(times, values), None if output is None else _from(output, start, 0.0))


LEAD = 2.0
"""Time [s] plotted before a command. Project choice."""


def _value_before(targets: list[Mark], step: int, position: Channel) -> float:
    if step > 0:
        return float(targets[step - 1].detail["value"])
    return position.held_at(targets[step].t)


def relay_series(trial: Trial, watched: PlottedSignals, periods: int = 5) -> RelaySeries | None:
    """Return the last :data:`MOST_PERIODS` periods of the relay experiment in *trial*; None if it has no usable
    position.
    """
    if watched.position not in trial:
        return None
    start = trial.start
    trial = _last_periods(trial)
    reference = _number(trial, "reference", float("nan"))
    if not np.isfinite(reference):
        values = trial[watched.position].values
        reference = float(np.nanmean(values)) if np.isfinite(values).any() else 0.0
    position = _from(trial[watched.position], start, reference)
    if len(position) < 2:
        return None
    switched = np.array([m.t - start for m in trial.marks if m.kind == "switch"], dtype=np.float64)
    at = np.interp(switched, position.t, position.y)
    first = float(switched[-2 * periods - 1]) if len(switched) > 2 * periods else float(position.t[0])
    return RelaySeries(
        name=trial.name,
        signals=watched,
        position=position,
        rate=_from(trial[watched.velocity], start, 0.0) if watched.velocity in trial else None,
        output=_from(trial[watched.force], start, 0.0) if watched.force in trial else None,
        switches=Curve(switched, at),
        hysteresis=_number(trial, "x_a", float("nan")),
        last_from=first,
    )


def _last_periods(trial: Trial) -> Trial:
    switches = [m.t for m in trial.marks if m.kind == "switch"]
    if len(switches) <= 2 * MOST_PERIODS:
        return trial
    return trial.between(switches[-2 * MOST_PERIODS], trial.end)


def _number(trial: Trial, key: str, missing: float) -> float:
    value = trial.meta.get(key)
    return float(value) if isinstance(value, int | float) else missing


def _from(channel: Channel, start: float, base: float) -> Curve:
    return finite(channel.t - start, channel.values - base)


MOST_RELAYS = 6
"""Largest number of relay experiments, and of fit traces, plotted, so that the page stays small. Project choice."""


def step_figure(story: TuneStory) -> Iterator[Figure]:
    """Yield the figure of the step before and after the tune, or of the predicted step."""
    yield Figure("step", _step_caption(story), partial(_draw_step, story))


def relay_figures(story: TuneStory) -> Iterator[Figure]:
    """Yield a figure of each relay experiment, then one of the limit cycles of each signal."""
    flown = {run.name: run for run in story.relays}
    candidates = (relay_series(trial, story.signals_of(trial)) for trial in story.relays[:MOST_RELAYS])
    relays = [series for series in candidates if series is not None]
    for i, relay in enumerate(relays, start=1):
        noun = relay.signals.noun
        caption = f"Relay experiment '{relay.name}': {noun} relative to its reference, with the relay switches marked."
        if flown[relay.name].reason:
            caption += f" End: {flown[relay.name].reason}."
        if not len(relay.switches):
            caption = f"Throttle steps '{relay.name}': {noun} relative to its value before the first step."
        yield Figure(f"relay-{i}", caption, partial(_draw_relay, relay, story))
    for signals in dict.fromkeys(relay.signals for relay in relays):
        caption = f"Limit cycles: rate of change against {signals.noun}. Bold: the last periods (at most five)."
        alike = [relay for relay in relays if relay.signals == signals]
        yield Figure(f"cycle-{signals.position}", caption, partial(_draw_cycles, alike, signals))


def fit_figures(story: TuneStory) -> Iterator[Figure]:
    """Yield a figure with model and measurement of each fitted run."""
    flown = {run.name: run for run in story.relays}
    for i, trace in enumerate(story.fit.traces[:MOST_RELAYS] if story.fit else (), start=1):
        model = story.fit.model if story.fit else None
        below = " and the input" if inputs_of(model, flown.get(trace.run)) else ""
        caption = f"Model and measurement of '{trace.run}', with the 95 % band. Below: the residual{below}."
        noun = PLOTTED_SIGNALS.get(trace.signal, story.experiment_signals).noun
        yield Figure(f"fit-{i}", caption, partial(draw_fit, trace, flown.get(trace.run), model, noun))


def model_figures(story: TuneStory) -> Iterator[Figure]:
    """Yield a figure of the parameters' uncertainties, and one of the thrust curve if thrust is not proportional to
    output.
    """
    if story.fit is not None:
        yield Figure("intervals", INTERVALS_CAPTION, partial(draw_intervals, story.fit.parameters))
    proposal = story.proposal
    if proposal is not None and proposal.actuator is not None and is_bent(proposal.actuator):
        caption = "Thrust curve of the design model: force over output."
        yield Figure("thrust", caption, partial(draw_thrust, proposal.actuator, _levels(story)))


def bode_figure(story: TuneStory) -> Iterator[Figure]:
    """Yield the Bode plot of the loops with old and new gains, if they were designed by frequency response."""
    proposal = story.proposal
    if proposal is not None and all(proposal.loops):
        margins = [loop_margins(loops) for loops in proposal.loops]
        several = any(len(loops) > 1 for loops in proposal.loops)
        yield Figure("bode", _bode_caption(margins, several=several), partial(draw_bode, proposal.loops, margins))


def track_figure(story: TuneStory) -> Figure:
    """Return the figure with the track over ground of all runs."""
    runs = {t.name: t for t in (story.step_before, *story.relays, story.step_after) if t is not None}
    return Figure("track", "Track over ground, north up.", partial(draw_track, runs))


def route_figure(story: TuneStory) -> Figure:
    """Return the tracks of a mission and its route."""
    return Figure("route", "Track over ground, north up; black: the route.", partial(_draw_route, story.missions))


def _draw_route(missions: Sequence[Trial]) -> Drawing | None:
    drawing = draw_track({trial.name: trial for trial in missions})
    if drawing is None:
        return None
    meta, axes = missions[-1].meta, drawing.axes[0]
    x, y = (np.asarray(meta[name][1:-1], dtype=float) for name in ("waypoints_x", "waypoints_y"))
    axes.plot(y, x, color=INK, linewidth=0.8, zorder=0)
    return drawing


def stays_figure(story: TuneStory) -> Figure:
    """Return the tracks of the steps and pushes of a position tune."""
    runs = {trial.name: trial for trial in story.stays}
    return Figure("stays", "Track over ground, north up: steps and pushes.", partial(draw_track, runs))


def _levels(story: TuneStory) -> list[float]:
    """Return the normalised outputs that were held in the experiments."""
    held = [t.meta.get("levels", [t.meta.get("C", math.nan), -t.meta.get("C", math.nan)]) for t in story.relays]
    return [float(v) for levels in held for v in levels if math.isfinite(v)]


def _bode_caption(margins: Sequence[LoopMargins], *, several: bool) -> str:
    words = []
    for margin, label in zip(margins, ("present", "new"), strict=True):
        if not margin.stable:
            words.append(f"{label} gains: unstable")
            continue
        gain = f"{format_number(margin.gain, 3)} in gain" if math.isfinite(margin.gain) else "no limit in gain"
        words.append(f"{label} gains: {gain}, {format_quantity(margin.phase, 'rad', 3)} in phase")
    thin_lines = " Thin lines: the loop at other speeds and outputs." if several else ""
    told = "; ".join(words)
    return f"Bode plot of the design model, with the loop opened at the actuator. Margins: {told}.{thin_lines}"


def _noun(watched: PlottedSignals) -> tuple[str, str, str]:
    """Return the signal's name, its display unit, and the rate's unit."""
    unit, _ = to_people(watched.unit)
    return watched.noun, unit, f"{unit}/s"


def _step_caption(story: TuneStory) -> str:
    what = _noun(story.stepped)[0]
    if story.step_before is None and story.step_after is None:
        return f"Predicted (not measured) {what} step with the old and the new gains."
    if story.step_before is None or story.step_after is None:
        flown = step_series(story.step_after if story.step_before is None else story.step_before, story.stepped)
        if flown is not None and len(flown.legs) < 2:
            return f"Measured {what} step, which ended before the step back. Below: the actuator."
        return f"Measured {what} step (first) and step back (second). Below: the actuator."
    return (
        f"The same {what} step (first) and step back (second), measured with the old and the new gains, over the time "
        "used for the comparison. Below: the actuator."
    )


def _draw_step(story: TuneStory) -> Drawing | None:
    one, other = story.step_before, story.step_after
    windows = common_windows(one, other) if one is not None and other is not None else ()
    before, after = (step_series(run, story.stepped, windows) for run in (one, other))
    flown = [series for series in (before, after) if series is not None]
    if not flown and story.proposal is None:
        return None
    what, unit, _ = _noun(story.stepped)
    count = max((len(series.legs) for series in flown), default=1)
    figure, columns = new_columns(count, (2.6, 1.1))
    for k, (top, bottom) in enumerate(columns):
        legs = [(s.legs[k], colour) for s, colour in ((before, BEFORE), (after, AFTER)) if s and k < len(s.legs)]
        _draw_targets(top, legs, story)
        if k == 0:
            _draw_predictions(top, bottom, flown[0].size if flown else None, story)
        for leg, colour in legs:
            _line(top, leg.position, story.stepped, colour, "before" if colour == BEFORE else "after")
            _draw_output(bottom, leg.output, story, colour)
        if legs:  # a prediction goes on for longer than what was flown and compared
            top.set_xlim(-LEAD, max(float(leg.target.t[-1]) for leg, _ in legs))
        bottom.set_xlabel("time since the step back [s]" if k else "time since the step [s]")
    top, bottom = columns[0]
    top.set_ylabel(f"change of {what} [{unit}]")
    if SIGNALS[story.stepped.position].down:
        top.invert_yaxis()  # shared by the row: depth grows downwards
    _label_output(bottom, story, story.dof.force)
    legend(top)
    return figure


def _draw_targets(axes: Axes, legs: Sequence[tuple[StepLeg, str]], story: TuneStory) -> None:
    """Plot the target of each leg. Coinciding targets are plotted once, in grey."""
    targets = [(leg.target, colour) for leg, colour in legs]
    if not targets and story.proposal is not None:
        targets = [(_predicted(story.proposal.after, "target"), FAINT)]
    alike = all(np.allclose(target.y, targets[0][0].y, rtol=0.01) for target, _ in targets)
    for target, colour in targets[:1] if alike else targets:
        label = "target" if alike else f"target {'before' if colour == BEFORE else 'after'}"
        shown = FAINT if alike else colour
        axes.step(target.t, _people(story.stepped) * target.y, where="post", color=shown, lw=1.0, ls="--", label=label)


def _draw_predictions(top: Axes, bottom: Axes, size: float | None, story: TuneStory) -> None:
    """Plot the predicted step, either over a measured step of the same *size* or alone (None)."""
    if story.proposal is None:
        return
    old, new = story.proposal.before, story.proposal.after
    target = _predicted(new, "target").y
    if size is not None and not (len(target) and np.isclose(target[-1], size, rtol=0.01)):
        return
    if story.proposal.is_matched:
        _line(top, _predicted(new, "wanted"), story.stepped, WANTED, "reference model", width=1.0)
    _line(top, _predicted(new, "position"), story.stepped, AFTER, "after, predicted", style=":")
    if size is None:
        _line(top, _predicted(old, "position"), story.stepped, BEFORE, "before, predicted", style=":")
        _draw_output(bottom, finite(old.t, old.output), story, BEFORE)
        _draw_output(bottom, finite(new.t, new.output), story, AFTER)


def _predicted(prediction: Prediction, name: str) -> Curve:
    base = float(prediction.position[0]) if len(prediction.position) else 0.0
    return finite(prediction.t, getattr(prediction, name) - base)


def _draw_relay(relay: RelaySeries, story: TuneStory) -> Drawing:
    plotted = relay.signals
    figure, (top, bottom) = new_axes((1.9, 0.9))
    scale = _people(plotted)
    what, unit, _ = _noun(plotted)
    if np.isfinite(relay.hysteresis):
        for sign in (-1.0, 1.0):
            label = "switching value" if sign > 0 else None
            axes_level = sign * scale * relay.hysteresis
            top.axhline(axes_level, color=FAINT, lw=0.9, ls="--", label=label)
    _line(top, relay.position, plotted, AFTER, what)
    if len(relay.switches):
        top.plot(
            relay.switches.t,
            scale * relay.switches.y,
            "o",
            ms=4.5,
            mfc=PAPER,
            mec=BEFORE,
            mew=1.2,
            label="switching",
        )
        top.axvspan(relay.last_from, float(relay.position.t[-1]), color=BAND, alpha=0.18, lw=0)
    top.set_ylabel(f"{what} from reference [{unit}]")
    if SIGNALS[plotted.position].down:
        top.invert_yaxis()  # depth grows downwards
    _draw_output(bottom, relay.output, story, INK)
    _label_output(bottom, story, plotted.force)
    bottom.set_xlabel("time [s] (shaded: the last periods, at most five)" if len(relay.switches) else "time [s]")
    legend(top)
    return figure


def _draw_cycles(relays: Sequence[RelaySeries], plotted: PlottedSignals) -> Drawing | None:
    shown = [relay for relay in relays if relay.rate is not None and len(relay.rate)]
    if not shown:
        return None
    figure, (axes,) = new_axes((3.0,), share=False)
    what, unit, rate_unit = _noun(plotted)
    for relay, colour in zip(shown, COLOURS, strict=False):
        assert relay.rate is not None
        rate = np.interp(relay.position.t, relay.rate.t, relay.rate.y)
        x, y = _people(plotted) * relay.position.y, _people(plotted) * rate
        last = relay.position.t >= relay.last_from
        every = max(1, len(x) // 1500)
        axes.plot(x[::every], y[::every], color=colour, lw=0.6, alpha=0.35)
        axes.plot(x[last][::every], y[last][::every], color=colour, lw=1.4, label=relay.name)
    axes.set_xlabel(f"{what} from reference [{unit}]")
    axes.set_ylabel(f"rate [{rate_unit}]")
    legend(axes)
    return figure


def _people(watched: PlottedSignals) -> float:
    return to_people(watched.unit)[1]


def _line(
    axes: Axes, curve: Curve, watched: PlottedSignals, colour: str, label: str, width: float = 1.5, style: str = "-"
) -> None:
    few = thin(curve)
    axes.plot(few.t, _people(watched) * few.y, color=colour, lw=width, ls=style, label=label)


def _draw_output(axes: Axes, curve: Curve | None, story: TuneStory, colour: str) -> None:
    if curve is None or not len(curve):
        return
    few = thin(curve)
    axes.step(few.t, _output_scale(story) * few.y, where="post", color=colour, lw=1.0)


def _label_output(axes: Axes, story: TuneStory, force: str) -> None:
    unit = "% of full output" if _output_scale(story) != 1.0 else pretty_unit(_output_unit(story))
    axes.set_ylabel(f"{force} [{unit}]")


def _output_unit(story: TuneStory) -> str:
    trials = (story.step_before, story.step_after, *story.relays)
    units = (t[story.dof.force].unit for t in trials if t is not None and story.dof.force in t)
    return next(units, "1")


def _output_scale(story: TuneStory) -> float:
    return 100.0 if _output_unit(story) == "1" else 1.0
