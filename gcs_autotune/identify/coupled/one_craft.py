"""Whether the runs of a coupled fit are of one craft; asked only when the common fit leaves something unexplained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.consistency import Estimate, apart_doubts, belongs, estimate_of, runs_apart
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.result import Doubt, Fit

__all__ = ["runs_of_another_craft"]

UNEXPLAINED = 0.3
"""Autocorrelation of neighbouring residuals above which it is worth fitting every run by itself."""
MOST_RUNS = 8
"""Beyond this the comparison would cost far more than the fit."""


def runs_of_another_craft(case: CoupledCase, fit: Fit, method: Callable[[CoupledCase], Fit]) -> list[Doubt]:
    """Return a doubt per run that does not belong to the others; none when the common fit explains them all."""
    if not 2 <= len(case.names) <= MOST_RUNS or not _unexplained(fit):
        return []

    def estimate(runs: tuple[int, ...]) -> Estimate | None:
        names = [case.names[i] for i in runs]
        records = tuple(r for r in case.records if any(belongs(r.run, n, case.names) for n in names))
        part = replace(case, names=tuple(names), records=records, trials=tuple(case.trials[i] for i in runs))
        try:
            found = estimate_of(method(part))
        except AutotuneError:
            return None
        return found if found is not None and len(found.values) == size else None

    common = estimate_of(fit)
    if common is None:
        return []
    size = len(common.values)
    return apart_doubts(runs_apart(case.names, estimate))


def _unexplained(fit: Fit) -> bool:
    for residual in fit.residuals:
        e = residual.values - residual.values.mean()
        power = float(e @ e)
        if len(e) > 10 and power > 0.0 and float(e[1:] @ e[:-1]) / power > UNEXPLAINED:
            return True
    return False
