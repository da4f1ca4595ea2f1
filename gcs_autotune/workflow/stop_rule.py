"""The second criterion of the stop rule: a relay ends once the gains that would be designed from it are known.

The first one, five periods that agree (Miskovic2010, 6.7), is needed to read a limit cycle by its first harmonic. Here
the record is fitted exactly, together with the step flown before. So a relay may end as soon as the remaining
uncertainty of the model hardly changes the gains. After the step, and after each half period from the third on, the
model is fitted and gains are designed, each time starting from the last ones. Their predicted ITAE is computed over
the 95 % region of the parameters. The final proposal is a new design.

With a dead zone or a thrust curve, one model does not explain both step and oscillation. Each of two sizes is then
ended once a model explains it alone; the actuator is identified afterwards. Other bad fits (waves) are left to the
five periods, and so is a boat that fits badly: waves show in its gentle steps before they show in its oscillations.
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
"""Chosen [percent]: a model to design from early leaves at most so much of the motion unexplained."""
BY_ITSELF = 6.0
"""Chosen [percent]: an oscillation of one size that leaves less than this unexplained has no waves in it."""
SPREAD = 0.10
"""Chosen: gains are known when the worst predicted ITAE is at most by this share above the nominal one."""
MOVED = 2.0
"""Chosen: a parameter that the last half period changed by so many standard errors is not known yet."""
TWICE = 2
"""The design must be known so many times in a row."""
LEAST_SAMPLES = 2 * MIN_SAMPLES
"""Least samples of a run: a fit leaves out shorter ones without a message."""
LEFT_OUT = "run-left-out"


@dataclass(frozen=True, slots=True, eq=False)
class DesignQuestion:
    """What gains are designed for: the ``axis`` with its ``present`` gains and the specification.

    ``step``: flown before under the autopilot's own loop. ``structure``, ``delay`` [s]: what to identify with.
    """

    axis: Axis
    present: Mapping[str, float]
    spec: Spec
    step: Trial
    structure: Structure | None = None
    delay: float | Literal["auto"] = "auto"


@dataclass(frozen=True, slots=True)
class Assessment:
    """What is known after a half period.

    Attributes
    ----------
    lacks : what the design still lacks, in words; empty when it is known.
    another_size : whether a model explains the run alone but not together with the step.
    refused : whether no gains meet the specification with this model.
    values, stds : the model's parameters and their standard errors.
    gains : those that would be designed now, with their predicted ITAE and its uncertainty.
    """

    lacks: str
    another_size: bool = False
    refused: bool = False
    values: tuple[float, ...] = ()
    stds: tuple[float, ...] = ()
    gains: ProvisionalGains | None = None

    @property
    def answers(self) -> bool:
        """Whether the gains are known, or that there are none."""
        return self.refused or not self.lacks

    def moved_from(self, last: Assessment) -> bool:
        """Whether any parameter differs from the *last* one by more than its uncertainty."""
        pairs = zip(self.values, last.values, last.stds, strict=True)
        return any(abs(now - then) > MOVED * std for now, then, std in pairs)


def assess(question: DesignQuestion, run: Trial | None = None, last: ProvisionalGains | None = None) -> Assessment:
    """Return what *run* so far and the step, or the step alone, show about the gains.

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
        much = "not" if fit is None else f"only by {fit.fit_percent:.0f} %"
        return Assessment(f"one model explains step and oscillation {much}", another_size=by_itself)
    covariance, m = fit.craft_covariance, fit.model
    values = (m.alpha, m.beta, m.beta_quadratic, m.delta, m.delay)
    stds = tuple(float(std) for std in np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    try:
        gains = provisional(m, covariance, question.axis, question.present, question.spec, last)
    except NoGainsMeetSpec as refusal:
        # Without a wish a better model may find gains; what somebody wished for no better model makes possible.
        wished = not question.spec.is_automatic
        return Assessment(f"no gains can be designed yet ({refusal})", refused=wished, values=values, stds=stds)
    wide = gains.spread > SPREAD
    lacks = f"the predicted ITAE is uncertain by {gains.spread:.0%}" if wide else ""
    return Assessment(lacks, values=values, stds=stds, gains=gains)


def _fit(question: DesignQuestion, *runs: Trial) -> AxisFit | None:
    """Return the model of all *runs*, None when there is none or when one of them was left out."""
    try:
        fit = fit_axis(runs, dof=question.axis.dof, structure=question.structure, delay=question.delay)
    except AutotuneError:
        return None
    return None if any(doubt.slug == LEFT_OUT for doubt in fit.doubts) else fit


class KnownDesign:
    """Ends relays once the gains of *question* are known; computed at *worker*, so that no tick ever waits for it.

    Every half period from the third on is assessed, in turn. So a slow computer gives the same result for one record as
    a fast one, only later. What was flown while a result was awaited does not count (:attr:`counted_to`).

    :meth:`start` comes first. *observer* gets the predicted ITAE.

    Attributes
    ----------
    known : whether the last relay ended because the gains are known.
    another_size : whether a relay of another size is called for.
    counted_to : the vehicle's time [s] at the end of the half period that was decisive; NaN when there is none, or when
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
        """A relay that is flown again has the same criterion."""
        return self

    def start(self) -> None:
        """Assess the step alone."""
        self._ask(None)

    def begin(self) -> None:
        """Forget the oscillations so far: a relay begins, or begins again with another size or hysteresis."""
        self._stale = self._at_work and self._of_step is not None
        self._reversals = self._times = 0
        self._waiting.clear()
        self._last = None
        self.known = self.another_size = False
        self.counted_to = math.nan
        if self._of_step is not None:
            self._judged(self._of_step, None)

    def update(self, relay: Relay, reversals: int) -> str:
        """Process one tick of *relay* after so many *reversals*; return why it may end, or an empty text."""
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
        """Return as much of *run*, a relay that has ended, as counts; what is still unanswered is answered first.

        awaited : waits for the worker, watching the craft, and returns its answer.
        """
        why = ""
        while not (self.known or self.another_size) and (self._at_work or self._waiting):
            why = self._answered(awaited) if self._at_work else self._ask(self._waiting.popleft())
        if not why:
            return run
        settings = {"enough": True, "to_t": self.counted_to}
        return replace(run, reason=why, meta={**run.meta, **settings}).proper

    def _ask(self, run: Trial | None) -> str:
        if isinstance(self._craft.clock, ManualClock):  # in simulated time nobody waits
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
        """Judge the assessment of *run*, None for that of the step alone."""
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
            return f"the gains are known. The model's uncertainty changes their ITAE by only {now.gains.spread:.0%}"
        if now.another_size:
            self.another_size = True
            return "the model explains this oscillation but not the step, so small and large commands act differently"
        return ""

    def weigh(self, whole: Assessment) -> None:
        """Process the assessment of a run flown earlier, to its end."""
        self.known, self.another_size = whole.answers, whole.another_size

    def close(self) -> None:
        """The relay is over; no result is needed any more."""
        self._waiting.clear()
        if self._at_work:
            self._worker.abandon()
            self._at_work = False
