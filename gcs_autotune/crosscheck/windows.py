"""Calculate the slopes of a signal over short windows, with one linear operator for both sides of a comparison.

The slope of a position over a window is a weighted sum of its samples. The same weights, applied to the integral of the
rate, yield the slope that the rate predicts, for any stamps. Gaps and filters then affect both sides equally.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.trial import Channel

__all__ = ["Series", "Windows", "integral", "series", "windows_on"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FEWEST = 20
"""Minimum number of samples of a channel for a comparison. Project choice."""
MOST = 20000
"""Maximum number of samples of one channel.

Longer channels are thinned, which does not change slow motion. Project choice.
"""
MOST_WINDOWS = 600
LEAST_IN_WINDOW = 4
NO_RADIANS = 1.0
"""Median step between samples [rad] above which an angle must be in degrees, whatever its column header states.

The angle is then not unwrapped. Project choice.
"""
FILLED, GAP = 0.7, 0.4
"""Limits for the samples of a window, as fractions of its length. Project choice.

- ``FILLED``: least extent of the samples.
- ``GAP``: longest gap between two samples.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One channel, prepared for a comparison.

    t, x : (n,) strictly increasing stamps [s], and values, with angles unwrapped.
    beat : time [s] between two *different* values.
    noise : standard deviation of the changes from sample to sample.
    """

    name: str
    t: Array
    x: Array
    beat: float
    noise: float


def series(channel: Channel, *, angle: bool = False) -> Series | None:
    """Return *channel* as a :class:`Series`, or None if it has too few samples.

    angle : whether the values are angles, which are then unwrapped.
    """
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    t, first = np.unique(channel.t[good], return_index=True)
    x = channel.values[good][first]
    if angle and len(x) > 1 and float(np.median(np.abs(np.diff(x)))) < NO_RADIANS:
        x = np.unwrap(x)
    if len(t) > MOST:
        every = -(-len(t) // MOST)
        t, x = t[::every], x[::every]
    if len(t) < FEWEST:
        return None
    steps = np.diff(x)
    changes = int(np.count_nonzero(steps))
    nominal = float(np.median(np.diff(t)))
    span = float(np.sum(np.diff(t)[np.diff(t) < 10.0 * nominal]))
    beat = max(nominal, span / changes) if changes else nominal
    return Series(channel.name, t, x, min(beat, 10.0 * nominal), _noise(x, steps))


def _noise(x: Array, steps: Array) -> float:
    """Return the noise from second differences, but at least the rounding noise of a coarse sensor."""
    second = np.abs(np.diff(x, n=2))
    noise = float(np.mean(np.minimum(second, 10.0 * float(np.median(second)) + 1e-300))) * 1.2533 / math.sqrt(6.0)
    moving = np.abs(steps[steps != 0.0])
    if len(moving) and len(moving) < 0.7 * len(steps):
        noise = max(noise, float(np.median(moving)) / math.sqrt(12.0))
    return noise


def integral(rate: Series) -> Array:
    """Return the integral (n,) of *rate*, starting at its first stamp."""
    steps = 0.5 * (rate.x[1:] + rate.x[:-1]) * np.diff(rate.t)
    return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of length ``span`` [s] on the stamps of a signal. The method ``slopes`` calculates the slopes over them.

    middle : (m,) their centres [s].
    gain : (m,) standard deviation of a slope per standard deviation of a sample.
    overlap : number of windows that contain the same sample.
    """

    span: float
    middle: Array
    gain: Array
    overlap: float
    which: Indices
    weights: Array
    starts: Indices

    def __len__(self) -> int:
        return len(self.middle)

    def slopes(self, x: Array) -> Array:
        """Return the slope (m,) over each window of *x* (n,), the values at the stamps."""
        found: Array = np.add.reduceat(self.weights * x[self.which], self.starts)
        return found


def windows_on(t: Array, span: float, start: float, end: float, gaps: Array | None = None) -> Windows | None:
    """Return windows of length *span* [s] on the stamps *t* (n,) between *start* and *end* [s], or None if there are
    none.

    gaps : (k, 2) time intervals [s] that no window may overlap.
    """
    hop = max(0.5 * span, (end - start - span) / MOST_WINDOWS)
    if end - start < span:
        return None
    begin = np.arange(start, end - span + 1e-9, hop)
    low, high = np.searchsorted(t, begin), np.searchsorted(t, begin + span, side="right")
    keep = high - low >= LEAST_IN_WINDOW
    if gaps is not None and len(gaps):
        touching = np.searchsorted(gaps[:, 0], begin + span) - np.searchsorted(gaps[:, 1], begin)
        keep &= touching <= 0
    low, high, begin = low[keep], high[keep], begin[keep]
    if not len(low):
        return None
    keep = (t[high - 1] - t[low] >= FILLED * span) & (_longest(t, low, high) <= GAP * span)
    low, high, begin = low[keep], high[keep], begin[keep]
    if not len(low):
        return None
    counts = high - low
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    which = np.repeat(low - starts, counts) + np.arange(int(counts.sum()))
    middle = np.add.reduceat(t[which], starts) / counts
    offset = t[which] - np.repeat(middle, counts)
    spread = np.add.reduceat(offset**2, starts)
    weights = offset / np.repeat(spread, counts)
    return Windows(span, middle, 1.0 / np.sqrt(spread), max(span / hop, 1.0), which, weights, starts)


def _longest(t: Array, low: Indices, high: Indices) -> Array:
    """Return the longest interval between samples in each window."""
    counts = high - low - 1
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    which = np.repeat(low - starts, counts) + np.arange(int(counts.sum()))
    longest: Array = np.maximum.reduceat(np.diff(t)[which], starts)
    return longest


def gaps_of(t: Array, longest: float) -> Array:
    """Return the gaps (k, 2) between samples that are longer than *longest* [s]."""
    wide = np.flatnonzero(np.diff(t) > longest)
    return np.column_stack([t[wide], t[wide + 1]])
