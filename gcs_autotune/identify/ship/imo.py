"""The IMO's standards for ship manoeuvrability, resolution MSC.137(76), section 5.3, beside what was measured.

They are written for ships of 100 m and more; smaller craft find in them a yardstick, not a rule. The limits on
overshoot depend on L/V in seconds: for a scale model take the full-scale value, ``sqrt(scale)`` times the model's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.identify.ship.readings import Reading

__all__ = [
    "Figure",
    "Limit",
    "first_overshoot_limit",
    "judged",
    "second_overshoot_limit",
]

ADVANCE, TACTICAL_DIAMETER, INITIAL_TURNING = 4.5, 5.0, 2.5
"""Largest values in ship lengths; 5.3.1 and 5.3.2."""

FIRST_OVERSHOOT_20 = math.radians(25.0)
"""Largest first overshoot of a 20/20 zig-zag [rad]; 5.3.3.3."""

Verdict = Literal["meets", "fails", "open"]


@dataclass(frozen=True, slots=True)
class Limit:
    """A criterion: the largest value allowed, in the unit of its figure, and where it stands."""

    value: float
    source: str


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure as ship people quote it, with the criterion beside it when there is one.

    ``verdict`` is ``open`` without a criterion, and when the limit lies within two standard errors of the reading.
    """

    slug: str
    name: str
    reading: Reading
    limit: Limit | None = None

    @property
    def verdict(self) -> Verdict:
        """Whether the figure meets its criterion."""
        if self.limit is None or not math.isfinite(self.reading.value):
            return "open"
        spread = 2.0 * self.reading.std if math.isfinite(self.reading.std) else 0.0
        if abs(self.reading.value - self.limit.value) < spread:
            return "open"
        return "meets" if self.reading.value <= self.limit.value else "fails"

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        return {
            "slug": self.slug,
            "name": self.name,
            "value": self.reading.value,
            "std": self.reading.std,
            "unit": self.reading.unit,
            "limit": None if self.limit is None else self.limit.value,
            "source": "" if self.limit is None else self.limit.source,
            "verdict": self.verdict,
        }


def judged(slug: str, name: str, reading: Reading, limit: float | None = None, source: str = "") -> Figure:
    """Return a figure; *limit* None or NaN when no criterion applies."""
    applies = limit is not None and math.isfinite(limit)
    return Figure(slug, name, reading, Limit(float(limit), f"MSC.137(76) {source}") if applies and limit else None)


def first_overshoot_limit(length_over_speed: float) -> float:
    """Return the largest first overshoot [rad] of a 10/10 zig-zag; 5.3.3.1. length_over_speed : L/V [s]."""
    return math.radians(_between(length_over_speed, 10.0, 20.0, 5.0, 0.5))


def second_overshoot_limit(length_over_speed: float) -> float:
    """Return the largest second overshoot [rad] of a 10/10 zig-zag; 5.3.3.2. length_over_speed : L/V [s]."""
    return math.radians(_between(length_over_speed, 25.0, 40.0, 17.5, 0.75))


def _between(seconds: float, short: float, long: float, offset: float, slope: float) -> float:
    if math.isnan(seconds):
        return math.nan
    return short if seconds < 10.0 else long if seconds >= 30.0 else offset + slope * seconds
