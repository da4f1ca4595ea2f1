"""The method ``iso``: identification from the first harmonic of a limit cycle, as in Miskovic2010.

It is fast. Its standard errors include the systematic error of neglecting the other harmonics.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.form import FREE, Structure
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import Findings, doubts_about
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, axis_table, fit_of
from gcs_autotune.identify.free_run import fit_percent_of, rms_of, run_freely
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.relay import iso
from gcs_autotune.identify.relay.iso import quadratic_drag, two_experiment_decision
from gcs_autotune.identify.result import AxisFit, Decision, IsoEstimate, Status
from gcs_autotune.models import SingleDof

__all__ = ["METHOD", "fit_by_iso"]

Array = NDArray[np.float64]

SYSTEMATIC = 0.05
"""Relative error that IS-O makes by balancing first harmonics only, added to the standard errors for linear drag.

Source: the largest error in Miskovic2010, Examples 7.1-7.3 and Table 6.2.
"""

SYSTEMATIC_QUADRATIC = 0.12
"""Relative error that IS-O makes by balancing first harmonics only, added to the standard errors for quadratic drag.

Quadratic drag flattens the velocity. Simulations gave 9 to 19 %, most for a narrow relay.
"""


def fit_by_iso(case: Case) -> AxisFit:
    """Return the fit of one degree of freedom in *case* by IS-O (identification by self-oscillation).

    A standard error combines the spread between the limit cycles with :data:`SYSTEMATIC`, or with
    :data:`SYSTEMATIC_QUADRATIC` for quadratic drag.

    Raises
    ------
    NotInformative
        The record contains no valid limit cycle, or ``affine`` is requested and all cycles are alike.
    """
    delay = case.delay or 0.0
    everything = [iso.estimate(c, delay) for c in case.cycles]
    usable = [e for e in everything if e.cycle.valid]
    if not usable:
        raise NotInformative(
            f"run '{case.names[0]}' contains no self-oscillation that satisfies Miskovic2010, eq. (7.12). IS-O "
            "(identification by self-oscillation) needs a relay. Fly a relay, or use method='output-error'"
        )
    decision = two_experiment_decision(usable)
    structure, undecided = _structure(case.structure, decision)
    model, covariance = _model(case, structure, usable, delay)
    status: list[Status] = ["fitted", *_drag_status(structure), "fitted", "absent" if case.delay is None else "fixed"]
    table = axis_table(model, covariance, status)
    runs = [run_freely(model, record)[0] for record in case.records]
    motion = Motion(tuple(runs), fit_percent_of(runs), rms_of(runs))
    findings = Findings(case, model, structure, table.parameters, decision, motion.rms, motion.fit_percent)
    doubts = [*doubts_about(findings), _first_harmonic(), *([_undecided()] if undecided else [])]
    main = case.records[0].main.name
    return fit_of(
        case,
        "iso",
        model,
        table,
        motion,
        structure=structure,
        doubts=doubts,
        extra={"signals": [main], "largest": case.largest},
        axis=AxisDetails(main, tuple(everything), decision),
    )


def _structure(requested: Structure | None, decision: Decision | None) -> tuple[Structure, bool]:
    if requested is not None:
        return requested, False
    if decision is None or decision.verdict == "undecided":
        return "linear", True
    return ("linear" if decision.verdict == "linear" else "nonlinear"), False


def _drag_status(structure: Structure) -> list[Status]:
    return ["fitted" if on else "absent" for on in FREE[structure][1:3]]


def _model(case: Case, structure: Structure, usable: Sequence[IsoEstimate], delay: float) -> tuple[SingleDof, Array]:
    columns = {n: np.array([getattr(e, n) for e in usable]) for n in ("alpha", "beta", "beta_quadratic")}
    if structure == "affine":
        columns["beta"], columns["beta_quadratic"] = _both_drags(usable)
    kept = dict(zip(("alpha", "beta", "beta_quadratic", "delta"), FREE[structure], strict=True))
    drags = zip(*(columns[n] if kept[n] else 0.0 * columns[n] for n in ("beta", "beta_quadratic")), strict=True)
    columns["delta"] = np.array([iso.constant_force(e.cycle, *d) for e, d in zip(usable, drags, strict=True)])
    values = {n: float(c.mean()) if kept[n] else 0.0 for n, c in columns.items()}
    variances = [_variance(columns[n], n) if kept[n] else 0.0 for n in columns]
    record = case.records[0]
    return SingleDof(record.dof.name, record.input_units[0], delay=delay, **values), np.diag([*variances, 0.0])


def _variance(values: Array, name: str) -> float:
    spread = float(values.var(ddof=1)) / len(values) if len(values) > 1 else 0.0
    share = {"delta": 0.0, "beta_quadratic": SYSTEMATIC_QUADRATIC}.get(name, SYSTEMATIC)
    floor = (share * float(values.mean())) ** 2
    return spread + floor


def _both_drags(usable: Sequence[IsoEstimate]) -> tuple[Array, Array]:
    """Return both drags, from the growth of the equivalent drag (6.43) with velocity."""
    gain = np.array([quadratic_drag(e.cycle.nu_0, e.cycle.X_m * e.cycle.omega)[1] for e in usable])
    if len(usable) < 2 or float(np.ptp(gain)) < 0.1 * float(gain.max()):
        raise NotInformative(
            "IS-O needs two clearly different limit cycles to separate the two drag terms. Fly another relay with a "
            "clearly different C (output) or x_a (switching value)"
        )
    table = np.column_stack([np.ones_like(gain), gain])
    beta, quadratic = np.linalg.lstsq(table, np.array([e.beta for e in usable]), rcond=None)[0]
    return np.full(len(usable), beta), np.full(len(usable), quadratic)


def _first_harmonic() -> Doubt:
    return Doubt(
        "first-harmonic",
        "IS-O (identification by self-oscillation) uses only the first harmonic of the limit cycle. The standard "
        f"errors therefore include {SYSTEMATIC:.0%} of inertia and linear drag, and {SYSTEMATIC_QUADRATIC:.0%} of "
        "quadratic drag. The error can be larger for a craft with further dynamics",
        "compare with method='output-error', which fits the whole motion",
    )


def _undecided() -> Doubt:
    return Doubt(
        "structure-undecided",
        "one limit cycle, or two similar ones, cannot distinguish linear from quadratic damping. Linear damping was "
        "used",
        "fly a second relay with a clearly different output C",
    )


METHOD = Method("iso", "first harmonic of a relay's self-oscillation", axis=fit_by_iso)
