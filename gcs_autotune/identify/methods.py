"""Every identification method, in one table: adding one is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.identify.axis.by_iso import fit_by_iso
from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.coupled.by_output_error import fit_coupled_by_output_error
from gcs_autotune.identify.coupled.limits import OPTIONS as OUTPUT_ERROR_OPTIONS
from gcs_autotune.identify.frequency.by_frequency import OPTIONS as FREQUENCY_OPTIONS
from gcs_autotune.identify.frequency.by_frequency import fit_by_frequency
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.ship.by_steps import fit_by_steps
from gcs_autotune.identify.ship.by_zigzag import fit_by_zigzag

__all__ = ["METHODS"]

METHODS: Mapping[str, Method] = {
    m.name: m
    for m in (
        Method(
            "output-error",
            "simulated against measured motion, by maximum likelihood",
            axis=fit_by_output_error,
            coupled=fit_coupled_by_output_error,
            options=OUTPUT_ERROR_OPTIONS,
        ),
        Method(
            "frequency",
            "Bode response of a sweep or relay, Nomoto fitted",
            axis=fit_by_frequency,
            options=FREQUENCY_OPTIONS,
        ),
        Method("iso", "first harmonic of a self-oscillation (relay)", axis=fit_by_iso),
        Method("step", "settled responses to steps of the input (thesis table 4.1)", axis=fit_by_steps),
        Method(
            "zig-zag",
            "K and T by integration over half periods (thesis 4.4)",
            axis=fit_by_zigzag,
            options=(("length", "ship length [m], for K' and T'"), ("speed", "approach speed [m/s], for K' and T'")),
        ),
    )
}
"""Name -> method."""
