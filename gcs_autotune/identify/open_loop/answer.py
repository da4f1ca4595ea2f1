"""From a model of one degree of freedom to an ``AxisFit``: shared by the step and the zig-zag method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.case import Case, named_parameters
from gcs_autotune.identify.doubts import Findings, collect
from gcs_autotune.identify.free_run import fit_percent_of, rms_of, runs_or_doubt
from gcs_autotune.identify.result import AxisFit, Doubt, Status, Structure
from gcs_autotune.models import SingleDof

__all__ = ["axis_answer"]

Array = NDArray[np.float64]


def axis_answer(
    case: Case,
    method: str,
    structure: Structure,
    theta: Array,
    covariance: Array,
    fitted: Sequence[bool],
    doubts: Sequence[Doubt],
    extra: Mapping[str, Any],
) -> AxisFit:
    """Return the fit with its free run on the records.

    theta, covariance, fitted : (4,), (4, 4), (4,) of (alpha, beta, beta_quadratic, Delta); the delay is the case's.
    """
    record = case.records[0]
    alpha, beta, quadratic, delta = (float(v) for v in theta)
    model = SingleDof(record.dof.name, record.input_units[0], alpha, beta, quadratic, delta, case.delay or 0.0)
    full = np.zeros((5, 5))
    full[:4, :4] = covariance
    status: list[Status] = ["fitted" if f else "absent" for f in fitted]
    status.append("absent" if case.delay is None else "fixed")
    parameters = named_parameters(model, full, status)
    traces, runaway = runs_or_doubt(model, case.records)
    rms, fit_percent = rms_of(traces), fit_percent_of(traces)
    findings = Findings(replace(case, cycles=()), model, structure, parameters, None, rms, fit_percent)
    return AxisFit(
        dof=model.dof,
        structure=structure,
        method=method,
        model=model,
        parameters=parameters,
        covariance=full,
        fit_percent=fit_percent,
        used=case.names,
        noise={} if not traces else {traces[0].signal: rms},
        doubts=(*collect(findings), *runaway, *doubts),
        traces=traces,
        noise_std=rms,
        residual_rms=rms,
        extra=dict(extra),
    )
