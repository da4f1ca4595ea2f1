"""Decide whether the craft responds with a delay: one rule for every form.

A delay costs phase margin in every later design and trades off against inertia, so its evidence must be strong. Models
with and without a delay are fitted to the same samples, those that do not depend on inputs before the record. They are
compared by the Bayesian information criterion, tempered by the residuals' correlation time (Kass1995: 6 is strong).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs_autotune.identify.problems.solution import Solution

__all__ = ["SEARCHED_DELAYS", "DelayVerdict", "weigh_delay"]

DELAY_EVIDENCE, SURELY = 6.0, 3.0
"""Difference of the criterion, and standard errors above zero, that a delay needs.

Without a delay they are reached by chance once in some thousands of records of a thousand samples.
"""

FIRST_MARGIN = 0.5
"""Seconds left out at the start while a delay is looked for; longer than the delay of any healthy link."""

LONGER = 1.2
"""Factor for the next time left out, if the delay is longer than the last one."""

SEARCHED_DELAYS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Delays [s] from which a second search starts, because a fit far from the true delay does not converge."""


@dataclass(frozen=True, slots=True, eq=False)
class DelayVerdict:
    """Whether a delay is ``kept``, with its ``evidence`` (difference of the criterion) and both fits.

    A fit is None if it failed or ended on a bound. ``margin`` [s] was left out at the beginning.
    """

    kept: bool
    evidence: float
    margin: float
    plain: Solution | None
    lagged: Solution | None


def weigh_delay(fits: Callable[[float], tuple[Solution | None, Solution | None]]) -> DelayVerdict:
    """Decide on a delay; *fits* returns both fits, without and with one, to the samples after a given time [s]."""
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
