"""Doubts only an output-error fit can raise: about its residuals, its bounds, its runs among each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_autotune.identify.axis.case import Case
from gcs_autotune.identify.axis.evidence import UNDECIDED
from gcs_autotune.identify.axis.start import Bounds
from gcs_autotune.identify.axis.structure import Selection
from gcs_autotune.identify.axis.uncertainty import explicit_covariance
from gcs_autotune.identify.doubts import delay_fitted, solution_doubts
from gcs_autotune.identify.odd_run import CraftEstimate, odd_run_doubts, odd_runs
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.simulators import EXPLICIT
from gcs_autotune.identify.solution import Solution, solve

__all__ = ["fit_doubts"]

DELAY_CHANGE = 0.03
"""Change of inertia by an unproved delay that is worth a word, if it also exceeds three standard errors."""

RUN_SPREAD, RUN_SIGMA = 0.10, 4.0
"""Runs disagree when a parameter differs by more than both (fraction, standard errors) from the common one."""


def fit_doubts(chosen: Selection, case: Case, bounds: Bounds) -> list[Doubt]:
    """Return what is doubtful about the chosen fit."""
    solution = chosen.solution
    found = solution_doubts(solution)
    if chosen.undecided:
        found.append(
            Doubt(
                "structure-undecided",
                "linear and quadratic damping explain the record equally well; the linear one was taken",
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
    if "a" in solution.at_bound or "c" in solution.at_bound:
        found.append(
            Doubt(
                "inertia-unresolved",
                "the craft answers faster than it is sampled: only the ratio of input to steady velocity is known",
                "ask for a higher message rate",
            )
        )
    apart = _runs_apart(chosen, case, bounds)
    disagree = _runs_disagree(chosen, bounds) if not apart else None
    return [*found, *apart, *([disagree] if disagree is not None else [])]


def _second_drag(chosen: Selection, case: Case) -> Doubt | None:
    """A second damping the evidence is undecided about."""
    bic = {c.structure: c.bic for c in chosen.candidates}
    if chosen.rival is None or bic["affine"] - bic[chosen.structure] > UNDECIDED:
        return None
    i = 1 if chosen.structure == "linear" else 2
    one, both = chosen.solution.theta, chosen.rival.theta
    change = float((both[i] / both[0]) / (one[i] / one[0])) - 1.0
    own, other = ("linear", "quadratic") if chosen.structure == "linear" else ("quadratic", "linear")
    return Doubt(
        "second-drag-undecided",
        f"{other} damping beside the {own} one is neither proved nor excluded; it would change the "
        f"{own} one by {100.0 * change:+.0f} %; standard errors were raised for it",
        f"{case.more_levels}: a wider range of speeds tells the two apart",
    )


def _delay_undecided(chosen: Selection, case: Case) -> Doubt | None:
    """A delay that would change the inertia, can be neither proved nor excluded (likelihood ratio at 10 %)."""
    tried = chosen.with_delay
    if tried is None or "delay" in chosen.solution.free:
        return None
    ratio = chosen.delay_evidence + math.log(tried.n / chosen.correlation)
    change = float(chosen.solution.theta[0] / tried.theta[0]) - 1.0
    spread = (
        3.0 * math.sqrt(explicit_covariance(chosen.solution, raised=False)[0, 0]) / abs(float(chosen.solution.theta[0]))
    )
    if ratio < 2.7 or abs(change) < max(DELAY_CHANGE, spread):
        return None
    return Doubt(
        "delay-undecided",
        f"a delay of {tried.theta[4]:.2f} s fits as well as none; inertia changes by {100.0 * change:+.0f} %",
        f"give --delay if you know it; {case.more_levels}",
    )


def _runs_apart(chosen: Selection, case: Case, bounds: Bounds) -> list[Doubt]:
    """Compare what each run says alone with what the others say, all with the drag structure chosen."""
    stretches = [[i for i, r in enumerate(chosen.records) if r.run == name] for name in case.names]
    craft = [EXPLICIT.index(n) for n in chosen.solution.free if n in ("b", "a", "c")]

    def estimate(runs: tuple[int, ...]) -> CraftEstimate | None:
        found = _solved(chosen, bounds, [i for run in runs for i in stretches[run]])
        if found is None or found.at_bound:
            return None
        return CraftEstimate(found.theta[craft], explicit_covariance(found)[np.ix_(craft, craft)])

    if len(case.names) < 2 or not all(stretches):
        return []
    return odd_run_doubts(odd_runs(case.names, estimate))


def _solved(chosen: Selection, bounds: Bounds, which: Sequence[int]) -> Solution | None:
    """Fit some of the stretches, structure, delay and noise as in the common fit."""
    common, segments = chosen.solution, [chosen.records[i].only(tuple(chosen.solution.models)) for i in which]
    measured = {n for s in segments for n in s.signals}
    free = [n for n in common.free if n != "delay"]
    problem = Problem(common.form, [replace(s, dating=0.0) for s in segments], None, bounds.limits, free)
    return solve(
        problem,
        common.theta + np.array([0.0, 0.0, 0.0, 0.0, common.shift]),
        [common.initial[i] for i in which],
        levels={n: level for n, level in common.noise.items() if n in measured},
        quanta=common.quanta,
        rounds=NOISE_ROUNDS if len(measured) > 1 else 1,
        effort=None,
    )


def _runs_disagree(chosen: Selection, bounds: Bounds) -> Doubt | None:
    """Fit every stretch by itself and compare its inertia with the common one."""
    if len(chosen.records) < 2:
        return None
    common, odd = chosen.solution, []
    for i, record in enumerate(chosen.records):
        alone = _solved(chosen, bounds, [i])
        if alone is None:
            continue
        difference = abs(float(common.theta[0] / alone.theta[0]) - 1.0)
        sigma = math.sqrt(explicit_covariance(alone)[0, 0]) / abs(float(alone.theta[0]))
        if difference > max(RUN_SPREAD, RUN_SIGMA * sigma):
            odd.append(f"{record.name} ({100.0 * (common.theta[0] / alone.theta[0] - 1.0) * -1:+.0f} %)")
    if not odd:
        return None
    return Doubt(
        "runs-disagree",
        f"taken alone, these runs give another inertia: {', '.join(odd)}",
        "did load, speed or battery change between the runs? identify the odd one by itself",
    )
