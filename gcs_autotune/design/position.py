"""Rule for the gains with which ArduSub holds a position: ``AC_PosControl`` in the horizontal plane.

``v = P e``, ``a = V (v - speed) + I int + D rate``; the acceleration becomes thrust as if the craft leaned:
``output = atan(a / g) / ANGLE_MAX``, as in ``ArduSub/motors``. One set of gains serves surge and sway.

With ``w = V c / alpha`` [1/s], c the output per acceleration, position and velocity loop together are
``s^2 + w s + w P``: a damping of ``sqrt(w / P) / 2``. A push is resisted by ``V P``. So the rule takes the largest
``V P`` inside the documented ranges that keeps the margins on both motions, over their 95 % regions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.margins import Plant, margins_of_each, worst
from gcs_autotune.design.matching import round_gain
from gcs_autotune.design.open_loop import Rational, constant, first_order, integrator
from gcs_autotune.design.plant import in_fractions, sample_region
from gcs_autotune.design.result import Change, Margins
from gcs_autotune.design.spec import Spec
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.firmware import Gain
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = [
    "LOITER_CONTEXT",
    "LOITER_GAINS",
    "POSITION_CONTEXT",
    "POSITION_GAINS",
    "PositionDesign",
    "design_position",
    "loiter_change",
]

GRAVITY = 9.80665
POSITION_GAINS = (
    Gain("PSC_POSXY_P", 0.5, 2.0, "speed per position error", 1.0),
    Gain("PSC_VELXY_P", 0.1, 6.0, "acceleration per speed error", 6.0),
    Gain("PSC_VELXY_I", 0.02, 1.0, "acceleration per accumulated speed error", 0.5),
)
"""What is tuned: documented range, meaning, default. Later names: ``firmware.aliases``."""
POSITION_CONTEXT = ("PSC_VELXY_D", "PSC_VELXY_FLTE", "ANGLE_MAX", "SCHED_LOOP_RATE", "WPNAV_SPEED")
"""Parameters that the rule reads; what is missing has ArduSub's default."""
LOITER_GAINS = (Gain("LOIT_RADIUS", 0.0, 20.0, "radius within which a boat drifts", 2.0),)
LOITER_CONTEXT = ("LOIT_SPEED_GAIN", "LOIT_TYPE", "WP_SPEED")
"""What else ``Rover/mode_loiter`` uses. A speed gain of 0.5 or 1 makes no difference to a BlueBoat."""
LEAST_RADIUS, NOISES = 0.5, 5.0
"""Smallest radius [m], and in standard deviations of the position. Project choice: within it a BlueBoat still rests,
and noise does not start its thrusters."""
DEFAULTS: Mapping[str, float] = {
    "PSC_VELXY_D": 0.0, "PSC_VELXY_FLTE": 5.0, "ANGLE_MAX": 4500.0, "SCHED_LOOP_RATE": 400.0
}  # fmt: skip
SHARES = (0.75, 0.6, 0.5, 0.4, 0.3, 0.25)
"""Position gains tried, relative to w: dampings from 0.58 to 1. Project choice; beyond 0.75 a step overshoots."""
SLOWER = 0.1
"""Rate of the integral relative to w: it takes 6 degrees of phase. Project choice."""
SIZES = 40
"""Number of velocity gains tried."""
LOOPS = 1.5
"""Delay of the autopilot [loop periods], as :class:`Spec` assumes."""


@dataclass(frozen=True, slots=True)
class PositionDesign(Displayed):
    """Gains by parameter, their ``margins`` at the worst point of both regions, and those of the ``present`` gains."""

    gains: Mapping[str, float]
    margins: Margins
    present: Margins

    def changes(self, present: Mapping[str, float], gains: Sequence[Gain]) -> list[Change]:
        """Return what differs from *present* by 2 % or more; *gains* has the ranges."""
        return [
            Change(g.parameter, present[g.parameter], new, g.low, g.high, g.meaning)
            for g in gains
            if not math.isclose(new := self.gains[g.parameter], present[g.parameter], rel_tol=0.02)
        ]


def design_position(
    motions: Sequence[tuple[SingleDof, NDArray[np.float64]]],
    present: Mapping[str, float],
    gains: Sequence[Gain] = POSITION_GAINS,
) -> PositionDesign:
    """Return the gains for *motions* (surge and sway): each a model with normalised output, and its covariance (5, 5).

    present : the vehicle's values of the gains and of :data:`POSITION_CONTEXT`. gains : with the vehicle's ranges.

    Raises
    ------
    NoGainsMeetSpec
        No gains within the ranges keep the margins, or the craft moves against its output.
    """
    regions = [sample_region(*in_fractions(model, covariance, None)) for model, covariance in motions]
    values, spec = {**DEFAULTS, **present}, Spec()
    position, velocity, integral = gains
    plants = [
        Plant(1.0, m.alpha, m.beta, m.delay + LOOPS / values["SCHED_LOOP_RATE"])
        for region in regions
        for m in (region.model, *region.samples)
    ]
    per_acceleration = 1.0 / (GRAVITY * math.radians(values["ANGLE_MAX"] / 100.0))
    slowest = max(region.model.alpha for region in regions)
    best: tuple[float, dict[str, float], Margins] | None = None
    for V, share in itertools.product(np.geomspace(velocity.low, velocity.high, SIZES).tolist(), SHARES):
        w = V * per_acceleration / slowest
        chosen = {
            position.parameter: _inside(share * w, position),
            velocity.parameter: _inside(V, velocity),
            integral.parameter: _inside(SLOWER * w * V, integral),
        }
        stiffness = chosen[position.parameter] * chosen[velocity.parameter]
        if best is not None and stiffness <= best[0]:
            continue
        margins = _margins(chosen, gains, values, per_acceleration, plants)
        if margins.stable and margins.gain >= spec.gain_margin and margins.phase >= spec.phase_margin:
            best = stiffness, chosen, margins
    if best is None:
        raise NoGainsMeetSpec(
            f"no {', '.join(g.parameter for g in gains)} within their documented ranges keep a gain margin of "
            f"{spec.gain_margin:g} and a phase margin of {math.degrees(spec.phase_margin):.0f} deg on this craft: its "
            f"delay is {max(p.delay for p in plants):.2f} s, and inertia over full thrust {slowest:.2f} s^2/m"
        )
    now = {g.parameter: values[g.parameter] for g in gains}
    return PositionDesign(best[1], best[2], _margins(now, gains, values, per_acceleration, plants))


def loiter_change(noise: float, present: Mapping[str, float], gain: Gain = LOITER_GAINS[0]) -> Change | None:
    """Return the new radius of a boat that turns on the spot; None if the present one is as small.

    noise : standard deviation of its position [m].
    """
    new, old = _inside(max(LEAST_RADIUS, NOISES * noise), gain), present[gain.parameter]
    if old <= 1.02 * new:
        return None
    why = f"{gain.meaning}: {NOISES:g} standard deviations of the position ({noise:.2f} m), at least {LEAST_RADIUS:g} m"
    return Change(gain.parameter, old, new, gain.low, gain.high, why)


def _inside(value: float, gain: Gain) -> float:
    return round_gain(min(max(value, gain.low), gain.high), gain)


def _margins(
    chosen: Mapping[str, float],
    gains: Sequence[Gain],
    values: Mapping[str, float],
    per_acceleration: float,
    plants: Sequence[Plant],
) -> Margins:
    """Return the smallest margins of the loop from velocity to output over *plants*."""
    P, V, I = (chosen[g.parameter] for g in gains)  # noqa: E741 - the integral gain's own name
    velocity = constant(V) + integrator(I)
    if values["PSC_VELXY_D"] > 0.0:
        velocity += Rational((values["PSC_VELXY_D"], 0.0), (1.0,))
    loop = velocity * (constant(1.0) + integrator(P)) * first_order(values["PSC_VELXY_FLTE"])
    return worst(margins_of_each(constant(per_acceleration) * loop, plants))
