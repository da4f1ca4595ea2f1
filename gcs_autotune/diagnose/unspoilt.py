"""Signals as they were before bookkeeping gave them another sign or unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.effects import BOOK
from gcs_autotune.effects.effect import Applied, Observed, columns_of
from gcs_autotune.identify.extended.stretches import Stretch

__all__ = ["unspoilt"]


def unspoilt(effects: Sequence[Applied], stretch: Stretch) -> Stretch:
    """Return a stretch with its signals as they were before *effects* gave some another sign or unit; itself where
    none did. Where the craft began is to be read off these.
    """
    signals = dict(stretch.record.signals)
    for own in effects:
        entry = BOOK[own.slug]
        if entry.family != "bookkeeping" or not entry.overrides("observe"):
            continue
        for name in set(columns_of(own.place)) & set(signals):
            signal = signals[name]
            ones = Observed(signal.t, {name: np.ones(len(signal.t))}, stretch.passage.start, stretch.run)
            factor = entry.observe(own, ones).signals[name]
            signals[name] = replace(signal, values=signal.values / factor)
    if all(np.array_equal(signals[n].values, s.values) for n, s in stretch.record.signals.items()):
        return stretch
    return replace(stretch, record=replace(stretch.record, signals=signals))
