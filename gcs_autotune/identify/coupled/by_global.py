"""The method ``global``: two global optimisers, the better kept, polished by output error."""

from __future__ import annotations

from dataclasses import replace

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.coupled.by_output_error import fit_of, with_known_delay
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.delay import Delayed
from gcs_autotune.identify.coupled.global_search import box_of, search
from gcs_autotune.identify.coupled.limits import OPTIONS as LIMIT_OPTIONS
from gcs_autotune.identify.coupled.limits import limits_of
from gcs_autotune.identify.coupled.local import Local
from gcs_autotune.identify.coupled.output_error import solve_coupled
from gcs_autotune.identify.coupled.record import later
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.identify.result import Fit

__all__ = ["OPTIONS", "fit_by_global_search"]

BUDGET = 150
"""Simulations of all records per free parameter both searches may spend together, if not told otherwise."""

LEAST = 50
"""Smallest budget."""

OPTIONS = (
    *LIMIT_OPTIONS,
    ("budget", f"simulations to spend on the search, {BUDGET} per free parameter if not given"),
    ("seed", "of the random numbers; the same seed gives the same answer"),
)
"""Options of ``fit`` read here."""


def fit_by_global_search(case: CoupledCase) -> Fit:
    """Fit *case* from the better of two global searches; an unknown delay is taken as none unless the form frees it.

    Start values of the form are not asked. ``extra["search"]`` tells which optimiser won, its margin in minus twice the
    log-likelihood, and what each spent.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    form = replace(with_known_delay(case.form, case.delay), start={})
    seed = int(case.options.get("seed", 0))
    budget = int(case.options.get("budget", BUDGET * len(form.free)))
    if budget < LEAST:
        raise UsageError(f"a budget of {budget} simulations finds nothing: give {LEAST} or more")
    limits = limits_of(form, case)
    records = tuple(later(r, form.known.get("delay", 0.0)) for r in case.records)
    ground = ground_of(form, records)
    found = search(ground, box_of(ground, limits), budget=budget, seed=seed)
    polished = solve_coupled(
        form, records, found.theta, ground.initial, limits, levels=ground.levels, robust=case.robust
    )
    if polished is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}': both global searches found only "
            "motions that run away; narrow the bounds or give a larger budget"
        )
    told = {"winner": found.winner, "margin": found.margin, "costs": found.costs, "evaluations": found.evaluations}
    return fit_of(case, Delayed(Local(polished, records), 0.0), limits, "global", {"search": told})
