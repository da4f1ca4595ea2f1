"""The noise with which a step is measured, from the signal of an undisturbed craft."""

from __future__ import annotations

import itertools
import math

import numpy as np

from gcs_autotune.identify import AxisFit
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import noise_in

__all__ = ["jitter_in", "noise_behind", "noise_while_held"]

_WINDOW = 2.0
"""Chosen: seconds in which a craft under control moves as a polynomial, and a sensor's noise does not."""
_LEAST_SAMPLES = 6
_TREND = 2
"""Order of the polynomial that counts as motion."""


def noise_behind(step: Trial, fit: AxisFit, moving: bool, resolution: float) -> float:
    """Return the standard deviation of the noise that a flown *step* is measured through (SI).

    Of a velocity (*moving*) the fit's when it was fitted to that, else read off the step; of a position the lesser of
    the fit's and what the craft did while it was held.
    """
    signal = str(step.meta["signal"])
    if moving:
        return fit.noise[signal] if signal in fit.noise else noise_in(step, signal)
    return min(fit.noise.get(signal, fit.noise_std), noise_while_held(step, resolution))


def noise_while_held(step: Trial, resolution: float = 0.0) -> float:
    """Return the standard deviation [rad or m] of the stepped signal about its own motion, by the median of windows.

    What a model leaves unexplained is no noise: a poor model must not make a poor step look good. A polynomial is taken
    off each window; the few with the steps themselves, or a kick out of a dead band, do not move the median. One short
    hold would do, were it not for its own error: 20 % of the noise it finds is 20 % of the error over time of a good
    step. At least what rounding to *resolution* [rad or m] makes; infinite when the record is too coarse in time.
    """
    signal = str(step.meta["signal"])
    begun = next((mark.t for mark in step.marks if mark.kind == "target"), math.inf)
    t, x = step[signal].t, step[signal].values
    t, x = t[t >= begun], x[t >= begun]
    if len(t) < _LEAST_SAMPLES:
        return math.inf
    edges = np.searchsorted(t, np.arange(t[0], t[-1] - _WINDOW, _WINDOW))
    found = []
    for first, last in itertools.pairwise(edges.tolist()):
        if last - first >= _LEAST_SAMPLES:
            since = t[first:last] - t[first]
            rest = x[first:last] - np.polyval(np.polyfit(since, x[first:last], _TREND), since)
            found.append(float(np.sum(rest**2)) / (last - first - _TREND - 1))
    if not found:
        return math.inf
    return max(math.sqrt(float(np.median(found))), resolution / math.sqrt(12.0))


def jitter_in(step: Trial, resolution: float = 0.0) -> float:
    """Return the standard deviation [rad or m] of what changes from sample to sample: the noise that moves an actuator.

    Slow oscillation of the craft or drift of the estimate is left out. At least the noise of rounding to *resolution*.
    """
    return max(noise_in(step, str(step.meta["signal"])), resolution / math.sqrt(12.0))
