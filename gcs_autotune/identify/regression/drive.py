"""Calculate the inputs of a form as the regression needs them: products of inputs, averaged over every grid interval.

An input jumps between two grid points. Values taken at the grid points would shift the jump by up to half a step. The
average over the interval about each point preserves the impulse. For an input that is held between its stamps, the
average is exact.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form, program_of
from gcs_autotune.models.coupled import kernel

__all__ = ["drives_of"]

Array = NDArray[np.float64]


def drives_of(record: Segment, form: Form, t: Array, step: float) -> Array:
    """Return the product of the input factors (n, T) of every term of *form*, averaged about each of the times *t*
    (n,). The product is 1 for a term without inputs.
    """
    program = program_of(form)
    stamps = record.t_in + form.known.get("delay", 0.0)
    inputs = record.inputs
    edges = np.concatenate([[t[0] - 0.5 * step], 0.5 * (t[1:] + t[:-1]), [t[-1] + 0.5 * step]])
    lag = form.known.get("lag", 0.0)
    if lag > 0.0:
        stamps, inputs = _lagged(stamps, inputs, edges, lag)
    out = np.ones((len(t), len(program.rows)))
    for j, factors in enumerate(program.factors):
        codes = [int(c) for c in factors if c >= kernel.INPUT]
        if not codes:
            continue
        product = np.ones(len(stamps))
        for code in codes:
            size = code >= kernel.INPUT_SIZE
            column = inputs[:, code - (kernel.INPUT_SIZE if size else kernel.INPUT)]
            product = product * (np.abs(column) if size else column)
        out[:, j] = _averages(stamps, product, edges)
    return out


def _averages(stamps: Array, values: Array, edges: Array) -> Array:
    """Return the mean of a held signal over each interval between *edges*.

    The first value also counts before its stamp.
    """
    row = np.maximum(np.searchsorted(stamps, edges, side="right") - 1, 0)
    gathered = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(stamps))])
    integral = gathered[row] + values[row] * (edges - stamps[row])
    means: Array = np.diff(integral) / np.diff(edges)
    return means


def _lagged(stamps: Array, inputs: Array, edges: Array, lag: float) -> tuple[Array, Array]:
    """Return the inputs after a first-order lag [s].

    They are steps that hold their mean between all stamps and *edges*.
    """
    times = np.unique(np.concatenate([stamps, edges]))
    held = inputs[np.maximum(np.searchsorted(stamps, times, side="right") - 1, 0)]
    state, means = held[0].copy(), np.empty_like(held)
    for i, span in enumerate([*np.diff(times), 0.0]):
        kept = math.exp(-span / lag)
        share = lag / span * (1.0 - kept) if span > 0.0 else 1.0
        means[i] = held[i] + (state - held[i]) * share
        state = held[i] + (state - held[i]) * kept
    return times, means
