"""The method ``output-error`` for one degree of freedom: an exact maximum-likelihood fit to the whole record.

The fit starts from IS-O or from a scan over time constants. Doubts are added about residuals, parameters on their
bounds, and differences between runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.evidence import craft_covariance
from gcs_autotune.identify.axis.form import FREE, Explicit
from gcs_autotune.identify.axis.run_comparison import compare_runs
from gcs_autotune.identify.axis.signals import first_names, objection, wanted_names
from gcs_autotune.identify.axis.start import DELAYS, Bounds, bounds_of, misfit, start_from_cycles, start_from_scan
from gcs_autotune.identify.axis.structure import Selection, select
from gcs_autotune.identify.axis.uncertainty import numbers_of
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import Choice, Findings, FittedDelay, doubts_about, inertia_unresolved
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, axis_table, fit_of
from gcs_autotune.identify.problems.stamp_correction import corrected
from gcs_autotune.identify.relay import iso
from gcs_autotune.identify.relay.iso import two_experiment_decision
from gcs_autotune.identify.result import AxisFit, Decision, IsoEstimate, Parameter, Status
from gcs_autotune.identify.signals.segment import Segment, within_horizon
from gcs_autotune.identify.signals.whiteness import whiteness

__all__ = ["fit_by_output_error"]

Array = NDArray[np.float64]

HALF = 0.5
"""Relative standard error above which a parameter counts as unknown. A fit without any known parameter is rejected.

Project choice.
"""

GOOD_START = 0.05
"""Largest fraction of the motion's variance that an IS-O start may leave unexplained. Above it, a scan is tried too.

Project choice. A smaller value costs the time of a scan more often.
"""

SHORTER = (4.0, 8.0, 16.0, 32.0)
"""Numbers of pieces into which the longest run is cut, tried in this order if the input does not explain whole runs.

Project choice.
"""


def fit_by_output_error(case: Case) -> AxisFit:
    """Fit *case* by output error.

    Over whole runs a slowly varying force accumulates until no model follows the motion. If the input does not explain
    whole runs, they are cut into pieces. The fit uses the longest pieces whose motion the input explains. Each piece
    has its own initial state. A doubt reports that the runs were cut.

    Raises
    ------
    NotInformative
        The input explains the motion no better than a straight line, even in pieces.
    """
    try:
        return _fitted(case)
    except _NotExplained as refused:
        longest = max(float(r.stamps[-1]) - r.start for r in case.records)
        for parts in SHORTER:
            pieces = within_horizon(case.records, longest / parts)
            try:
                fit = _fitted(replace(case, records=tuple(pieces)))
            except NotInformative:
                continue
            return replace(fit, doubts=(_only_in_pieces(longest / parts), *fit.doubts))
        raise refused


class _NotExplained(NotInformative):
    """Error: the input does not explain the motion."""


def _only_in_pieces(seconds: float) -> Doubt:
    return Doubt(
        "only-in-pieces",
        f"the input explains the motion over pieces of {seconds:.2g} s, but not over whole runs. A slowly varying "
        "force, a changing bias or a missing term can cause this",
        "repeat in calmer water, or with larger and faster commands. Use `diagnose` to find the cause",
    )


def _fitted(case: Case) -> AxisFit:
    bounds = bounds_of(case.records)
    estimates = [iso.estimate(c, case.delay or 0.0) for c in case.cycles]
    decision = two_experiment_decision(estimates)
    start = _start(case, estimates, bounds)
    names, left_out, start, records = _signals(case, start, bounds)
    chosen = select(records, names, start, bounds, case.structure, case.delay, decision, robust=case.robust)
    better = corrected(records, [r.only(names) for r in chosen.records], chosen.solution)
    if better is not None:
        start = numbers_of(chosen.solution)
        chosen = select(better, names, start, bounds, case.structure, case.delay, decision, robust=case.robust)
    _check_that_input_explains(case.records, chosen)
    solution = chosen.solution
    estimates = [iso.estimate(c, solution.value("delay")) for c in case.cycles]
    return _assembled(case, chosen, estimates, two_experiment_decision(estimates), names, left_out, bounds)


def _start(case: Case, estimates: Sequence[IsoEstimate], bounds: Bounds) -> Explicit:
    """Return the start values from IS-O, or those from the scan if they explain the record clearly better."""
    begin = start_from_cycles(estimates)
    if begin is not None:
        begin = begin._replace(a=float(np.clip(begin.a, 1e-3, bounds.rate)))
        variance = sum(float(np.var(r.main.values)) * min(len(r.main.t), 400) for r in case.records)
        if misfit(case.records, begin) <= GOOD_START * variance:
            return begin
    scanned = start_from_scan(case.records, bounds, DELAYS if case.delay is None else (case.delay,))
    if begin is not None and misfit(case.records, begin) <= misfit(case.records, scanned):
        return begin
    return scanned


def _signals(
    case: Case, start: Explicit, bounds: Bounds
) -> tuple[tuple[str, ...], dict[str, str], Explicit, Sequence[Segment]]:
    """Return the signals to fit, the omitted ones with reasons, a better start, and the corrected records.

    The time stamps of the input changes in the records are corrected.
    """
    records = case.records
    if case.use is not None:
        return wanted_names(records, case.use), {}, start, records
    names = first_names(records)
    axis = records[0].dof
    if names != (axis.position,) or not any(r.velocity is not None for r in records):
        return names, {}, start, records
    structure = case.structure or "affine"
    first = select(records, names, start, bounds, structure, case.delay, None, robust=case.robust)
    better = corrected(records, [r.only(names) for r in first.records], first.solution)
    if better is not None:
        records, start = better, numbers_of(first.solution)
        first = select(records, names, start, bounds, structure, case.delay, None, robust=case.robust)
    reason = objection(first.records, first.solution)
    if reason:
        return names, {axis.velocity: reason}, numbers_of(first.solution), records
    return (axis.position, axis.velocity), {}, numbers_of(first.solution), records


def _check_that_input_explains(records: Sequence[Segment], chosen: Selection) -> None:
    """Raise an error if the fit is no better than a straight line (position) or a constant (velocity).

    The comparison, per stretch, uses the Bayesian criterion of the fit.
    """
    solution = chosen.solution
    n = solution.samples / chosen.correlation
    gain = 0.0
    for r in solution.rests:
        degree = 1 if r.signal == records[0].dof.position else 0
        t = r.t - r.t[0]
        line = r.measured - np.polyval(np.polyfit(t, r.measured, degree), t)
        floor = max(float(r.judged @ r.judged), 1e-300)
        gain += len(t) / chosen.correlation * math.log(max(float(line @ line), 1e-300) / floor)
    if gain < 3.0 * math.log(max(n, 2.0)) + 6.0:
        raise _NotExplained(
            f"run '{records[0].run}': the input {records[0].input_names[0]} explains the motion no better than a "
            "straight line. Use larger inputs. Check that input and output belong together"
        )


def _check_that_something_is_known(records: Sequence[Segment], parameters: Mapping[str, Parameter]) -> None:
    """Raise an error if the standard errors of inertia and of every drag exceed half of the value."""
    craft = [parameters[n] for n in records[0].dof.parameter_names()[:3] if parameters[n].status != "absent"]
    if any(p.std <= HALF * abs(p.value) for p in craft):
        return
    errors = ", ".join(f"{p.name} {100.0 * p.std / max(abs(p.value), 1e-300):.0f} %" for p in craft)
    raise NotInformative(
        f"run '{records[0].run}' determines no parameter of the craft (standard errors: {errors}). It is too short, "
        "sampled too slowly, or its motion is small compared with the noise. Record longer, at a higher rate and "
        "with larger inputs, preferably a relay"
    )


def _assembled(
    case: Case,
    chosen: Selection,
    estimates: Sequence[IsoEstimate],
    decision: Decision | None,
    names: tuple[str, ...],
    left_out: dict[str, str],
    bounds: Bounds,
) -> AxisFit:
    solution, records = chosen.solution, chosen.records
    covariance = craft_covariance(solution, chosen.rival, chosen.correlation)
    model = numbers_of(solution).model(records[0].dof, records[0].input_units[0])
    if inertia_unresolved(solution):
        _admit_unresolved_inertia(covariance, model.alpha)
    table = axis_table(model, covariance, _status(case, chosen))
    _check_that_something_is_known(records, table.parameters)
    main = solution.rests[0].signal
    motion = Motion.of_solution(records, solution, main)
    findings = Findings(
        case,
        model,
        chosen.structure,
        table.parameters,
        decision,
        motion.noise[main],
        motion.fit_percent,
        solution.white,
    )
    extra: dict[str, Any] = {
        "signals": list(names),
        "signals_left_out": left_out,
        "largest": case.largest,
        "std_inflation": float(solution.factors.max()),
        "residual_correlation_time": chosen.correlation,
        "delay_evidence": chosen.delay_evidence,
        "time_shift": solution.shift,
        "whiteness_p": min(whiteness(s) for s in solution.scores),
        "sigma": {k: law.sigma for k, law in solution.noise_models.items()},
        "quantum": {k: law.quantum for k, law in solution.noise_models.items()},
    }
    return fit_of(
        case,
        "output-error",
        model,
        table,
        motion,
        structure=chosen.structure,
        doubts=doubts_about(
            findings,
            solution,
            Choice(chosen, case),
            FittedDelay(solution, chosen.delay_evidence),
            compare_runs(chosen, case.names, bounds),
        ),
        extra=extra,
        axis=AxisDetails(main, tuple(estimates), decision, chosen.candidates),
    )


def _admit_unresolved_inertia(covariance: Array, alpha: float) -> None:
    """Set the standard error of inertia to its value, because the data only limit its size."""
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = alpha**2


def _status(case: Case, chosen: Selection) -> list[Status]:
    drag: list[Status] = ["fitted" if on else "absent" for on in FREE[chosen.structure][1:3]]
    inertia: Status = "at_bound" if inertia_unresolved(chosen.solution) else "fitted"
    delay: Status = "fitted" if "delay" in chosen.solution.free else "absent" if case.delay is None else "fixed"
    return [inertia, *drag, "fitted", delay]
