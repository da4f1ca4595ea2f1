"""Identify a craft during a run, from self-oscillations or from two runs of throttle steps, and fit its model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify import AxisFit, Fit, Model, fit_axis
from gcs_autotune.identify.thrust import (
    describe_slow_actuator,
    describe_thrust_curve,
    fit_slow_actuator,
    fit_surge,
    fit_thrust_curve,
    set_on_the_way_back,
    with_actuator,
)
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiments import SWING_AHEAD, Relays, noise_in, throttle_steps_for
from gcs_autotune.workflow.extra_relay import extra_relay, fly_extra
from gcs_autotune.workflow.pull_map import curve_of
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.stop_rule import BY_ITSELF, KnownDesign, assess

__all__ = ["Identified", "again_with_step", "delay_of", "identify"]


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """The identified model of one axis.

    Attributes
    ----------
    runs : the runs it was fitted to.
    extended : the same model with the actuator that the record requires: a thrust curve, a dead zone, a limited rate
        or a lag. None if an ideal actuator is sufficient.
    short : whether the experiments ended early without an assessment of the gains.
    """

    fit: AxisFit
    runs: Sequence[Trial]
    extended: Fit[Model] | None = None
    short: bool = False

    @property
    def unexplained(self) -> float:
        """Fraction of the motion [%] that the model does not explain."""
        return (self.fit if self.extended is None else self.extended).unexplained


def identify(
    context: TuneContext,
    step: Trial | None = None,
    rule: KnownDesign | None = None,
    *,
    turns_first: bool = True,
    early: bool = False,
) -> Identified:
    """Fly the experiments of the axis, fit its model and return it. Errors are those of flying and of ``fit_axis`` or
    ``fit_surge``.

    step : an earlier step under the autopilot's own loop, if any; it separates a dead zone from a thrust curve.
    rule : ends relays once the gains are known; without a rule, relays end when five periods agree.
    turns_first : also turn a boat around before the first relay.
    early : omit a boat's throttle steps on the return run if they add no information.
    """
    if context.axis.excitation.by_throttle and context.craft.firmware.needs_way:
        return _by_throttle_steps(context, turns_first=turns_first, early=early)
    if rule is None or step is None:
        return _by_relays(context, step, turns_first=turns_first)
    try:
        return _by_short_relays(context, step, rule)
    finally:
        rule.close()


def delay_of(settings: TuneSettings) -> float | Literal["auto"]:
    """Return the delay [s] used for identification: the one in the settings, otherwise an estimate."""
    return "auto" if settings.delay is None else settings.delay


def _by_relays(context: TuneContext, step: Trial | None, *, turns_first: bool) -> Identified:
    s, log, craft, dof = context.settings, context.log, context.craft, context.axis.dof
    relays = Relays.of(s, dof, craft, context.throttle)
    relay = relays.relay(1, s.relay_output)
    if turns_first:
        context.turn_around(relay.name, SWING_AHEAD)
    first = context.fly(relay, relays.stage("first"))
    if relays.against_wall:
        log.say("identifying")
        return Identified(_plain(context, [first]), [first])
    relay = relays.relay(2, relays.second_output(first))
    context.turn_around(relay.name, SWING_AHEAD)
    trials = [first, context.fly(relay, relays.stage("second"))]
    log.say("identifying")
    plain = _plain(context, trials)
    if step is None and s.structure is None and s.most_relays > len(trials):
        third = context.run_in_background(extra_relay, trials, plain)
        if third is not None:
            context.turn_around(relays.name(3), SWING_AHEAD)
            context.come_down()
            trials += fly_extra(third, relays, context.runner, log)
            plain = _plain(context, trials)
    log.fit = plain
    return _extended(context, plain, trials, step)


def _by_short_relays(context: TuneContext, step: Trial, rule: KnownDesign) -> Identified:
    """Fly one relay until the gains are known from it and *step*. Fly another amplitude only if that is impossible.

    An actuator with a dead or weak range at small commands needs two amplitudes, fitted together with *step*. If this
    leaves too much unexplained, the experiments are flown again in full.
    """
    s, log, craft, dof = context.settings, context.log, context.craft, context.axis.dof
    relays = Relays.of(s, dof, craft, context.throttle)
    noise = noise_in(step, context.axis.excitation.signal) if relays.keep_still else None
    rule.start()
    context.turn_around("relay-1", SWING_AHEAD)
    relay = relays.relay(1, s.relay_output, noise_std=noise, criterion=rule)
    again = context.earlier.has("relay-1")
    first = context.fly(relay, "first self-oscillation")
    if again:
        rule.weigh(context.run_in_background(assess, rule.question, first))
    else:
        first = rule.conclude(first, context.await_worker)
    if rule.known:
        log.say("identifying")
        fit = log.fit = _plain(context, [step, first])
        return Identified(fit, [step, first])
    short = rule.another_size
    output = relays.second_output(first)
    turned = context.turn_around("relay-2", SWING_AHEAD)
    noise = None if turned else float(first.meta["noise_std"])
    relay = relays.relay(2, output, noise_std=noise, criterion=rule if short else None)
    second = context.fly(relay, "second self-oscillation")
    trials = [first, rule.conclude(second, context.await_worker) if short else second]
    log.say("identifying")
    plain = log.fit = _plain(context, trials)
    found = _extended(context, plain, trials, step)
    if found.unexplained < BENT_UNEXPLAINED or not short:
        return replace(found, short=short)
    log.say(f"{found.unexplained:.0f} % of the motion is unexplained: flying again until five periods agree")
    return _by_relays(context, step, turns_first=True)


BENT_UNEXPLAINED = 10.0
"""Largest unexplained fraction of the motion [%] for a model with a thrust curve or dead zone. In a complete record of
a BlueROV2 it is 7 %. Project choice.
"""


def again_with_step(context: TuneContext, found: Identified, step: Trial) -> Identified:
    """Return *found* with a thrust curve fitted to *step* as well. The step is flown about the speed that *found*
    predicts.

    Each oscillation has one amplitude, larger than the outputs of the step. So only the step contains small outputs.
    This is not done for a boat's steering, because it depends on the throttle, which the autopilot changes. For a
    boat's surge the step replaces the return run.
    """
    if found.short and context.axis.excitation.by_throttle:
        return _with_step_back(context, found, step)
    if context.axis.excitation.by_throttle or context.axis.needs_speed:
        return found
    context.log.say("identifying from the experiments and the step")
    return _extended(context, found.fit, found.runs, step, with_band=True)


def _extended(
    context: TuneContext, plain: AxisFit, trials: Sequence[Trial], step: Trial | None, *, with_band: bool = False
) -> Identified:
    extended = None
    if context.settings.structure is None:
        extended = context.run_in_background(fit_thrust_curve, trials, plain, step, with_band=with_band)
        if extended is not None:
            context.log.say(describe_thrust_curve(extended, plain, step))
        else:
            extended = context.run_in_background(fit_slow_actuator, trials, plain)
            if extended is not None:
                context.log.say(describe_slow_actuator(extended, plain))
    if extended is not None:
        context.log.fit = with_actuator(extended, plain)
    return Identified(plain, trials, extended)


def _plain(context: TuneContext, trials: list[Trial]) -> AxisFit:
    s, dof = context.settings, context.axis.dof
    return context.run_in_background(fit_axis, trials, dof=dof, structure=s.structure, delay=delay_of(s))


def _by_throttle_steps(context: TuneContext, *, turns_first: bool, early: bool) -> Identified:
    """Fly throttle steps out and back; the difference between them shows a current.

    *early*: no throttle steps on the return run if the outward run is explained. The step flown on the return run then
    shows the current.
    """
    log, fitted = context.log, _surge_fit(context)
    if turns_first:
        context.turn_around("throttle-1", SWING_AHEAD)
    out = throttle_steps_for(context.throttle, 0, "throttle-1", short=early)
    first = context.fly(out, "first throttle steps")
    if early and not context.earlier.has("throttle-2"):
        log.say("identifying")
        alone = context.compute_while_turning("step-before", partial(_or_none, fitted, [first]))
        if alone is not None and alone.unexplained < BY_ITSELF:
            log.fit = alone
            return Identified(alone, [first], short=True)
    else:
        context.turn_around("throttle-2", math.inf)
    trials = [first, context.fly(throttle_steps_for(context.throttle, 1, "throttle-2"), "second throttle steps")]
    log.say("identifying")
    fit = log.fit = context.run_in_background(fitted, trials)
    return Identified(fit, trials)


def _surge_fit(context: TuneContext) -> Callable[..., AxisFit]:
    """Return the function that fits surge, with the thrust curve of the pull test if there is one."""
    s = context.settings
    square = None if s.pull_test is None else curve_of(s.pull_test, context.craft.servos)
    return partial(fit_surge, structure=s.structure, delay=delay_of(s), square=square)


def _with_step_back(context: TuneContext, found: Identified, step: Trial) -> Identified:
    """Return the surge model of the outward run and the *step* of the return run, or fly throttle steps back too.

    The two are not sufficient if they show a current or do not determine the form of drag or thrust.
    """
    log, first = context.log, found.runs[0]
    fitted = _surge_fit(context)
    along = context.run_in_background(set_on_the_way_back, found.fit, first, step)
    if along is not None and along.is_none:
        log.say(
            f"the speeds there and back agree within {max(2.0 * abs(along.set), 0.01):.2f} m/s: no significant current"
        )
        log.say("identifying from the experiments and the step")
        both = context.run_in_background(_or_none, fitted, [first, step])
        told = both is not None and not any(doubt.slug in UNKNOWN_YET for doubt in both.doubts)
        if both is not None and told and both.unexplained < BY_ITSELF:
            log.fit = both
            return Identified(both, [first, step], short=True)
    context.turn_around("throttle-2", SWING_AHEAD)
    trials = [first, context.fly(throttle_steps_for(context.throttle, 1, "throttle-2"), "second throttle steps")]
    log.say("identifying")
    fit = log.fit = context.run_in_background(fitted, trials, along=along)
    return Identified(fit, trials)


def _or_none(fitted: Callable[[Sequence[Trial]], AxisFit], trials: Sequence[Trial]) -> AxisFit | None:
    """Return the fit of *trials*, or None if they are not sufficient and more must be flown."""
    try:
        return fitted(trials)
    except AutotuneError:
        return None


UNKNOWN_YET = ("thrust-curve-unknown", "second-drag-undecided")
"""Doubts that require throttle steps on the return run of a boat that flew only the outward run."""
