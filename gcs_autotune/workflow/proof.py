"""The proof of a loop: a step flown before and after the change, and the facts that the design needs.

A heading or depth step starts from the present value. A speed or turn-rate step is flown about the steady value
measured in the experiments, so there the experiments come first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.axes import excitation_of
from gcs_autotune.design import (
    SHORTER,
    Actuator,
    Reduction,
    Remark,
    holding,
    in_fractions,
    pulse_of,
    reduce,
    throttle_of,
    turn_rate_step,
)
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import AxisFit, Fit, Model
from gcs_autotune.identify.thrust import CURVE, square_of
from gcs_autotune.manoeuvres import (
    MOST_DURATION,
    SHARE_OF_TOP,
    STOPPING,
    Step,
    StepSettings,
    speed_step,
    step_from_present,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import noise_in
from gcs_autotune.workflow.identification import Identified
from gcs_autotune.workflow.noise_estimate import noise_of_velocity
from gcs_autotune.workflow.settings import TuneSettings
from gcs_autotune.workflow.supplied_model import SuppliedModel

__all__ = [
    "SHARE",
    "Known",
    "Proof",
    "cruise_pair",
    "farthest_turn",
    "known_of",
    "proof_about_rest",
    "proof_of_speed",
    "proof_of_turn_rate",
    "proof_of_velocity",
    "reduction_of",
    "turn_sentence",
]

FILTERED = ("surge",)
"""Degrees of freedom whose velocity is measured by a satellite receiver, which low-passes it."""
LEAST_NOISES = 8.0
"""Smallest useful speed or turn-rate step, in standard deviations of the measured noise. Project choice."""
RATE_BAND = 0.25
"""Deviation from the held turn rate that counts as steady before the step, as a fraction of that rate.

It is large because turn rates are noisy.
"""
NEAR = 0.9
"""Fraction of the experiment's speed. For a step that ends below it, the cruise parameters are those of the
final speed.
"""
SAME_SPEED = 0.02
"""Relative difference from the measured cruise speed below which the present CRUISE_SPEED is kept."""
LEAST_SETTLE = 6.0
"""Shortest time [s] for a boat to reach the turn rate at which its step begins."""
SETTLE_OF_TIME, LEAST_DURATION = 5.0, 8.0
"""Duration of a speed step in time constants of the craft, and its minimum [s]."""
SHORT_OF_TIME, LEAST_SHORT = 3.5, 5.0
"""Duration of a half step that may end early, in time constants of the craft, and its minimum [s].

A boat with useful gains is at its target by then. The two steps are compared over the time that both recorded.
"""
OF_TIME_BESIDE = 3.0
"""Duration of the additional turn-rate step of a heading tune, in time constants of the craft."""


@dataclass(frozen=True, slots=True)
class Known:
    """Properties of the craft known before its loop is flown: its model with normalised outputs, its actuator, and the
    noise of its velocity (SI).
    """

    model: SingleDof
    actuator: Actuator
    noise_std: float


def known_of(source: Identified | SuppliedModel, axis: Axis) -> Known:
    """Return the craft's properties on *axis* from experiments or a model file, before the loop itself is flown.

    The noise is the difference between neighbouring samples, because the residual of a model includes more than noise.
    A receiver filters speeds over ground, so neighbouring samples have correlated noise. For speeds over ground the
    residual is used, unless the model is poor.
    """
    if isinstance(source, Identified):
        fit, extended = source.fit, source.extended
        reduction = reduction_of(fit) if extended is None else reduction_of_extended(extended, axis)
        velocity = fit.model.axis.velocity
        noise = min(noise_in(run, velocity) for run in source.runs)
        if axis.dof in FILTERED:
            noise = max(noise, noise_of_velocity(fit.noise.get(velocity, 0.0), noise))
        if reduction is None:
            return Known(fit.model, Actuator(), noise)
        return Known(reduction.model, reduction.actuator, noise)
    reduction, full = source.reduction, source.full_scale or 1.0
    model, _ = in_fractions(reduction.model, reduction.covariance, full)
    return Known(model, reduction.actuator.in_fractions(full), source.noise_std)


@dataclass(frozen=True, slots=True)
class Proof:
    """One proof step: the step flown with old and new gains.

    ``settings``: the step as flown.
    ``design_speed`` [m/s]: the speed for the control law; None: the measured speed.
    ``measured``: parameter -> measured value.
    """

    settings: StepSettings
    design_speed: float | None
    measured: Mapping[str, float]

    def step(self, name: str) -> Step:
        """Return the manoeuvre that flies the step."""
        return Step(self.settings, name)

    def after(self, before: Trial) -> Proof:
        """Return the proof for the new gains, whose hold before the step lasts as long as that of *before*.

        The controller's integral at the start of the step affects the measurement: a hold of 3 s instead of 12 s
        doubles the ITAE of a BlueROV2's heading step. So the hold lasts at least as long as before, and longer if the
        craft is not at rest by then.
        """
        s, targets = self.settings, [mark.t for mark in before.marks if mark.kind == "target"]
        held = targets[1] - targets[0] if len(targets) > 1 else s.hold
        least = max(held, s.least_hold) if math.isfinite(s.least_hold) else math.inf
        return replace(self, settings=replace(s, hold=max(held, s.hold), least_hold=least))


def proof_about_rest(settings: TuneSettings, axis: Axis, speed: float) -> Proof:
    """Return the heading or depth step, flown at *speed* [m/s]."""
    d = axis.kind
    step = step_from_present(
        d.excitation.signal,
        settings.step if settings.step is not None else d.step,
        settings.step_duration or d.step_duration,
        speed,
        under_way=axis.needs_speed,
        ends_early=settings.ends_early,
    )
    return Proof(step, None, {})


def proof_of_velocity(
    dof: str, settings: TuneSettings, throttle: float, speed: float, known: Known, present: Mapping[str, float]
) -> Proof:
    """Return the step of a loop that controls the velocity of *dof* (``surge``, ``yaw``); it raises the errors of
    :func:`proof_of_speed` and :func:`proof_of_turn_rate`.
    """
    if excitation_of(dof).by_throttle:
        return proof_of_speed(settings, throttle, known, present)
    return proof_of_turn_rate(settings, speed, known)


def proof_of_speed(settings: TuneSettings, throttle: float, known: Known, present: Mapping[str, float]) -> Proof:
    """Return the speed step about the steady speed at *throttle* [fraction], and the pair of throttle and speed.

    Raises
    ------
    PreconditionFailed
        The boat hardly moves, or a step below the autopilot's WP_SPEED is too small for the noise.
    """
    model = known.model
    force = float(known.actuator.static(np.array([pulse_of(throttle, present)]))[0])
    kept = model.steady_velocity(force)
    top = kept if settings.speed is None else settings.speed
    limit = present.get("WP_SPEED", math.inf)
    top = min(top, limit) if limit > 0.0 else top
    size = abs(settings.step) if settings.step is not None else SHARE_OF_TOP * top
    if not (math.isfinite(kept) and top > size > LEAST_NOISES * known.noise_std):
        raise PreconditionFailed(
            f"a speed step of {size:.2f} m/s up to {top:.2f} m/s is too small for the speed noise of "
            f"{known.noise_std:.3f} m/s. Use a larger --throttle or --step, or raise WP_SPEED ({limit:g} m/s)"
        )
    drag = model.beta + 2.0 * model.beta_quadratic * (top - size)
    time = model.alpha / max(drag, 1e-3)
    share, least_duration = (
        (SETTLE_OF_TIME, LEAST_DURATION) if not settings.ends_early else (SHORT_OF_TIME, LEAST_SHORT)
    )
    duration = settings.step_duration or min(max(share * time, least_duration), MOST_DURATION)
    step = speed_step(top, size, duration, ends_early=settings.ends_early)
    if top < NEAR * kept:
        throttle = throttle_of(known.actuator.output_for(holding(model, top)), present)
    return Proof(step, top - size, cruise_pair(known, throttle, present))


def cruise_pair(known: Known, throttle: float, present: Mapping[str, float]) -> dict[str, float]:
    """Return the whole percent nearest to *throttle*, and the speed the boat holds at it.

    The speed is the model's steady speed. The present pair is kept if it is the same.
    """
    percent = float(max(round(100.0 * throttle), 1))
    force = float(known.actuator.static(np.array([pulse_of(percent / 100.0, present)]))[0])
    speed = float(f"{known.model.steady_velocity(force):.3g}")
    old = present.get("CRUISE_SPEED", math.nan)
    if present.get("CRUISE_THROTTLE") == percent and abs(old - speed) <= SAME_SPEED * speed:
        speed = old
    return {"CRUISE_SPEED": speed, "CRUISE_THROTTLE": percent}


def proof_of_turn_rate(settings: TuneSettings, speed: float, known: Known, *, beside: bool = False) -> Proof:
    """Return the turn-rate step, from one side to the other, at *speed* [m/s].

    beside : whether it accompanies a heading tune. It is then shorter and ignores size and time of *settings*.

    Raises
    ------
    PreconditionFailed
        The craft hardly turns, or it would turn too far for the heading limit: a step of the user's, or one whose turn
        rates would disappear in the noise if they were reduced.
    """
    at_rest = not speed > 0.0
    if beside:
        size, duration = turn_rate_step(known.model, at_rest=at_rest, of_time=OF_TIME_BESIDE)
    else:
        size, duration = turn_rate_step(known.model, at_rest=at_rest, duration=settings.step_duration)
        size = abs(settings.step) if settings.step is not None else size
    if not size > LEAST_NOISES * known.noise_std:
        raise PreconditionFailed(
            f"a turn-rate step of {math.degrees(size):.1f} deg/s is smaller than the noise. Use a larger --step"
        )
    step = StepSettings(
        "r",
        size,
        duration,
        speed=speed,
        base=-0.5 * size,
        settle=SHORTER * duration if at_rest else LEAST_SETTLE,
        steady_time=1.5,
        steady_band=RATE_BAND,
        hold=SHORTER * duration if at_rest else 0.0,
    )
    limit, asked = settings.envelope.heading_excursion, None if beside else settings.step
    return Proof(_within(step, limit, known, given=asked is not None), None, {})


SHARE = 0.85
"""Fraction of the heading limit that a turn-rate step may use.

Project choice: a drift is stopped at a larger fraction (``envelope.NEARLY``), so a step usually lasts its full time."""


def farthest_turn(step: StepSettings) -> float:
    """Return how far a turn-rate *step* turns the craft from its first heading [rad], with the time to stop a turn.

    The craft turns to one side while it is held, then back and beyond, then to the first side again.
    """
    held = max(step.hold, step.settle)
    return 0.5 * step.size * (max(held, step.duration - max(step.hold, step.steady_time)) + STOPPING)


def _within(step: StepSettings, limit: float, known: Known, *, given: bool) -> StepSettings:
    """Return *step* with its turn rates reduced so that it turns by less than *limit* [rad]. The user's *given* one is
    not reduced.
    """
    share = SHARE * limit / farthest_turn(step)
    if share >= 1.0:
        return step
    most = f"the heading limit of {math.degrees(limit):.0f} deg"
    if given:
        raise PreconditionFailed(
            f"a turn-rate step of {math.degrees(step.size):.0f} deg/s for {step.duration:.1f} s may turn the craft by "
            f"{math.degrees(farthest_turn(step)):.0f} deg, too much for {most}. Use a smaller --step, a shorter "
            "--step-duration, or a larger --max-heading-excursion"
        )
    size = share * step.size
    if not size > LEAST_NOISES * known.noise_std:
        raise PreconditionFailed(f"{most} is too small for this step. Use a larger --max-heading-excursion")
    return replace(step, size=size, base=-0.5 * size)


def turn_sentence(step: StepSettings, limit: float) -> str:
    """Return a sentence on how far a turn-rate *step* turns the craft, and on the heading *limit* [rad]."""
    rate, turn = math.degrees(0.5 * step.size), math.degrees(farthest_turn(step))
    ends = f". It ends early if the craft could not stop before the limit of {math.degrees(limit):.0f} deg"
    return (
        f"turn-rate step from {rate:.0f} deg/s to port to {rate:.0f} deg/s to starboard and back, {step.duration:.1f} "
        f"s each, turns the craft by up to {turn:.0f} deg{ends if math.isfinite(limit) else ''}"
    )


SLIGHT_CURVATURE = 0.2
"""Quadratic fraction of the thrust below which a significant thrust curve is too slight to correct. Project choice."""


def reduction_of(fit: AxisFit) -> Reduction | None:
    """Return the model of a surge fit including its thrust curve; None if the fit has no curve."""
    if CURVE not in fit.extra:
        return None
    square = square_of(fit)
    curve = Remark(
        "quadratic-actuator",
        fit.model.axis.force,
        f"{square:.0%} of the thrust grows with the square of the throttle. The margins cover both ends of the step",
        f"MOT_THST_EXPO about {min(max(square, -1.0), 1.0):.2f} would linearise the thrust. Then tune again",
    )
    matters = bool(fit.significant_effects) and abs(square) > SLIGHT_CURVATURE
    remarks = (curve,) if matters else ()
    return Reduction(fit.model, fit.model.axis.force, fit.craft_covariance, Actuator(square=square), remarks=remarks)


def reduction_of_extended(found: Fit[Model], axis: Axis) -> Reduction:
    """Return the model that a loop of *axis* is designed with if *found* has actuator effects."""
    model, units, covariance = design_input_of(found)
    return reduce(model, axis.dof, units, law=axis.law, names=tuple(found.parameters), covariance=covariance)


def design_input_of(found: Fit[Model]) -> tuple[ExtendedModel, dict[str, str], NDArray[np.float64]]:
    """Return (model for the design, unit of its inputs, covariance (p, p) of its parameters)."""
    std = np.array([parameter.std for parameter in found.parameters.values()])
    model = found.model
    assert isinstance(model, ExtendedModel)
    covariance: NDArray[np.float64] = np.nan_to_num(found.correlation) * np.outer(std, std)
    return model, dict.fromkeys(model.base.form.inputs, "1"), covariance
