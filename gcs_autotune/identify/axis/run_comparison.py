"""Compare the runs of a fit of one axis: fit each run alone with the chosen structure, and find runs that differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.identify.axis.start import Bounds
from gcs_autotune.identify.axis.structure import Selection
from gcs_autotune.identify.axis.uncertainty import explicit_covariance, numbers_of, std_of
from gcs_autotune.identify.moved import dof_option, moved_besides
from gcs_autotune.identify.outlier_run import CraftEstimate, OutlierRun, outlier_runs
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.reweighting import NOISE_ROUNDS
from gcs_autotune.identify.problems.solution import Solution, solve
from gcs_autotune.trial import Trial

__all__ = ["RunComparison", "compare_runs"]

RUN_SPREAD, RUN_SIGMA = 0.10, 4.0
"""Limits for the difference of one run's parameter from the common value, as a fraction and in standard errors.

Runs disagree if both limits are exceeded. Project choice.
"""


@dataclass(frozen=True, slots=True)
class RunComparison:
    """Result of the comparison of the runs of a fit.

    - ``outliers``: runs whose parameters differ from those of the other runs.
    - ``lacks_term``: whether the residuals of most runs exceed the noise. The model then lacks a term, and ``outliers``
      do not indicate another craft.
    - ``moved_too``: other degrees of freedom in which the craft moved.
    - ``option``: value of ``--dof`` that includes ``moved_too``.
    - ``other_inertia``: names of runs whose inertia, fitted separately, differs from the common one. It is empty if
      there are outliers.
    """

    outliers: tuple[OutlierRun, ...] = ()
    lacks_term: bool = False
    moved_too: tuple[str, ...] = ()
    option: str = ""
    other_inertia: tuple[str, ...] = ()


def compare_runs(chosen: Selection, names: Sequence[str], bounds: Bounds) -> RunComparison:
    """Return the comparison of the runs called *names*, each fitted with the chosen drag structure."""
    stretches = [[i for i, r in enumerate(chosen.records) if r.run == name] for name in names]
    craft = [chosen.solution.form.parameters.index(n) for n in chosen.solution.free if n in ("b", "a", "c")]
    by_itself: list[Solution] = []

    def estimate(runs: tuple[int, ...]) -> CraftEstimate | None:
        solution = _solved(chosen, bounds, [i for run in runs for i in stretches[run]])
        if solution is None or solution.at_bound:
            return None
        by_itself.extend([solution] if len(runs) == 1 else [])
        return CraftEstimate(solution.theta[craft], explicit_covariance(solution)[np.ix_(craft, craft)])

    outliers = outlier_runs(names, estimate) if len(names) > 1 and all(stretches) else ()
    if not outliers:
        return RunComparison(other_inertia=_other_inertia(chosen, bounds))
    if 2 * sum(solution.white for solution in by_itself) >= len(by_itself):
        return RunComparison(outliers)
    runs = [Trial(r.run, r.measured) for r in chosen.records]
    dof = chosen.records[0].dof.name
    moved = tuple(name for name in moved_besides(runs, (dof,)) if name in ("surge", "sway"))
    return RunComparison(outliers, True, moved, dof_option(runs, (dof,), moved) if moved else "")


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


def _other_inertia(chosen: Selection, bounds: Bounds) -> tuple[str, ...]:
    """Return the stretches whose inertia, fitted separately, differs from the common one."""
    if len({record.name for record in chosen.records}) < max(len(chosen.records), 2):
        return ()  # one run, or pieces of runs
    common, odd = chosen.solution, []
    for i, record in enumerate(chosen.records):
        alone = _solved(chosen, bounds, [i])
        if alone is None:
            continue
        ratio = common.value("b") / alone.value("b")
        sigma = std_of(alone, "b") / abs(alone.value("b"))
        if abs(ratio - 1.0) > max(RUN_SPREAD, RUN_SIGMA * sigma):
            odd.append(f"{record.name} ({100.0 * (ratio - 1.0) * -1:+.0f} %)")
    return tuple(odd)
