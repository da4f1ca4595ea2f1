"""All numbers that a user can set, with meaning, unit, range and the reason for the range.

One table serves the command line (parser and help), the settings of the workflow, and the web page. A number that is
not finite or outside its range is rejected, with its name, before anything is opened, created or moved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gcs_autotune.limits.flight import BY_AXIS, FLOWN, MANOEUVRED
from gcs_autotune.limits.ground import DESK, LINKED
from gcs_autotune.limits.limit import Limit, UnitMistake, finite
from gcs_autotune.limits.safety import GUARDED

__all__ = ["LIMITS", "Limit", "UnitMistake", "axes_of", "finite", "limit_of"]

LIMITS: Mapping[tuple[str, str], Limit] = {
    (limit.name, limit.axis): limit for limit in (*BY_AXIS, *FLOWN, *MANOEUVRED, *GUARDED, *LINKED, *DESK)
}
"""(Option without dashes, axis or empty) -> its limit. To add a number, add a row to one of these tables."""


def limit_of(name: str, axis: str = "") -> Limit:
    """Return the limit called *name*; if it differs by axis, the one of *axis*."""
    return LIMITS.get((name, axis)) or LIMITS[name, ""]


def axes_of(name: str) -> Sequence[Limit]:
    """Return all limits called *name*: one, or one per axis."""
    return [limit for (called, _), limit in LIMITS.items() if called == name]
