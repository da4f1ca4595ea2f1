"""Convert a run to checked segments, to which models are fitted.

A :class:`Segment` is one uninterrupted stretch of a run, in SI units. Its signals have their own stamps, and its inputs
are held from their stamps on. :func:`prepare` returns the segments for one degree of freedom, and :func:`prepare_form`
those for a form. :func:`prepare_as_recorded` returns uncorrected segments for a fit with effects.

==============  ===============================================================================
segment         the segment, and how it is cut
preparation     from a run to its segments
intake          checks of a run: clock restarts, units, columns that contradict each other
cleaning        cleaning of one channel: invalid numbers, late stamps, clipping, gaps
along_axis      surge and sway derived from positions
whiteness       whiteness tests, and the part of a residual that is noise
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
