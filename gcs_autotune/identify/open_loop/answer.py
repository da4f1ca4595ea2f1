"""Build the ``Fit`` of the step and the zig-zag method from their model of one degree of freedom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.form import Structure
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import Findings, doubts_about
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, axis_table, fit_of
from gcs_autotune.identify.result import AxisFit, Status
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
    """Return the fit of one degree of freedom with the parameters *theta*, and its free run on the records.

    theta (4,), covariance (4, 4), fitted (4,) : for alpha, beta, beta_quadratic and Delta. The delay is that of *case*.
    """
    record = case.records[0]
    alpha, beta, quadratic, delta = (float(v) for v in theta)
    model = SingleDof(record.dof.name, record.input_units[0], alpha, beta, quadratic, delta, case.delay or 0.0)
    full = np.zeros((5, 5))
    full[:4, :4] = covariance
    status: list[Status] = ["fitted" if f else "absent" for f in fitted]
    status.append("absent" if case.delay is None else "fixed")
    table = axis_table(model, full, status)
    motion = Motion.freely(model, case.records)
    findings = Findings(
        replace(case, cycles=()), model, structure, table.parameters, None, motion.rms, motion.fit_percent
    )
    if motion.traces:
        motion = replace(motion, noise={motion.traces[0].signal: motion.rms})
    return fit_of(
        case,
        method,
        model,
        table,
        motion,
        structure=structure,
        doubts=(*doubts_about(findings), *motion.doubts, *doubts),
        extra=extra,
        axis=AxisDetails(record.main.name),
    )
