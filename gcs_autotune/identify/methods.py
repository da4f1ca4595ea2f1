"""Every identification method, in one table: adding one is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.identify.axis.by_iso import fit_by_iso
from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.kalman.ekf import FILTER_OPTIONS, fit_by_ekf, fit_by_ukf
from gcs_autotune.identify.kalman.prediction_error import PEM_OPTIONS, fit_by_prediction_error
from gcs_autotune.identify.kalman.smoother import SMOOTHER_OPTIONS, fit_by_smoother
from gcs_autotune.identify.method import Method

__all__ = ["METHODS"]

METHODS: Mapping[str, Method] = {
    m.name: m
    for m in (
        Method("output-error", "simulated against measured motion, by maximum likelihood", axis=fit_by_output_error),
        Method("iso", "first harmonic of a self-oscillation (relay)", axis=fit_by_iso),
        Method(
            "ekf", "extended Kalman filter, parameters in its state", for_axis(fit_by_ekf), fit_by_ekf, FILTER_OPTIONS
        ),
        Method("ukf", "sigma-point Kalman filter, likewise", for_axis(fit_by_ukf), fit_by_ukf, FILTER_OPTIONS),
        Method(
            "smoother",
            "iterated smoother: positions alone will do",
            for_axis(fit_by_smoother),
            fit_by_smoother,
            SMOOTHER_OPTIONS,
        ),
        Method(
            "prediction-error",
            "innovations' likelihood: gusts and other process noise told apart from measurement noise",
            for_axis(fit_by_prediction_error),
            fit_by_prediction_error,
            PEM_OPTIONS,
        ),
    )
}
"""Name -> method."""
