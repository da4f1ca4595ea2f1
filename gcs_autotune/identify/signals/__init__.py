"""A run as segments: what a model is fitted to, checked, before any model.

A :class:`Segment` is one uninterrupted stretch: signals with their own stamps, inputs that hold from theirs, the
accuracy of both, in SI units. :func:`prepare` makes the segments of one degree of freedom of a run,
:func:`prepare_form` those of a form, and :func:`prepare_as_recorded` those whose errors effects will explain.

==============  ===============================================================================
segment         the segment and its cuts
preparation     a run to segments
intake          a run on input: clock restarts, units, columns that contradict each other
cleaning        one channel: invalid numbers, late stamps, clipping, gaps
along_axis      speed along the track for surge
whiteness       autocorrelation of a series, and how much of a residual is noise
==============  ===============================================================================
"""

from __future__ import annotations

from gcs_autotune.identify.signals.cleaning import clean
from gcs_autotune.identify.signals.intake import check_axes, clock_jump, left_out, parts_of
from gcs_autotune.identify.signals.preparation import (
    INPUTS,
    prepare,
    prepare_as_recorded,
    prepare_form,
    signals_of,
)
from gcs_autotune.identify.signals.segment import Segment, Signal, within_horizon, without_signal
from gcs_autotune.identify.signals.whiteness import autocorrelation, correlation_time

__all__ = [
    "INPUTS",
    "Segment",
    "Signal",
    "autocorrelation",
    "check_axes",
    "clean",
    "clock_jump",
    "correlation_time",
    "left_out",
    "parts_of",
    "prepare",
    "prepare_as_recorded",
    "prepare_form",
    "signals_of",
    "within_horizon",
    "without_signal",
]
