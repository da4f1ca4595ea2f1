"""Divide the error that a model explains among its causes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

__all__ = ["shares_of"]

Key = tuple[str, str]
"""Slug and place of an effect."""


def shares_of(models: Iterable[tuple[Sequence[Key], float]]) -> dict[Key, float]:
    """Return for each cause of the last model the fraction of the error that it explains.

    These fractions add up to the fraction that the last model explains. They are empty if that is unknown. A new cause
    gets what its model explains beyond the remaining causes. A cause that replaces another thus gets that one's
    fraction too, or remains without one. Of several causes added at once, the last one gets it, because the runs
    support them only together. Any other change (a removed cause, a better fit) scales the fractions of the remaining
    causes.

    models : the models of a search, one after the other. Each has its causes in the order added, and the fraction of
    the error that they explain together. NaN: unknown.
    """
    shares: dict[Key, float] = {}
    explained = math.nan
    for causes, explained in models:
        if not math.isfinite(explained):
            continue
        total = min(max(explained, 0.0), 1.0)
        kept = sum(shares.get(key, 0.0) for key in causes)
        added = [key for key in causes if key not in shares]
        lost = [share for key, share in shares.items() if key not in causes]
        is_exchange = kept > 0.0 and len(added) == len(lost) and not any(lost)  # of causes without a fraction
        if added and total >= kept and not is_exchange:
            shares = {key: shares.get(key, 0.0) for key in causes}
            shares[added[-1]] = total - kept
        else:
            scale = total / kept if kept > 0.0 else 0.0
            shares = {key: scale * shares.get(key, 0.0) for key in causes}
            if causes and kept <= 0.0:
                shares[causes[-1]] = total
    return shares if math.isfinite(explained) else {}
