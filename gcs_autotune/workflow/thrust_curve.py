"""Thrusters that are weak for small commands: two oscillations of different size show it, one model of both needs it.

A propeller's thrust goes with n|n|, and ArduSub sends its demands to the thrusters as they are, so that an ROV's gain
grows with the size of the command. Without it the smaller oscillation is that of another craft than the larger.

Most speed controllers do nothing at all near neutral besides. Two sizes of square wave cannot tell such a dead band
from a curve: each tells one point of the characteristic. A step under the autopilot's own loop, whose output runs
through all sizes down to the bias it holds against, can; it has been flown anyway.

And no thruster pulls with the square of its command up to full: its motor runs out of voltage, its propeller out of
water. A square law fitted to small oscillations promises half again the force there is. A step whose output went beyond
the oscillations tells where the thrust levels off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design import Proposal, Reduction, Spec, design_from, reduce
from gcs_autotune.design.actuator import USED
from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import AutotuneError
from gcs_autotune.firmware import Axis
from gcs_autotune.identify import AxisFit, Fit, fit
from gcs_autotune.identify.result import Parameter
from gcs_autotune.trial import Trial

__all__ = [
    "CURVE",
    "DEAD",
    "design_with_curve",
    "fit_thrust_curve",
    "fitted",
    "left",
    "number",
    "pays",
    "reduction_with_curve",
    "told",
]

Array = NDArray[np.float64]

CURVE = "quadratic-actuator"
DEAD = "dead-zone"
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
_SHARES = (0.1, 1.5)
"""What the share of n|n| can be."""


def fit_thrust_curve(runs: Sequence[Trial], plain: AxisFit, step: Trial | None = None) -> Fit | None:
    """Return a model with a thrust curve when the *runs* clearly call for one, else None.

    plain : the model without, of the same runs. step : flown under the autopilot's own loop; with it, or with three
    sizes of oscillation, the curve may turn out to be a dead band, or to have one, or to level off.
    """
    if left(plain) < _WORTH_A_LOOK:
        return None
    curve = fitted(runs, plain, CURVE)
    if curve is None or not pays(curve, plain, CURVE) or not _SHARES[0] < number(curve, CURVE).value < _SHARES[1]:
        return None
    if step is None and len(runs) < _SIZES:
        return curve
    more = [DEAD] if step is None or not _goes_beyond(step, runs, plain.model.axis.force) else [DEAD, LEVEL]
    return _with_more(runs if step is None else [*runs, step], plain, curve, more)


def _goes_beyond(step: Trial, runs: Sequence[Trial], force: str) -> bool:
    flown = max(float(np.max(np.abs(run[force].values))) for run in runs)
    return float(np.max(np.abs(step[force].values))) > _BEYOND * flown


def _with_more(runs: Sequence[Trial], plain: AxisFit, curve: Fit, more: Sequence[str]) -> Fit:
    """Return a model of all *runs* with what they clearly call for of *more*, the worthiest first, else *curve*."""
    slugs: tuple[str, ...] = (CURVE,)
    best = fitted(runs, plain, CURVE)
    found, more = curve, list(more)
    while more and best is not None:
        without = best
        tried = [(slug, fitted(runs, plain, *_in_order((slug, *slugs)))) for slug in more]
        paying = [(left(fit), slug, fit) for slug, fit in tried if fit is not None and pays(fit, without, slug)]
        if not paying:
            break
        _, slug, best = min(paying, key=lambda entry: entry[0])
        found, slugs = best, (slug, *slugs)
        more.remove(slug)
    return found


def _in_order(slugs: Sequence[str]) -> tuple[str, ...]:
    """Return the effects as they act: on the command first, on the force last."""
    return tuple(slug for slug in (LEVEL, DEAD, CURVE) if slug in slugs)


def fitted(runs: Sequence[Trial], plain: AxisFit, *slugs: str) -> Fit | None:
    """Return the model with these effects of the actuator, or None when there is none."""
    effects = tuple(f"{slug}@{plain.model.axis.force}" for slug in slugs)
    try:
        return fit(list(runs), "affine", dof=plain.model.dof, effects=effects)
    except AutotuneError:
        return None


def pays(found: Fit, without: Fit | AxisFit, slug: str) -> bool:
    """Whether *found* clearly needs its effect *slug*, *without* being a model of the same runs that lacks it."""
    own = number(found, slug)
    return left(found) < _UNEXPLAINED * left(without) and own.value > _STDS * own.std


def number(found: Fit, slug: str) -> Parameter:
    """Return the one number of the effect *slug*."""
    return next(p for name, p in found.parameters.items() if name.startswith(slug))


def left(found: Fit | AxisFit) -> float:
    """Return what is left unexplained [percent]."""
    return 100.0 - found.fit_percent


def told(found: Fit, plain: AxisFit, step: Trial | None = None) -> str:
    """Return the finding in a sentence. *step*: the one that was looked at too."""
    share, has = number(found, CURVE), {name.partition("@")[0] for name in found.parameters}
    at, part = bent_at_half(found)
    square = f"{part:.0%} of the force goes with the square of the command at {at:.0%} of full"
    levels = f", and pushes no harder beyond {number(found, LEVEL).value:.0%}" if LEVEL in has else ""
    if DEAD in has:
        speak = f"of an actuator that does nothing below {number(found, DEAD).value:.1%} of full"
        if share.value > _STDS * share.std:
            speak += f", beyond which {square}"
        told_by = "three oscillations" if step is None else "oscillations and the step together"
        return f"the {told_by} speak {speak}{levels}"
    told_by = "oscillations and the step together" if levels else "two oscillations"
    return (
        f"the {told_by} speak of an actuator that is weak for small commands ({square}){levels}: with that the model "
        f"explains {found.fit_percent:.0f} % of the motion instead of {plain.fit_percent:.0f} %"
    )


def bent_at_half(found: Fit) -> tuple[float, float]:
    """Return an output [fraction of full] and the share of the force there that goes with the square of the command.

    The fitted share is that at the largest output of the runs it was fitted to. Told of one output, half of full, the
    same thruster has the same share whatever was flown.
    """
    share, reference = number(found, CURVE).value, _reference(found)
    dead = next((p.value for name, p in found.parameters.items() if name.startswith(DEAD)), 0.0)
    square = share * max(USED - dead, 0.0) / reference
    return USED, square / (1.0 - share + square)


def _reference(found: Fit) -> float:
    assert isinstance(found.model, ExtendedModel)
    return next(own.constants["u_ref"] for own in found.model.effects if own.slug == CURVE)


def design_with_curve(found: Fit, axis: Axis, present: Mapping[str, float], spec: Spec) -> Proposal:
    """Return gains designed with the curve in the loop; errors as those of :func:`gcs_autotune.design.design_from`."""
    model, units, covariance = _parts(found)
    return design_from(model, axis, present, spec, inputs=units, names=tuple(found.parameters), covariance=covariance)


def reduction_with_curve(found: Fit, axis: Axis) -> Reduction:
    """Return what a loop of *axis* is designed with when the curve is known."""
    model, units, covariance = _parts(found)
    return reduce(model, axis.dof, units, law=axis.law, names=tuple(found.parameters), covariance=covariance)


def _parts(found: Fit) -> tuple[ExtendedModel, dict[str, str], Array]:
    """Return the model, the unit of its inputs and the covariance of its numbers (p, p)."""
    std = np.array([parameter.std for parameter in found.parameters.values()])
    model = found.model
    assert isinstance(model, ExtendedModel)
    covariance: Array = np.nan_to_num(found.correlation) * np.outer(std, std)
    return model, dict.fromkeys(model.base.form.inputs, "1"), covariance
