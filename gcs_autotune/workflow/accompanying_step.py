"""The turn-rate step flown next to the heading step of a tune, before and after it. Both loops share the same gains."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.axes import axis_kind
from gcs_autotune.design import OTHER_MODE, StepMetrics, Verdict, is_followed, scatter_of
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.manoeuvres import common_windows
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.designing import StepCriteria
from gcs_autotune.workflow.experiments import STEP_AHEAD, noise_in, resolution
from gcs_autotune.workflow.proof import LEAST_NOISES, Known, Proof, proof_of_turn_rate

__all__ = ["BESIDE", "PRESENT", "PROVING", "AccompanyingStep", "Compared", "flies_accompanying_step", "within"]

BESIDE = "turn rates"
"""Label of the accompanying step's results in the report."""
PRESENT, PROVING = "turn rate with present gains", "turn rate with new gains"
"""Names of the two stages of the accompanying step: with the present gains and with the new ones."""


def flies_accompanying_step(context: TuneContext) -> bool:
    """Return whether a turn-rate step is flown in addition to the heading step of this axis."""
    return not context.law.controls_velocity and context.axis.law in OTHER_MODE


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """The accompanying step flown with the old and with the new gains, and the verdict."""

    before: StepMetrics
    after: StepMetrics
    verdict: Verdict


@dataclass(frozen=True, slots=True, eq=False)
class AccompanyingStep:
    """The accompanying turn-rate step: how it is evaluated, and the record flown with the present gains."""

    criteria: StepCriteria
    before: Trial

    @classmethod
    def flown(cls, context: TuneContext, known: Known | None) -> AccompanyingStep | None:
        """Fly the step with the present gains.

        Return None if the axis has no such step or the craft's model is unknown.
        """
        if known is None or not flies_accompanying_step(context):
            return None
        try:
            proof = proof_of_turn_rate(context.settings, context.speed, known, beside=True)
            proof = within(context.settings.envelope.heading_excursion, proof, known)
        except PreconditionFailed as error:
            context.log.say(f"turn-rate step omitted: {error}")
            return None
        before = _fly(context, StepCriteria(proof, known.noise_std, 0.0), "turn-rate-before", PRESENT)
        noise = min(known.noise_std, noise_in(before, "r"))
        return cls(StepCriteria(proof, noise, resolution(before)), before)

    def compared(self, context: TuneContext) -> Compared:
        """Fly the step with the new gains and compare both records."""
        after = _fly(context, self.criteria, "turn-rate-after", PROVING)
        return context.run_in_background(_compared, self.criteria, self.before, after)


def within(limit: float, proof: Proof, known: Known) -> Proof:
    """Return *proof* with its turn rates reduced so that the heading stays within *limit* [rad] of where it began.

    Raises
    ------
    PreconditionFailed
        Turn rates this small cannot be distinguished from the noise.
    """
    s = proof.settings
    turned = 0.5 * s.size * max(s.hold, s.settle, s.duration)
    share = SHARE * limit / turned
    if share >= 1.0:
        return proof
    size = share * s.size
    if not size > LEAST_NOISES * known.noise_std:
        raise PreconditionFailed(
            f"the heading limit of {math.degrees(limit):.0f} deg is too small for this step. "
            "Use a larger --max-heading-excursion"
        )
    return replace(proof, settings=replace(s, size=size, base=-0.5 * size))


SHARE = 0.8
"""Fraction of the heading limit that a turn-rate step may use. Project choice; the rest is margin."""


def _fly(context: TuneContext, criteria: StepCriteria, name: str, stage: str) -> Trial:
    context.turn_around(name, STEP_AHEAD, last=True)
    context.runner.come_to_rest(stage, axis_kind("yaw"))
    return context.fly(criteria.proof.step(name), stage)


def _compared(criteria: StepCriteria, before: Trial, after: Trial) -> Compared:
    windows = common_windows(before, after)
    scatter = scatter_of(criteria.halves(before, windows), criteria.halves(after, windows))
    then, now = criteria.read(before, windows), criteria.read(after, windows)
    return Compared(then, now, is_followed(then, now, scatter, BESIDE))
