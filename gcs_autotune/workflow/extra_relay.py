"""A third relay amplitude, for cases where two cannot distinguish a dead zone from a thrust curve.

A square wave of one amplitude shows one point of the actuator's characteristic. A dead zone and a thrust curve both fit
two points at any noise level; a third point separates them. The third relay is flown only if the first two records need
a dead zone or a curve. Its amplitude is the one at which the two models differ most per second of oscillation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, Characteristic, ExtendedModel
from gcs_autotune.errors import NotAchieved
from gcs_autotune.identify import AxisFit, Fit, Model
from gcs_autotune.identify.thrust import DEAD_ZONE, QUADRATIC, effect_number, either_kind
from gcs_autotune.observer import Observer
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import Relays
from gcs_autotune.workflow.runner import ManoeuvreRunner

__all__ = ["ExtraRelay", "extra_relay", "fly_extra"]

Array = NDArray[np.float64]

_WEAKEST = 0.5
"""Smallest force of a weaker relay, relative to the smallest one flown.

Below it the relay takes too long and a constant force dominates. Project choice.
"""
_APART = 1.25
"""Smallest ratio between the third amplitude and those flown. Project choice."""


@dataclass(frozen=True, slots=True)
class ExtraRelay:
    """The relay to fly: its ``output`` [fraction of full output] and the reason ``why``."""

    output: float
    why: str


def extra_relay(runs: Sequence[Trial], plain: AxisFit, room: float = 0.9) -> ExtraRelay | None:
    """Return the relay that separates a dead zone from a thrust curve. None if the *runs* need neither model, or
    already separate them.

    plain : the model of the *runs* without dead zone and curve.
    room : largest available relay output [fraction of full].
    """
    kinds = either_kind(runs, plain)
    if kinds is None:
        return None
    dead, bent = kinds
    output = _telling(_force_of(dead), _force_of(bent), [float(run.meta["C"]) for run in runs], room)
    if output is None:
        return None
    below, square = effect_number(dead, DEAD_ZONE).value, effect_number(bent, QUADRATIC).value
    return ExtraRelay(
        output,
        f"two causes fit the oscillations about equally well: a dead zone below {below:.0%} of full output, or a "
        f"thrust curve ({square:.0%} of the force with the square of the command). A third oscillation at "
        f"{output:.0%} of full output can distinguish them",
    )


def fly_extra(third: ExtraRelay, relays: Relays, runner: ManoeuvreRunner, observer: Observer) -> list[Trial]:
    """Report why a third amplitude is needed, fly it and return its record. Return nothing if the craft does not
    oscillate with it.
    """
    observer.say(third.why)
    try:
        return [runner.fly(relays.relay(3, third.output), relays.stage("third"))]
    except NotAchieved as error:
        observer.say(f"{error}. Continuing with the two experiments flown")
        return []


def _force_of(found: Fit[Model]) -> ExtendedModel:
    assert isinstance(found.model, ExtendedModel)
    return found.model


def _force(model: ExtendedModel, u: Array) -> Array:
    """Return the accelerations caused by commands *u* (n,) according to each model."""
    own = model.effects[0]
    inertia = abs(float(model.base.inertia[0, 0]))
    actuator = EFFECTS[own.slug]
    assert isinstance(actuator, Characteristic)
    force: Array = actuator.acting(own, u) / inertia
    return force


def _telling(dead: ExtendedModel, bent: ExtendedModel, flown: Sequence[float], room: float) -> float | None:
    """Return the relay output that best separates the two accelerations per second of oscillation."""
    u = np.arange(0.05, room + 1e-9, 0.01)
    one, other = _force(dead, u), _force(bent, u)
    mean = 0.5 * (one + other)
    apart = np.abs(one - other) / np.maximum(mean, 1e-12)
    strong = one > _WEAKEST * _force(dead, np.array([min(flown)]))[0]
    new = np.all([np.maximum(u / c, c / u) >= _APART for c in flown], axis=0)
    worth = np.where(strong & new, apart**2 * mean, 0.0)
    best = int(np.argmax(worth))
    return float(round(u[best], 2)) if worth[best] > 0.0 else None
