"""When an experiment has told enough: once the gains that would be designed from it are known.

Five periods that agree (Miskovic2010, 6.7) are needed to read a limit cycle by its first harmonic. Here the record is
fitted exactly, together with the step flown before, so an experiment may end as soon as what is left in doubt about the
craft hardly matters to the gains. After the step, and after each half period from the third on, the model is fitted and
designed for, briefly and each time from the last gains on, and the predicted error over time of those gains looked at
all over the 95 % region of its parameters. What is offered in the end is designed anew.

An actuator with a dead zone or a bent curve makes the step another craft's than the oscillation. Each of two sizes is
then ended once it is explained by itself; what is between them is found afterwards, and looked at again then. Whatever
fits badly otherwise (waves) is left to the five periods, and so is a boat that fits badly: waves show in its steps,
which turn it gently, before they show in its oscillations.
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
from gcs_autotune.identify import MIN_SAMPLES, AxisFit, Structure, fit_axis, unexplained
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import LEAST_REVERSALS, Relay
from gcs_autotune.trial import Trial
from gcs_autotune.watch import PredictedCost, SilentWatcher, Watcher
from gcs_autotune.workflow.worker import Worker

__all__ = ["BY_ITSELF", "SPREAD", "UNEXPLAINED", "Assessment", "DesignQuestion", "KnownDesign", "assess"]

UNEXPLAINED = 4.0
"""Chosen [percent]: of the motion, at most so much may be left unexplained by a model that is designed from early."""
BY_ITSELF = 6.0
"""Chosen [percent]: an oscillation of one size that leaves less than this needs no waves to be explained."""
SPREAD = 0.10
"""Chosen: gains are known when the worst predicted error over time is at most this share more than the nominal one."""
MOVED = 2.0
"""Chosen: a number that the last half period moved by so many standard errors is not known yet."""
TWICE = 2
"""So many times running the design must be known."""
LEAST_SAMPLES = 2 * MIN_SAMPLES
"""Of a run that is to count in a fit: shorter ones are left out of it silently."""
LEFT_OUT = "run-left-out"


@dataclass(frozen=True, slots=True, eq=False)
class DesignQuestion:
    """What gains are wanted for: the ``axis`` with its ``present`` gains and the wish, and what is known already.

    ``step``: flown before under the autopilot's own loop. ``structure``, ``delay`` [s]: as asked for.
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

    ``lacks``: what the design still lacks, in words, empty when it is known. ``another_size``: the run is explained by
    itself but not together with the step. ``refused``: the craft so modelled cannot be given what was wished for.
    ``values``, ``stds``: the model's numbers and their standard errors.
    ``gains`` as they would be now: their predicted error over time, and by what share it is larger at worst.
    """

    lacks: str
    another_size: bool = False
    refused: bool = False
    values: tuple[float, ...] = ()
    stds: tuple[float, ...] = ()
    gains: ProvisionalGains | None = None

    @property
    def answers(self) -> bool:
        """Whether it says what gains there will be, or that there are none."""
        return self.refused or not self.lacks

    def moved_from(self, last: Assessment) -> bool:
        """Whether any number is further from what it was in the *last* one than chance explains."""
        pairs = zip(self.values, last.values, last.stds, strict=True)
        return any(abs(now - then) > MOVED * std for now, then, std in pairs)


def assess(question: DesignQuestion, run: Trial | None = None, last: ProvisionalGains | None = None) -> Assessment:
    """Return what *run*, as far as it has come, and the step, or the step alone, tell about the gains wanted.

    last : the gains when less was known, to go on from.
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
    if fit is None or unexplained(fit) >= UNEXPLAINED:
        alone = None if question.axis.needs_speed or run is None else _fit(question, run)
        by_itself = alone is not None and unexplained(alone) < BY_ITSELF
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
    """Ends relays once the answer to *question* is known; computed at *worker*, so that no tick ever waits for it.

    Every half period from the third on is asked about, in turn, and none is passed over. Of one record a slow computer
    therefore gives the same answers as a fast one, only later. What was flown while an answer was awaited does not
    count (:attr:`counted_to`).

    :meth:`start` comes first of all. *watcher* is told what the gains promise by then.

    Attributes
    ----------
    known : whether the last relay ended because the gains are known.
    another_size : whether a relay of another size is called for.
    counted_to : the vehicle's time [s] at the end of the half period that was decisive; NaN when there is none, or when
        the relay ended with it.
    """

    def __init__(
        self, craft: MavlinkCraft, worker: Worker, question: DesignQuestion, watcher: Watcher | None = None
    ) -> None:
        self._craft, self._worker, self.question = craft, worker, question
        self._watcher = watcher or SilentWatcher()
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
        """A relay that is flown again asks the same one."""
        return self

    def start(self) -> None:
        """Assess the step by itself."""
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
        """Take note of one tick of *relay* after so many *reversals*; return why it may end, empty while it may not."""
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
        """Take the worker's *answer*; return why the relay may end, empty while it may not."""
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
            self._watcher.note(PredictedCost(now.gains.itae, now.gains.itae * (1.0 + now.gains.spread)))
        is_known = now.answers and (last is None or not last.answers or not now.moved_from(last))
        self._times = self._times + 1 if is_known else 0
        if run is None:
            return ""
        if self._times >= TWICE and now.refused:
            self.known = True
            return "no gains meet the specification with the present model"
        if self._times >= TWICE and now.gains is not None:
            self.known = True
            return f"the gains are known: the model's uncertainty changes their error by {now.gains.spread:.0%}"
        if now.another_size:
            self.another_size = True
            return "the model explains this oscillation but not the step: small and large commands act differently"
        return ""

    def weigh(self, whole: Assessment) -> None:
        """Take note of the assessment of a run that was flown earlier, to its end."""
        self.known, self.another_size = whole.answers, whole.another_size

    def close(self) -> None:
        """The relay is over; nobody waits for an answer any more."""
        self._waiting.clear()
        if self._at_work:
            self._worker.abandon()
            self._at_work = False
