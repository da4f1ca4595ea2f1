"""Second thoughts: a cause accepted early may have been a stand-in for two; once another is found it is asked again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.diagnose.judging import ALIKE, is_needed, price_of
from gcs_autotune.diagnose.whiteness import correlation_of
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify.extended.fitting import Fitted

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["drop_swallowed", "reconsider"]

HALF_WIDTH = 1.96
"""Standard errors to either end of a 95 % interval."""

RIVALS = 9
"""Candidates fitted roughly, where only those count that may beat a cause already found."""


def reconsider(search: Search) -> None:
    """Let every earlier cause defend its place against its rivals, the others given.

    The newest has just won it, and does so again only where an earlier one has changed since.
    """
    newest, won = search.steps[-1].accepted, search.fitted
    last = None if newest is None else (newest.own.slug, newest.own.place)
    given = {(e.slug, e.place) for e in search.base.effects}
    asked = [(e.slug, e.place) for e in won.effects if (e.slug, e.place) not in given]
    for key in sorted(asked, key=lambda k: k == last):
        if key != last or search.fitted is not won:
            _asked_again(search, *key)


def _asked_again(search: Search, slug: str, place: str) -> None:
    """Leave out a cause that is not needed any more; let a likelier one take its place."""
    kept, problem = search.fitted, search.problem
    rest = tuple(e for e in kept.effects if (e.slug, e.place) != (slug, place))
    if len(rest) == len(kept.effects):
        return
    without = problem.fit(kept.theta, rest, kept.initial, trials=12, shift=kept.shift)
    if without is None:
        return
    likelihood = (without.cost - kept.cost) / correlation_of(kept)
    if not is_needed(likelihood, kept, without, search.tried):
        search.fitted, search.present_unseen = without, search.unseen(without)
        return
    slugs = [s for s in search.slugs if not EFFECTS[s].is_disturbance]
    again = search.step(f"second thoughts on {slug}", without, slugs=slugs, quick=True, most=RIVALS)
    rival = next((j for j in again.judged if j.own.slug != slug), None)
    if rival is not None and kept.cost - rival.fitted.cost - price_of(rival.fitted, kept) > ALIKE:
        search.take(rival)


def drop_swallowed(search: Search) -> None:
    """Leave out causes whose numbers, by their 95 % intervals, may all be such that nothing happens."""
    given = {(e.slug, e.place) for e in search.base.effects}
    while True:
        fit = search.fitted
        lost = next((e for e in fit.effects if (e.slug, e.place) not in given and _is_swallowed(fit, e)), None)
        rest = tuple(e for e in fit.effects if e is not lost)
        without = None if lost is None else search.problem.fit(fit.theta, rest, fit.initial, shift=fit.shift)
        if without is None:
            return
        search.fitted, search.present_unseen = without, search.unseen(without)


def _is_swallowed(fitted: Fitted, own: EffectInstance) -> bool:
    entry, i = EFFECTS[own.slug], fitted.effects.index(own)
    at = {n: len(fitted.free) + k for k, (j, n) in enumerate(fitted.free_effects) if j == i and n in entry.grows_with}
    if not at or set(at) != set(entry.grows_with) & set(own.values):
        return False
    std = np.sqrt(np.maximum(np.diag(fitted.covariance(correlation_of(fitted))), 0.0))
    return all(abs(own[n] - entry.neutral.get(n, 0.0)) <= HALF_WIDTH * std[k] for n, k in at.items())
