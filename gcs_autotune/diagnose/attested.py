"""A candidate under process noise, and whether it may be named: what it gains on data it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gcs_autotune.diagnose.heldout import BLOCKS, FEWEST
from gcs_autotune.diagnose.score import HALF, is_form_of
from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify import WanderingFit

__all__ = ["WORTH", "Attested", "densities_of", "interval_of", "plainest"]

Array = NDArray[np.float64]

WORTH = 3.0
"""Log-likelihood gained on data left out (odds of twenty to one) that a name must have."""

AMPLE = 10.0
"""Chosen: log-likelihood gained on data left out that needs no interval where each of three parts contributes to it."""

FAR_MORE = 3.0
"""Chosen: so many times what is needed, gained on what is left out, makes up for too little on the runs given. With
once as much, asymmetric thrust was named of a clean craft (weather, seed 75 case 11: 5.6 of 6.4, 12.5 left out)."""

RUNS_AWAY = -1e6
"""Log density of a sample on which a model runs away."""

FAR_ROUGHER = 2.0
"""Chosen: squares of innovations on data left out, over what the other runs' fit expects, from which on its weather is
another's."""

FEWEST_WHOLES = 4
"""Chosen: parts left out, of which the scatter tells something: two or three are alike by accident."""

SURE = 0.95
"""Quantile at either end of a 90 % interval: a gain is none in one case of twenty."""


@dataclass(frozen=True, slots=True, eq=False)
class Attested:
    """A candidate under process noise: log-likelihood gained on the runs fitted, and on each part left out.

    ``interval``: 90 % of what is gained on all data left out. ``paid``: whether it may be named; ``falls_short``: it
    pays on the runs it is fitted to, and not on each left out.
    """

    effect: EffectInstance
    fit: WanderingFit
    gain: float
    unseen: Array
    needed: float
    step: int
    interval: tuple[float, float] = (0.0, math.inf)
    brief: bool = False
    """Its time, or the craft's own beside it, is so short that it may as well be a smoother of the recorded signal, or
    the craft's inertia; or shorter than the interval judged where commands answer the heading: never named."""
    uncertain: bool = False
    """Whether the 95 % intervals of its numbers contain no effect: never named."""
    ahead: float = 1.0
    """Error some seconds ahead on the runs given, over that of the model before; 1 where it was not looked at."""
    unsound: str = ""
    """Why it is not named although it pays: no model of the craft stands with it, or predictions are no better."""

    @property
    def foretold(self) -> float:
        """Log-likelihood gained on all data left out."""
        return float(self.unseen.sum())

    @property
    def ample(self) -> bool:
        """Whether each of three parts and more left out contributes to ten nats, and none all but three of them.

        That is sure whatever its scatter over blocks: no single gust brings it.
        """
        even = len(self.unseen) > 2 and bool(np.all(self.unseen > 0.0))
        return even and self.foretold > AMPLE and self.foretold - float(self.unseen.max()) > WORTH

    @property
    def holds(self) -> bool:
        """Whether what is left out gains surely, and every part of it.

        Of three parts and more one may lose, where the others gain well more. What is ample is sure.
        """
        if self.interval[0] < 0.0 and not self.ample:
            return False
        losing = int(np.sum(self.unseen <= 0.0))
        if losing == 0:
            return self.foretold > WORTH
        most = float(self.unseen.max())
        return losing == 1 and len(self.unseen) > 2 and min(self.foretold - most, 0.5 * self.foretold) > WORTH

    @property
    def paid(self) -> bool:
        """Whether it may be named: what was needed of so many tried it gains on the runs given, or far more of it on
        those left out, where the plain model itself may be lost.
        """
        enough = self.gain > self.needed or self.foretold > FAR_MORE * self.needed
        return enough and self.holds and not self.brief and not self.uncertain and not self.unsound

    @property
    def falls_short(self) -> bool:
        """Whether it pays on the runs it is fitted to, and does not hold on those it has not seen, or is unsound."""
        return self.gain > self.needed and (not self.holds or bool(self.unsound))


def densities_of(fits: Sequence[WanderingFit | None], plain: Sequence[WanderingFit | None]) -> list[Array]:
    """Return the log densities (samples,) of what each fold leaves out, under the weather that *plain* shows there.

    Where that is far rougher than the other runs' (a gust, a glitch, a worse day), it is so for every candidate:
    by the others' calm, a few samples would outweigh all there is, to either side.
    """
    found = []
    for fit, base in zip(fits, plain, strict=True):
        rougher = 1.0 if base is None or base.roughness < FAR_ROUGHER else base.roughness
        found.append(np.full(1, RUNS_AWAY) if fit is None else fit.densities(rougher))
    return found


def interval_of(before: Sequence[Array], after: Sequence[Array]) -> tuple[float, float]:
    """Return the 90 % interval of the log-likelihood gained on all that is left out: of two the narrower.

    From its scatter over blocks, for a single gust, or one manoeuvre, may bring all of a gain; and over what is left
    out in turn: a noise level fitted anew takes from lively blocks what it gives to quiet ones, in every run alike.
    """
    size = max(FEWEST, sum(map(len, before)) // BLOCKS)
    wholes, sums = [], []
    for old, new in zip(before, after, strict=True):
        d = new - old
        wholes.append(float(np.sum(d)))
        sums += [float(np.sum(part)) for part in np.array_split(d, max(1, len(d) // size))]
    half = _half_width(sums)
    if len(wholes) >= FEWEST_WHOLES:
        half = min(half, _half_width(wholes))
    return sum(wholes) - half, sum(wholes) + half


def _half_width(parts: Sequence[float]) -> float:
    """Return half the 90 % interval of the sum of *parts*, by Student's law of their scatter."""
    n = len(parts)
    return float(stdtrit(n - 1, SURE)) * math.sqrt(n * float(np.var(parts, ddof=1))) if n > 1 else math.inf


def plainest(winner: Attested, paid: Sequence[Attested]) -> Attested:
    """Return *winner*, or the same cause by a plainer law where that holds as well."""
    found = (a for a in paid if is_form_of(winner.effect, a.effect) and a.foretold > HALF * winner.foretold)
    return next(found, winner)
