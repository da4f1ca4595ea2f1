"""Thrusters that are weak for small commands: two oscillations of different size show it, one model of both needs it.

A propeller's thrust goes with n|n|, and ArduSub sends its demands to the thrusters as they are, so that an ROV's gain
grows with the size of the command. Without it the smaller oscillation is that of another craft than the larger.

Most speed controllers do nothing at all near neutral besides. Two sizes of square wave cannot tell such a dead band
from a curve: each tells one point of the characteristic. A step under the autopilot's own loop, whose output runs
through all sizes down to the bias it holds against, can; it has been flown anyway.

And no thruster pulls with the square of its command up to full: its motor runs out of voltage, its propeller out of
water. A square law fitted to small oscillations promises half again the force there is. A step whose output went beyond
the oscillations tells where the thrust levels off, and so do three sizes of oscillation that speak of a dead band.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import SUBTRACTED, EffectInstance, ExtendedModel, in_order
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.api import fit
from gcs_autotune.identify.free_run import validate
from gcs_autotune.identify.result import AxisFit, Fit, Model, Parameter
from gcs_autotune.trial import Trial

__all__ = [
    "DEAD_ZONE",
    "QUADRATIC",
    "effect_number",
    "fit_thrust_curve",
    "fit_with_actuator",
    "pays",
    "thrust_curve_told",
    "unexplained",
]

Array = NDArray[np.float64]

QUADRATIC = "quadratic-actuator"
DEAD_ZONE = "dead-zone"
LEVEL = "saturation"
_UNEXPLAINED = 0.8
"""The curve must bring what is left unexplained below this share of what it was..."""
_WORTH_A_LOOK = 4.0
"""Chosen [percent]: what a straight actuator leaves unexplained that nobody need look into."""
_BEYOND = 1.1
"""Chosen: a step whose output went so far beyond the oscillations (ratio) can tell that thrust levels off."""
_SIZES = 3
"""Sizes of oscillation that tell a dead band from a curve."""
_STDS = 5.0
"""...and be this many standard errors from a straight line. Both chosen: a curve that matters passes both by far."""
_WIDEST = 0.6
"""Chosen: a neutral band is not looked for beyond this share of the smallest oscillation."""
_LEVELS = 60
"""Bands looked at, at most."""
_CLOSER = 2
"""So many of them, those that foretell the step best, are fitted with everything else."""
_HALF = 0.5
"""Output [fraction of full] of which a bend is told in words."""
_SHARES = (0.1, 1.5)
"""What the share of n|n| can be."""


def fit_thrust_curve(
    runs: Sequence[Trial], plain: AxisFit, step: Trial | None = None, *, with_band: bool = False
) -> Fit[Model] | None:
    """Return a model with a thrust curve when the *runs* clearly call for one, else None.

    plain : the model without, of the same runs. step : flown under the autopilot's own loop; with it, or with three
    sizes of oscillation, the curve may turn out to be a dead band, or to have one, or to level off. Only the step tells
    the two kinds of dead band apart: its output dwells about the edge, and just beyond it the craft is either hardly
    pushed (a linkage with slack) or as hard as without a band (a speed controller that starts at once). The second is
    looked for *with_band* only: position loops designed for it flew worse (BlueROV2 heading, ITAE 0.74 for 0.40).
    """
    if unexplained(plain) < _WORTH_A_LOOK:
        return None
    curve = fit_with_actuator(runs, plain, QUADRATIC)
    if (
        curve is None
        or not pays(curve, plain, QUADRATIC)
        or not _SHARES[0] < effect_number(curve, QUADRATIC).value < _SHARES[1]
    ):
        return _dead_alone(runs, plain) if step is None and len(runs) >= _SIZES else None
    if step is None and len(runs) < _SIZES:
        return curve
    together = runs if step is None else [*runs, step]
    bent = fit_with_actuator(together, plain, QUADRATIC)
    if bent is None:
        return curve
    beyond = step is not None and _goes_beyond(step, runs, plain.model.axis.force)
    found = _with_more(together, plain, bent, [DEAD_ZONE, LEVEL] if beyond else [DEAD_ZONE], QUADRATIC)
    banded = None if step is None or not with_band else _with_neutral_band(runs, plain, curve, bent, step)
    if banded is not None and _likelihood(banded) > _likelihood(found):
        return banded
    return curve if found is bent else found


def _dead_alone(runs: Sequence[Trial], plain: AxisFit) -> Fit[Model] | None:
    """Return the model with a dead zone and no curve, if it pays, levelling off where that pays, too.

    A curve alone need not come near that.
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
    """Return a model of *runs* and *step* whose actuator stands still in a band and acts in full beyond, if it pays.

    How wide the band is no gradient tells, for it acts by whole steps of the recorded output. So the step is simulated
    with every width in question by *curve*, the model of the oscillations, none of which comes to rest within the band.
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
    """A neutral band of *force*: half its ``width`` [fraction of full] and how finely that is known."""

    force: str
    width: float
    std: float

    def on(self, run: Trial) -> Trial:
        """Return *run* with what the actuator makes of its commands."""
        force = run[self.force]
        let_through = np.where(np.abs(force.values) > self.width, force.values, 0.0)
        return replace(run, channels={**run.channels, self.force: replace(force, values=let_through)})

    def foretold(self, model: Fit[Model], run: Trial) -> float:
        """Return how much of *run* a *model* explains [percent] when this band stands before its actuator."""
        try:
            return validate(model.model, [self.on(run)]).fit_percent
        except AutotuneError:  # it runs away: with this band the model is none of this craft
            return -math.inf

    def within(self, fit: Fit[Model]) -> Fit[Model]:
        """Return *fit*, of runs that are :meth:`on` it, with the band as the effect that it is."""
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
    """Return the bands that end between two levels of the *step*'s output, below part of the *smallest* oscillation."""
    levels = np.unique(np.round(np.abs(step[force].values), 5))
    levels = levels[levels < _WIDEST * smallest]
    if len(levels) > _LEVELS:
        levels = levels[np.linspace(0, len(levels) - 1, _LEVELS).round().astype(int)]
    ends = zip(levels[:-1].tolist(), levels[1:].tolist(), strict=True)
    return [_Band(force, 0.5 * (low + high), (high - low) / math.sqrt(12.0)) for low, high in ends if low > 0.0]


def _with_more(runs: Sequence[Trial], plain: AxisFit, simple: Fit[Model], more: Sequence[str], has: str) -> Fit[Model]:
    """Return a model of all *runs* with what they clearly call for of *more*, the worthiest first, else *simple*, which
    *has* one effect.
    """
    slugs: tuple[str, ...] = (has,)
    best, more = simple, list(more)
    while more:
        tried = [(slug, fit_with_actuator(runs, plain, *_in_order((slug, *slugs)))) for slug in more]
        paying = [(unexplained(fit), slug, fit) for slug, fit in tried if fit is not None and pays(fit, best, slug)]
        if not paying:
            break
        _, slug, best = min(paying, key=lambda entry: entry[0])
        slugs = (slug, *slugs)
        more.remove(slug)
    return best


def _in_order(slugs: Sequence[str]) -> tuple[str, ...]:
    """Return the effects as they act: on the command first, on the force last."""
    return tuple(slug for slug in (LEVEL, DEAD_ZONE, QUADRATIC) if slug in slugs)


def fit_with_actuator(
    runs: Sequence[Trial], plain: AxisFit, *slugs: str, band: _Band | None = None
) -> Fit[Model] | None:
    """Return the model with these effects of the actuator, and with a neutral *band*, or None when there is none."""
    effects = tuple(f"{slug}@{plain.model.axis.force}" for slug in slugs)
    try:
        found = fit(
            [run if band is None else band.on(run) for run in runs], "affine", dof=plain.model.dof, effects=effects
        )
    except AutotuneError:
        return None
    return found if band is None else band.within(found)


def pays(found: Fit[Model], without: Fit[Model], slug: str) -> bool:
    """Whether *found* clearly needs its effect *slug*, *without* being a model of the same runs that lacks it."""
    own = effect_number(found, slug)
    return unexplained(found) < _UNEXPLAINED * unexplained(without) and own.value > _STDS * own.std


def effect_number(found: Fit[Model], slug: str) -> Parameter:
    """Return the one number of the effect *slug*."""
    return next(p for name, p in found.parameters.items() if name.startswith(slug))


def unexplained(found: Fit[Model]) -> float:
    """Return what is left unexplained [percent]."""
    return 100.0 - found.fit_percent


def thrust_curve_told(found: Fit[Model], plain: AxisFit, step: Trial | None = None) -> str:
    """Return the finding in a sentence. *step*: the one that was looked at too."""
    has = {name.partition("@")[0] for name in found.parameters}
    square, sure = "", False
    if QUADRATIC in has:
        share, (at, part) = effect_number(found, QUADRATIC), _bent_at_half(found)
        sure = share.value > _STDS * share.std
        square = f"{part:.0%} of the force goes with the square of the command at {at:.0%} of full"
    levels = f", and pushes no harder beyond {effect_number(found, LEVEL).value:.0%}" if LEVEL in has else ""
    if DEAD_ZONE in has:
        what = f"an actuator that does nothing below {effect_number(found, DEAD_ZONE).value:.1%} of full"
        if _lost(found) == 0.0:
            what += " and acts at once beyond (the neutral band of a speed controller)"
        if sure:
            what += f", beyond which {square}"
        told_by = "three oscillations" if step is None else "oscillations and the step together"
        return f"the {told_by} indicate {what}{levels}"
    told_by = "oscillations and the step together" if levels else "two oscillations"
    return (
        f"the {told_by} indicate an actuator that is weak for small commands ({square}){levels}: with that the model "
        f"explains {found.fit_percent:.0f} % of the motion instead of {plain.fit_percent:.0f} %"
    )


def _bent_at_half(found: Fit[Model]) -> tuple[float, float]:
    """Return an output [fraction of full] and the share of the force there that goes with the square of the command.

    The fitted share is that at the largest output of the runs it was fitted to. Told of one output, half of full, the
    same thruster has the same share whatever was flown.
    """
    share, reference = effect_number(found, QUADRATIC).value, _reference(found)
    square = share * max(_HALF - _lost(found), 0.0) / reference
    return _HALF, square / (1.0 - share + square)


def _lost(found: Fit[Model]) -> float:
    """Return what a dead zone takes off commands beyond it; 0 without one."""
    assert isinstance(found.model, ExtendedModel)
    zones = (own for own in found.model.effects if own.slug == DEAD_ZONE)
    return next((own.constants.get(SUBTRACTED, 1.0) * own["width"] for own in zones), 0.0)


def _reference(found: Fit[Model]) -> float:
    assert isinstance(found.model, ExtendedModel)
    return next(own.constants["u_ref"] for own in found.model.effects if own.slug == QUADRATIC)
