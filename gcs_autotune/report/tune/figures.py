"""The pictures of a tune: step before and after, self-oscillation, limit cycle, fit against measurement.

Each function returns a figure, or None when the story does not reach that far. Matplotlib is imported when
the first one is drawn. Angles are in degrees here, and only here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.design import Prediction
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
    pens,
    to_svg,
)
from gcs_autotune.report.toolkit.figures import (
    COLOURS,
    INTERVALS_CAPTION,
    Curve,
    draw_fit,
    draw_intervals,
    draw_thrust,
    draw_track,
    finite,
    is_bent,
    thin,
)
from gcs_autotune.report.toolkit.page import Picture
from gcs_autotune.report.toolkit.wording import format_number, format_quantity, pretty_unit, to_people
from gcs_autotune.report.tune.bode import LoopMargins, draw_bode, loop_margins
from gcs_autotune.report.tune.story import WATCHED, TuneStory, Watched
from gcs_autotune.trial import Channel, Mark, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["MOST_RELAYS", "RelaySeries", "StepSeries", "draw_pictures", "relay_series", "step_series"]


MOST_PERIODS = 60
"""Periods of a self-oscillation drawn at most. Chosen: twice what an experiment may last; more is solid block."""


@dataclass(frozen=True, slots=True, eq=False)
class StepSeries:
    """A step and the step back: times from the step [s], positions from where it began [rad or m]."""

    position: Curve
    target: Curve
    output: Curve | None
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class RelaySeries:
    """A self-oscillation: times from its beginning [s], positions from the relay's reference [rad or m].

    ``switches`` are where the relay switched; ``last_from`` the time from which the last ``periods`` run.
    """

    name: str
    position: Curve
    rate: Curve | None
    output: Curve | None
    switches: Curve
    hysteresis: float
    last_from: float


def step_series(trial: Trial | None, watched: Watched) -> StepSeries | None:
    """Return the step in *trial*, or None when it has none (it was never flown, or ended before it).

    The marks ``target`` with ``value`` [rad or m] and ``phase`` (``hold``, ``step``, ``back``) tell where it is.
    """
    if trial is None or watched.position not in trial:
        return None
    targets = [m for m in trial.marks if m.kind == "target" and "value" in m.detail]
    step = next((i for i, m in enumerate(targets) if m.detail.get("phase") == "step"), None)
    if step is None:
        return None
    start, base = targets[step].t, _value_before(targets, step, trial[watched.position])
    lead = min(2.0, start - trial.start)
    position = _from(trial[watched.position].between(start - lead, trial.end), start, base)
    if len(position) < 2:
        return None
    flown = targets[step:]
    times = [-lead, *(m.t - start for m in flown), float(position.t[-1])]
    values = [0.0, *(float(m.detail["value"]) - base for m in flown)]
    output = trial[watched.force].between(start - lead, trial.end) if watched.force in trial else None
    return StepSeries(
        position=position,
        target=Curve(np.array(times), np.array([*values, values[-1]])),
        output=None if output is None else _from(output, start, 0.0),
        size=values[1],
    )


def _value_before(targets: list[Mark], step: int, position: Channel) -> float:
    if step > 0:
        return float(targets[step - 1].detail["value"])
    return position.held_at(targets[step].t)


def relay_series(trial: Trial, watched: Watched, periods: int = 5) -> RelaySeries | None:
    """Return the last :data:`MOST_PERIODS` periods in *trial*, or None when it holds no usable position."""
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
"""Relay experiments and fit traces drawn one by one; chosen so that the page stays small."""


def draw_pictures(story: TuneStory) -> tuple[Picture, ...]:
    """Draw everything the story has data for, in the order of the report."""
    drawn = []
    for name, caption, draw in _wanted(story):
        with pens(name):
            figure = draw()
            if figure is not None:
                drawn.append(Picture(name.split("-")[0], caption, to_svg(figure, name, caption)))
    return tuple(drawn)


def _wanted(story: TuneStory) -> Iterator[tuple[str, str, Callable[[], Figure | None]]]:
    swung = story.swung
    what = _noun(swung)[0]
    yield "step", _step_caption(story), partial(_draw_step, story)
    found = (relay_series(trial, swung) for trial in story.relays[:MOST_RELAYS])
    relays = [series for series in found if series is not None]
    flown = {run.name: run for run in story.relays}
    for i, relay in enumerate(relays, start=1):
        caption = f"Self-oscillation '{relay.name}': {what} about its reference, with the switchings marked."
        if flown[relay.name].reason:
            caption += f" It ended so: {flown[relay.name].reason}."
        if not len(relay.switches):
            caption = f"Throttle steps '{relay.name}': {what} against that before the first step."
        yield f"relay-{i}", caption, partial(_draw_relay, relay, story)
    caption = f"Limit cycles: rate of change against {what}. Strong lines: up to five periods at the end."
    yield "cycle", caption, partial(_draw_cycles, relays, swung)
    for i, trace in enumerate(story.fit.traces[:MOST_RELAYS] if story.fit else (), start=1):
        caption = (
            f"Fit against measurement, '{trace.run}', with its 95 % band; below, what the model leaves over and the "
            "input that drove both."
        )
        model = story.fit.model if story.fit else None
        noun = WATCHED.get(trace.signal, swung).noun
        yield f"fit-{i}", caption, partial(draw_fit, trace, flown.get(trace.run), model, noun)
    if story.fit is not None:
        yield "intervals", INTERVALS_CAPTION, partial(draw_intervals, story.fit.parameters)
    proposal = story.proposal
    if proposal is not None and proposal.actuator is not None and is_bent(proposal.actuator):
        caption = "Thrust curve of the model the gains came from: force over output."
        yield "thrust", caption, partial(draw_thrust, proposal.actuator, _levels(story))
    if proposal is not None and all(proposal.loops):
        margins = [loop_margins(loops) for loops in proposal.loops]
        yield "bode", _bode_caption(margins), partial(draw_bode, proposal.loops, margins)
    runs = {t.name: t for t in (story.step_before, *story.relays, story.step_after) if t is not None}
    yield "track", "Track over ground, north up.", partial(draw_track, runs)


def _levels(story: TuneStory) -> list[float]:
    """Return the outputs the experiments held, fractions of full."""
    held = [t.meta.get("levels", [t.meta.get("C", math.nan), -t.meta.get("C", math.nan)]) for t in story.relays]
    return [float(v) for levels in held for v in levels if math.isfinite(v)]


def _bode_caption(margins: Sequence[LoopMargins]) -> str:
    words = []
    for found, label in zip(margins, ("present", "new"), strict=True):
        if not found.stable:
            words.append(f"{label} gains: unstable")
            continue
        gain = f"{format_number(found.gain, 3)} in gain" if math.isfinite(found.gain) else "no limit in gain"
        words.append(f"{label} gains: {gain}, {format_quantity(found.phase, 'rad', 3)} in phase")
    return (
        "The loop opened at the actuator (Bode), on the model the gains came from; margins: "
        + "; ".join(words)
        + ". Thin: the same at other speeds and outputs."
    )


def _noun(watched: Watched) -> tuple[str, str, str]:
    """Return what the signal is called, its unit for people, and the rate's unit."""
    unit, _ = to_people(watched.unit)
    return watched.noun, unit, f"{unit}/s"


def _step_caption(story: TuneStory) -> str:
    what = _noun(story.stepped)[0]
    if story.step_before is None and story.step_after is None:
        return f"Predicted {what} step with the old and the new gains; nothing of this was measured."
    if story.step_before is None or story.step_after is None:
        return f"Measured {what} step and step back; below, the actuator."
    return f"The same {what} step and step back, measured with the old and the new gains; below, the actuator."


def _draw_step(story: TuneStory) -> Figure | None:
    before, after = step_series(story.step_before, story.stepped), step_series(story.step_after, story.stepped)
    what, unit, _ = _noun(story.stepped)
    if before is None and after is None and story.proposal is None:
        return None
    figure, (top, bottom) = new_axes((2.6, 1.1))
    _draw_target(top, after or before, story)
    _draw_predictions(top, bottom, (before, after), story)
    for series, colour, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
        if series is not None:
            _line(top, series.position, story.stepped, colour, label)
            _draw_output(bottom, series.output, story, colour)
    top.set_ylabel(f"{what}, from the start [{unit}]")
    _label_output(bottom, story)
    bottom.set_xlabel("time since the step [s]")
    legend(top)
    return figure


def _draw_target(axes: Axes, series: StepSeries | None, story: TuneStory) -> None:
    if series is not None:
        target = series.target
    elif story.proposal is not None:
        target = _predicted(story.proposal.after, "target")
    else:
        return
    axes.step(target.t, _people(story.stepped) * target.y, where="post", color=FAINT, lw=1.0, ls="--", label="target")


def _draw_predictions(
    top: Axes, bottom: Axes, measured: tuple[StepSeries | None, StepSeries | None], story: TuneStory
) -> None:
    """Draw what the model promises: beside a measured step of the same size, or alone when there is none."""
    if story.proposal is None:
        return
    old, new = story.proposal.before, story.proposal.after
    size = next((s.size for s in measured if s is not None), None)
    target = _predicted(new, "target").y
    if size is not None and not (len(target) and np.isclose(target[-1], size, rtol=0.01)):
        return
    _line(top, _predicted(new, "wanted"), story.stepped, WANTED, "wanted", width=1.0)
    _line(top, _predicted(new, "position"), story.stepped, AFTER, "after, predicted", style=":")
    if size is None:
        _line(top, _predicted(old, "position"), story.stepped, BEFORE, "before, predicted", style=":")
        _draw_output(bottom, finite(old.t, old.output), story, BEFORE)
        _draw_output(bottom, finite(new.t, new.output), story, AFTER)


def _predicted(prediction: Prediction, name: str) -> Curve:
    base = float(prediction.position[0]) if len(prediction.position) else 0.0
    return finite(prediction.t, getattr(prediction, name) - base)


def _draw_relay(relay: RelaySeries, story: TuneStory) -> Figure:
    swung = story.swung
    figure, (top, bottom) = new_axes((1.9, 0.9))
    scale = _people(swung)
    what, unit, _ = _noun(swung)
    if np.isfinite(relay.hysteresis):
        for sign in (-1.0, 1.0):
            label = "set switching value" if sign > 0 else None
            axes_level = sign * scale * relay.hysteresis
            top.axhline(axes_level, color=FAINT, lw=0.9, ls="--", label=label)
    _line(top, relay.position, swung, AFTER, what)
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
    _draw_output(bottom, relay.output, story, INK)
    _label_output(bottom, story)
    bottom.set_xlabel("time [s]; shaded: up to five periods at the end" if len(relay.switches) else "time [s]")
    legend(top)
    return figure


def _draw_cycles(relays: Sequence[RelaySeries], swung: Watched) -> Figure | None:
    shown = [relay for relay in relays if relay.rate is not None and len(relay.rate)]
    if not shown:
        return None
    figure, (axes,) = new_axes((3.0,), share=False)
    what, unit, rate_unit = _noun(swung)
    for relay, colour in zip(shown, COLOURS, strict=False):
        assert relay.rate is not None
        rate = np.interp(relay.position.t, relay.rate.t, relay.rate.y)
        x, y = _people(swung) * relay.position.y, _people(swung) * rate
        last = relay.position.t >= relay.last_from
        every = max(1, len(x) // 1500)
        axes.plot(x[::every], y[::every], color=colour, lw=0.6, alpha=0.35)
        axes.plot(x[last][::every], y[last][::every], color=colour, lw=1.4, label=relay.name)
    axes.set_xlabel(f"{what} from reference [{unit}]")
    axes.set_ylabel(f"rate [{rate_unit}]")
    legend(axes)
    return figure


def _people(watched: Watched) -> float:
    return to_people(watched.unit)[1]


def _line(
    axes: Axes, curve: Curve, watched: Watched, colour: str, label: str, width: float = 1.5, style: str = "-"
) -> None:
    few = thin(curve)
    axes.plot(few.t, _people(watched) * few.y, color=colour, lw=width, ls=style, label=label)


def _draw_output(axes: Axes, curve: Curve | None, story: TuneStory, colour: str) -> None:
    if curve is None or not len(curve):
        return
    few = thin(curve)
    axes.step(few.t, _output_scale(story) * few.y, where="post", color=colour, lw=1.0)


def _label_output(axes: Axes, story: TuneStory) -> None:
    unit = "% of full" if _output_scale(story) != 1.0 else pretty_unit(_output_unit(story))
    axes.set_ylabel(f"{story.dof.force} [{unit}]")


def _output_unit(story: TuneStory) -> str:
    trials = (story.step_before, story.step_after, *story.relays)
    units = (t[story.dof.force].unit for t in trials if t is not None and story.dof.force in t)
    return next(units, "1")


def _output_scale(story: TuneStory) -> float:
    return 100.0 if _output_unit(story) == "1" else 1.0
