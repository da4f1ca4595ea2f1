"""Every identification method, in one table: adding one is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.identify.axis.by_iso import fit_by_iso
from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.coupled import by_global, limits
from gcs_autotune.identify.coupled.by_output_error import fit_coupled_by_output_error
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.frequency import by_frequency
from gcs_autotune.identify.kalman import ekf, prediction_error, smoother
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.open_loop.by_steps import fit_by_steps
from gcs_autotune.identify.open_loop.by_zigzag import fit_by_zigzag
from gcs_autotune.identify.regression import by_instruments, by_least_squares, by_recursion

__all__ = ["METHODS"]

METHODS: Mapping[str, Method] = {
    m.name: m
    for m in (
        Method(
            "output-error",
            "simulated against measured motion, by maximum likelihood",
            axis=fit_by_output_error,
            coupled=fit_coupled_by_output_error,
            options=limits.OPTIONS,
            bears=frozenset({"stamps", "rounding", "robust", "delay", "effects", "lever arm"}),
        ),
        Method(
            "global",
            "output error from the better of two global searches",
            axis=for_axis(by_global.fit_by_global_search),
            coupled=by_global.fit_by_global_search,
            options=by_global.OPTIONS,
            bears=frozenset({"stamps", "robust", "lever arm"}),
        ),
        Method(
            "prediction-error",
            "innovations' likelihood: gusts and other process noise told apart from measurement noise",
            axis=for_axis(prediction_error.fit_by_prediction_error),
            coupled=prediction_error.fit_by_prediction_error,
            options=prediction_error.PEM_OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "ekf",
            "extended Kalman filter, parameters in its state",
            axis=for_axis(ekf.fit_by_ekf),
            coupled=ekf.fit_by_ekf,
            options=ekf.FILTER_OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "ukf",
            "sigma-point Kalman filter, likewise",
            axis=for_axis(ekf.fit_by_ukf),
            coupled=ekf.fit_by_ukf,
            options=ekf.FILTER_OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "smoother",
            "iterated smoother: positions alone will do",
            axis=for_axis(smoother.fit_by_smoother),
            coupled=smoother.fit_by_smoother,
            options=smoother.SMOOTHER_OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "least-squares",
            "the equations of motion as a linear regression",
            axis=by_least_squares.fit_axis_by_least_squares,
            coupled=by_least_squares.fit_by_least_squares,
            options=by_least_squares.OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "instrumental-variables",
            "least squares freed of its noise bias by simulated instruments",
            axis=by_instruments.fit_axis_by_instruments,
            coupled=by_instruments.fit_by_instruments,
            options=by_instruments.OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method(
            "recursive-least-squares",
            "least squares as it develops along the run, with forgetting on request",
            axis=by_recursion.fit_axis_by_recursion,
            coupled=by_recursion.fit_by_recursion,
            options=by_recursion.OPTIONS,
            bears=frozenset({"stamps"}),
        ),
        Method("iso", "first harmonic of a self-oscillation (relay)", axis=fit_by_iso),
        Method("step", "settled responses to steps of the input (Miskovic2010, table 4.1)", axis=fit_by_steps),
        Method(
            "zig-zag",
            "K and T by integration over half periods (Miskovic2010, 4.4)",
            axis=fit_by_zigzag,
            options=(("length", "ship length [m], for K' and T'"), ("speed", "approach speed [m/s], for K' and T'")),
        ),
        Method(
            "frequency",
            "Bode response of a sweep or relay, Nomoto fitted",
            axis=by_frequency.fit_by_frequency,
            options=by_frequency.OPTIONS,
        ),
    )
}
"""Name -> method."""
