"""Runs split into what is learnt from and what is predicted: by run where there are several, else by time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.trial import Channel, Trial

__all__ = ["BLOCKS", "MOST_FOLDS", "Fold", "folds_of"]

BLOCKS = 4
"""Blocks one single run is cut into. Chosen: three quarters are left to learn from each time."""

MOST_FOLDS = 6
"""Folds at most; with more runs than that several are left out together."""


@dataclass(frozen=True, slots=True)
class Fold:
    """``held`` is predicted by what was fitted to ``train``."""

    train: tuple[Trial, ...]
    held: tuple[Trial, ...]


def folds_of(trials: Sequence[Trial], inputs: Sequence[str]) -> tuple[Fold, ...]:
    """Return the folds of *trials*; *inputs* are held over cuts in time."""
    if len(trials) == 1:
        return _in_time(trials[0], frozenset(inputs))
    groups = np.array_split(np.arange(len(trials)), min(len(trials), MOST_FOLDS))
    return tuple(
        Fold(tuple(t for i, t in enumerate(trials) if i not in g), tuple(trials[i] for i in g)) for g in groups
    )


def _in_time(trial: Trial, inputs: frozenset[str]) -> tuple[Fold, ...]:
    edges = np.linspace(trial.start, trial.end, BLOCKS + 1)
    edges[-1] = np.nextafter(edges[-1], np.inf)
    parts = [_part(trial, float(a), float(b), k, inputs) for k, (a, b) in enumerate(itertools.pairwise(edges))]
    return tuple(Fold(tuple(p for p in parts if p is not held), (held,)) for held in parts)


def _part(trial: Trial, start: float, end: float, k: int, inputs: frozenset[str]) -> Trial:
    """Return the part with ``start <= t < end``, its inputs in force from the start on."""
    channels = {}
    for name, channel in trial.channels.items():
        keep = (channel.t >= start) & (channel.t < end)
        t, values = channel.t[keep], channel.values[keep]
        if name in inputs and len(channel) and not (len(t) and t[0] == start):
            t, values = np.concatenate([[start], t]), np.concatenate([[channel.held_at(start)], values])
        channels[name] = Channel(name, channel.unit, t, values)
    return replace(trial, name=f"{trial.name}/{k + 1}", channels=channels, marks=(), meta={})
