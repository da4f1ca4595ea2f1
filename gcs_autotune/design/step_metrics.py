"""How well a step was followed, simulated or measured, by the same ruler."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from gcs_autotune.design.reference_model import SETTLED
from gcs_autotune.design.result import StepMetrics
from gcs_autotune.errors import NotInformative

__all__ = ["combine", "noise_floor", "step_metrics"]

Array = NDArray[np.float64]
MIN_SAMPLES = 8
SPIKE = 0.25
"""Chosen: a lone sample this far from its neighbours, as a fraction of the step, is no motion."""
NOISE_STDS = 2.0
"""Errors within so many standard deviations of the noise count as none."""
QUANTUM = 1.01
"""A reading one quantum off the target is as near as the sensor can tell; the hundredth is for float32 rounding."""
FAR = 5.0
"""Errors further than so many standard deviations from what counts are read as they are."""
LAST_PART = 1.0 / 3.0
"""Share of the record that tells about the steady state."""


def noise_floor(noise_std: float, quantum: float) -> float:
    """Return the error [rad or m] that counts as none: two of *noise_std* or one *quantum*, whichever is larger."""
    return max(NOISE_STDS * noise_std, QUANTUM * quantum)


def combine(found: Sequence[StepMetrics]) -> StepMetrics:
    """Join steps of both directions: error, travel and times are averaged; what has a limit counts as the worst."""
    if not found:
        return StepMetrics(*[math.nan] * 7)
    mean = {n: float(np.mean([getattr(m, n) for m in found])) for n in ("itae", "rise", "settling", "travel")}
    worst = {n: max(getattr(m, n) for m in found) for n in ("overshoot", "steady_error", "oscillation")}
    return StepMetrics(**mean, **worst)


def step_metrics(
    t: Array,
    target: Array,
    position: Array,
    output: Array,
    *,
    noise_std: float = 0.0,
    quantum: float = 0.0,
    unread: float = 0.0,
) -> StepMetrics:
    """Measure one step.

    t : (n,) [s], increasing, any spacing. target, position : (n,) [rad or m], headings unwrapped. output : (n,)
    [fraction of full], held until the next sample. Samples before the target moves are the state at rest; a
    target that never moves is a step from the first position. ``noise_std`` and ``quantum`` (the sensor's smallest
    step) [rad or m]: errors within :func:`noise_floor` count as none, and the settling band is never narrower than
    that. Single wild samples are replaced by their neighbours' mean. Compare only steps recorded over equally long
    windows: ITAE grows with the window.

    unread : standard deviation [rad or m] of the noise that a simulated *position* is without: its error over time is
        then that to be expected of a reading through such noise.

    Raises
    ------
    NotInformative
        Fewer than eight samples after the step, samples that are not finite, time that runs backwards, or no step.
    """
    t, target, position, output = _checked(t, target, position, output)
    begin, start = _find_step(target, position)
    size = float(target[-1] - start)
    floor = noise_floor(noise_std, quantum)
    if abs(size) <= 2.0 * floor:
        raise NotInformative(f"no step to measure: the target moved by {size:.3g}, within the noise; use a larger step")
    floor /= abs(size)
    if len(t) - begin < MIN_SAMPLES:
        raise NotInformative(f"only {len(t) - begin} samples after the step; record longer or ask for higher rates")
    smooth = _without_spikes(position, size)[begin:]
    seconds = t[begin:] - t[begin]
    share = (smooth - start) / size
    error = _beyond(np.abs(1.0 - share), floor, unread / abs(size))
    last = seconds >= seconds[-1] * (1.0 - LAST_PART)
    swing = max(0.5 * float(np.ptp(share[last])) - floor, 0.0)
    return StepMetrics(
        itae=float(np.trapezoid(seconds * error, seconds)),
        overshoot=max(0.0, float(share.max()) - 1.0 - floor),
        rise=_crossing(seconds, share, 0.9) - _crossing(seconds, share, 0.1),
        settling=_settling(seconds, share, max(SETTLED, floor)),
        steady_error=abs(float(np.mean(1.0 - share[last]))),
        travel=float(np.abs(np.diff(output[begin:])).sum() / seconds[-1]),
        oscillation=swing,
    )


def _beyond(error: Array, floor: float, std: float) -> Array:
    """Return by how much sizes of errors (n,) go beyond *floor*: on the mean, once read through normal noise of *std*.

    ``E max(|e + n| - f, 0)``, both tails of which are the loss function of the normal distribution.
    """
    beyond: Array = np.maximum(error - floor, 0.0)
    if std > 0.0:
        near = np.abs(error - floor) < FAR * std
        beyond[near] = sum(
            std * np.exp(-0.5 * (tail / std) ** 2) / math.sqrt(math.tau) + tail * ndtr(tail / std)
            for tail in (error[near] - floor, -error[near] - floor)
        )
    return beyond


def _checked(*signals: Array) -> list[Array]:
    arrays = [np.asarray(s, dtype=np.float64) for s in signals]
    if len({a.shape for a in arrays}) != 1 or arrays[0].ndim != 1:
        raise NotInformative("time, target, position and output of a step must be equally long")
    if not all(np.all(np.isfinite(a)) for a in arrays):
        raise NotInformative("the step holds samples that are not finite; drop them first")
    if len(arrays[0]) < MIN_SAMPLES:
        raise NotInformative(f"a step of {len(arrays[0])} samples cannot be measured; record longer")
    if np.any(np.diff(arrays[0]) < 0.0) or arrays[0][-1] <= arrays[0][0]:
        raise NotInformative("the step's time does not run forwards")
    return arrays


def _find_step(target: Array, position: Array) -> tuple[int, float]:
    """Return the index at which the target first moves, and where the step starts from."""
    moved = np.flatnonzero(target != target[0])
    if len(moved):
        return int(moved[0]), float(target[0])
    return 0, float(np.median(position[:3]))


def _without_spikes(values: Array, size: float) -> Array:
    """Replace samples that leave both neighbours, which agree with each other, by a quarter of the step."""
    middle = 0.5 * (values[:-2] + values[2:])
    lone = np.abs(values[1:-1] - middle) > SPIKE * abs(size)
    lone &= np.abs(values[2:] - values[:-2]) < SPIKE * abs(size)
    clean = values.copy()
    clean[1:-1] = np.where(lone, middle, values[1:-1])
    return clean


def _crossing(t: Array, share: Array, level: float) -> float:
    """Return when *share* first reaches *level*, between samples by a straight line; NaN when never."""
    reached = np.flatnonzero(share >= level)
    if not len(reached):
        return math.nan
    i = int(reached[0])
    if i == 0:
        return float(t[0])
    part = (level - share[i - 1]) / (share[i] - share[i - 1])
    return float(t[i - 1] + part * (t[i] - t[i - 1]))


def _settling(t: Array, share: Array, band: float) -> float:
    """Return when *share* enters *band* around 1 for good; NaN when it has not by the last tenth."""
    outside = np.flatnonzero(np.abs(share - 1.0) > band)
    if not len(outside):
        return 0.0
    i = int(outside[-1]) + 1
    return float(t[i]) if i < len(t) and t[i] <= 0.9 * t[-1] else math.nan
