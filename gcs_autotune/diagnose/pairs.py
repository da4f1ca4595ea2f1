"""Two causes at once, when neither pays alone.

With both missing from the model each hides the other: a free run with the right drag but without the steady moment
drifts off as far as the base does. Where no single cause pays although much is left, the most promising ones are
taken on trial: whoever gives the other its chance is accepted with it, if the two together pay.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from gcs_autotune.diagnose.heldout import p_value
from gcs_autotune.diagnose.whiteness import correlation_of, tests_of, whiteness_of
from gcs_autotune.effects import BOOK

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Found, Judged, Search

__all__ = ["pair_ahead"]

TRIED = 2
"""Candidates taken on trial, at most."""

LEFT = 0.005
"""Whiteness above which nothing is left that two causes could explain."""


def pair_ahead(search: Search, found: Found, stage: str, *, least: float, chance: float) -> tuple[Found, Found] | None:
    """Return the two steps to the best pair of causes that pays; None when there is none. *search* is left as it was.

    found : the step that nobody won. least : share by which a candidate must lower the held-out error to be tried.
    chance : of a pair that pays on unseen data by luck alone.
    """
    if whiteness_of(tests_of(search.problem, search.fitted)) > LEFT:
        return None
    promising = [j for j in found.judged if j.evidence > 0.0 and j.gain > least and _foretells(j)]
    promising.sort(key=lambda j: -j.gain)
    best: tuple[float, Found, Found] | None = None
    fitted, unseen, tried = search.fitted, search.present_unseen, search.tried
    for first in promising[:TRIED]:
        search.fitted, search.present_unseen = first.fitted, first.unseen or unseen
        then = search.step(f"{stage} and another")
        search.fitted, search.present_unseen = fitted, unseen
        second = then.accepted
        if second is None or second.unseen is None:
            continue
        raised = correlation_of(second.fitted)
        p = p_value(unseen, second.unseen, second.fitted.levels, raised, fitted.parameters, tried * search.tried)
        cost = second.fitted.cost + search.price(second.fitted, fitted)
        if p < chance and (best is None or cost < best[0]):
            best = cost, replace(found, accepted=first), then
    return None if best is None else best[1:]


def _foretells(judged: Judged) -> bool:
    """Whether a cause foretells motion; disturbances learnt from what is left over would stand in for any pair."""
    return not BOOK[judged.own.slug].overrides("learn")
