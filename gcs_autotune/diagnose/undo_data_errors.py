"""Correct signals for wrong signs and units in the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, EffectInstance, Observed, columns_of
from gcs_autotune.identify.signals import Segment
from gcs_autotune.models import Form, states_of

__all__ = ["turned", "undo_data_errors"]

Array = NDArray[np.float64]


TURN = 2.0 * np.pi


def undo_data_errors(effects: Sequence[EffectInstance], segment: Segment) -> Segment:
    """Return a segment with the sign and unit errors *effects* removed from its signals.

    Return the segment itself if no effect changes a sign or unit. Initial states are to be read from these signals.
    """
    signals = dict(segment.signals)
    for own in effects:
        entry = EFFECTS[own.slug]
        if entry.family != "data errors" or "sensors" not in entry.acts_on:
            continue
        for name in set(columns_of(own.place)) & set(signals):
            signal = signals[name]
            ones = Observed(signal.t, {name: np.ones(len(signal.t))}, segment.passage.start, segment.run)
            factor = entry.observe(own, ones).signals[name]
            signals[name] = replace(signal, values=signal.values / factor)
    if all(np.array_equal(signals[n].values, s.values) for n, s in segment.signals.items()):
        return segment
    return replace(segment, signals=signals)


def turned(own: EffectInstance, form: Form, segments: Sequence[Segment], initial: Sequence[Array]) -> tuple[Array, ...]:
    """Return *initial* states with the heading shifted by whole turns, to match the heading corrected by *own*.

    A heading of 85 in degrees, whose header states radians, is fitted by 1.5 rad and thirteen turns. The motion is the
    same, but in degrees these turns would be 4680 too much.
    """
    states = []
    for segment, x_0 in zip(segments, initial, strict=True):
        right = undo_data_errors([own], segment) if "psi" in columns_of(own.place) else segment
        if right is not segment:
            at = states_of(form).index("psi")
            x_0 = x_0.copy()
            x_0[at] += TURN * np.round((right.signals["psi"].values[0] - x_0[at]) / TURN)
        states.append(x_0)
    return tuple(states)
