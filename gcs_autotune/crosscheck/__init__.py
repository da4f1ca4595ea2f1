"""Sensors that report the same motion twice, held against each other: :func:`contradictions` of a recorded run.

``windows`` and ``agreement`` compare a position with the integral of a rate; ``rates``, ``track`` and ``commands`` hold
the pairs; ``wording`` says what was found. Nothing is changed: who asks decides whether to warn or to refuse.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.crosscheck.commands import command_contradictions
from gcs_autotune.crosscheck.contradiction import Contradiction
from gcs_autotune.crosscheck.rates import compared_with_rate, rate_contradictions
from gcs_autotune.crosscheck.track import course_of, heading_contradictions, speed_contradictions
from gcs_autotune.trial import Trial

__all__ = ["Contradiction", "compared_with_rate", "contradictions"]


def contradictions(trial: Trial, use: Sequence[str] | None = None) -> tuple[Contradiction, ...]:
    """Return what contradicts itself in *trial*, each pair once.

    use : columns that count; a pair of which one is left out is not compared. All when None.
    """
    found = [
        *rate_contradictions(trial, course_of),
        *speed_contradictions(trial),
        *heading_contradictions(trial),
        *command_contradictions(trial),
    ]
    return tuple(c for c in found if use is None or all(name in use for name in c.columns))
