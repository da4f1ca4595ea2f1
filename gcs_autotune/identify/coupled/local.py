"""One local fit, from the first start that leads somewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.coupled.initial_guess import initial_guess_of
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.reweighting import Effort
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import THOROUGH, Solution, solve_form
from gcs_autotune.models.coupled import Form

__all__ = ["MISFIT", "SKETCH", "Local", "local_fit"]

GOOD = 2.0
"""A fit whose noise is below this many times each signal's own roughness needs no other start."""

HOPELESS = 10.0
"""A fit that misses some signal by so many times the noise to begin with, that is by as much as the signal moves, has
gone astray: it is tried on short pieces."""

SKETCH = Effort(15, exact=False, astray=HOPELESS)
"""Effort for each start; only the best is fitted to the end."""

MISFIT = Effort(25, exact=False)
"""Effort for the end of a fit that leaves far more than noise: its last digits are about what the model misses."""

PATIENT = Effort(25, exact=False)
"""For whole runs at any price: a large remainder is no reason to give up."""

BETTER = 3.0
"""Short pieces are kept when they are fitted so many times better than whole runs."""


@dataclass(frozen=True, slots=True, eq=False)
class Local:
    """A fit and the records it was made on; ``pieces``: cut short, because no fit held over whole runs."""

    solution: Solution
    records: tuple[Segment, ...]
    pieces: bool = False


def local_fit(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool, whole: bool = False) -> Local:
    """Fit *form* from one start after the other until one explains the records down to their noise; the best else.

    A free run that diverges from the measured one after a while (a course-unstable craft, runs of different craft, a
    term missing) has no minimum worth the name. Then the records are cut into short pieces, each with its own initial
    state; unless *whole* runs are asked for.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    ground = initial_guess_of(form, records)
    best: Solution | None = None
    sketch = PATIENT if whole else SKETCH
    for theta in ground.starts(limits):
        found = solve_form(
            form, records, theta, ground.initial, limits, levels=ground.levels, robust=robust, effort=sketch
        )
        if found is None:
            continue
        agreed = best is not None and abs(found.log_likelihood - best.log_likelihood) < 1.0
        if best is None or found.log_likelihood > best.log_likelihood:
            best = found
        if found.converged and (agreed or _excess(found, ground.rough) < GOOD):
            break
    if best is None or (not whole and _excess(best, ground.levels) > HOPELESS):
        pieces, initial = ground.pieces()
        sturdy = ground.sturdy(limits)
        begin = ground.regression.solve(sturdy)
        better = ground.on_pieces(begin, sturdy)
        begin = begin if better is None else better[0]
        cut = solve_form(form, pieces, begin, initial, limits, levels=ground.levels, robust=robust, effort=MISFIT)
        if cut is not None and (best is None or BETTER * _excess(cut, ground.levels) < _excess(best, ground.levels)):
            return Local(cut, pieces, pieces=True)
    if best is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}': every start ran away; give start "
            "values in the form, or check that inputs and outputs belong together"
        )
    effort = THOROUGH if _excess(best, ground.rough) < GOOD else MISFIT
    last = solve_form(form, records, best.theta, best.initial, limits, levels=best.noise, robust=robust, effort=effort)
    return Local(best if last is None or last.log_likelihood < best.log_likelihood else last, tuple(records))


def _excess(solution: Solution, levels: Mapping[str, float]) -> float:
    """Return how many times its level the worst fitted signal is missed."""
    return max(solution.noise[n] / level for n, level in levels.items())
