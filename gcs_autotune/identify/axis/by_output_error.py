"""The method ``output-error`` for one degree of freedom: an exact fit to the whole record.

It starts from IS-O or from a scan over time constants. It adds doubts about residuals, bounds and differences between
runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.evidence import UNDECIDED, craft_covariance
from gcs_autotune.identify.axis.form import FREE, Explicit
from gcs_autotune.identify.axis.signals import first_names, objection, wanted_names
from gcs_autotune.identify.axis.start import DELAYS, Bounds, bounds_of, misfit, start_from_cycles, start_from_scan
from gcs_autotune.identify.axis.structure import Selection, select
from gcs_autotune.identify.axis.uncertainty import explicit_covariance, numbers_of, std_of
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import Findings, collect, delay_fitted
from gcs_autotune.identify.fit_builder import AxisDetails, Motion, axis_table, fit_of
from gcs_autotune.identify.moved import dof_option, moved_besides
from gcs_autotune.identify.outlier_run import CraftEstimate, OutlierRun, outlier_run_doubts, outlier_runs
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.identify.problems.stamp_correction import corrected
from gcs_autotune.identify.relay import iso
from gcs_autotune.identify.relay.iso import two_experiment_decision
from gcs_autotune.identify.result import AxisFit, Decision, IsoEstimate, Parameter, Status
from gcs_autotune.identify.signals.segment import Segment, within_horizon
from gcs_autotune.identify.signals.whiteness import whiteness
from gcs_autotune.identify.solution_doubts import solution_doubts
from gcs_autotune.trial import Trial

__all__ = ["fit_by_output_error", "fit_doubts"]

Array = NDArray[np.float64]

HALF = 0.5
"""Relative standard error above which a parameter counts as unknown. A fit without any known parameter is rejected."""

GOOD_START = 0.05
"""Fraction of the motion's variance that an IS-O start may leave unexplained. Above it a scan is tried too."""

SHORTER = (4.0, 8.0, 16.0, 32.0)
"""Numbers of pieces to try for the longest run if the input does not explain whole runs."""


def fit_by_output_error(case: Case) -> AxisFit:
    """Fit *case* by output error.

    Over whole runs a slowly varying force accumulates until no model follows the motion. If the input does not explain
    whole runs, they are cut into pieces. The fit uses the longest pieces that the input explains, each with its own
    initial state. A doubt reports this.

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
                found = _fitted(replace(case, records=tuple(pieces)))
            except NotInformative:
                continue
            return replace(found, doubts=(_only_in_pieces(longest / parts), *found.doubts))
        raise refused


class _NotExplained(NotInformative):
    """Error: the input does not explain the motion."""


def _only_in_pieces(seconds: float) -> Doubt:
    return Doubt(
        "only-in-pieces",
        f"the input does not explain the motion over whole runs, but does over pieces of {seconds:.2g} s. A slowly "
        "varying force or a changing bias also moves the craft",
        "repeat in calmer water, or with larger and faster commands; use `diagnose` to find the cause",
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
            "straight line. Use larger inputs, and check that input and output belong together"
        )


def _check_that_something_is_known(records: Sequence[Segment], parameters: Mapping[str, Parameter]) -> None:
    """Raise an error if the standard errors of inertia and of every drag exceed half of the value."""
    craft = [parameters[n] for n in records[0].dof.parameter_names()[:3] if parameters[n].status != "absent"]
    if any(p.std <= HALF * abs(p.value) for p in craft):
        return
    errors = ", ".join(f"{p.name} {100.0 * p.std / max(abs(p.value), 1e-300):.0f} %" for p in craft)
    raise NotInformative(
        f"run '{records[0].run}' determines no parameter of the craft (standard errors: {errors}). It is too "
        "short, sampled too slowly, or its motion is small compared with the noise. Record longer, at a higher "
        "rate and with larger inputs, preferably a relay"
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
    if _inertia_unresolved(solution):
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
        doubts=(*collect(findings), *fit_doubts(chosen, case, bounds)),
        extra=extra,
        axis=AxisDetails(main, tuple(estimates), decision, chosen.candidates),
    )


def _inertia_unresolved(solution: Solution) -> bool:
    """Return whether a rate is at the limit of what the sampling resolves."""
    return "a" in solution.at_bound or "c" in solution.at_bound


def _admit_unresolved_inertia(covariance: Array, alpha: float) -> None:
    """Set the standard error of inertia to its value, because the data only limit its size."""
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = alpha**2


def _status(case: Case, chosen: Selection) -> list[Status]:
    drag: list[Status] = ["fitted" if on else "absent" for on in FREE[chosen.structure][1:3]]
    inertia: Status = "at_bound" if _inertia_unresolved(chosen.solution) else "fitted"
    delay: Status = "fitted" if "delay" in chosen.solution.free else "absent" if case.delay is None else "fixed"
    return [inertia, *drag, "fitted", delay]


DELAY_CHANGE = 0.03
"""Relative change of inertia by an unproved delay, above which a doubt is raised. The change must also exceed three
standard errors."""

RUN_SPREAD, RUN_SIGMA = 0.10, 4.0
"""Limits (fraction, standard errors) for the difference of a run's parameter from the common one. Runs disagree if both
are exceeded."""


def fit_doubts(chosen: Selection, case: Case, bounds: Bounds) -> list[Doubt]:
    """Return the doubts about the chosen fit."""
    solution = chosen.solution
    found = solution_doubts(solution)
    if chosen.undecided:
        found.append(
            Doubt(
                "structure-undecided",
                "linear and quadratic damping explain the record equally well. Linear damping was used",
                case.more_levels,
            )
        )
    second_drag = _second_drag(chosen, case)
    if second_drag is not None:
        found.append(second_drag)
    delay = delay_fitted(solution, chosen.delay_evidence)
    found += [delay] if delay is not None else []
    undecided_delay = _delay_undecided(chosen, case)
    if undecided_delay is not None:
        found.append(undecided_delay)
    if _inertia_unresolved(solution):
        found.append(
            Doubt(
                "inertia-unresolved",
                "the craft responds faster than it is sampled. Only the ratio of input to steady velocity is known",
                "request a higher message rate",
            )
        )
    apart = _runs_apart(chosen, case, bounds)
    disagree = _runs_disagree(chosen, bounds) if not apart else None
    return [*found, *apart, *([disagree] if disagree is not None else [])]


def _second_drag(chosen: Selection, case: Case) -> Doubt | None:
    """Return a doubt if the evidence neither proves nor excludes a second damping term."""
    bic = {c.structure: c.bic for c in chosen.candidates}
    if chosen.rival is None or bic["affine"] - bic[chosen.structure] > UNDECIDED:
        return None
    drag = "a" if chosen.structure == "linear" else "c"
    one, both = (s.value(drag) / s.value("b") for s in (chosen.solution, chosen.rival))
    change = both / one - 1.0
    own, other = ("linear", "quadratic") if chosen.structure == "linear" else ("quadratic", "linear")
    return Doubt(
        "second-drag-undecided",
        f"{other} damping in addition to {own} damping is neither proved nor excluded. It would change {own} "
        f"damping by {100.0 * change:+.0f} %, so the standard errors were increased",
        f"{case.more_levels}: a wider range of speeds separates the two",
    )


def _delay_undecided(chosen: Selection, case: Case) -> Doubt | None:
    """Return a doubt about a delay that is neither proved nor excluded and would change the inertia.

    The test is a likelihood ratio at 10 %.
    """
    tried = chosen.with_delay
    if tried is None or "delay" in chosen.solution.free:
        return None
    ratio = chosen.delay_evidence + math.log(tried.samples / chosen.correlation)
    gain = chosen.solution.value("b")
    change = gain / tried.value("b") - 1.0
    spread = 3.0 * std_of(chosen.solution, "b", raised=False) / abs(gain)
    if ratio < 2.7 or abs(change) < max(DELAY_CHANGE, spread):
        return None
    return Doubt(
        "delay-undecided",
        f"a delay of {tried.value('delay'):.2f} s fits as well as no delay, and changes the inertia by "
        f"{100.0 * change:+.0f} %",
        f"supply --delay if it is known; {case.more_levels}",
    )


def _runs_apart(chosen: Selection, case: Case, bounds: Bounds) -> list[Doubt]:
    """Return doubts about runs that differ from the others. All are fitted with the chosen drag structure."""
    stretches = [[i for i, r in enumerate(chosen.records) if r.run == name] for name in case.names]
    craft = [chosen.solution.form.parameters.index(n) for n in chosen.solution.free if n in ("b", "a", "c")]

    by_itself: list[Solution] = []

    def estimate(runs: tuple[int, ...]) -> CraftEstimate | None:
        found = _solved(chosen, bounds, [i for run in runs for i in stretches[run]])
        if found is None or found.at_bound:
            return None
        by_itself.extend([found] if len(runs) == 1 else [])
        return CraftEstimate(found.theta[craft], explicit_covariance(found)[np.ix_(craft, craft)])

    if len(case.names) < 2 or not all(stretches):
        return []
    odd = outlier_runs(case.names, estimate)
    if odd and 2 * sum(found.white for found in by_itself) < len(by_itself):
        return [_model_lacking(chosen, odd)]
    return outlier_run_doubts(odd)


def _model_lacking(chosen: Selection, odd: Sequence[OutlierRun]) -> Doubt:
    """Return a doubt about runs that differ while the model does not explain most of them down to noise.

    Such a difference is not a sign of another craft.
    """
    runs = [Trial(r.run, r.measured) for r in chosen.records]
    dof = chosen.records[0].dof.name
    besides = [name for name in moved_besides(runs, (dof,)) if name in ("surge", "sway")]
    option = dof_option(runs, (dof,), besides) if besides else ""
    names = ", ".join(f"'{o.run}' by {o.sigmas:.0f} standard errors" for o in odd)
    moved = f". The craft also moved in {' and '.join(besides)}, which the model does not include" if besides else ""
    return Doubt(
        "runs-disagree",
        f"the parameters differ between runs ({names}), but in most runs the model error exceeds the noise. The "
        f"difference therefore does not show that the craft changed{moved}",
        f"identify them with --dof {option}" if option else "find the missing term with `diagnose`",
    )


def _solved(chosen: Selection, bounds: Bounds, which: Sequence[int]) -> Solution | None:
    """Fit the stretches *which*, with structure, delay and noise of the common fit."""
    common, segments = chosen.solution, [chosen.records[i].only(tuple(chosen.solution.noise_models)) for i in which]
    measured = {n for s in segments for n in s.signals}
    free = [n for n in common.free if n != "delay"]
    problem = Problem(common.form, [replace(s, dating=0.0) for s in segments], None, bounds.limits, free)
    return solve(
        problem,
        np.array(numbers_of(common).later(common.shift)),
        [common.initial[i] for i in which],
        levels={n: level for n, level in common.noise.items() if n in measured},
        quanta=common.quanta,
        rounds=NOISE_ROUNDS if len(measured) > 1 else 1,
        effort=None,
    )


def _runs_disagree(chosen: Selection, bounds: Bounds) -> Doubt | None:
    """Return a doubt about stretches whose inertia, fitted separately, differs from the common one."""
    if len({record.name for record in chosen.records}) < max(len(chosen.records), 2):
        return None  # one run, or pieces of runs
    common, odd = chosen.solution, []
    for i, record in enumerate(chosen.records):
        alone = _solved(chosen, bounds, [i])
        if alone is None:
            continue
        ratio = common.value("b") / alone.value("b")
        sigma = std_of(alone, "b") / abs(alone.value("b"))
        if abs(ratio - 1.0) > max(RUN_SPREAD, RUN_SIGMA * sigma):
            odd.append(f"{record.name} ({100.0 * (ratio - 1.0) * -1:+.0f} %)")
    if not odd:
        return None
    return Doubt(
        "runs-disagree",
        f"fitted separately, these runs give a different inertia: {', '.join(odd)}",
        "check whether load, speed or battery changed between the runs; identify the outlier separately",
    )
