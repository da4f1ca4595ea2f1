"""Every identification method, in one table: adding one is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.identify.axis.by_iso import fit_by_iso
from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.regression.by_instruments import OPTIONS as INSTRUMENTS_OPTIONS
from gcs_autotune.identify.regression.by_instruments import fit_axis_by_instruments, fit_by_instruments
from gcs_autotune.identify.regression.by_least_squares import OPTIONS as LEAST_SQUARES_OPTIONS
from gcs_autotune.identify.regression.by_least_squares import fit_axis_by_least_squares, fit_by_least_squares
from gcs_autotune.identify.regression.by_recursion import OPTIONS as RECURSION_OPTIONS
from gcs_autotune.identify.regression.by_recursion import fit_axis_by_recursion, fit_by_recursion

__all__ = ["METHODS"]

METHODS: Mapping[str, Method] = {
    m.name: m
    for m in (
        Method("output-error", "simulated against measured motion, by maximum likelihood", axis=fit_by_output_error),
        Method(
            "least-squares",
            "the equations of motion as a linear regression",
            axis=fit_axis_by_least_squares,
            coupled=fit_by_least_squares,
            options=LEAST_SQUARES_OPTIONS,
        ),
        Method(
            "instrumental-variables",
            "least squares freed of its noise bias by simulated instruments",
            axis=fit_axis_by_instruments,
            coupled=fit_by_instruments,
            options=INSTRUMENTS_OPTIONS,
        ),
        Method(
            "recursive-least-squares",
            "least squares as it develops along the run, with forgetting on request",
            axis=fit_axis_by_recursion,
            coupled=fit_by_recursion,
            options=RECURSION_OPTIONS,
        ),
        Method("iso", "first harmonic of a self-oscillation (relay)", axis=fit_by_iso),
    )
}
"""Name -> method."""
