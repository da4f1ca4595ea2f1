"""Entry points of the package: calculate a proposal of gains from a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel, reference_model, settling_time, stability_bound, uncertainty_of
from gcs_autotune.design.actuator import PERFECT
from gcs_autotune.design.hunting import hunting_of
from gcs_autotune.design.laws import CEILINGS, LAWS, SKID, THROTTLE, Law, Settings
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.notes import NEAR_LIMIT, limit_by_loop_rate, notes_on, other_mode_notes, residual_motion
from gcs_autotune.design.other_mode import OtherMode, other_mode
from gcs_autotune.design.plant import heavier, in_fractions, sample_region
from gcs_autotune.design.prediction import predict, predict_as_flown, predict_error, ruler_of
from gcs_autotune.design.reduction import Reduction, reduce
from gcs_autotune.design.refinement import (
    MIN_ERROR,
    any_better,
    beyond,
    passes,
    refine,
    refine_beyond,
    refine_briefly,
    refine_for_both,
)
from gcs_autotune.design.result import Beside, Change, Hunting, Proposal
from gcs_autotune.design.selection import GainCandidate, choose, is_tolerable, judge
from gcs_autotune.design.spec import Spec
from gcs_autotune.design.verdict import is_better
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import ParameterMissing, UsageError
from gcs_autotune.firmware import Axis, Gain
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup

__all__ = ["ProvisionalGains", "design", "design_from", "problem_of", "provisional"]

LOOP_PERIODS = 1.5
"""Delay of a digital loop, in loop periods: one to compute, and half a period because the output is held."""
MIN_SPAN = 5.0
"""Minimum length [s] of predicted steps. Project choice."""
SMALL = 1.0 / 3.0
"""Size of the small step for residual motion, relative to the required step.

Project choice: usual corrections are small.
"""
FOLLOWED = 0.01
"""Shortfall of the other mode's step up to which the step counts as followed well enough. Project choice."""
NOTEWORTHY = 0.9
"""Largest error of gains outside the documented ranges, relative to that of the proposed gains, for which they are
mentioned. Project choice. They are also mentioned if the shortfall in turn rates is a tenth smaller.
"""
SAME = 1e-3
"""Relative difference below which two gains count as equal. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class ProvisionalGains(Displayed):
    """Approximate gains for the present model, calculated while experiments are flown.

    - ``wanted``: the reference model.
    - ``gains``: canonical name -> value.
    - ``itae`` [s^2]: predicted ITAE with these gains, evaluated like flown steps.
    - ``spread``: relative increase of the ITAE within the 95 % region, as in :class:`Proposal`.
    - ``span`` [s]: simulated time of the search.
    """

    wanted: ReferenceModel
    gains: Settings
    span: float
    itae: float
    spread: float


def design(
    fit_model: SingleDof,
    covariance: NDArray[np.float64],
    axis: Axis,
    present: Mapping[str, float],
    spec: Spec | None = None,
    reduction: Reduction | None = None,
) -> Proposal:
    """Return new gains for *axis*, with their prediction and that of the present gains.

    covariance : (5, 5), of (alpha, beta, beta_quadratic, delta, delay) in the model's units, as in ``Fit``.

    present : canonical name -> value of the vehicle's parameters, which stay unchanged. Every gain of the axis is
        needed, and the known parameters of ``axis.context``. The firmware's defaults are used for the others. The
        proposal has the vehicle's own names and values (``axis.names``).

    reduction : the reduction from which *fit_model* results, if the model had effects; :func:`design_from` supplies it.
        The actuator of the reduction is part of the simulated loop.

    Raises
    ------
    NoGainsMeetSpec
        No gains inside the documented ranges are acceptable, or the model excludes any.
    ParameterMissing
        A gain of the axis is not in *present*.
    UsageError
        The model's degree of freedom is not the axis', or full scale or speed is needed and missing.
    UnknownName
        The axis has an unknown control law.
    """
    spec = spec or Spec()
    problem = problem_of(fit_model, covariance, axis, present, spec, reduction)
    law, model, actuator = problem.law, problem.model, problem.actuator
    chosen = choose(problem)
    span = _span(spec, chosen)
    after = judge(problem, chosen.wanted, chosen.settings, span)
    before = judge(problem, chosen.wanted, problem.settings, span)
    keep, other, alone = False, other_mode(problem), after
    if spec.is_automatic:
        after, keep = _best(problem, before, after, span)
        alone = before if keep else after
        after, keep = _for_both(problem, before, alone, other, span)
    is_refined = after.settings != chosen.settings
    changes = () if keep else _changes(law, axis, before, after, is_refined)
    shown = after if changes else before
    beside = None if other is None else _beside(other, before, shown, alone)
    wider = _beyond_ranges(problem, shown, other, span) if spec.is_automatic and spec.bandwidth >= 1.0 else None
    remarks = () if reduction is None else reduction.remarks
    left = () if actuator.is_perfect or law.controls_velocity else _left(problem, (before, shown))
    predictions, windows = (before.prediction, shown.prediction), tuple[float, ...]()
    if math.isfinite(spec.settled_time):
        read = predict_as_flown(problem, (before.settings, shown.settings), span)
        old, new = read.halves
        predictions = (
            replace(predictions[0], metrics=read.one, halves=old),
            replace(predictions[1], metrics=read.other, halves=new),
        )
        windows = read.windows
        if not changes:
            predictions = predictions[0], predictions[0]
    limit = limit_by_loop_rate(problem, shown)
    velocity = float(np.max(np.abs(np.gradient(shown.prediction.position, shown.prediction.t))))
    return Proposal(
        axis=axis.name,
        law=law.name,
        changes=changes,
        wanted=chosen.wanted,
        margins=shown.margins,
        worst_margins=shown.worst_margins,
        bound=_bound(law, model, chosen.wanted, problem.region.covariance, velocity),
        before=predictions[0],
        after=predictions[1],
        notes=(
            *(r.sentence for r in remarks),
            *(residual_motion(*left, axis.dof) if left else ()),
            *map(axis.names.worded, notes_on(problem, axis, before, shown, bool(changes), is_refined, wider)),
            *([limit] if limit else ()),
            *(() if beside is None else other_mode_notes(beside)),
        ),
        remarks=remarks,
        left=left,
        loops=(problem.loops(before.settings, chosen.wanted), problem.loops(shown.settings, chosen.wanted)),
        actuator=actuator,
        windows=windows,
        spread=_spread(problem, shown.settings, span),
        ruler=ruler_of(spec),
        beside=beside,
        limit=limit,
        unmet=tuple(map(axis.names.worded, shown.objections)) if changes else (),
        is_matched=bool(changes) and not is_refined,
    )


def provisional(
    fit_model: SingleDof,
    covariance: NDArray[np.float64],
    axis: Axis,
    present: Mapping[str, float],
    spec: Spec,
    last: ProvisionalGains | None = None,
) -> ProvisionalGains:
    """Return an approximation of :func:`design`, sufficient to judge the remaining uncertainty during the experiments.

    The search starts at the *last* gains for the same specification, or else like a design. It is short and ignores the
    present gains. Exceptions are those of :func:`design`.
    """
    problem = problem_of(fit_model, covariance, axis, present, spec)
    if last is None or not spec.is_automatic:
        near = choose(problem, patience=0)
        span = _span(spec, near)
    else:
        span = last.span
        near = judge(problem, last.wanted, {**problem.settings, **last.gains}, span)
    if spec.is_automatic:
        near = refine_briefly(problem, near, span, everywhere=last is None)
    itae = predict_error(problem, near.settings, problem.step, span).itae
    if math.isfinite(spec.settled_time):
        itae = predict_as_flown(problem, (problem.settings, near.settings), span).other.itae
    gains = {g.parameter: near.settings[g.parameter] for g in axis.gains}
    return ProvisionalGains(near.wanted, gains, span, itae, _spread(problem, near.settings, span))


def design_from(
    source: ExtendedModel,
    axis: Axis,
    present: Mapping[str, float],
    spec: Spec | None = None,
    *,
    inputs: Mapping[str, str] | None = None,
    names: Sequence[str] = (),
    covariance: NDArray[np.float64] | None = None,
) -> Proposal:
    """Return new gains for *axis* from a model with effects. The result is that of :func:`design`.

    Delays, lag, drag and actuator effects are in the simulated loop and, if linear, in the margins. ``remarks`` state
    the treatment of each effect, with advice.

    inputs : name -> unit of the model's inputs (SI if missing).
    names, covariance : names of the fitted parameters and their covariance (p, p).

    Raises
    ------
    AutotuneError
        :func:`design` raised the error. UsageError is also raised if the model does not have this axis.
    """
    spec = spec or Spec()
    r = reduce(source, axis.dof, inputs or {}, law=axis.law, speed=spec.speed, names=names, covariance=covariance)
    return design(r.model, r.covariance, axis, present, replace(spec, quantum=max(spec.quantum, r.quantum)), r)


def _best(
    problem: DesignProblem, before: GainCandidate, matched: GainCandidate, span: float
) -> tuple[GainCandidate, bool]:
    """Return the gains to propose, and whether the present ones are kept.

    The present gains are kept if they are safe to fly and no gains in the ranges are better.
    """
    share = problem.spec.bandwidth
    refined = refine(problem, matched, span)
    for found in (refined, matched)[: 2 if share >= 1.0 else 1]:
        if passes(problem, before, found, span, 1.0 / share**2):
            return found, False
    other = any_better(problem, before, span) if share >= 1.0 else None
    return (refined, is_tolerable(before)) if other is None else (other, False)


def _for_both(
    problem: DesignProblem, before: GainCandidate, alone: GainCandidate, other: OtherMode | None, span: float
) -> tuple[GainCandidate, bool]:
    """Return the gains to propose if the *other* mode counts too, and whether the present ones are kept.

    alone : the best gains for this mode alone; the present ones if none are better.
    """
    stays = alone is before
    if other is None or problem.law.controls_velocity or other.shortfall(alone.settings) <= FOLLOWED:
        return alone, stays
    found = refine_for_both(problem, alone, other, span)
    free = problem.law.free_overshoot
    old, new = (c.prediction.metrics for c in (before, found))
    errors = other.error(before.settings), other.error(found.settings)
    slower = 1.0 / problem.spec.bandwidth**2
    if found is alone or not is_better(old, new, free, (errors[0].itae, errors[1].itae), slower=slower).better:
        return alone, stays
    return found, False


def _beside(other: OtherMode, before: GainCandidate, shown: GainCandidate, alone: GainCandidate) -> Beside:
    """Return the prediction for the *other* mode, and the cost of considering it for this mode."""
    own = max(alone.prediction.metrics.itae, MIN_ERROR)
    return Beside(
        other.problem.law.name,
        other.shortfall(before.settings),
        other.shortfall(shown.settings),
        shown.prediction.metrics.itae / own - 1.0,
    )


def _beyond_ranges(
    problem: DesignProblem, shown: GainCandidate, other: OtherMode | None, span: float
) -> GainCandidate | None:
    """Return better gains outside the documented ranges with the same margins and noise; None if there are none."""
    if problem.spec.beyond_ranges or not any(_at_end(g, shown.settings) for g in (*problem.gains, *problem.late)):
        return None
    gains, late = ([beyond(g) for g in group] for group in (problem.gains, problem.late))
    beside = None if problem.law.controls_velocity else other
    found = refine_beyond(replace(problem, gains=gains, late=late), shown, beside, span)
    old, new = shown.prediction.metrics.itae, found.prediction.metrics.itae
    apart = 0.0 if beside is None else beside.shortfall(shown.settings) - beside.shortfall(found.settings)
    return found if new <= NOTEWORTHY * old or (apart >= 1.0 - NOTEWORTHY and new <= old) else None


def _at_end(gain: Gain, settings: Settings) -> bool:
    near = NEAR_LIMIT * (gain.high - gain.low)
    value = settings[gain.parameter]
    return value >= gain.high - near or (gain.low > 0.0 and value <= gain.low + near)


def _spread(problem: DesignProblem, settings: Settings, span: float) -> float:
    """Return the largest relative increase of the error over time within the 95 % region."""
    nominal = max(predict_error(problem, settings, problem.step, span).itae, MIN_ERROR)
    each = (predict_error(problem, settings, problem.step, span, m).itae for m in problem.region.samples)
    return max(max(each, default=nominal) / nominal - 1.0, 0.0)


def _bound(
    law: Law, model: SingleDof, wanted: ReferenceModel, covariance: NDArray[np.float64], velocity: float
) -> tuple[float, float]:
    """Return Miskovic2010's stability bound, which applies to position loops; NaN for other loops."""
    if law.controls_velocity:
        return math.nan, math.nan
    return stability_bound(model, wanted, uncertainty_of(model, covariance), velocity)


def _left(problem: DesignProblem, pair: tuple[GainCandidate, GainCandidate]) -> tuple[Hunting, Hunting]:
    """Return the residual error by dead zone and backlash after a small step, for the present and the shown gains."""
    first, second = (hunting_of(problem, c.settings, SMALL * problem.step) for c in pair)
    return first, second


def _check(model: SingleDof, axis: Axis, present: Mapping[str, float], spec: Spec) -> None:
    if model.dof != axis.dof:
        raise UsageError(
            f"the {axis.name} axis needs a model of {axis.dof}, not of {model.dof}. Identify {axis.dof} first"
        )
    for gain in axis.gains:
        if not math.isfinite(present.get(gain.parameter, math.nan)):
            raise ParameterMissing(
                f"the present value of {gain.parameter} is unknown, so it could not be restored later. Read the "
                "vehicle's parameters first",
                name=gain.parameter,
            )
    if axis.needs_speed and spec.speed is None:
        raise UsageError(f"the {axis.name} axis needs the speed at which the model was identified. Supply that speed")


def problem_of(
    fit_model: SingleDof,
    covariance: NDArray[np.float64],
    axis: Axis,
    present: Mapping[str, float],
    spec: Spec,
    reduction: Reduction | None = None,
) -> DesignProblem:
    """Return the problem that :func:`design` solves; arguments and errors are its."""
    law = lookup(LAWS, axis.law, "control law")
    _check(fit_model, axis, present, spec)
    model, covariance = in_fractions(fit_model, covariance, spec.full_scale)
    model = replace(model, delay=max(model.delay - spec.link_delay, 0.0))
    region, actuator = sample_region(model, covariance), PERFECT
    if spec.skid:
        present = {**present, SKID: 1.0}
    if spec.throttle > 0.0:
        present = {**present, THROTTLE: spec.throttle}
    if reduction is not None:
        actuator = reduction.actuator.in_fractions(1.0 if spec.full_scale is None else spec.full_scale)
        region = heavier(region, reduction.heavier)
    offered = [beyond(g) for g in axis.gains] if spec.beyond_ranges else axis.gains
    by_name = {g.parameter: _within_reason(g, law, region.model, present, spec) for g in offered}
    delay = spec.loop_delay if spec.loop_delay is not None else LOOP_PERIODS * law.loop_period(present)
    step = spec.step if spec.step is not None else law.usual_step
    tuned, late = ([by_name[n] for n in names] for names in (law.tuned, law.late))
    problem = DesignProblem(law, tuned, region, dict(present), spec, step, delay, actuator=actuator, late=late)
    return replace(problem, present_overshoot=_present_overshoot(problem))


def _within_reason(gain: Gain, law: Law, model: SingleDof, present: Mapping[str, float], spec: Spec) -> Gain:
    """Return *gain* with its range limited to values that are useful beyond the flown step."""
    ceilings = CEILINGS[law.name](model, present, spec.speed) if law.name in CEILINGS else {}
    return replace(gain, high=min(gain.high, ceilings.get(gain.parameter, math.inf)))


def _span(spec: Spec, chosen: GainCandidate) -> float:
    """Return the length [s] of the shown steps: as flown; otherwise three times the settling time of the new gains."""
    if spec.step_duration is not None:
        return spec.step_duration
    metrics = chosen.prediction.metrics
    required = settling_time(chosen.wanted.kind, chosen.wanted.omega_0)
    settled = metrics.settling if math.isfinite(metrics.settling) else float(chosen.prediction.t[-1])
    return max(3.0 * settled, 3.0 * required, MIN_SPAN)


def _present_overshoot(problem: DesignProblem) -> float:
    """Return the overshoot of the present gains, simulated long enough for the craft's slowest motion."""
    model, step, span = problem.model, problem.step, problem.spec.step_duration
    span = span or MIN_SPAN + 4.0 * model.alpha / max(model.equivalent_drag(step), 0.1 * model.alpha)
    return predict(problem, model, reference_model("bessel", 1.0), problem.settings, span).metrics.overshoot


def _changes(law: Law, axis: Axis, before: GainCandidate, after: GainCandidate, is_refined: bool) -> tuple[Change, ...]:
    found = []
    for gain in axis.gains:
        old, new = float(before.settings[gain.parameter]), float(after.settings[gain.parameter])
        if not math.isclose(old, new, rel_tol=SAME, abs_tol=1e-6):
            reason = _reason(law, gain, after, is_refined)
            was, will, low, high = (
                axis.names.own_value(gain.parameter, value) for value in (old, new, gain.low, gain.high)
            )
            found.append(Change(axis.names.own(gain.parameter), was, will, low, high, reason))
    return tuple(found)


def _reason(law: Law, gain: Gain, after: GainCandidate, is_refined: bool) -> str:
    if gain.parameter in law.measured:
        return f"{gain.meaning}: set to the speed measured at this throttle"
    if gain.parameter in law.fixed and after.settings[gain.parameter] == law.fixed[gain.parameter]:
        return f"{gain.meaning}: not needed, since the identified model has no lag"
    wanted, new = after.wanted, after.settings[gain.parameter]
    settled = settling_time(wanted.kind, wanted.omega_0)
    reason = f"{gain.meaning}: " + (
        "chosen for the smallest predicted tracking error (ITAE) of the step"
        if is_refined
        else f"matched within the ranges to a {wanted.kind.capitalize()} step settling in {settled:.1f} s"
    )
    if new != 0.0 and new in (gain.low, gain.high):
        reason += f", limited to the documented {'minimum' if new == gain.low else 'maximum'}"
    return reason
