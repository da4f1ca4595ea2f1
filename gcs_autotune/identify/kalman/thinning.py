"""Records with one signal, no closer than suits a craft, and their inputs as means over a share of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.identify.segment import Segment

__all__ = ["thinned_to"]

PER_SAMPLE = 4.0
"""Inputs and measured motions are held as means over no less than this share of the interval between samples."""

VELOCITIES = ("u", "v", "w", "p", "q", "r")


def thinned_to(segments: Sequence[Segment], signal: str, interval: float) -> list[Segment]:
    """Return the segments with samples of *signal* only, no closer than *interval* [s]."""
    found = []
    for segment in segments:
        if signal not in segment.signals:
            continue
        own = segment.signals[signal]
        step = float(np.median(np.diff(own.t)))
        every = max(1, round(interval / step))
        kept = replace(own, t=own.t[::every], values=own.values[::every])
        found.append(_coarser(replace(segment, signals={signal: kept}), interval / PER_SAMPLE))
    return found


def _coarser(segment: Segment, width: float) -> Segment:
    """Return the segment with inputs and measured motions as means over *width* [s], where they come more often."""
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
