"""What a signal does when nothing is asked of the craft: the noise a step is measured through."""

from __future__ import annotations

import math

import numpy as np

from gcs_autotune.identify import AxisFit
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import noise_in

__all__ = ["jitter_in", "noise_behind", "noise_while_held"]

_LOOK_BACK = 3.0
"""Seconds of the hold before a step: as long as it has to be steady before the step begins."""
_LEAST_SAMPLES = 12
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
    """Return the standard deviation [rad or m] of the stepped signal while it was held, slow motion taken off.

    What a model leaves unexplained is no noise: a poor model must not make a poor step look good. At least what
    rounding to *resolution* [rad or m] makes; infinite when the record shows no hold to measure in.
    """
    signal = str(step.meta["signal"])
    targets = [mark.t for mark in step.marks if mark.kind == "target"]
    if len(targets) < 2:
        return math.inf
    held = step[signal].between(max(targets[0], targets[1] - _LOOK_BACK), targets[1])
    if len(held.t) < _LEAST_SAMPLES:
        return math.inf
    t = held.t - held.t[0]
    rest = held.values - np.polyval(np.polyfit(t, held.values, _TREND), t)
    return max(float(np.sqrt(np.sum(rest**2) / (len(t) - _TREND - 1))), resolution / math.sqrt(12.0))


def jitter_in(step: Trial, resolution: float = 0.0) -> float:
    """Return the standard deviation [rad or m] of what changes from sample to sample: the noise that moves an actuator.

    A craft that still swings, or an estimate that wanders, is no jitter. At least what rounding to *resolution* makes.
    """
    return max(noise_in(step, str(step.meta["signal"])), resolution / math.sqrt(12.0))
