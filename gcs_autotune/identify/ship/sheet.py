"""A sheet of figures: one manoeuvre of one run, as IMO and ITTC name what it tells."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.ship.imo import Figure
from gcs_autotune.identify.ship.readings import Reading

__all__ = ["Particulars", "Sheet", "helm_text", "in_lengths", "known"]

NAN = math.nan


@dataclass(frozen=True, slots=True)
class Particulars:
    """The ship: ``length`` between perpendiculars [m], trial ``speed`` [m/s] when no run tells it, model ``scale``.

    ``scale``: lengths of the ship over those of the model; times grow with its square root (Froude).
    """

    length: float = NAN
    speed: float = NAN
    scale: float = 1.0

    def seconds(self, approach: float) -> float:
        """Return full-scale L/V [s], with the approach speed of the run or else the trial speed."""
        speed = approach if approach > 0.0 else self.speed
        return self.length / speed * math.sqrt(self.scale)

    def __post_init__(self) -> None:
        """Refuse what no ship has."""
        if self.length <= 0.0 or self.speed <= 0.0 or not self.scale > 0.0:
            raise UsageError("length, speed and scale of a ship are positive")


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """The figures of one manoeuvre in one run; ``verdict`` what the manoeuvre was flown to tell, or ``""``."""

    run: str
    manoeuvre: str
    title: str
    figures: tuple[Figure, ...]
    verdict: str
    doubts: tuple[Doubt, ...]

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
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
    """Return a length in ship lengths."""
    return reading.scaled(1.0 / ship.length, "L")


def known(*figures: Figure) -> tuple[Figure, ...]:
    """Return the figures whose value is known."""
    return tuple(f for f in figures if math.isfinite(f.reading.value))


def helm_text(helm: float, unit: str) -> str:
    """Return a helm for a title: degrees of a rudder, else the number."""
    return f"{math.degrees(helm):.0f}" if unit == "rad" else f"{helm:.3g}"
