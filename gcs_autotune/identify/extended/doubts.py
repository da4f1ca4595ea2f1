"""Reasons not to trust the effects of a fit blindly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from gcs_autotune import chi_square
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify.problem import Fitted, Problem, label_of
from gcs_autotune.identify.result import Doubt, Parameter

__all__ = ["effect_doubts"]

SIGNIFICANCE = 0.01
"""Chance of keeping an effect that is not there."""


def effect_doubts(
    problem: Problem, fitted: Fitted, parameters: Mapping[str, Parameter], correlation: float
) -> Iterator[Doubt]:
    """Yield a doubt for every effect the runs do not call for: the likelihood ratio, *correlation* samples as one."""
    for own in fitted.effects:
        entry = EFFECTS[own.slug]
        others = tuple(e for e in fitted.effects if e is not own)
        without = problem.fit(fitted.theta, others, fitted.initial, shift=fitted.shift)
        pays = math.inf if without is None else without.cost - fitted.cost
        numbers = max(len(entry.parameters), 1)
        if chi_square.exceeded_by_chance(max(pays, 0.0) / correlation, numbers) > SIGNIFICANCE:
            said = ", ".join(f"{n} = {v:.3g} +- {parameters[label_of(own, n)].std:.2g}" for n, v in own.values.items())
            yield Doubt(
                "effect-not-needed",
                f"these runs do not call for {own.slug} at {own.place} ({said}): without it they are followed as well",
                f"leave it out; to look for it, fly {entry.separated_by}",
            )
