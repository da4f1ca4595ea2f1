"""Compare sensors that measure the same motion: :func:`contradictions` between the columns of a recorded run.

``windows`` and ``agreement`` compare a position with the integral of a rate. ``rates``, ``track`` and ``commands``
define the pairs, and ``wording`` describes the result. The run is not changed. The caller decides whether to warn or to
reject a run.
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
    """Return the contradictions in *trial*, each pair once.

    use : names of the columns that are used; None for all. A pair with an unused column is not compared.
    """
    found = [
        *rate_contradictions(trial, course_of),
        *speed_contradictions(trial),
        *heading_contradictions(trial),
        *command_contradictions(trial),
    ]
    return tuple(c for c in found if use is None or all(name in use for name in c.columns))
