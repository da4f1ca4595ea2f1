"""Signals as they were before bookkeeping gave them another sign or unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, EffectInstance, Observed, columns_of
from gcs_autotune.identify.extended.stretches import Stretch
from gcs_autotune.models.coupled.program import states_of

__all__ = ["turned", "unspoilt"]

Array = NDArray[np.float64]

TURN = 2.0 * np.pi


def unspoilt(effects: Sequence[EffectInstance], stretch: Stretch) -> Stretch:
    """Return a stretch with its signals as they were before *effects* gave some another sign or unit; itself where
    none did. Where the craft began is to be read off these.
    """
    signals = dict(stretch.record.signals)
    for own in effects:
        entry = EFFECTS[own.slug]
        if entry.family != "data errors" or "sensors" not in entry.acts_on:
            continue
        for name in set(columns_of(own.place)) & set(signals):
            signal = signals[name]
            ones = Observed(signal.t, {name: np.ones(len(signal.t))}, stretch.passage.start, stretch.run)
            factor = entry.observe(own, ones).signals[name]
            signals[name] = replace(signal, values=signal.values / factor)
    if all(np.array_equal(signals[n].values, s.values) for n, s in stretch.record.signals.items()):
        return stretch
    return replace(stretch, record=replace(stretch.record, signals=signals))


def turned(own: EffectInstance, stretches: Sequence[Stretch], initial: Sequence[Array]) -> tuple[Array, ...]:
    """Return *initial* states with the heading put forward or back by whole turns, to where *own* would have it read.

    A heading of 85 (degrees, its head says radians) is fitted by 1.5 rad and thirteen turns: no other motion, but as
    degrees it would be 4680 too much.
    """
    found = []
    for stretch, x_0 in zip(stretches, initial, strict=True):
        right = unspoilt([own], stretch) if "psi" in columns_of(own.place) else stretch
        if right is not stretch:
            at = states_of(stretch.form).index("psi")
            x_0 = x_0.copy()
            x_0[at] += TURN * np.round((right.record.signals["psi"].values[0] - x_0[at]) / TURN)
        found.append(x_0)
    return tuple(found)
