"""Causes that only pay together: a path of several, followed by likelihood alone and judged as a whole at its end.

Where two things are wrong, mending one may foretell no better (a position drifts all the same), so that no step pays
by itself. The likeliest causes are each followed by the best next one; the best of these pairs, if it does not pay
either, by a third.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs_autotune.diagnose.judging import Found, Judged, price_of, winner_of
from gcs_autotune.effects import EFFECTS

if TYPE_CHECKING:
    from gcs_autotune.diagnose.search import Search

__all__ = ["look_ahead"]

STARTS = 3
"""Candidates that are followed."""

FARTHEST = 3
"""Causes of a path, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """Causes in order, and what was judged beside each."""

    taken: tuple[Judged, ...]
    steps: tuple[Found, ...]

    def followed(self, search: Search, stage: str) -> _Path | None:
        """Return the path with the likeliest next cause; None when nothing adds to it.

        No disturbance: what a filter learns from what is left over foretells any ringing of a wrong model.
        """
        slugs = [s for s in search.slugs if not EFFECTS[s].is_disturbance]
        step = search.step(f"{stage} and another", self.taken[-1].fitted, slugs=slugs, quick=True)
        if not step.judged or step.judged[0].evidence <= 0.0:
            return None
        return _Path((*self.taken, step.judged[0]), (*self.steps, step))

    def price(self, search: Search) -> float:
        """Return the cost of its end, parameters paid for."""
        end = self.taken[-1].fitted
        return end.cost + price_of(end, search.fitted)


def look_ahead(search: Search, found: Found, stage: str) -> tuple[Found, ...] | None:
    """Return steps, all accepted, that pay together; None when no path does. *found*: the step where nothing paid."""
    starts = [j for j in found.judged if j.evidence > 0.0][:STARTS]
    paths = [p for one in starts if (p := _Path((one,), (found,)).followed(search, stage)) is not None]
    path = min(paths, key=lambda p: p.price(search), default=None)
    while path is not None:
        length, end = len(path.taken), path.taken[-1]
        tried = math.comb(max(search.tried, length), length)
        whole = search.judged(end.own, end.fitted, search.fitted, tried)
        if winner_of([whole], tried, search.fitted) is not None:
            return _accepted(path, whole)
        path = path.followed(search, stage) if length < FARTHEST else None
    return None


def _accepted(path: _Path, whole: Judged) -> tuple[Found, ...]:
    """Return the steps of a path with its causes accepted, their numbers those of its end."""
    now = {(e.slug, e.place): e for e in whole.fitted.effects}
    steps = []
    for taken, step in zip(path.taken[:-1], path.steps[:-1], strict=True):
        own = replace(taken, own=now[taken.own.slug, taken.own.place])
        steps.append(Found(tuple(own if j is taken else j for j in step.judged), own))
    last = path.steps[-1]
    others = tuple(j for j in last.judged if j is not path.taken[-1])
    return (*steps, Found((whole, *others), whole))
