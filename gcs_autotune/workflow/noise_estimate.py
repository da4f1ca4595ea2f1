"""Measurement noise of a step, estimated from the signal of an undisturbed craft."""

from __future__ import annotations

import itertools
import math

import numpy as np

from gcs_autotune.identify import AxisFit
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import noise_in

__all__ = ["jitter_in", "noise_behind", "noise_of_velocity", "noise_while_held"]

_WINDOW = 2.0
"""Length of a window [s], short enough that a controlled craft moves as a polynomial while sensor noise does not.
Project choice."""
_LEAST_SAMPLES = 6
_TREND = 2
"""Order of the polynomial that is subtracted as motion."""

_POOR = 5.0
"""Fit's noise over that of the sample-to-sample changes, above which the model is poor. It is 1.2 for the speed of a
simulated boat, and 3.9 for a receiver that averages over 1 s. Project choice."""


def noise_behind(step: Trial, fit: AxisFit, moving: bool, resolution: float) -> float:
    """Return the standard deviation of the measurement noise of a flown *step* (SI).

    For a velocity (*moving*) it is that of :func:`noise_of_velocity`. For a position it is the smaller of two values:
    the noise of the fit, and the noise while the position was held.
    """
    signal = str(step.meta["signal"])
    if moving:
        return noise_of_velocity(fit.noise.get(signal, math.inf), noise_in(step, signal))
    return min(fit.noise.get(signal, fit.noise_std), noise_while_held(step, resolution))


def noise_of_velocity(of_fit: float, of_changes: float) -> float:
    """Return the noise of a velocity (SI): the residual of its model *of_fit*, otherwise that of the sample-to-sample
    changes.

    Filtered velocities have correlated noise, so their changes show too little of it. A residual beyond :data:`_POOR`
    times these changes is the error of a poor model, and not used.
    """
    return of_fit if of_fit <= _POOR * of_changes else of_changes


def noise_while_held(step: Trial, resolution: float = 0.0) -> float:
    """Return the noise of the stepped signal [rad or m]: its standard deviation about the motion, as the median over
    windows.

    A polynomial is subtracted from each window. The few windows with the steps, or with a jump out of a dead band, do
    not change the median. The residual of a model is not used, because a poor model would make a poor step look good. A
    single short hold is not used either: its noise estimate would be 20 % off, and with it the ITAE of a good step.

    The result is at least the noise of rounding to *resolution* [rad or m]. It is infinite if the record has too few
    samples per window.
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
    """Return the standard deviation [rad or m] of the sample-to-sample changes, which is the noise that moves an
    actuator.

    Slow oscillation of the craft and drift of the estimate are excluded. The result is at least the noise of rounding
    to *resolution*.
    """
    return max(noise_in(step, str(step.meta["signal"])), resolution / math.sqrt(12.0))
