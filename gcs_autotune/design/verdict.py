"""The stated measure: is the step after really better than the step before?

New gains are kept only when every line holds; otherwise the old ones are put back. In words: clearly less
error over time, and none of the usual prices for it (overshoot, oscillation, a standing error, a busy actuator).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_autotune.design.result import StepMetrics

__all__ = ["Verdict", "is_better"]

ITAE_RATIO = 0.95
"""The new ITAE must be at least 5 % lower."""
OVERSHOOT = 0.15
"""Overshoot allowed at least; more only when the old gains had it too."""
OSCILLATION = 0.05
"""Half peak-to-peak in the last third allowed at least; more only when the old gains had more."""
STEADY_ERROR = 0.05
TRAVEL = 1.0
"""Actuator travel allowed at least: one full stroke per second."""
TRAVEL_RATIO = 3.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether to keep the new gains, and every reason, good and bad, in words."""

    better: bool
    reasons: tuple[str, ...]


def is_better(before: StepMetrics, after: StepMetrics, free_overshoot: float = 0.0) -> Verdict:
    """Compare two steps of the same size recorded over equally long windows.

    free_overshoot : what the control law itself causes (``Law.free_overshoot``), allowed on top.
    """
    lines = [
        _itae(before, after),
        _limit("overshoot", after.overshoot, max(OVERSHOOT + free_overshoot, before.overshoot), before.overshoot),
        _limit("remaining swing", after.oscillation, max(OSCILLATION, before.oscillation), before.oscillation),
        _limit("steady error", after.steady_error, max(STEADY_ERROR, before.steady_error), before.steady_error),
        _travel(before, after),
        _settles(before, after),
    ]
    return Verdict(all(good for good, _ in lines), tuple(text for _, text in lines))


def _itae(before: StepMetrics, after: StepMetrics) -> tuple[bool, str]:
    old, new = before.itae, after.itae
    if not math.isfinite(new):
        return False, "the new step's error could not be measured"
    if not math.isfinite(old):
        return True, f"error over time (ITAE) {new:.3g} s^2; before it could not be measured"
    good = new <= ITAE_RATIO * old
    change = f"{abs(1.0 - new / old):.0%} {'lower' if new <= old else 'higher'}" if old > 0.0 else "higher"
    tail = "" if good else f"; at least {1.0 - ITAE_RATIO:.0%} lower is asked for"
    return good, f"error over time (ITAE) {old:.3g} -> {new:.3g} s^2, {change}{tail}"


def _limit(what: str, new: float, most: float, old: float) -> tuple[bool, str]:
    good = new <= most
    return (
        good,
        f"{what} {old:.1%} -> {new:.1%} of the step{'' if good else f', more than the {most:.1%} allowed'}",
    )


def _travel(before: StepMetrics, after: StepMetrics) -> tuple[bool, str]:
    most = max(TRAVEL, TRAVEL_RATIO * before.travel)
    good = after.travel <= most
    tail = "" if good else f", more than the {most:.2f} allowed"
    return good, f"actuator travel {before.travel:.2f} -> {after.travel:.2f} full strokes per second{tail}"


def _settles(before: StepMetrics, after: StepMetrics) -> tuple[bool, str]:
    if math.isfinite(after.settling):
        return True, f"settled after {after.settling:.1f} s"
    if after.hidden_by_noise:
        return True, "settling cannot be read: the noise is wider than the 5 % band"
    if math.isfinite(before.settling):
        return False, f"did not settle to 5 %; the old gains did in {before.settling:.1f} s"
    return True, "neither step was within 5 % when its record ended"
