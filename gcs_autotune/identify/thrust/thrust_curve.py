"""Identify thrusters that are weak for small commands, from two oscillations of different size.

A propeller's thrust grows with n|n|, and ArduSub sends its demands to the thrusters unchanged. The gain of an ROV
therefore grows with the size of the command. Without this effect, a model of the smaller oscillation differs from that
of the larger.

Most speed controllers also have a dead band near neutral. Two sizes of square wave cannot distinguish a dead band from
a curve, because each size determines one point of the characteristic. A step with the autopilot's own controller
distinguishes the two. Its output covers all sizes, down to the bias that it compensates. This step is flown anyway.

No thruster follows the square law up to full command, because the motor runs out of voltage and the propeller stalls. A
square law fitted to small oscillations overestimates full thrust by half. A step whose output exceeds the oscillations
shows where thrust saturates. Three sizes of oscillation that indicate a dead band also show this.

Most propellers push less astern than ahead. A model with one gain takes the difference for a constant force, which the
gains would then be designed to compensate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import SUBTRACTED, EffectInstance, ExtendedModel, in_order, limit_sentence
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.api import fit
from gcs_autotune.identify.coupled.one_axis import with_actuator
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.free_run import validate
from gcs_autotune.identify.result import AxisFit, Fit, Model, Parameter, is_of_one_axis
from gcs_autotune.rounding import HALF_WIDTH, format_number
from gcs_autotune.sname import DOFS, SIDES
from gcs_autotune.trial import Trial

__all__ = [
    "DEAD_ZONE",
    "LOPSIDED",
    "QUADRATIC",
    "describe_thrust_curve",
    "effect_number",
    "either_kind",
    "fit_thrust_curve",
    "fit_with_actuator",
    "pays",
    "with_doubt_of_kind",
    "with_thrust_curve",
]

Array = NDArray[np.float64]
ModelT = TypeVar("ModelT", bound=Model)

QUADRATIC = "quadratic-actuator"
DEAD_ZONE = "dead-zone"
LEVEL = "saturation"
LOPSIDED = "asymmetric-thrust"
_UNEXPLAINED = 0.8
"""Largest ratio of the unexplained part with the curve to that without it, for the curve to be kept.

The value is chosen: the ratio of a curve that matters is far smaller.
"""
LINEAR_ENOUGH = 4.0
"""Unexplained part [percent] of a model with a linear actuator, below which no curve is tried."""
_ALIKE = 0.9
"""Ratio of residuals above which two models count as not distinguished. Project choice."""
_BEYOND = 1.1
"""Ratio of a step's output to that of the oscillations, above which the step can show that thrust saturates."""
_SIZES = 3
"""Number of sizes of output that can distinguish a dead band from a curve."""
_SIZE, _HELD = 0.05, 0.05
"""Difference of two sizes of output [fraction of full], and least fraction of the time that a size is held. Project
choice."""
_SLIGHT = 0.5
"""Largest correlated residual, relative to the noise, of runs that need no thrust curve. Project choice."""
_NEARLY_ALL = 0.2
"""Largest correlated residual with a thrust curve, relative to that without it, in runs that are not oscillations.
Project choice: other missing terms leave more.
"""
_STDS = 5.0
"""Number of standard errors by which the curve must differ from a straight line.

The value is chosen: a curve that matters differs by far more.
"""
_WIDEST = 0.6
"""Widest neutral band tried, relative to the smallest oscillation."""
_LEVELS = 60
"""Maximum number of neutral bands tried."""
_CLOSER = 2
"""Number of neutral bands that are fitted together with all other parameters.

They are the ones that predict the step best.
"""
_HALF = 0.5
"""Output [fraction of full] at which a curve is described in the report."""
_SHARES = (0.1, 1.5)
"""Range of the fraction of thrust that is quadratic (n|n|) in which a curve is accepted."""


def fit_thrust_curve(
    runs: Sequence[Trial], plain: AxisFit, step: Trial | None = None, *, with_band: bool = False
) -> Fit[Model] | None:
    """Return a model with a thrust curve if the *runs* clearly require one, else None.

    plain : model of the same runs without a curve.
    step : run flown with the autopilot's own controller. With this run, or with three sizes of oscillation, the result
        may be a dead band instead. It may also include a dead band, a saturation, or thrust that is weaker in one
        direction.

    Only the step distinguishes the two kinds of dead band, because its output stays near the edge of the band. Just
    beyond the edge, a linkage with backlash hardly pushes the craft. A speed controller that starts at once pushes as
    hard as without a band. The second kind is tried only *with_band*, because position loops designed for it performed
    worse (BlueROV2 heading: ITAE 0.74 instead of 0.40).

    If the step supports no more than a curve, the curve is fitted to it too only *with_band*. It made a turn-rate loop
    better (bluerov2-nav: ITAE 0.026 instead of 0.10) and a position loop worse (bluerov2-standard roll: 0.94 instead of
    0.42).
    """
    if _is_linear_enough(plain):
        return None
    curve = fit_with_actuator(runs, plain, QUADRATIC)
    if (
        curve is None
        or not pays(curve, plain, QUADRATIC)
        or not _SHARES[0] < effect_number(curve, QUADRATIC).value < _SHARES[1]
    ):
        lopsided = _lopsided_first(runs, plain, step)
        if lopsided is not None:
            return lopsided
        return _dead_alone(runs, plain) if step is None and _sizes(runs, plain) >= _SIZES else None
    if step is None and _sizes(runs, plain) < _SIZES:
        return curve
    together = runs if step is None else [*runs, step]
    bent = fit_with_actuator(together, plain, QUADRATIC)
    if bent is None:
        return curve
    beyond = step is not None and _goes_beyond(step, runs, plain.model.axis.force)
    extended = _with_more(together, plain, bent, [DEAD_ZONE, LOPSIDED, *([LEVEL] if beyond else [])], QUADRATIC)
    banded = None if step is None or not with_band else _with_neutral_band(runs, plain, curve, bent, step)
    if banded is not None and _likelihood(banded) > _likelihood(extended):
        return banded
    return curve if extended is bent and not with_band else extended


def _lopsided_first(runs: Sequence[Trial], plain: AxisFit, step: Trial | None) -> Fit[Model] | None:
    """Return a model with thrust that is weaker in one direction, and with what else the runs support, or None.

    Without this effect, an oscillation drifts away from its model, and no curve explains it.
    """
    first = fit_with_actuator(runs, plain, LOPSIDED)
    if first is None or not pays(first, plain, LOPSIDED):
        return None
    together, more = (runs, [QUADRATIC]) if step is None else ([*runs, step], [QUADRATIC, DEAD_ZONE])
    simple = first if step is None else fit_with_actuator(together, plain, LOPSIDED)
    return first if simple is None else _with_more(together, plain, simple, more, LOPSIDED)


def _is_linear_enough(plain: AxisFit) -> bool:
    """Return whether a linear actuator explains the runs of *plain*.

    An oscillation stays about one heading, and the unexplained fraction of its motion shows the actuator. Other
    manoeuvres turn through many circles. A fraction of all that heading hides the actuator, so the residual is compared
    with its noise instead.
    """
    if plain.iso:
        return plain.unexplained < LINEAR_ENOUGH
    return all(left.unexplained <= _SLIGHT * left.noise for left in plain.remainder.values())


def with_thrust_curve(plain: AxisFit, runs: Sequence[Trial]) -> AxisFit:
    """Return the fit *plain* of flown *runs* with a thrust curve if they clearly require one, else *plain*.

    The curve must explain nearly all that *plain* does not, because another missing term may resemble it. If the runs
    do not distinguish it from a dead zone, the result has a doubt.
    """
    curve = fit_thrust_curve(runs, plain) if plain.model.input_unit == "1" else None
    bent = None if curve is None else with_actuator(curve, plain)
    if bent is None or _correlated(bent) > _NEARLY_ALL * _correlated(plain):
        return plain
    return with_doubt_of_kind(bent, runs)


def with_doubt_of_kind(fit: Fit[ModelT], runs: Sequence[Trial]) -> Fit[ModelT]:
    """Return *fit* with a doubt if its *runs* do not distinguish its thrust curve from a dead zone, or the reverse.

    The standard errors of its parameters then include the difference from the model of the other kind. Each kind is
    taken as equally probable. The covariance remains that of the kind in the model.
    """
    other = _of_other_kind(fit, runs)
    if other is None:
        return fit
    own_names, names = DOFS[fit.dof].parameter_names(), DOFS[fit.dof].derivative_names()
    parameters, changes = dict(fit.parameters), []
    for name, derivative in zip(own_names if is_of_one_axis(fit) else names, names, strict=False):
        if name not in parameters:
            continue
        own, value = parameters[name], other.parameters[derivative].value if derivative in other.parameters else 0.0
        value = -value if is_of_one_axis(fit) and derivative != names[3] else value
        if abs(value - own.value) <= HALF_WIDTH * own.std:
            continue
        std = math.hypot(own.std, (value - own.value) / math.sqrt(2.0))
        parameters[name] = replace(own, std=std, bound=math.nan)
        changes.append(f"{name} {format_number(value, 3)} instead of {format_number(own.value, 3)}")
    one, another = ("thrust curve", "dead zone") if QUADRATIC in _kinds(fit) else ("dead zone", "thrust curve")
    better = other.unexplained < _ALIKE * fit.unexplained
    doubt = Doubt(
        "dead-zone-or-curve",
        f"a {another} of the actuator fits the runs {'better than' if better else 'as well as'} the {one} of this "
        f"model. It gives {', '.join(changes) or 'the same craft'}. The errors of these parameters include the "
        f"difference. The error of the {one} itself does not",
        "fly a manoeuvre with more sizes of output, such as staircase",
    )
    return replace(fit, parameters=parameters, doubts=(*fit.doubts, doubt))


def _of_other_kind(own: Fit[Model], runs: Sequence[Trial]) -> Fit[Model] | None:
    """Return a model of the *runs* with a dead zone instead of a thrust curve, or the reverse, if it fits as well as
    *own*; else None.
    """
    slugs, kinds = _slugs(own), _kinds(own)
    if own.dof not in DOFS or len(kinds) != 1 or not _is_sure(own, kinds[0]):
        return None
    kind = DEAD_ZONE if kinds[0] == QUADRATIC else QUADRATIC
    effects = [f"{kind if slug == kinds[0] else slug}@{place}" for slug, place in slugs]
    try:
        other = fit(runs, "affine", dof=own.dof, effects=effects)
    except AutotuneError:
        return None
    if kind == QUADRATIC and not _SHARES[0] < effect_number(other, kind).value < _SHARES[1]:
        return None
    return other if _is_sure(other, kind) and _ALIKE * other.unexplained <= own.unexplained else None


def _slugs(fit: Fit[Model]) -> list[tuple[str, str]]:
    """Return slug and place of the effects of *fit*."""
    effects = fit.effects or (fit.model.effects if isinstance(fit.model, ExtendedModel) else ())
    return [(own.slug, own.place) for own in effects]


def _kinds(fit: Fit[Model]) -> list[str]:
    """Return those effects of *fit* that two sizes of output cannot distinguish."""
    return [slug for slug, _ in _slugs(fit) if slug in (DEAD_ZONE, QUADRATIC)]


def _is_sure(fit: Fit[Model], slug: str) -> bool:
    """Return whether the effect *slug* of *fit* differs from none."""
    own = effect_number(fit, slug)
    if slug == LOPSIDED:  # none is a ratio of 1
        return abs(own.value - 1.0) > _STDS * own.std
    return own.value > _STDS * own.std


def _correlated(fit: AxisFit) -> float:
    """Return the correlated residual of the main signal of *fit* [rad or m]."""
    return fit.remainder[fit.traces[0].signal].unexplained if fit.traces else math.inf


def _sizes(runs: Sequence[Trial], plain: AxisFit) -> int:
    """Return the number of sizes of output in *runs*: one per oscillation, otherwise those held for some time."""
    if plain.iso:
        return len(runs)
    sizes = np.concatenate([np.abs(run[plain.model.axis.force].values) for run in runs])
    bins = np.bincount(np.round(sizes / _SIZE).astype(int))
    return int(np.sum(bins[1:] >= _HELD * len(sizes)))


def either_kind(runs: Sequence[Trial], plain: AxisFit) -> tuple[Fit[Model], Fit[Model]] | None:
    """Return a model with a dead zone and one with a thrust curve, if the *runs* require one of them and do not
    distinguish the two; else None.
    """
    dead, bent = fit_with_actuator(runs, plain, DEAD_ZONE), fit_with_actuator(runs, plain, QUADRATIC)
    if dead is None or bent is None or not (pays(dead, plain, DEAD_ZONE) and pays(bent, plain, QUADRATIC)):
        return None
    few, many = sorted((dead.unexplained, bent.unexplained))
    return None if few < _ALIKE * many else (dead, bent)


def _dead_alone(runs: Sequence[Trial], plain: AxisFit) -> Fit[Model] | None:
    """Return the model with a dead zone and no curve, or None if the runs do not support it.

    A saturation is added if the runs support it. A curve alone may not explain such runs.
    """
    dead = fit_with_actuator(runs, plain, DEAD_ZONE)
    return (
        _with_more(runs, plain, dead, [LEVEL], DEAD_ZONE) if dead is not None and pays(dead, plain, DEAD_ZONE) else None
    )


def _likelihood(fit: Fit[Model]) -> float:
    return float(fit.extra["log_likelihood"])


def _goes_beyond(step: Trial, runs: Sequence[Trial], force: str) -> bool:
    flown = max(float(np.max(np.abs(run[force].values))) for run in runs)
    return float(np.max(np.abs(step[force].values))) > _BEYOND * flown


def _with_neutral_band(
    runs: Sequence[Trial], plain: AxisFit, curve: Fit[Model], bent: Fit[Model], step: Trial
) -> Fit[Model] | None:
    """Return a model of *runs* and *step* with a neutral band, or None if the runs do not support it.

    The actuator does not act within the band and acts fully beyond it. The width has no gradient, because its effect
    changes in steps of the recorded output. The step is therefore simulated with every possible width by *curve*, the
    model of the oscillations. The output of an oscillation never stays within the band.
    """
    smallest = min(float(np.max(np.abs(run[plain.model.axis.force].values))) for run in runs)
    bands = _bands(step, plain.model.axis.force, smallest)
    bands.sort(key=lambda band: band.foretold(curve, step), reverse=True)
    together = [*runs, step]
    tried = [
        (fit, band)
        for band in bands[:_CLOSER]
        if (fit := fit_with_actuator(together, plain, QUADRATIC, band=band)) is not None
    ]
    if not tried:
        return None
    best, band = max(tried, key=lambda entry: _likelihood(entry[0]))
    if not pays(best, bent, DEAD_ZONE):
        return None
    levelled = fit_with_actuator(together, plain, LEVEL, QUADRATIC, band=band)
    return levelled if levelled is not None and pays(levelled, best, LEVEL) else best


@dataclass(frozen=True, slots=True)
class _Band:
    """A neutral band of the actuator of *force*.

    - ``width``: half-width [fraction of full].
    - ``std``: its standard error.
    """

    force: str
    width: float
    std: float

    def on(self, run: Trial) -> Trial:
        """Return *run* with the commands of the actuator set to zero within the band."""
        force = run[self.force]
        let_through = np.where(np.abs(force.values) > self.width, force.values, 0.0)
        return replace(run, channels={**run.channels, self.force: replace(force, values=let_through)})

    def foretold(self, model: Fit[Model], run: Trial) -> float:
        """Return the fraction of the motion of *run* that *model* explains [%], with this band before its actuator."""
        try:
            return validate(model.model, [self.on(run)]).fit_percent
        except AutotuneError:  # it runs away: with this band the model is none of this craft
            return -math.inf

    def within(self, fit: Fit[Model]) -> Fit[Model]:
        """Return *fit* with the band added as an effect. The runs of *fit* must come from :meth:`on`."""
        model = fit.model
        assert isinstance(model, ExtendedModel)
        own = EffectInstance(DEAD_ZONE, self.force, {"width": self.width}, {SUBTRACTED: 0.0})
        name = f"{DEAD_ZONE}@{self.force}.width"
        size = len(fit.parameters)
        covariance = np.zeros((size + 1,) * 2)
        covariance[:size, :size] = fit.covariance
        covariance[size, size] = self.std**2
        return replace(
            fit,
            structure=f"{fit.structure} + {DEAD_ZONE}@{self.force}",
            model=replace(model, effects=in_order((*model.effects, own))),
            parameters={**fit.parameters, name: Parameter(name, self.width, "1", self.std, "fitted")},
            covariance=covariance,
        )


def _bands(step: Trial, force: str, smallest: float) -> list[_Band]:
    """Return the bands that end between two levels of the *step*'s output.

    They must be below a fraction of the *smallest* oscillation.
    """
    levels = np.unique(np.round(np.abs(step[force].values), 5))
    levels = levels[levels < _WIDEST * smallest]
    if len(levels) > _LEVELS:
        levels = levels[np.linspace(0, len(levels) - 1, _LEVELS).round().astype(int)]
    ends = zip(levels[:-1].tolist(), levels[1:].tolist(), strict=True)
    return [_Band(force, 0.5 * (low + high), (high - low) / math.sqrt(12.0)) for low, high in ends if low > 0.0]


def _with_more(runs: Sequence[Trial], plain: AxisFit, simple: Fit[Model], more: Sequence[str], has: str) -> Fit[Model]:
    """Return a model of all *runs* with those effects of *more* that they clearly support, the best first.

    simple : model with only the effect *has*. It is returned if no further effect is supported.
    """
    slugs: tuple[str, ...] = (has,)
    best, more = simple, list(more)
    while more:
        tried = [(slug, fit_with_actuator(runs, plain, *_in_order((slug, *slugs)))) for slug in more]
        paying = [(fit.unexplained, slug, fit) for slug, fit in tried if fit is not None and pays(fit, best, slug)]
        if not paying:
            break
        _, slug, best = min(paying, key=lambda entry: entry[0])
        slugs = (slug, *slugs)
        more.remove(slug)
    return best


def _in_order(slugs: Sequence[str]) -> tuple[str, ...]:
    """Return the effects in the order in which they act, from the command to the force."""
    return tuple(slug for slug in (LEVEL, DEAD_ZONE, QUADRATIC, LOPSIDED) if slug in slugs)


def fit_with_actuator(
    runs: Sequence[Trial], plain: AxisFit, *slugs: str, band: _Band | None = None
) -> Fit[Model] | None:
    """Return a model with the actuator effects *slugs* and a neutral *band*, or None if it cannot be fitted."""
    effects = tuple(f"{slug}@{plain.model.axis.force}" for slug in slugs)
    try:
        fitted = fit(
            [run if band is None else band.on(run) for run in runs], "affine", dof=plain.model.dof, effects=effects
        )
    except AutotuneError:
        return None
    return fitted if band is None else band.within(fitted)


def pays(fit: Fit[Model], without: Fit[Model], slug: str) -> bool:
    """Return whether the runs clearly support the effect *slug* of *fit*.

    Noise is not compared: beside the noise of a coarse compass, the error of a missing dead zone looks small.

    without : model of the same runs without this effect.
    """
    left, before = fit.remainder, without.remainder
    sizes = {s: one.noise for s, one in before.items() if s in left and one.noise > 0.0}
    after, ahead = (sum((of[s].rms ** 2 - of[s].noise ** 2) / sizes[s] ** 2 for s in sizes) for of in (left, before))
    less = after < _UNEXPLAINED**2 * ahead if sizes else fit.unexplained < _UNEXPLAINED * without.unexplained
    return less and _is_sure(fit, slug)


def effect_number(fit: Fit[Model], slug: str) -> Parameter:
    """Return the only parameter of the effect *slug* in *fit*."""
    return next(p for name, p in fit.parameters.items() if name.startswith(slug))


def describe_thrust_curve(fit: Fit[Model], plain: AxisFit, step: Trial | None = None) -> str:
    """Return one sentence that reports the thrust curve, dead band, saturation or asymmetry in *fit*.

    plain : model of the same runs without an actuator effect.
    step : the step that was used too, if any.
    """
    has = {name.partition("@")[0] for name in fit.parameters}
    square, sure = "", False
    if QUADRATIC in has:
        share, (at, part) = effect_number(fit, QUADRATIC), _bent_at_half(fit)
        sure = share.value > _STDS * share.std
        flown = f"{share.value:.0%} at {_reference(fit):.0%}, the largest output flown"
        square = f"at {at:.0%} of full output, {part:.0%} of the force is quadratic in the command ({flown})"
    levels = f". {limit_sentence(f'{effect_number(fit, LEVEL).value:.0%}')}" if LEVEL in has else ""
    with_step = step is not None and step.name in fit.used
    records = "oscillations and the step together" if with_step else "oscillations"
    explains = (
        f"With this the model explains {fit.fit_percent:.0f} % of the motion instead of {plain.fit_percent:.0f} %"
    )
    if LOPSIDED in has:
        one, way = SIDES[fit.dof]
        ratio = f"thrust {way} is {effect_number(fit, LOPSIDED).value:.0%} of that {one}"
        if not has & {DEAD_ZONE, QUADRATIC}:
            return f"the {records} show that {ratio}{levels}. {explains}"
        levels += f". {ratio[0].upper()}{ratio[1:]}"
    if DEAD_ZONE in has:
        what = f"an actuator that does nothing below {effect_number(fit, DEAD_ZONE).value:.1%} of full output"
        if _lost(fit) == 0.0:
            what += " and acts at once beyond it, like the neutral band of a speed controller"
        if sure:
            what += f". Beyond it, {square}"
        return f"the {'three ' if step is None else ''}{records} are explained best by {what}{levels}"
    return (
        f"the {records} are explained best by an actuator that is weak for small commands: {square}{levels}. {explains}"
    )


def _bent_at_half(fit: Fit[Model]) -> tuple[float, float]:
    """Return an output [fraction of full] and the fraction of the force there that is quadratic in the command.

    The fitted fraction applies to the largest output of the runs used. It is converted to half of full output, where it
    is the same for all runs of a thruster.
    """
    share, reference = effect_number(fit, QUADRATIC).value, _reference(fit)
    square = share * max(_HALF - _lost(fit), 0.0) / reference
    return _HALF, square / (1.0 - share + square)


def _lost(fit: Fit[Model]) -> float:
    """Return the amount subtracted from commands beyond a dead zone, 0 without one."""
    assert isinstance(fit.model, ExtendedModel)
    zones = (own for own in fit.model.effects if own.slug == DEAD_ZONE)
    return next((own.constants.get(SUBTRACTED, 1.0) * own["width"] for own in zones), 0.0)


def _reference(fit: Fit[Model]) -> float:
    assert isinstance(fit.model, ExtendedModel)
    return next(own.constants["u_ref"] for own in fit.model.effects if own.slug == QUADRATIC)
