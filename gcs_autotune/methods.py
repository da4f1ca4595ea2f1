"""Table of the identification methods and their modules. To add one, add a file and a line here.

This module does not import them, so that the command line can list them quickly.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["METHOD_PLACES"]

METHOD_PLACES: Mapping[str, str] = {
    "output-error": "gcs_autotune.identify.coupled.by_output_error:METHOD",
    "global": "gcs_autotune.identify.coupled.by_global:METHOD",
    "prediction-error": "gcs_autotune.identify.kalman.prediction_error:METHOD",
    "ekf": "gcs_autotune.identify.kalman.ekf:EKF",
    "ukf": "gcs_autotune.identify.kalman.ekf:UKF",
    "smoother": "gcs_autotune.identify.kalman.smoother:METHOD",
    "least-squares": "gcs_autotune.identify.regression.by_least_squares:METHOD",
    "instrumental-variables": "gcs_autotune.identify.regression.by_instruments:METHOD",
    "recursive-least-squares": "gcs_autotune.identify.regression.by_recursion:METHOD",
    "iso": "gcs_autotune.identify.axis.by_iso:METHOD",
    "step": "gcs_autotune.identify.open_loop.by_steps:METHOD",
    "zig-zag": "gcs_autotune.identify.open_loop.by_zigzag:METHOD",
    "frequency": "gcs_autotune.identify.frequency.by_frequency:METHOD",
}
"""Name -> module and attribute."""
