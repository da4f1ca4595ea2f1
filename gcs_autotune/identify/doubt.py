"""Define a doubt: a reason not to trust a result."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from gcs_autotune.notebook import Displayed

__all__ = ["Doubt", "Grade", "once"]

Grade = Literal["distrust", "caution", "note"]
"""How much a doubt matters: the result should not be used, should be used with care, or has taken it into account."""

DISTRUST = frozenset(
    {
        "above-command",
        "contradiction",
        "inertia-not-positive",
        "joint-fit-failed",
        "negative-drag",
        "no-inertia",
        "not-converged",
        "not-excited",
        "not-physical",
        "not-seen",
        "poor-fit",
        "run-apart",
        "runs-away",
        "short-horizon",
        "simulation-not-understood",
        "time-unit",
        "unsettled",
        "wrong-sign",
    }
)
"""Slugs of doubts with which the result should not be used before the remedy."""

NOTES = frozenset(
    {
        "another-place",
        "beyond-noise",
        "command-scaled",
        "commands-exchanged",
        "current-unknown",
        "day-to-day",
        "dead-column",
        "delay-fitted",
        "dropped-rows",
        "effect-not-needed",
        "first-harmonic",
        "forces-in-shares",
        "gaps",
        "late-samples",
        "missing-samples",
        "no-bias",
        "no-disturbance",
        "not-settled",
        "quantised",
        "repeated-stamps",
        "residuals-not-white",
        "run-twice",
        "runs-of-no-step",
        "second-drag-undecided",
        "simulation-elsewhere",
        "structure-undecided",
        "thrust-while-steering",
        "unit-missing",
        "validation-was-needed",
    }
)
"""Slugs of doubts that the result has taken into account, such as by wider error bars. All others are cautions."""


@dataclass(frozen=True, slots=True)
class Doubt(Displayed):
    """A reason not to trust a result.

    - ``slug``: its short name.
    - ``cause``: its probable cause.
    - ``cure``: the remedy.
    """

    slug: str
    cause: str
    cure: str

    @property
    def grade(self) -> Grade:
        """How much the doubt matters."""
        return "distrust" if self.slug in DISTRUST else "note" if self.slug in NOTES else "caution"


def once(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Return *doubts* in their order, without repeats of the same slug and cause."""
    return tuple({(d.slug, d.cause): d for d in doubts}.values())
