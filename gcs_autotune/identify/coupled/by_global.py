"""The method ``global``: two global optimisers, the better kept, polished by output error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.coupled.by_output_error import fit_of, with_known_delay
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.global_search import box_of, search
from gcs_autotune.identify.coupled.limits import OPTIONS as LIMIT_OPTIONS
from gcs_autotune.identify.coupled.limits import limits_of
from gcs_autotune.identify.coupled.local import Delayed, LocalCost, local_fit
from gcs_autotune.identify.initial_guess import initial_guess_of
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import Solution, solve_form
from gcs_autotune.models import Form

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

    Start values of the form are not asked. The local fit from the regression's start is kept when it is better still.
    ``extra["search"]`` tells which optimiser won, its margin in minus twice the log-likelihood, what each spent, and by
    how much log-likelihood their polished answer is ahead of the local fit (negative: the local fit was kept).

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
    records = tuple(r.after(form.known.get("delay", 0.0)) for r in case.records)
    ground = initial_guess_of(form, records)
    found = search(ground, box_of(ground, limits), budget=budget, seed=seed)
    polished = solve_form(form, records, found.theta, ground.initial, limits, levels=ground.levels, robust=case.robust)
    if polished is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}': both global searches found only "
            "motions that run away; narrow the bounds or give a larger budget"
        )
    told = {"winner": found.winner, "margin": found.margin, "costs": found.costs, "evaluations": found.evaluations}
    plain = _from_regression(form, records, limits, robust=case.robust)
    ahead = math.nan if plain is None else polished.log_likelihood - plain.log_likelihood
    if plain is not None and ahead < 0.0:
        polished = plain
    extra = {"search": {**told, "ahead_of_local": ahead}}
    return fit_of(case, Delayed(LocalCost(polished, records), 0.0), limits, "global", extra)


def _from_regression(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool) -> Solution | None:
    """Return the local fit from the regression's start: with many parameters no affordable search comes near it."""
    try:
        found = local_fit(form, records, limits, robust=robust, whole=True)
    except NotInformative:
        return None
    return found.solution
