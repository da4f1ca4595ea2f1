"""Every number a user may give: what it means, its unit, its least and greatest value, and why.

One table serves the command line (parser and help), the settings of the workflow, and any page that asks for the same
numbers. A number that is not finite, or outside its range, is refused by name before anything is opened, made or moved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gcs_autotune.limits.flight import BY_AXIS, FLOWN, MANOEUVRED
from gcs_autotune.limits.ground import DESK, LINKED
from gcs_autotune.limits.limit import Limit, Slip, finite
from gcs_autotune.limits.safety import GUARDED

__all__ = ["LIMITS", "Limit", "Slip", "axes_of", "finite", "limit_of"]

LIMITS: Mapping[tuple[str, str], Limit] = {
    (limit.name, limit.axis): limit for limit in (*BY_AXIS, *FLOWN, *MANOEUVRED, *GUARDED, *LINKED, *DESK)
}
"""(Option without dashes, axis or empty) -> its limit; a number more is a row more in one of these tables."""


def limit_of(name: str, axis: str = "") -> Limit:
    """Return the limit called *name*, that of *axis* where axes differ."""
    return LIMITS.get((name, axis)) or LIMITS[name, ""]


def axes_of(name: str) -> Sequence[Limit]:
    """Return the limits called *name*: one, or one per axis."""
    return [limit for (called, _), limit in LIMITS.items() if called == name]
