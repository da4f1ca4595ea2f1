"""Does the craft answer late? One rule for every form.

A delay costs phase margin in every later design and trades against inertia, so it must be strongly evident. A model
with a delay and one without are fitted to the same samples, those that do not answer to inputs from before the record,
and compared by the Bayesian information criterion, tempered by the residuals' correlation time (Kass1995: 6 is strong).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs_autotune.identify.solution import Solution

__all__ = ["SEARCHED_DELAYS", "DelayVerdict", "weigh_delay"]

DELAY_EVIDENCE, SURELY = 6.0, 3.0
"""Difference of the criterion, and standard errors above zero, that a delay needs. Without one that comes about by
chance once in some thousands of records of a thousand samples."""

FIRST_MARGIN = 0.5
"""Seconds left out at the start while a delay is looked for. Chosen: longer than any healthy link's."""

LONGER = 1.2
"""Where the delay turns out longer than what was left out, so many times it is left out next."""

SEARCHED_DELAYS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Delays [s] a second search starts from: far from the truth a delay's fit gets stuck."""


@dataclass(frozen=True, slots=True, eq=False)
class DelayVerdict:
    """Whether a delay is ``kept``, on what ``evidence`` (difference of the criterion), of which fits; None where one
    could not be made or ended on a bound. ``margin`` [s] was left out at the beginning.
    """

    kept: bool
    evidence: float
    margin: float
    plain: Solution | None
    lagged: Solution | None


def weigh_delay(fits: Callable[[float], tuple[Solution | None, Solution | None]]) -> DelayVerdict:
    """Weigh a delay; *fits* returns both fits, without and with one, to the samples after so many seconds."""
    margin = FIRST_MARGIN
    while True:
        plain, lagged = fits(margin)
        if plain is None or lagged is None or "delay" in lagged.at_bound:
            return DelayVerdict(False, 0.0, margin, plain, None)
        delay = lagged.value("delay")
        if delay <= margin:
            break
        margin = LONGER * delay
    correlation, place = lagged.correlation, lagged.free.index("delay")
    evidence = plain.bic(correlation) - lagged.bic(correlation)
    std = math.sqrt(float(lagged.raised_covariance[place, place]))
    return DelayVerdict(evidence > DELAY_EVIDENCE and delay > SURELY * std, evidence, margin, plain, lagged)
