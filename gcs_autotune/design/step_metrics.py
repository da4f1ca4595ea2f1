"""Measure how well a step was followed, by the same criteria for simulated and flown steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import SETTLED
from gcs_autotune.design.result import StepMetrics
from gcs_autotune.errors import NotInformative
from gcs_autotune.jit import called, entry

__all__ = ["StepError", "combine", "error_behind", "noise_floor", "step_error", "step_metrics"]

Array = NDArray[np.float64]
MIN_SAMPLES = 8
SPIKE = 0.25
"""Deviation of a single sample from its neighbours, relative to the step, above which it is an outlier.

Project choice.
"""
NOISE_STDS = 2.0
"""Number of standard deviations of the noise within which errors count as zero. Project choice."""
QUANTUM = 1.01
"""Number of quanta of the sensor within which errors count as zero. One hundredth is for float32 rounding."""
HALVES = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
"""Half-widths, in samples, of the parabolas that smooth an error. Project choice."""
_HALVES = np.array(HALVES)
INTERVAL = 1.5
"""Half-width, in standard errors, of the intervals that must have a point in common.

The widest parabola for which the intervals have a common point is used. The value is the best on synthetic steps:
larger ones smooth corners, smaller ones leave more noise (tests/design/test_error_estimate.py).
"""
LAST_PART = 1.0 / 3.0
"""Fraction of the record, at its end, from which the steady state is calculated. Project choice."""


def _parabola(half: int) -> tuple[float, float, float, float]:
    """Return sums and errors of the polynomials 1, p and p p - s2 / w over 2 *half* + 1 samples.

    They are the sum s2 of p p, the sum of the square of the third polynomial, s2 / w, and the standard error of the
    parabola at its middle for noise of 1.
    """
    w = 2.0 * half + 1.0
    s2 = half * (half + 1.0) * w / 3.0
    q2 = s2 * (3.0 * half * (half + 1.0) - 1.0) / 5.0 - s2 * s2 / w
    q = s2 / w
    return s2, q2, q, math.sqrt(1.0 / w + q * q / q2)


_PARABOLAS = np.array([_parabola(half) for half in HALVES])


class StepError(NamedTuple):
    """Metrics of a step for a search for gains, as in ``StepMetrics``: ``itae`` [s^2], ``overshoot``, ``rise`` [s]."""

    itae: float
    overshoot: float
    rise: float


def noise_floor(noise_std: float, quantum: float) -> float:
    """Return the error [rad or m] up to which errors count as zero.

    It is twice *noise_std* or 1.01 times *quantum*, whichever is larger.
    """
    return max(NOISE_STDS * noise_std, QUANTUM * quantum)


def combine(metrics: Sequence[StepMetrics]) -> StepMetrics:
    """Return the combined metrics of steps in both directions: the mean of error, travel and times, the shortest span,
    and the worst of the others.
    """
    if not metrics:
        return StepMetrics(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
    mean = {n: float(np.mean([getattr(m, n) for m in metrics])) for n in ("itae", "rise", "settling", "travel")}
    worst = {n: max(getattr(m, n) for m in metrics) for n in ("overshoot", "steady_error", "oscillation")}
    unsettled = [m for m in metrics if math.isnan(m.settling)]
    hidden = bool(unsettled) and all(m.hidden_by_noise for m in unsettled)
    return StepMetrics(**mean, **worst, hidden_by_noise=hidden, span=min(m.span for m in metrics))


def step_metrics(
    t: Array,
    target: Array,
    position: Array,
    output: Array,
    *,
    noise_std: float = 0.0,
    quantum: float = 0.0,
    noise_time: float = 0.0,
) -> StepMetrics:
    """Return the metrics of one step.

    t : (n,) [s], increasing, any spacing. target, position : (n,) [rad or m], headings unwrapped. output : (n,)
        [fraction of full], held until the next sample. Samples before the target moves are the state at rest. If the
        target never moves, the step starts at the first position.
    noise_std, quantum : noise and smallest step of the sensor [rad or m]. Errors within :func:`noise_floor` count as
        zero, and the settling band is never narrower than that. The ITAE is calculated from the error without the noise
        (:func:`error_behind`). Single outliers are replaced by the mean of their neighbours.
    noise_time : time [s] for which one value of the noise lasts, if this exceeds the sampling interval. Examples are
        samples of a moving mean, and simulated samples with such noise.

    Compare only steps recorded over equally long windows, because the ITAE grows with the window.

    Raises
    ------
    NotInformative
        Fewer than eight samples after the step, samples that are not finite, time that runs backwards, or no step.
    """
    t, target, position, output = _checked(t, target, position, output)
    begin, start = _find_step(target, position)
    size = float(target[-1] - start)
    floor = _floor_of(size, noise_std, quantum)
    if len(t) - begin < MIN_SAMPLES:
        raise NotInformative(f"only {len(t) - begin} samples after the step. Record longer or request higher rates")
    smooth = _without_spikes(position, size)[begin:]
    seconds = t[begin:] - t[begin]
    share = (smooth - start) / size
    last = seconds >= seconds[-1] * (1.0 - LAST_PART)
    oscillation = max(0.5 * float(np.ptp(share[last])) - floor, 0.0)
    band = max(SETTLED, floor)
    settling = _settling(seconds, share, band)
    steady_error = abs(float(np.mean(1.0 - share[last])))
    hidden = math.isnan(settling) and steady_error <= band and _is_hidden(seconds, share, band, noise_std / abs(size))
    return StepMetrics(
        **_measured(seconds, share, noise_std / abs(size), floor, noise_time)._asdict(),
        settling=settling,
        steady_error=steady_error,
        travel=float(np.abs(np.diff(output[begin:])).sum() / seconds[-1]),
        oscillation=oscillation,
        hidden_by_noise=hidden,
        span=float(seconds[-1]),
    )


def step_error(
    t: Array, position: Array, size: float, *, noise_std: float = 0.0, quantum: float = 0.0, noise_time: float = 0.0
) -> StepError:
    """Return the metrics of :func:`step_metrics` for a simulated step of *size* from rest at 0, without outliers.

    Raises
    ------
    NotInformative
        The motion is not finite, or the step is within the noise.
    """
    floor = _floor_of(size, noise_std, quantum)
    found = _measured(t - t[0], position / size, noise_std / abs(size), floor, noise_time)
    if not math.isfinite(found.itae):
        raise NotInformative("the simulated step contains samples that are not finite")
    return found


def _floor_of(size: float, noise_std: float, quantum: float) -> float:
    """Return the result of :func:`noise_floor` relative to a step of *size*."""
    floor = noise_floor(noise_std, quantum)
    if abs(size) <= 2.0 * floor:
        raise NotInformative(
            f"there is no step to measure, because the target moved by only {size:.3g}, within the noise. Use a "
            "larger step"
        )
    return floor / abs(size)


def _measured(t: Array, share: Array, noise_std: float, floor: float, noise_time: float) -> StepError:
    """Return the metrics of a motion *share* (n,), relative to the step, at the times *t* (n,) [s] from 0.

    noise_time [s] : interval to which the samples are thinned for the ITAE.
    """
    every, n = max(round(noise_time * (len(t) - 1) / float(t[-1])), 1), len(t)
    levels, interval = (0.1, 0.9), INTERVAL * noise_std
    work = np.empty((3, n + 1)), np.empty((2, n))
    itae, peak, low, high = _read_step(t, share, every, levels, floor, interval, _HALVES, _PARABOLAS, *work)
    return StepError(itae, max(0.0, peak - 1.0 - floor), high - low)


def error_behind(error: Array, std: float) -> Array:
    """Return *error* (n,), sampled at even intervals, without its white measurement noise of standard deviation *std*.

    The noise of single readings above a floor accumulates, up to a third of the ITAE of a fast ROV. Assuming a tenth
    more noise reduced that error by a quarter. Each sample is therefore taken from a parabola fitted to its neighbours
    (Savitzky1964). The parabola is as wide as the intersection of confidence intervals permits: the intervals of all
    narrower parabolas must have a point in common with that of the parabola (Goldenshluger1997). The parabola is narrow
    where the craft turns, and wide where it rests.
    """
    error = np.ascontiguousarray(error)  # one kind of array: the kernel is compiled for each kind
    found = error.copy()
    if std > 0.0:
        _read_behind(error, np.empty((3, len(error) + 1)), _HALVES, _PARABOLAS, INTERVAL * std, found)
    return found


@entry
def _read_behind(
    error: Array, sums: Array, halves: NDArray[np.int64], parabolas: Array, interval: float, found: Array
) -> None:
    """Fill *found* (n,) with the smoothed error, and *sums* (3, n + 1) with cumulative sums.

    *sums* are those of *error* before each sample, times its index to the power 0, 1, 2.
    With them the cost of a parabola does not depend on its width. Its three coefficients follow from polynomials
    orthogonal over the window: ``1``, ``p`` and ``p p - s2 / w`` of the distance ``p`` from its middle.
    """
    n = len(error)
    sums[:, 0] = 0.0
    for i in range(n):
        place = i - 0.5 * n
        sums[0, i + 1] = sums[0, i] + error[i]
        sums[1, i + 1] = sums[1, i] + error[i] * place
        sums[2, i + 1] = sums[2, i] + error[i] * place * place
    for i in range(n):
        low, high, least = error[i] - interval, error[i] + interval, 1.0
        for k in range(len(halves)):
            half = halves[k]
            width = 2 * half + 1
            if width > n:
                break
            first = i - half
            first = 0 if first < 0 else (n - width if first > n - width else first)
            middle, w = first + half - 0.5 * n, float(width)
            sum_0 = sums[0, first + width] - sums[0, first]
            sum_1 = sums[1, first + width] - sums[1, first]
            sum_2 = sums[2, first + width] - sums[2, first]
            # About the window's middle: sums of p p and of the square of the third polynomial.
            sum_2 += middle * (middle * sum_0 - 2.0 * sum_1)
            s2, q2, mean_square, middle_error = parabolas[k]
            p = i - first - float(half)
            if p == 0.0:  # as nearly everywhere: a few divisions and a root less
                value = sum_0 / w - mean_square * (sum_2 - sum_0 * s2 / w) / q2
                error_of_it = middle_error
            else:
                sum_1 -= middle * sum_0
                q = p * p - mean_square
                value = sum_0 / w + p * sum_1 / s2 + q * (sum_2 - sum_0 * s2 / w) / q2
                error_of_it = math.sqrt(1.0 / w + p * p / s2 + q * q / q2)
            reach = interval * error_of_it
            low = value - reach if value - reach > low else low
            high = value + reach if value + reach < high else high
            if low > high:
                break
            if error_of_it < least:
                found[i], least = value, error_of_it


@called
def _reached(t: Array, share: Array, i: int, level: float) -> float:
    """Return the time at which *share* reaches *level* between the samples before *i* and *i*."""
    if i == 0:
        return float(t[0])
    return float(t[i - 1] + (level - share[i - 1]) / (share[i] - share[i - 1]) * (t[i] - t[i - 1]))


@entry
def _read_step(
    t: Array,
    share: Array,
    every: int,
    levels: tuple[float, float],
    floor: float,
    interval: float,
    halves: NDArray[np.int64],
    parabolas: Array,
    sums: Array,
    signals: Array,
) -> tuple[float, float, float, float]:
    """Return the ITAE, the largest *share* (n,), and the times at which it first reaches each of two *levels*.

    The ITAE is the integral of time times the part of the error above *floor*. The times are interpolated linearly; NaN
    if a level is never reached.

    every : number of samples, counted from the last, of which one contributes to the ITAE. interval : half-width of the
        interval of one sample, see :func:`error_behind`; 0 for no noise.
    sums (3, n + 1), signals (2, n) : memory.
    """
    n = len(t)
    first, count = (n - 1) % every, (n - 1) // every + 1
    error, found = signals[0, :count], signals[1, :count]
    for i in range(count):
        error[i] = found[i] = 1.0 - share[first + i * every]
    if interval > 0.0:
        _read_behind(error, sums, halves, parabolas, interval, found)
    itae = last = 0.0
    for i in range(count):
        k = first + i * every
        beyond = abs(found[i]) - floor
        weighted = t[k] * (0.0 if beyond < 0.0 else beyond)  # not a number stays what it is
        if i > 0:
            itae += 0.5 * (t[k] - t[k - every]) * (last + weighted)
        last = weighted
    peak, low, high = share[0], math.nan, math.nan
    for i in range(n):
        peak = share[i] if share[i] > peak else peak
        if math.isnan(low) and share[i] >= levels[0]:
            low = _reached(t, share, i, levels[0])
        if math.isnan(high) and share[i] >= levels[1]:
            high = _reached(t, share, i, levels[1])
    return itae, peak, low, high


def _checked(*signals: Array) -> list[Array]:
    arrays = [np.asarray(s, dtype=np.float64) for s in signals]
    if len({a.shape for a in arrays}) != 1 or arrays[0].ndim != 1:
        raise NotInformative(
            "time, target, position and output of a step must be one-dimensional and have the same number of samples"
        )
    if not np.all(np.isfinite(np.array(arrays))):
        raise NotInformative("the step contains samples that are not finite. Drop them first")
    if len(arrays[0]) < MIN_SAMPLES:
        raise NotInformative(f"a step of {len(arrays[0])} samples is too short to measure. Record longer")
    if np.any(np.diff(arrays[0]) < 0.0) or arrays[0][-1] <= arrays[0][0]:
        raise NotInformative("the time of the step does not increase. Check the recording")
    return arrays


def _find_step(target: Array, position: Array) -> tuple[int, float]:
    """Return the index at which the target first moves, and the position at which the step starts."""
    moved = np.flatnonzero(target != target[0])
    if len(moved):
        return int(moved[0]), float(target[0])
    return 0, float(np.median(position[:3]))


def _without_spikes(values: Array, size: float) -> Array:
    """Replace single samples that deviate from both neighbours by more than a quarter of the step.

    The two neighbours must agree with each other.
    """
    middle = 0.5 * (values[:-2] + values[2:])
    lone = np.abs(values[1:-1] - middle) > SPIKE * abs(size)
    lone &= np.abs(values[2:] - values[:-2]) < SPIKE * abs(size)
    clean = values.copy()
    clean[1:-1] = np.where(lone, middle, values[1:-1])
    return clean


def _settling(t: Array, share: Array, band: float) -> float:
    """Return the time from which *share* stays within *band* of 1; NaN if it does not by the last tenth."""
    outside = np.flatnonzero(np.abs(share - 1.0) > band)
    if not len(outside):
        return 0.0
    i = int(outside[-1]) + 1
    return float(t[i]) if i < len(t) and t[i] <= 0.9 * t[-1] else math.nan


def _is_hidden(t: Array, share: Array, band: float, noise_std: float) -> bool:
    """Return whether only the noise of single readings leaves *band*, while the smoothed motion ends inside it."""
    motion = 1.0 - error_behind(1.0 - share, noise_std)
    return noise_std > 0.0 and math.isfinite(_settling(t, motion, band))
