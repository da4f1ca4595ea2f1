"""A sheet of figures, with the IMO's standards for ship manoeuvrability, MSC.137(76), section 5.3.

The standards apply to ships of 100 m and more; for smaller craft they are a comparison, not a rule. The limits on
overshoot depend on L/V in seconds. For a scale model use the full-scale value, ``sqrt(scale)`` times the model's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.notebook import Displayed

__all__ = [
    "Criterion",
    "Figure",
    "Particulars",
    "Shape",
    "Sheet",
    "first_overshoot_limit",
    "helm_text",
    "in_lengths",
    "judged",
    "known",
    "per_helm",
    "per_helm_words",
    "second_overshoot_limit",
]

Array = NDArray[np.float64]

ADVANCE, TACTICAL_DIAMETER, INITIAL_TURNING, TRACK_REACH = 4.5, 5.0, 2.5, 15.0
"""Largest allowed values in ship lengths. Source: MSC.137(76), 5.3.1, 5.3.2 and, for a stop with full astern, 5.3.4."""

FIRST_OVERSHOOT_20 = math.radians(25.0)
"""Largest allowed first overshoot of a 20/20 zig-zag [rad]. Source: MSC.137(76), 5.3.3.3."""

Verdict = Literal["meets", "fails", "open"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The classic diagram of a manoeuvre as numbers: curves and marked points, in SI units.

    - ``kind``: ``time`` (a signal and the helm over time), ``track`` (positions ahead over positions abeam of the
      approach, from the execute) or ``curve`` (yaw rate over helm).
    - ``lines``: name, abscissae (n,) and ordinates (n,). A ``time`` shape has the heading change first, then the helm.
    - ``points``: label, abscissa and ordinate.
    - ``helm_unit``: unit of the helm: ``rad`` or ``1``.
    """

    kind: Literal["time", "track", "curve"]
    lines: tuple[tuple[str, Array, Array], ...]
    points: tuple[tuple[str, float, float], ...] = ()
    helm_unit: str = ""


@dataclass(frozen=True, slots=True)
class Criterion:
    """A criterion for a figure.

    - ``value``: largest allowed value, in the unit of the figure.
    - ``source``: where the criterion is defined.
    """

    value: float
    source: str


@dataclass(frozen=True, slots=True)
class Figure(Displayed):
    """One figure of a sea trial, with its criterion if there is one.

    The verdict is ``open`` without a criterion, and also if the limit is within two standard errors of the value.
    """

    slug: str
    name: str
    reading: Reading
    limit: Criterion | None = None

    @property
    def verdict(self) -> Verdict:
        """Whether the figure meets its criterion: ``meets``, ``fails`` or ``open``."""
        if self.limit is None or not math.isfinite(self.reading.value):
            return "open"
        spread = 2.0 * self.reading.std if math.isfinite(self.reading.std) else 0.0
        if abs(self.reading.value - self.limit.value) < spread:
            return "open"
        return "meets" if self.reading.value <= self.limit.value else "fails"

    def to_dict(self) -> dict[str, object]:
        """Return the figure as data for JSON."""
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
    """Return a figure with its criterion.

    limit : largest allowed value. None or NaN means that no criterion applies.
    """
    applies = limit is not None and math.isfinite(limit)
    return Figure(slug, name, reading, Criterion(float(limit), f"MSC.137(76) {source}") if applies and limit else None)


def first_overshoot_limit(length_over_speed: float) -> float:
    """Return the largest allowed first overshoot [rad] of a 10/10 zig-zag, MSC.137(76), 5.3.3.1.

    length_over_speed : L/V [s].
    """
    return math.radians(_between(length_over_speed, 10.0, 20.0, 5.0, 0.5))


def second_overshoot_limit(length_over_speed: float) -> float:
    """Return the largest allowed second overshoot [rad] of a 10/10 zig-zag, MSC.137(76), 5.3.3.2.

    length_over_speed : L/V [s].
    """
    return math.radians(_between(length_over_speed, 25.0, 40.0, 17.5, 0.75))


def _between(seconds: float, short: float, long: float, offset: float, slope: float) -> float:
    if math.isnan(seconds):
        return math.nan
    return short if seconds < 10.0 else long if seconds >= 30.0 else offset + slope * seconds


NAN = math.nan


@dataclass(frozen=True, slots=True)
class Particulars:
    """Data of the ship.

    - ``length``: length between perpendiculars [m].
    - ``speed``: trial speed [m/s], used if no run contains it.
    - ``scale``: ship length divided by model length. Times scale with the square root of the scale (Froude).
    """

    length: float = NAN
    speed: float = NAN
    scale: float = 1.0

    def seconds(self, approach: float) -> float:
        """Return the full-scale L/V [s] for the speed *approach* [m/s] of the run, or else for the trial speed."""
        speed = approach if approach > 0.0 else self.speed
        return self.length / speed * math.sqrt(self.scale)

    def __post_init__(self) -> None:
        """Reject impossible values."""
        if self.length <= 0.0 or self.speed <= 0.0 or not self.scale > 0.0:
            raise UsageError(
                "length, speed and scale of the ship must be greater than zero. Check --length, --speed and --scale"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Sheet(Displayed):
    """The figures of one manoeuvre in one run.

    ``verdict``: conclusion about the craft as text, empty if there is none. ``shape``: the manoeuvre's diagram, if it
    has one.
    """

    run: str
    manoeuvre: str
    title: str
    figures: tuple[Figure, ...]
    verdict: str
    doubts: tuple[Doubt, ...]
    shape: Shape | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the sheet as data for JSON."""
        return {
            "run": self.run,
            "manoeuvre": self.manoeuvre,
            "title": self.title,
            "figures": [f.to_dict() for f in self.figures],
            "verdict": self.verdict,
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }

    def __getitem__(self, slug: str) -> Figure:
        """Return a figure by its slug."""
        return {f.slug: f for f in self.figures}[slug]


def in_lengths(reading: Reading, ship: Particulars) -> Reading:
    """Return the length *reading* [m] converted to ship lengths."""
    return reading.scaled(1.0 / ship.length, "L")


def known(*figures: Figure) -> tuple[Figure, ...]:
    """Return those of *figures* whose value is known."""
    return tuple(f for f in figures if math.isfinite(f.reading.value))


def per_helm(unit: str, helm: str) -> str:
    """Return the unit of a quantity in *unit* per helm in *helm* (``rad`` for a rudder, ``1`` for a normalised
    output).
    """
    if helm == "rad":
        return {"rad/s": "1/s", "rad": "1"}.get(unit, f"{unit}/rad")
    return unit if helm == "1" else f"{unit}/({helm})"


def per_helm_words(helm: str) -> str:
    """Return "per helm", or "per full helm" for a normalised output, whose unit 1 is not shown."""
    return "per full helm" if helm == "1" else "per helm"


def helm_text(helm: float, unit: str) -> str:
    """Return the rudder angle *helm* in *unit* as text for a title: degrees, percent of full output, or the number."""
    if unit == "rad":
        return f"{round(math.degrees(helm))}"
    return f"{round(100.0 * helm)} %" if unit == "1" else f"{helm:.3g}"
