"""Decide whether to keep new gains: the step with the new gains must be better than the step with the old ones.

New gains are kept only if every criterion is met; otherwise the old ones are restored. The ITAE must be clearly lower,
without more overshoot, oscillation, remaining error or actuator travel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs_autotune.design.result import StepMetrics
from gcs_autotune.notebook import Displayed

__all__ = ["Verdict", "is_better", "is_calmer", "is_followed", "is_foretold", "is_no_worse", "scatter_of"]

ITAE_RATIO = 0.95
"""Largest ratio of the new to the old ITAE. Project choice: the new ITAE must be at least 5 % lower."""
OVERSHOOT = 0.15
"""Overshoot [fraction of the step] that is always allowed.

Project choice. More is allowed only if the old gains had it too.
"""
OSCILLATION = 0.05
"""Oscillation [fraction of the step] that is always allowed.

Project choice. More is allowed only if the old gains had it too.

It is half the peak-to-peak value in the last third of the record.
"""
STEADY_ERROR = 0.05
TRAVEL = 1.0
"""Actuator travel that is always allowed [fraction of full per second]. Project choice: one full stroke per second."""
TRAVEL_RATIO = 3.0


NO_WORSE, CLEARLY = 1.05, 0.8
"""Limits of an exception for two modes with the same gains.

Project choice. With an ITAE at most 5 % higher, gains are still better if the other mode's ITAE is 20 % lower.
"""
MISSED, SMALL_ERROR = 1.5, 0.01
"""Ratio of predicted and measured ITAE from which a prediction is doubtful, and ITAE [s^2] below which they are not
compared. Project choice: predictions of good models are within 25 %.
"""
NOT_WORSE, ALIKE = 1.1, 0.03
"""Limits of a change that has another aim: the ratio of the new to the old ITAE, and the difference of overshoot,
oscillation or remaining error [fraction of the step]. Project choice: speed steps with the same gains differ as much.
"""
TIMES = 3.0
"""Largest difference of two measurements with the same gains, in standard deviations of one half.

94 % of the differences are smaller, if the standard deviation is estimated from two pairs of halves (Student's t of 2
degrees of freedom). Project choice.
"""
SCATTER_OF_PEAKS = 0.2
"""Relative difference of the peaks of an irregular oscillation between two records that counts as scatter.

Project choice.
"""


@dataclass(frozen=True, slots=True)
class Verdict(Displayed):
    """Decision whether to keep the new gains: every criterion as whether it is met, and a sentence."""

    criteria: tuple[tuple[bool, str], ...]

    @property
    def better(self) -> bool:
        """Whether all criteria are met."""
        return all(good for good, _ in self.criteria)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Sentences of all criteria."""
        return tuple(text for _, text in self.criteria)

    @property
    def against(self) -> tuple[str, ...]:
        """Sentences of the criteria that are not met."""
        return tuple(text for good, text in self.criteria if not good)


def scatter_of(*pairs: Sequence[StepMetrics]) -> dict[str, float]:
    """Return name -> standard deviation of one measurement, for each limited quantity.

    pairs : step and step back flown with the same gains, once for each set of gains.
    """
    found = {}
    for name in ("overshoot", "oscillation", "steady_error"):
        apart = [getattr(p[0], name) - getattr(p[1], name) for p in pairs if len(p) == 2]
        known = [d for d in apart if math.isfinite(d)]
        found[name] = math.sqrt(sum(d * d for d in known) / (2.0 * len(known))) if known else 0.0
    return found


def is_foretold(predicted: float, measured: float) -> bool:
    """Return whether the ITAE *predicted* for a step [s^2] is near the *measured* one."""
    low, high = sorted((max(predicted, SMALL_ERROR), max(measured, SMALL_ERROR)))
    return not high > MISSED * low


def is_better(
    before: StepMetrics,
    after: StepMetrics,
    free_overshoot: float = 0.0,
    other: tuple[float, float] | None = None,
    scatter: Mapping[str, float] | None = None,
    slower: float = 1.0,
) -> Verdict:
    """Return the decision from two steps of the same size, recorded over equally long windows.

    free_overshoot : overshoot that the control law itself causes (``Law.free_overshoot``); it is allowed in addition.
    other : ITAE [s^2] of the other mode's step before and after, if the gains serve another mode.
    scatter : result of :func:`scatter_of`. An increase within the scatter does not count.
    slower : factor by which the ITAE may rise if the actuator travels clearly less (``Style.slower``).
    """
    known = scatter or {}
    oscillation = TIMES * known.get("oscillation", 0.0)
    if scatter is not None:
        oscillation = max(oscillation, SCATTER_OF_PEAKS * before.oscillation)
    over, off = (TIMES * known.get(name, 0.0) for name in ("overshoot", "steady_error"))
    lines = [
        _itae(before, after, other, slower),
        _limit("overshoot", after.overshoot, OVERSHOOT + free_overshoot, before.overshoot, over),
        _limit("remaining oscillation", after.oscillation, OSCILLATION, before.oscillation, oscillation),
        _limit("remaining error", after.steady_error, STEADY_ERROR, before.steady_error, off),
        _travel(before, after),
        _settles(before, after),
    ]
    return Verdict(tuple(lines))


def is_no_worse(before: StepMetrics, after: StepMetrics, scatter: Mapping[str, float]) -> Verdict:
    """Return whether a step is followed no worse after a change that has another aim; arguments as for
    :func:`is_better`.
    """
    old, new = before.itae, after.itae
    good = math.isfinite(new) and not new > NOT_WORSE * old
    names = ("oscillation", "overshoot", "steady_error")
    oscillation, over, off = (max(TIMES * scatter.get(name, 0.0), ALIKE) for name in names)
    tail = "" if good else f", more than {NOT_WORSE - 1.0:.0%} higher"
    lines = [
        (good, f"tracking error (ITAE) {old:.3g} -> {new:.3g} s^2{tail}"),
        _limit("overshoot", after.overshoot, OVERSHOOT, before.overshoot, over),
        _limit("remaining oscillation", after.oscillation, OSCILLATION, before.oscillation, oscillation),
        _limit("remaining error", after.steady_error, STEADY_ERROR, before.steady_error, off),
        _travel(before, after),
    ]
    return Verdict(tuple(lines))


def is_followed(before: StepMetrics, after: StepMetrics, scatter: Mapping[str, float], what: str) -> Verdict:
    """Return the decision from steps of the other mode.

    The change of the ITAE is only reported. Oscillation and actuator travel are limited.
    """
    old, new = before.itae, after.itae
    known = math.isfinite(old) and math.isfinite(new) and old > 0.0
    change = f", {abs(1.0 - new / old):.0%} {'lower' if new <= old else 'HIGHER'}" if known else ""
    oscillation = max(TIMES * scatter.get("oscillation", 0.0), SCATTER_OF_PEAKS * before.oscillation)
    lines = [
        (True, f"tracking error (ITAE) {old:.3g} -> {new:.3g} s^2{change}"),
        _limit("remaining oscillation", after.oscillation, OSCILLATION, before.oscillation, oscillation),
        _travel(before, after),
    ]
    return Verdict(tuple((good, f"{what}: {text}") for good, text in lines))


def is_calmer(before: StepMetrics, after: StepMetrics, slower: float) -> bool:
    """Return whether the actuator travels clearly less at an ITAE that is at most *slower* times as large."""
    return slower > 1.0 and after.itae <= slower * before.itae and after.travel <= CLEARLY * before.travel


def _itae(
    before: StepMetrics, after: StepMetrics, other: tuple[float, float] | None, slower: float
) -> tuple[bool, str]:
    old, new = before.itae, after.itae
    if not math.isfinite(new):
        return False, "the tracking error of the new step could not be measured"
    if not math.isfinite(old):
        return True, f"tracking error (ITAE) {new:.3g} s^2, not measurable before"
    good = new <= ITAE_RATIO * old
    change = f"{abs(1.0 - new / old):.0%} {'lower' if new <= old else 'higher'}" if old > 0.0 else "higher"
    tail = "" if good else f", but at least {1.0 - ITAE_RATIO:.0%} lower is required"
    if not good and other is not None and new <= NO_WORSE * old and other[1] <= CLEARLY * other[0]:
        good, tail = True, f". It is accepted, because the other mode's error is {1.0 - other[1] / other[0]:.0%} lower"
    if not good and is_calmer(before, after, slower):
        less = 1.0 - after.travel / before.travel
        good, tail = (
            True,
            f". It is accepted, because a slower loop is required and the actuator travels {less:.0%} less",
        )
    return good, f"tracking error (ITAE) {old:.3g} -> {new:.3g} s^2, {change}{tail}"


def _limit(what: str, new: float, least: float, old: float, scatter: float) -> tuple[bool, str]:
    """Return whether *new* is within the limit, and a sentence.

    The limit is *least*, or *old* plus the *scatter* of two measurements, whichever is larger.
    """
    most = max(least, old + scatter)
    good = new <= most
    text = f"{what} {old:.1%} -> {new:.1%} of the step"
    if good and new > max(least, old):
        text += ", within the measurement scatter"
    return good, text if good else f"{text}, more than the {most:.1%} allowed"


def _travel(before: StepMetrics, after: StepMetrics) -> tuple[bool, str]:
    most = max(TRAVEL, TRAVEL_RATIO * before.travel)
    good = after.travel <= most
    tail = "" if good else f", more than the {most:.2f} allowed"
    return good, f"actuator travel {before.travel:.2f} -> {after.travel:.2f} full strokes per second{tail}"


def _settles(before: StepMetrics, after: StepMetrics) -> tuple[bool, str]:
    if math.isfinite(after.settling):
        return True, f"settled after {after.settling:.1f} s"
    if after.hidden_by_noise:
        return True, "settling time not measurable, because readings leave the 5 % band by noise"
    if math.isfinite(before.settling):
        return False, f"not settled within 5 %, although the old gains settled in {before.settling:.1f} s"
    if before.hidden_by_noise:
        return True, "not settled within 5 %. The old gains' settling time was not measurable because of noise"
    return True, "neither step settled within 5 % during its record"
