"""Decide whether the craft responds with a delay: one rule for every form.

A delay reduces the phase margin of every later design, and a longer delay can replace part of the inertia in a fit. Its
evidence must therefore be strong. Models with and without a delay are fitted to the same samples, those that do not
depend on inputs before the record. They are compared by the Bayesian information criterion, tempered by the residuals'
correlation time. On the scale of Kass1995 a difference of 6 is strong evidence.

A fit with a delay may lose its inertia: it ends on the shortest time constant that the sampling resolves, and the delay
replaces the whole inertia. Such a delay is not kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs_autotune.identify.problems.solution import Solution

__all__ = ["SEARCHED_DELAYS", "DelayVerdict", "weigh_delay"]

DELAY_EVIDENCE, SURELY = 6.0, 3.0
"""Limits from which a delay is kept: decrease of the information criterion, and standard errors above zero.

For a craft without a delay, both limits are exceeded by chance once in some thousands of records of a thousand samples.
Source of the first: Kass1995.
"""

FIRST_MARGIN = 0.5
"""Time [s] left out at the start of a record while a delay is tested.

It exceeds the delay of any healthy link. Project choice.
"""

LONGER = 1.2
"""Factor for the time left out in the next attempt, relative to the fitted delay. Project choice.

It applies if the delay exceeds the time left out so far.
"""

SEARCHED_DELAYS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Delays [s] from which a second search starts.

A fit that starts far from the true delay does not converge. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class DelayVerdict:
    """Decision whether the craft responds with a delay.

    - ``kept``: whether the delay is kept.
    - ``evidence``: decrease of the Bayesian information criterion with the delay.
    - ``margin`` [s]: time left out at the beginning of every record.
    - ``plain``, ``lagged``: fits without and with a delay, None if they failed or ended on a bound.
    """

    kept: bool
    evidence: float
    margin: float
    plain: Solution | None
    lagged: Solution | None


def weigh_delay(fits: Callable[[float], tuple[Solution | None, Solution | None]]) -> DelayVerdict:
    """Return the decision whether a delay is kept.

    fits : function of the time [s] that is left out at the beginning. It returns the fits without and with a delay.
    """
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
    is_sure = evidence > DELAY_EVIDENCE and delay > SURELY * std
    return DelayVerdict(is_sure and set(lagged.at_bound) <= set(plain.at_bound), evidence, margin, plain, lagged)
