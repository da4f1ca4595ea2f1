"""What is left of the margins when a boat goes faster or slower than it was identified at.

A ship's turning scales with its speed (Nomoto's K' and T' are constant: K = K' U/L, T = T' L/U); ArduRover divides its
steering by speed above MOT_SPD_SCA_BASE. The two cancel in the gain, not in the time constant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from gcs_autotune.design.laws import SKID, Settings
from gcs_autotune.design.matching import Problem
from gcs_autotune.design.result import Margins, ModelFunction
from gcs_autotune.models import SingleDof

__all__ = ["at_speed", "on_other_speeds"]

SPEEDS = (0.5, 2.0)
"""Shares of the experiment's speed that are looked at."""
ENOUGH_GAIN, ENOUGH_PHASE = 1.6, math.radians(25.0)
"""Chosen: below these the sentence is a warning."""
MOST = 100.0


def at_speed(model: SingleDof, share: float) -> SingleDof:
    """Return *model* (input a fraction of full rudder) at *share* times the speed it was identified at."""
    turn = 1.0 / share
    return replace(
        model, alpha=model.alpha * turn**2, beta=model.beta * turn, beta_quadratic=model.beta_quadratic * turn**2
    )


def on_other_speeds(problem: Problem, settings: Settings, wanted: ModelFunction) -> Iterator[str]:
    """Yield a sentence with the margins at half and twice the speed; nothing for a craft that does not steer by way."""
    speed = problem.spec.speed
    steered_by_thrust = settings.get("MOT_VEC_ANGLEMAX", 0.0) > 0.0 or settings.get(SKID, 0.0) > 0.0
    if speed is None or steered_by_thrust:
        return
    told, thin = [], False
    for share in SPEEDS:
        there = replace(problem, spec=replace(problem.spec, speed=share * speed))
        margins = there.margins(settings, wanted, [at_speed(problem.model, share)])[0]
        told.append(f"{share * speed:.2f} m/s {_said(margins)}")
        thin = thin or not margins.stable or margins.gain < ENOUGH_GAIN or margins.phase < ENOUGH_PHASE
    yield (
        f"if it turns as ships do (rate per rudder in proportion to speed, time constant inversely) there remain at "
        f"{' and at '.join(told)}" + ("; do not go there with these gains before tuning there" if thin else "")
    )


def _said(margins: Margins) -> str:
    if not margins.stable:
        return "no margin at all: the loop is unstable"
    gain = f"{margins.gain:.1f}" if margins.gain <= MOST else f"more than {MOST:.0f}"
    return f"a factor of {gain} in gain and {math.degrees(margins.phase):.0f} deg of phase"
