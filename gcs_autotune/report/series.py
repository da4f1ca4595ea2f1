"""Curves taken out of trials, ready to be drawn: relative to where the manoeuvre began, finite, thinned."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.report.story import Watched
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["Curve", "RelaySeries", "StepSeries", "finite", "relay_series", "step_series", "thin"]

Array = NDArray[np.float64]

MOST_PERIODS = 60
"""Periods of a self-oscillation drawn at most. Chosen: twice what an experiment may last; more is solid block."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """t, y : (n,) in SI units, all finite."""

    t: Array
    y: Array

    def __len__(self) -> int:
        return len(self.t)


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


def finite(t: Array, y: Array) -> Curve:
    """Return the samples where both are finite."""
    keep = np.isfinite(t) & np.isfinite(y)
    return Curve(t[keep], y[keep])


def thin(curve: Curve, most: int = 600) -> Curve:
    """Return at most about *most* samples that keep every bucket's least and greatest value."""
    n = len(curve)
    if n <= most:
        return curve
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    keep: set[int] = {0, n - 1}
    for low, high in itertools.pairwise(edges):
        part = curve.y[low:high]
        keep.update((low + int(np.argmin(part)), low + int(np.argmax(part))))
    index = np.array(sorted(keep))
    return Curve(curve.t[index], curve.y[index])


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
