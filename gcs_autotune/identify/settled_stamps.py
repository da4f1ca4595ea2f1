"""Correct a common shift of input stamps (decision 3), for methods that need exact stamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.local import local_fit
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel

__all__ = ["on_settled_stamps"]


def on_settled_stamps(method: Callable[[Case], Fit[CoupledModel]]) -> Callable[[Case], Fit[CoupledModel]]:
    """Return a method that accepts input stamps with a common shift, using *method*, which needs exact stamps (decision
    3).

    Output error estimates the shift, which is then removed. A second fit uses a shift that is larger by one standard
    error. The difference between both fits adds the uncertainty of the shift to the estimate.
    """

    def fit(case: Case) -> Fit[CoupledModel]:
        form = case.the_form if not case.delay else case.the_form.fixing({"delay": case.delay})
        if not any(s.dating for s in case.records) or "delay" in form.free:
            return method(case)
        solution = local_fit(form, case.records, Limits({}, {}), robust=case.robust).solution
        std = float(np.sqrt(solution.whole[-1, -1]) * solution.raised[-1])
        best, later = (method(_at_shift(case, s)) for s in (solution.shift, solution.shift + std))
        pairs = zip(best.parameters.values(), later.parameters.values(), strict=True)
        moved = np.array([b.value - a.value if a.status == "fitted" else 0.0 for a, b in pairs])
        covariance = best.covariance + np.outer(moved, moved)
        stds = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        parameters = {n: replace(p, std=s) for (n, p), s in zip(best.parameters.items(), stds, strict=True)}
        extra = {**best.extra, "time_shift": solution.shift}
        return replace(best, parameters=parameters, covariance=covariance, extra=extra)

    return fit


def _at_shift(case: Case, shift: float) -> Case:
    moved = [replace(s, t_in=s.t_in + shift if s.dating else s.t_in, dating=0.0) for s in case.records]
    return replace(case, records=tuple(moved))
