"""A second beginning: where the base was lost and whole runs named nothing that explains them, pieces are asked.

Causes fitted in short pieces (:mod:`.footholds`) are expensive, and most lost bases are found again without them. So
the search ends first; only when it leaves much behind does it begin once more, with what pieces foretell beside what
whole runs did. What it then names stands when it leaves less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs_autotune.diagnose.attempts import RUNNERS, Attempt, best_of_each
from gcs_autotune.diagnose.explained import leaves_nothing
from gcs_autotune.diagnose.footholds import footholds
from gcs_autotune.diagnose.judging import price_of
from gcs_autotune.identify.extended.fitting import Fitted

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["LostBase", "begin_in_pieces"]


@dataclass(frozen=True, slots=True, eq=False)
class LostBase:
    """A base that misses some signal altogether, and the fits begun there, of so many candidates tried."""

    base: Fitted
    ends: Sequence[Attempt]
    tried: int


def begin_in_pieces(search: Search) -> None:
    """Begin *search* again with causes found in pieces, where its base was lost and it left much behind."""
    lost = search.lost
    if lost is None or leaves_nothing(search.problem, search.fitted):
        return
    search.say("in pieces", 0, 1)
    held = footholds(search.problem, lost.base, search.slugs, search.jobs)
    ends = best_of_each([*lost.ends, *search.ends_of(held)], lost.base)[:RUNNERS]
    if all(any(fit is old for _, old in lost.ends) for _, fit in ends):
        return
    former = search.fitted, search.parts, search.base_unseen, search.present_unseen, search.given_unseen, search.steps
    search.fitted, search.steps = lost.base, []
    search.present_unseen = search.base_unseen if lost.base is search.base else search.unseen(lost.base)
    search.until_none_pays(search.judged_all(ends, lost.base, lost.tried))
    now, before = (fit.cost + price_of(fit, lost.base) for fit in (search.fitted, former[0]))
    if now >= before:
        search.fitted, search.parts, search.base_unseen, search.present_unseen, search.given_unseen, search.steps = (
            former
        )
