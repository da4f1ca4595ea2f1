"""One local fit, from the first start that leads somewhere."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.objective import Limits
from gcs_autotune.identify.coupled.output_error import CoupledSolution, solve_coupled
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.models.coupled import Form

__all__ = ["local_fit"]

GOOD = 2.0
"""A fit whose noise is below this many times each signal's own roughness needs no other start."""


def local_fit(form: Form, records: Sequence[CoupledRecord], limits: Limits, *, robust: bool) -> CoupledSolution:
    """Fit *form* from one start after the other until one explains the records down to their noise; the best else.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    ground = ground_of(form, records)
    best: CoupledSolution | None = None
    for theta in ground.starts(limits):
        found = solve_coupled(form, records, theta, ground.initial, limits, levels=ground.levels, robust=robust)
        if found is None:
            continue
        if best is None or found.log_likelihood > best.log_likelihood:
            best = found
        if found.converged and all(found.noise[n] < GOOD * level for n, level in ground.levels.items()):
            break
    if best is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}': every start ran away; give start "
            "values in the form, or check that inputs and outputs belong together"
        )
    return best
