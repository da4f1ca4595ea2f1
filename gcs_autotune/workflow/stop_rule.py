"""The second criterion of the stop rule: a relay ends once the gains designed from it are known.

The first one, five periods that agree (Miskovic2010, 6.7), is needed to read a limit cycle by its first harmonic. Here
the record is fitted exactly, together with the step flown before. So a relay may end as soon as the remaining
uncertainty of the model hardly changes the gains. The model is fitted and gains are designed after the step, and after
each half period from the third on. Each design starts from the previous gains. Their predicted ITAE is computed over
the 95 % region of the parameters. The final proposal is a new design.

With a dead zone or a thrust curve, one model does not explain both step and oscillation. Each of two relay amplitudes
then ends once a model explains it alone. The actuator is identified afterwards. For other bad fits (waves) the relay
ends after the five periods. This includes a boat that fits badly, because waves affect its small steps more than its
oscillations.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from gcs_autotune.clock import ManualClock
from gcs_autotune.design import ProvisionalGains, Spec, provisional
from gcs_autotune.errors import AutotuneError, NoGainsMeetSpec
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import MIN_SAMPLES, AxisFit, Structure, fit_axis
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import LEAST_REVERSALS, Relay
from gcs_autotune.observer import Observer, PredictedCost, SilentObserver
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.worker import Worker

__all__ = ["BY_ITSELF", "SPREAD", "UNEXPLAINED", "Assessment", "DesignQuestion", "KnownDesign", "assess"]

UNEXPLAINED = 4.0
"""Largest unexplained fraction of the motion [%] of a model from which gains are designed before five periods agree.
Project choice.
"""
BY_ITSELF = 6.0
"""Unexplained fraction of the motion [%] below which an oscillation of one amplitude counts as free of waves. Project
choice.
"""
SPREAD = 0.10
"""Largest relative excess of the worst predicted ITAE over the nominal one at which gains count as known. Project
choice."""
MOVED = 2.0
"""Change of a parameter over the last half period, in standard errors, above which the parameter does not count as
known. Project choice.
"""
TWICE = 2
"""Number of consecutive assessments that must find the gains known. Project choice."""
LEAST_SAMPLES = 2 * MIN_SAMPLES
"""Smallest number of samples of a run to assess; a fit leaves out shorter runs without a message."""
LEFT_OUT = "run-left-out"


@dataclass(frozen=True, slots=True, eq=False)
class DesignQuestion:
    """The gains to be designed, and the specification.

    ``axis``: the axis with its ``present`` gains.
    ``step``: an earlier step under the autopilot's own loop.
    ``structure``, ``delay`` [s]: settings of the identification.
    """

    axis: Axis
    present: Mapping[str, float]
    spec: Spec
    step: Trial
    structure: Structure | None = None
    delay: float | Literal["auto"] = "auto"


@dataclass(frozen=True, slots=True)
class Assessment:
    """Result of an assessment: whether the records so far determine the gains.

    Attributes
    ----------
    lacks : sentence that states what is still uncertain; empty if it is known.
    another_size : whether a model explains the run alone but not together with the step.
    refused : whether no gains meet the specification with this model.
    values, stds : the model's parameters and their standard errors.
    gains : the gains designed now, with their predicted ITAE and its uncertainty.
    """

    lacks: str
    another_size: bool = False
    refused: bool = False
    values: tuple[float, ...] = ()
    stds: tuple[float, ...] = ()
    gains: ProvisionalGains | None = None

    @property
    def answers(self) -> bool:
        """Whether the question is answered: the gains are known, or no gains meet the specification."""
        return self.refused or not self.lacks

    def moved_from(self, last: Assessment) -> bool:
        """Return whether any parameter differs from that of the *last* assessment by more than its uncertainty."""
        pairs = zip(self.values, last.values, last.stds, strict=True)
        return any(abs(now - then) > MOVED * std for now, then, std in pairs)


def assess(question: DesignQuestion, run: Trial | None = None, last: ProvisionalGains | None = None) -> Assessment:
    """Return the assessment of the gains from *run* so far and the step, or from the step alone.

    last : the gains of the last assessment, to start from.
    """
    try:
        return _assess(question, run, last)
    except (AutotuneError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return Assessment(f"no gains can be designed yet ({error})")


def _assess(question: DesignQuestion, run: Trial | None, last: ProvisionalGains | None) -> Assessment:
    runs = [question.step] if run is None else [question.step, run]
    signal = str(runs[-1].meta["signal"])
    if len(runs[-1][signal]) < LEAST_SAMPLES:
        return Assessment(f"{len(runs[-1][signal])} samples of {signal}, fewer than {LEAST_SAMPLES}")
    fit = _fit(question, *runs)
    if fit is None or fit.unexplained >= UNEXPLAINED:
        alone = None if question.axis.needs_speed or run is None else _fit(question, run)
        by_itself = alone is not None and alone.unexplained < BY_ITSELF
        much = "does not explain" if fit is None else f"explains only {fit.fit_percent:.0f} % of"
        return Assessment(f"one model {much} step and oscillation", another_size=by_itself)
    covariance, m = fit.craft_covariance, fit.model
    values = (m.alpha, m.beta, m.beta_quadratic, m.delta, m.delay)
    stds = tuple(float(std) for std in np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    try:
        gains = provisional(m, covariance, question.axis, question.present, question.spec, last)
    except NoGainsMeetSpec as refusal:
        # A better model may find gains, but it does not make a user's specification possible.
        specified = not question.spec.is_automatic
        return Assessment(f"no gains can be designed yet ({refusal})", refused=specified, values=values, stds=stds)
    wide = gains.spread > SPREAD
    lacks = f"the predicted ITAE is uncertain by {gains.spread:.0%}" if wide else ""
    return Assessment(lacks, values=values, stds=stds, gains=gains)


def _fit(question: DesignQuestion, *runs: Trial) -> AxisFit | None:
    """Return the model of all *runs*; None if no fit exists or a run was left out."""
    try:
        fit = fit_axis(runs, dof=question.axis.dof, structure=question.structure, delay=question.delay)
    except AutotuneError:
        return None
    return None if any(doubt.slug == LEFT_OUT for doubt in fit.doubts) else fit


class KnownDesign:
    """Ends relays once the gains of *question* are known; computed in *worker*, so that no tick waits for it.

    Every half period from the third on is assessed, in turn. So a slow computer reaches the same result for a record as
    a fast one, only later. Samples flown while the decisive result was awaited do not count (:attr:`counted_to`).

    Call :meth:`start` first. *observer* receives the predicted ITAE.

    Attributes
    ----------
    known : whether the last relay ended because the gains are known.
    another_size : whether a relay of another amplitude is needed.
    counted_to : the vehicle's time [s] at the end of the decisive half period; NaN when there is none, or when
        the relay ended with it.
    """

    def __init__(
        self, craft: MavlinkCraft, worker: Worker, question: DesignQuestion, observer: Observer | None = None
    ) -> None:
        self._craft, self._worker, self.question = craft, worker, question
        self._observer = observer or SilentObserver()
        self._at_work = self._stale = False
        self._reversals = 0
        self._waiting: deque[Trial] = deque()
        self._asked: Trial | None = None
        self._of_step: Assessment | None = None
        self._last: Assessment | None = None
        self._gains: ProvisionalGains | None = None
        self._times = 0
        self.known = self.another_size = False
        self.counted_to = math.nan

    def __deepcopy__(self, memo: dict[int, Any]) -> KnownDesign:
        """Return itself: a relay that is flown again uses the same criterion."""
        return self

    def start(self) -> None:
        """Start an assessment of the step alone."""
        self._ask(None)

    def begin(self) -> None:
        """Discard the oscillations so far, because a relay starts, or restarts with another size or hysteresis."""
        self._stale = self._at_work and self._of_step is not None
        self._reversals = self._times = 0
        self._waiting.clear()
        self._last = None
        self.known = self.another_size = False
        self.counted_to = math.nan
        if self._of_step is not None:
            self._judged(self._of_step, None)

    def update(self, relay: Relay, reversals: int) -> str:
        """Process one tick of *relay* after this many *reversals*. Return why the relay may end, or an empty text."""
        if reversals >= LEAST_REVERSALS and reversals > self._reversals:
            self._reversals = reversals
            self._waiting.append(self._craft.recorded_so_far(relay.settings).proper)
        while True:
            if self._at_work:
                if not self._worker.done:
                    return ""
                why = self._answered(self._worker.result)
            elif self._waiting:
                why = self._ask(self._waiting.popleft())
            else:
                return ""
            if why:
                return why

    def conclude(self, run: Trial, awaited: Callable[[], Assessment]) -> Trial:
        """Return the samples of *run*, a relay that has ended, that count for the result. Pending assessments are
        completed first.

        awaited : function that waits for the worker while monitoring the craft, and returns its answer.
        """
        why = ""
        while not (self.known or self.another_size) and (self._at_work or self._waiting):
            why = self._answered(awaited) if self._at_work else self._ask(self._waiting.popleft())
        if not why:
            return run
        settings = {"enough": True, "to_t": self.counted_to}
        return replace(run, reason=why, meta={**run.meta, **settings}).proper

    def _ask(self, run: Trial | None) -> str:
        if isinstance(self._craft.clock, ManualClock):  # simulated time stands still during a computation
            return self._judged(assess(self.question, run, self._gains), run)
        self._worker.begin(partial(assess, self.question, run, self._gains))
        self._at_work, self._asked = True, run
        return ""

    def _answered(self, answer: Callable[[], Assessment]) -> str:
        """Process the worker's *answer*; return why the relay may end, or an empty text."""
        self._at_work = False
        try:
            assessment = answer()
        except AutotuneError as error:
            assessment = Assessment(str(error))
        stale, self._stale = self._stale, False
        if stale:
            return ""
        why = self._judged(assessment, self._asked)
        if why and self._asked is not None:
            self.counted_to = self._asked.end
        return why

    def _judged(self, now: Assessment, run: Trial | None) -> str:
        """Evaluate the assessment of *run*, or of the step alone if None."""
        if self._of_step is None:
            self._of_step = now
        last, self._last = self._last, now
        if now.gains is not None:
            self._gains = now.gains
            self._observer.note(PredictedCost(now.gains.itae, now.gains.itae * (1.0 + now.gains.spread)))
        is_known = now.answers and (last is None or not last.answers or not now.moved_from(last))
        self._times = self._times + 1 if is_known else 0
        if run is None:
            return ""
        if self._times >= TWICE and now.refused:
            self.known = True
            return "no gains meet the specification with the present model"
        if self._times >= TWICE and now.gains is not None:
            self.known = True
            most = f"at most {now.gains.spread:.0%}" if now.gains.spread >= 0.005 else "less than 1%"
            return f"the model is accurate enough for the design: its uncertainty changes the predicted ITAE by {most}"
        if now.another_size:
            self.another_size = True
            return (
                "no model with proportional thrust explains both oscillation and step: small and large commands may "
                "act differently"
            )
        return ""

    def weigh(self, whole: Assessment) -> None:
        """Assess a complete *run* flown earlier."""
        self.known, self.another_size = whole.answers, whole.another_size

    def close(self) -> None:
        """Cancel pending assessments, because the relay is over."""
        self._waiting.clear()
        if self._at_work:
            self._worker.abandon()
            self._at_work = False
