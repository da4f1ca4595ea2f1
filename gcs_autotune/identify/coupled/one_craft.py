"""Whether the runs of a coupled fit are of one craft; asked only when the common fit leaves something unexplained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gcs_autotune.errors import AutotuneError, NotInformative
from gcs_autotune.identify.consistency import Estimate, apart_doubts, belongs, estimate_of, runs_apart
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.result import Doubt, Fit

__all__ = ["blamed", "runs_of_another_craft"]

UNEXPLAINED = 0.3
"""Autocorrelation of neighbouring residuals above which it is worth fitting every run by itself."""
MOST_RUNS = 8
"""Beyond this the comparison would cost far more than the fit."""


def runs_of_another_craft(case: CoupledCase, fit: Fit, method: Callable[[CoupledCase], Fit]) -> list[Doubt]:
    """Return a doubt per run that does not belong to the others; none when the common fit explains them all."""
    common = estimate_of(fit)
    if common is None or not _unexplained(fit):
        return []
    return _compared(case, method, len(common.values))


def blamed(case: CoupledCase, error: NotInformative, method: Callable[[CoupledCase], Fit]) -> NotInformative:
    """Return *error*, with the run of another craft named where the runs cannot be fitted together for that reason."""
    doubts = _compared(case, method, None)
    if not doubts:
        return error
    return NotInformative(f"{error}; fitted one by one, {'; '.join(d.cause for d in doubts)}; {doubts[0].cure}")


def _compared(case: CoupledCase, method: Callable[[CoupledCase], Fit], size: int | None) -> list[Doubt]:
    """Compare the runs; only estimates of *size* parameters count, those of the first fit when None."""
    if not 2 <= len(case.names) <= MOST_RUNS:
        return []
    sizes = [] if size is None else [size]

    def estimate(runs: tuple[int, ...]) -> Estimate | None:
        names = [case.names[i] for i in runs]
        records = tuple(r for r in case.records if any(belongs(r.run, n, case.names) for n in names))
        part = replace(case, names=tuple(names), records=records, trials=tuple(case.trials[i] for i in runs))
        try:
            found = estimate_of(method(part))
        except AutotuneError:
            return None
        sizes.extend([len(found.values)] if found is not None and not sizes else [])
        return found if found is not None and len(found.values) == sizes[0] else None

    return apart_doubts(runs_apart(case.names, estimate))


def _unexplained(fit: Fit) -> bool:
    for residual in fit.residuals:
        e = residual.values - residual.values.mean()
        power = float(e @ e)
        if len(e) > 10 and power > 0.0 and float(e[1:] @ e[:-1]) / power > UNEXPLAINED:
            return True
    return False
