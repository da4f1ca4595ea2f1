"""Model of the actuator between the autopilot's output and the force, as a diagnosis identified it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.notebook import Displayed

__all__ = ["PERFECT", "Actuator", "ActuatorStep"]

Array = NDArray[np.float64]

MIN_SLOPE = 0.25
"""Local gain [1] of the actuator below which margins are not calculated.

Project choice. The loop is then nearly open, and the simulation evaluates it instead.
"""
USED = 0.5
"""Largest output [normalised] for which the margins must be met, independent of the relay sizes.

Project choice. From this output to full output, the gain of a quadratic thrust curve at most doubles. The loop passes
through that range only briefly. A gain margin of 2.5 is then still 1.25.
"""


class ActuatorStep(NamedTuple):
    """An :class:`Actuator` with its constants per loop, all floats.

    - ``acts``: 0 for an ideal actuator, else 1.
    - ``rate``: rate limit per loop.
    - ``lag``: fraction of the distance to the target that is covered in one loop.
    - ``backlash``: half the width of the backlash.
    """

    acts: float
    limit: float
    rate: float
    lag: float
    backlash: float
    dead_zone: float
    square: float
    reference: float
    ahead: float
    astern: float
    lost: float
    dither: float


@dataclass(frozen=True, slots=True)
class Actuator(Displayed):
    """The actuator from output to force, with its elements in this order.

    Outputs are in the model's input unit, or in fractions of full output after :meth:`in_fractions`.

    - ``limit``: saturation.
    - ``rate`` [1/s]: rate limit.
    - ``lag`` [s]: time constant of a first-order lag.
    - ``backlash``: width of the backlash of its linkage.
    - ``dead_zone``: half-width of the dead zone of its linkage or speed controller.
    - ``subtracted``: fraction of the half-width that is lost outside the dead zone (1: the force starts from zero; 0:
      it starts with a jump).
    - ``square``: fraction of its force that is proportional to ``u|u|/reference``.
    - ``ahead``, ``astern``: gains for positive and negative outputs.
    - ``weakest``: the gain to which the force may decrease in use.
    - ``dither``: rms of noise on its output that is too fast for the craft, so that the force is the mean over the
      noise.
    """

    limit: float = math.inf
    rate: float = math.inf
    lag: float = 0.0
    backlash: float = 0.0
    dead_zone: float = 0.0
    subtracted: float = 1.0
    square: float = 0.0
    reference: float = 1.0
    ahead: float = 1.0
    astern: float = 1.0
    weakest: float = 1.0
    dither: float = 0.0

    @property
    def is_perfect(self) -> bool:
        """Whether the actuator adds nothing to the model."""
        return self == PERFECT

    @property
    def is_plain(self) -> bool:
        """Whether the static curve is linear. The actuator may still have a lag, limits or a decreasing gain."""
        bends = self.backlash, self.dead_zone, self.square, self.dither, self.subtracted, self.ahead, self.astern
        return bends == (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0)

    @property
    def lost(self) -> float:
        """Amount that the dead zone subtracts from an output outside it, in the unit of the output."""
        return self.subtracted * self.dead_zone

    def in_fractions(self, full: float) -> Actuator:
        """Return the actuator with outputs as fractions of *full* [input unit].

        A negative *full* means that full output acts in the opposite direction.
        """
        size = abs(full)
        turned = {"ahead": self.astern, "astern": self.ahead} if full < 0.0 else {}
        return replace(
            self,
            limit=self.limit / size,
            rate=self.rate / size,
            backlash=self.backlash / size,
            dead_zone=self.dead_zone / size,
            dither=self.dither / size,
            reference=self.reference / size,
            **turned,
        )

    def static(self, u: Array) -> Array:
        """Return the force (n,) of steady outputs *u* (n,), with the backlash taken up in the direction of each
        output.
        """
        held = np.clip(u, -self.limit, self.limit)
        size = np.maximum(np.abs(held) - 0.5 * self.backlash, 0.0)
        held = np.sign(held) * np.where(size > self.dead_zone, size - self.lost, 0.0)
        bent = (1.0 - self.square) * held + self.square * held * np.abs(held) / self.reference
        force: Array = np.where(bent >= 0.0, self.ahead, self.astern) * bent
        return force

    def output_for(self, force: float) -> float:
        """Return the steady output that produces *force*.

        Raises
        ------
        NoGainsMeetSpec
            Full output does not produce *force*.
        """
        return _output_for(self, force)

    def slopes(self) -> tuple[float, ...]:
        """Return the local gains for small motions, for each direction, size of output and state of the battery.

        Outputs are normalised (:meth:`in_fractions`) and range from rest to ``USED``, less dead zone and backlash. The
        margins must be met for each gain. Inside dead zone and backlash the loop is open, and the simulation evaluates
        it instead.
        """
        return _slopes(self)

    def step(self, dt: float) -> ActuatorStep:
        """Return the constants of :func:`.laws.kernel.actuate` for a time step of *dt* [s]."""
        share = 1.0 if self.lag <= 0.0 else -math.expm1(-dt / self.lag)
        most = 1e300
        return ActuatorStep(
            acts=0.0 if self.is_perfect else 1.0,
            limit=min(self.limit, most),
            rate=min(self.rate * dt, most),
            lag=share,
            backlash=0.5 * self.backlash,
            dead_zone=self.dead_zone,
            square=self.square,
            reference=self.reference,
            ahead=self.ahead,
            astern=self.astern,
            lost=self.lost,
            dither=self.dither,
        )


PERFECT = Actuator()
"""An ideal actuator: the force equals the output."""


@lru_cache(maxsize=256)
def _output_for(actuator: Actuator, force: float) -> float:
    """Return the result of :meth:`Actuator.output_for`, cached, because a design calls it thousands of times."""
    if force == 0.0:
        return 0.0
    grid = np.linspace(0.0, math.copysign(1.0, force), 2001)
    reach = actuator.static(grid) * math.copysign(1.0, force)
    if reach[-1] < abs(force):
        raise NoGainsMeetSpec(
            f"the actuator cannot hold the constant force on the craft, {force:.2f} of full output. It reaches at "
            f"most {reach[-1]:.2f}. Trim the craft first"
        )
    first = int(np.argmax(reach >= abs(force)))
    share = (abs(force) - reach[first - 1]) / max(reach[first] - reach[first - 1], 1e-300)
    return float(grid[first - 1] + share * (grid[first] - grid[first - 1]))


@lru_cache(maxsize=256)
def _slopes(actuator: Actuator) -> tuple[float, ...]:
    """Return the result of :meth:`Actuator.slopes`, cached."""
    bend = 2.0 * actuator.square * max(USED - 0.5 * actuator.backlash - actuator.lost, 0.0) / actuator.reference
    sizes = (1.0 - actuator.square, 1.0 - actuator.square + bend) if actuator.square else (1.0,)
    found = {
        round(w * s * g, 6) for w in {1.0, actuator.weakest} for s in sizes for g in {actuator.ahead, actuator.astern}
    }
    return tuple(sorted({max(g, MIN_SLOPE) for g in found}))
