"""Blocks of every run left out instead of runs, where no run is foretold by the others.

Where each run shows one size of command only, none tells of the next although one cause explains all of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs_autotune.diagnose.explained import explains_all, leaves_nothing
from gcs_autotune.diagnose.heldout import parts_of
from gcs_autotune.diagnose.judging import Found, ordered, winner_of

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["judged_by_blocks"]


def judged_by_blocks(search: Search, found: Found) -> Found | None:
    """Judge a step of *search* again by blocks; None, and nothing changed, where that names nothing either."""
    present = search.fitted
    if search.parts.kind != "runs" or leaves_nothing(search.problem, present):
        return None
    if not explains_all(search.problem, found):
        return None
    former = search.parts, search.base_unseen, search.present_unseen, search.given_unseen
    search.parts = parts_of(search.problem, in_blocks=True)
    search.base_unseen = search.unseen(search.base)
    search.given_unseen = None if search.given is None else search.unseen(search.given, refit=False)
    search.present_unseen = search.unseen(present)
    paying = [j for j in found.judged if j.evidence > 0.0]
    again = ordered([search.judged(j.own, j.fitted, present, search.tried) for j in paying])
    winner = winner_of(again, search.tried, present)
    if winner is None:
        search.parts, search.base_unseen, search.present_unseen, search.given_unseen = former
        return None
    return Found(tuple(again), winner)
