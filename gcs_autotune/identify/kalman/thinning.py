"""Reduce records to one signal at a suitable interval, with inputs averaged accordingly.

Inputs become means over a fraction of the interval, or are smoothed as the signal was.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import Drive
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.slow_imports import scipy_signal

__all__ = ["smoothed_drive", "thinned_to"]

Array = NDArray[np.float64]

PER_SAMPLE = 4.0
"""Number of averaging intervals of inputs and measured motions per interval of the thinned signal. Project choice."""

VELOCITIES = ("u", "v", "w", "p", "q", "r")


def thinned_to(segments: Sequence[Segment], signal: str, interval: float) -> list[Segment]:
    """Return *segments* with *signal* only, thinned to samples about *interval* [s] apart.

    Inputs and measured velocities are averaged over a fraction of the interval. Segments without the signal are left
    out.
    """
    thinned = []
    for segment in segments:
        if signal not in segment.signals:
            continue
        own = segment.signals[signal]
        step = float(np.median(np.diff(own.t)))
        every = max(1, round(interval / step))
        kept = replace(own, t=own.t[::every], values=own.values[::every])
        thinned.append(_coarser(replace(segment, signals={signal: kept}), interval / PER_SAMPLE))
    return thinned


def _coarser(segment: Segment, width: float) -> Segment:
    """Return the segment with inputs and measured velocities averaged over *width* [s].

    Channels with fewer samples stay unchanged.
    """
    measured = {}
    for name, channel in segment.measured.items():
        known = np.isfinite(channel.values) & np.isfinite(channel.t)
        t, values = channel.t[known], channel.values[known]
        if len(t) < 2 or name not in VELOCITIES or 2.0 * float(np.median(np.diff(t))) > width:
            measured[name] = channel
            continue
        bins = np.floor((t - t[0]) / width).astype(int)
        count = np.maximum(np.bincount(bins), 1)
        there = np.bincount(bins) > 0
        mean_t, mean = (np.bincount(bins, x)[there] / count[there] for x in (t, values))
        measured[name] = replace(channel, t=mean_t, values=mean)
    segment = replace(segment, measured=measured)
    t_in, end = segment.t_in, float(segment.stamps[-1])
    if len(t_in) < 8 or 2.0 * float(np.median(np.diff(t_in))) > width or end <= t_in[0]:
        return segment
    edges = np.arange(t_in[0], end + width, width)
    every = np.union1d(t_in, edges)
    row = np.searchsorted(t_in, every, side="right") - 1
    held = np.diff(np.append(every, max(float(every[-1]), end) + width))
    own = np.clip(np.searchsorted(edges, every, side="right") - 1, 0, len(edges) - 1)
    weight = np.bincount(own, held, len(edges))
    table = np.column_stack(
        [np.bincount(own, held * segment.inputs[row, i], len(edges)) / weight for i in range(segment.inputs.shape[1])]
    )
    return replace(segment, t_in=edges, inputs=table, slack=np.zeros(len(edges)))


def smoothed_drive(drive: Drive, smoothing: float, end: float, step: float, commands: Container[str]) -> Drive:
    """Return the inputs of *drive* up to *end* [s] as means over *step* [s], with *commands* smoothed in both
    directions.

    smoothing : time constant [s] of the smoother in each direction.
    """
    t = np.arange(float(drive.t[0]), end + step, step)
    every = np.union1d(drive.t[drive.t < t[-1] + step], t)
    row = np.searchsorted(drive.t, every, side="right") - 1
    held = np.diff(np.append(every, t[-1] + step))
    own = np.clip(np.searchsorted(t, every, side="right") - 1, 0, len(t) - 1)
    weight = np.bincount(own, held, len(t))
    kept = math.exp(-step / smoothing)
    channels = {}
    for name, values in drive.channels.items():
        mean = np.bincount(own, held * values[row], len(t)) / weight
        channels[name] = _two_sided(mean, kept) if name in commands else mean
    return replace(drive, t=t, channels=channels)


def _two_sided(x: Array, kept: float) -> Array:
    """Return *x* (n,) smoothed with weights ``kept**|k|``, as if its end values continued for ever."""
    rest = 1.0 - kept
    lfilter = scipy_signal().lfilter
    forward, _ = lfilter([1.0], [1.0, -kept], x, zi=[kept * x[0] / rest])
    backward, _ = lfilter([1.0], [1.0, -kept], x[::-1], zi=[kept * x[-1] / rest])
    both: Array = (forward + backward[::-1] - x) * rest / (1.0 + kept)
    return both
