"""The turn-rate step flown next to the heading step of a tune, before and after it. Both loops share the same gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_autotune.axes import axis_kind
from gcs_autotune.design import OTHER_MODE, StepMetrics, Verdict, is_followed, scatter_of
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.manoeuvres import are_read, common_windows
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.designing import StepCriteria
from gcs_autotune.workflow.experiments import STEP_AHEAD, noise_in, resolution
from gcs_autotune.workflow.proof import Known, proof_of_turn_rate, turn_sentence

__all__ = ["BESIDE", "PRESENT", "PROVING", "AccompanyingStep", "Compared", "compared_over", "flies_accompanying_step"]

BESIDE = "turn rates"
"""Label in the report for the results of the turn-rate step that accompanies a heading step."""
PRESENT, PROVING = "turn rate with present gains", "turn rate with new gains"
"""Names of the two stages of the accompanying step: with the present gains and with the new ones."""


def flies_accompanying_step(context: TuneContext) -> bool:
    """Return whether a tune of this axis flies a turn-rate step in addition to its heading step."""
    return not context.law.controls_velocity and context.axis.law in OTHER_MODE


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """Metrics of the turn-rate step flown with the old and with the new gains, and the verdict on their difference."""

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
        """Fly the turn-rate step with the present gains and return it. None if the axis has no such step, or the
        craft's model is unknown.
        """
        if known is None or not flies_accompanying_step(context):
            return None
        try:
            proof = proof_of_turn_rate(context.settings, context.speed, known, beside=True)
        except PreconditionFailed as error:
            context.log.say(f"turn-rate step omitted: {error}")
            return None
        context.log.say(turn_sentence(proof.settings, context.settings.envelope.heading_excursion))
        before = _fly(context, StepCriteria(proof, known.noise_std, 0.0), "turn-rate-before", PRESENT)
        noise = min(known.noise_std, noise_in(before, "r"))
        return cls(StepCriteria(proof, noise, resolution(before)), before)

    def compared(self, context: TuneContext) -> Compared:
        """Fly the turn-rate step with the new gains. Return the comparison with the record of the present gains."""
        after = _fly(context, self.criteria, "turn-rate-after", PROVING)
        alike = common_windows(self.before, after)
        if min(alike, default=math.inf) < self.criteria.proof.settings.duration:
            context.log.say(compared_over(alike))
        return context.run_in_background(_compared, self.criteria, self.before, after)


def compared_over(alike: Sequence[float]) -> str:
    """Return a sentence on the durations [s] of the step and the step back over which two flights are compared."""
    legs = zip(alike, ("step", "step back"), are_read(alike), strict=False)
    parts = " and ".join(f"the first {seconds:.0f} s of the {leg}" for seconds, leg, is_read in legs if is_read)
    return f"both flights are compared over {parts}: the shorter flight ends there"


def _fly(context: TuneContext, criteria: StepCriteria, name: str, stage: str) -> Trial:
    context.turn_around(name, STEP_AHEAD, last=True)
    context.runner.come_to_rest(stage, axis_kind("yaw"))
    return context.fly(criteria.proof.step(name), stage)


def _compared(criteria: StepCriteria, before: Trial, after: Trial) -> Compared:
    windows = common_windows(before, after)
    scatter = scatter_of(criteria.halves(before, windows), criteria.halves(after, windows))
    then, now = criteria.read(before, windows), criteria.read(after, windows)
    return Compared(then, now, is_followed(then, now, scatter, BESIDE))
