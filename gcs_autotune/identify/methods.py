"""Every identification method, in one table: adding one is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.identify.axis.by_iso import fit_by_iso
from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.coupled.by_global import OPTIONS as GLOBAL_OPTIONS
from gcs_autotune.identify.coupled.by_global import fit_by_global_search
from gcs_autotune.identify.coupled.by_output_error import fit_coupled_by_output_error
from gcs_autotune.identify.coupled.limits import OPTIONS as OUTPUT_ERROR_OPTIONS
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.method import Method

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
            "global",
            "output error from the better of two global searches",
            axis=for_axis(fit_by_global_search),
            coupled=fit_by_global_search,
            options=GLOBAL_OPTIONS,
        ),
        Method("iso", "first harmonic of a self-oscillation (relay)", axis=fit_by_iso),
    )
}
"""Name -> method."""
