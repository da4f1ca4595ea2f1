"""Second thoughts: a cause accepted early may have been a stand-in for two; once another is found it is asked again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_autotune.diagnose.judging import ALIKE, is_needed, price_of
from gcs_autotune.diagnose.whiteness import correlation_of
from gcs_autotune.effects import BOOK

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["reconsider"]

RIVALS = 9
"""Candidates fitted roughly, where only those count that may beat a cause already found."""


def reconsider(search: Search) -> None:
    """Let every earlier cause defend its place against its rivals, the others given.

    The newest has just won it, and does so again only where an earlier one has changed since.
    """
    newest, won = search.steps[-1].accepted, search.fitted
    last = None if newest is None else (newest.own.slug, newest.own.place)
    for key in sorted([(e.slug, e.place) for e in won.effects], key=lambda k: k == last):
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
    slugs = [s for s in search.slugs if not BOOK[s].overrides("learn")]
    again = search.step(f"second thoughts on {slug}", without, slugs=slugs, quick=True, most=RIVALS)
    rival = next((j for j in again.judged if j.own.slug != slug), None)
    if rival is not None and kept.cost - rival.fitted.cost - price_of(rival.fitted, kept) > ALIKE:
        search.take(rival)
