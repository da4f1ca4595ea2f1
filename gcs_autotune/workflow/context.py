"""State that the stages of one tune or experiment share: the vehicle, the axis, the settings and the log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ParamSpec, TypeVar

from gcs_autotune.clock import ManualClock
from gcs_autotune.design import LAWS, Law
from gcs_autotune.firmware import Axis
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Manoeuvre, SignCheck
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.background import await_worker, hold_neutral, run_in_background
from gcs_autotune.workflow.experiments import dive_for, speed_for
from gcs_autotune.workflow.mission import Visit
from gcs_autotune.workflow.preflight import (
    STAGE,
    check_signs,
    most_speed_of,
    sign_check_for,
    steered_meanwhile,
)
from gcs_autotune.workflow.resuming import Earlier
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.supplied_model import SuppliedModel
from gcs_autotune.workflow.tune_log import TuneLog

__all__ = ["TuneContext", "tune_runner"]

T = TypeVar("T")
P = ParamSpec("P")


@dataclass(frozen=True, slots=True, eq=False)
class TuneContext:
    """One tune or experiment on one vehicle.

    Attributes
    ----------
    earlier : trials of an earlier run to use.
    axis : the axis, with the vehicle's own parameter names.
    present : values of the axis' parameters, under the canonical names.
    given : the user's model to design from; None: identify the craft in this run.
    throttle, speed : throttle [fraction of full] and speed [m/s] at which to tune.
    """

    settings: TuneSettings
    visit: Visit[TuneLog]
    runner: ManoeuvreRunner
    earlier: Earlier
    axis: Axis
    given: SuppliedModel | None
    present: Mapping[str, float]
    throttle: float
    speed: float

    @property
    def craft(self) -> MavlinkCraft:
        """The vehicle, as flown by the manoeuvres."""
        return self.visit.craft

    @property
    def log(self) -> TuneLog:
        """The log of all events of the run so far."""
        return self.visit.log

    @property
    def law(self) -> Law:
        """The autopilot's control law of the axis. Raises ``UnknownName`` for an axis that is only identified."""
        return lookup(LAWS, self.axis.law, "control law")

    def fly(self, manoeuvre: Manoeuvre, stage: str) -> Trial:
        """Report the *stage* and fly it, unless an earlier run already has. Return the manoeuvre. ``NotAchieved`` is
        raised if it fails.
        """
        flown = self.earlier.take(manoeuvre.name)
        if flown is not None:
            self.visit.keep(flown)
            self.log.flown(flown)
            self.log.say(f"{stage}: not flown. Using {flown.name} from the earlier run")
            return flown
        self.come_down()
        self.log.say(stage)
        return self.runner.fly(manoeuvre, stage)

    def come_down(self) -> None:
        """Dive if the next manoeuvre needs depth and a buoyant craft has risen towards the surface."""
        if self.craft.firmware.floats or not self.axis.excitation.below_surface:
            return
        dive = dive_for(self.axis.dof, self.craft.firmware, self.craft.observe())
        if dive is not None:
            self.log.say("diving")
            self.runner.fly(dive, "diving")

    def turn_around(self, before: str, ahead: float, *, last: bool = False) -> bool:
        """Turn a boat around before the trial *before* of up to *ahead* [s] if the space requires it. Return whether it
        turned.

        The boat does not turn before a trial that an earlier run has flown. If stages do not end early, the boat always
        turns.
        """
        if self.earlier.has(before):
            return False
        ahead = math.inf if not self.settings.ends_early else ahead
        return self.runner.turn_around(self.throttle, ahead, last=last)

    def compute_while_turning(self, before: str, work: Callable[[], T]) -> T:
        """Return ``work()``, computed by the worker while a boat returns before the trial *before*."""
        if isinstance(self.craft.clock, ManualClock):  # simulated time stands still during a computation
            self.turn_around(before, math.inf)
            return work()
        self.visit.worker.begin(work)
        try:
            self.turn_around(before, math.inf)
        except BaseException:
            self.visit.worker.abandon()
            raise
        found: T = self.await_worker()
        return found

    def await_worker(self) -> Any:
        """Return the result that the worker is computing. Until then monitor the craft. Exceptions of the worker are
        raised here.
        """
        if not self.visit.worker.done:
            hold_neutral(self.craft)
        return await_worker(self.craft, self.visit.worker, self.runner.bear)

    def begin(self) -> TuneContext:
        """Check that the actuators act in the right direction before a loop or a relay uses them. Dive first if
        necessary. The actuators are that of the axis and the one that steers during the run. Return the context. Its
        throttle is adjusted if the boat's cruise throttle drives it much faster than its cruise speed.
        """
        axis, firmware, servos = self.axis, self.craft.firmware, self.craft.servos
        output, limit = self.settings.relay_output, self.runner.speed_limit
        self.log.say(STAGE)
        context = self
        meanwhile = steered_meanwhile(axis.dof, firmware, servos)
        for dof in (axis.dof, *(["yaw"] if meanwhile else [])):
            check = sign_check_for(
                dof,
                self.craft,
                self.throttle,
                axis.needs_speed,
                output if dof == axis.dof else None,
                wanted_speed=self.speed,
                most_speed=most_speed_of(self.settings.throttle, self.speed, limit),
            )
            if dof == axis.dof:
                check_signs(check, self.runner.attempt)
            else:
                envelope = replace(self.settings.envelope, cruise=self.speed)
                self.runner.check_steering(check, envelope)
            if isinstance(check, SignCheck) and check.eased:
                context = self._with_throttle(check.throttle)
        self.come_down()
        return context

    def _with_throttle(self, throttle: float) -> TuneContext:
        """Report the *throttle* [fraction] just measured and return the context with that throttle."""
        cruise = speed_for(replace(self.settings, throttle=None, speed=None), self.axis, self.present)
        is_own = (self.throttle, self.speed) == cruise
        these = "CRUISE_SPEED and CRUISE_THROTTLE" if is_own else "this speed and this throttle"
        pair = (
            f"{self.throttle:.0%} throttle drives the boat much faster than {self.speed:g} m/s, so {these} do not "
            f"match. {throttle:.1%} throttle is enough"
        )
        self.log.say(f"{pair} and is used now")
        used = "these two parameters" if is_own else "CRUISE_SPEED and CRUISE_THROTTLE"
        self.runner.too_fast = (
            f"{pair}. The autopilot uses {used}. Run `tune speed` first, which measures and "
            f"writes them, or set CRUISE_THROTTLE to {max(100.0 * throttle, 1.0):.0f}"
        )
        return replace(self, throttle=throttle)

    def run_in_background(self, work: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
        """Return ``work(*args, **named)``, computed by the worker while the link is served."""
        return run_in_background(self.craft, self.visit.worker, self.runner.bear, work, *args, **named)


def tune_runner(settings: TuneSettings, visit: Visit[TuneLog], speed: float) -> ManoeuvreRunner:
    """Return the runner that flies the experiments and proofs at *speed* [m/s], and stores and reports every trial."""
    log = visit.log

    def keep(trial: Trial) -> None:
        visit.keep(trial)
        log.flown(trial.proper)
        log.say_ending(trial)

    return visit.runner(replace(settings.envelope, cruise=speed), keep, gains=True)
