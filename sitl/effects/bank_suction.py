"""A vertical bank or wall beside the track: suction towards it, and a moment that turns the bow away."""

from __future__ import annotations

import math

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.plants import Wrench

__all__ = ["BankSuction"]

_CLOSEST = 0.02
"""Least distance to the wall over that from the start, at least half the beam. Project choice: no wall stops a hull."""


class BankSuction(HiddenEffect):
    """A straight wall: ``Y u^2 / gap`` towards it and ``N u |u| / gap`` away from it, for a craft along it.

    The law is that of Norrbin1971, proportional to squared speed and inverse distance; ``gap`` is the distance of the
    craft's origin from the wall. For another heading both are multiplied by the sine of the angle between the heading
    and the direction of the wall. Project choice: a craft that heads straight at it is pulled to neither side.
    """

    slug = "bank-suction"
    meaning = "a wall beside the craft pulls it sideways and turns its bow away"
    parameters = (
        EffectParameter("direction", "rad", "from the origin straight to the wall", least=-10.0, most=10.0),
        EffectParameter("distance", "m", "from the origin to the wall", least=1e-3, most=1e6),
        EffectParameter("beam", "m", "beam of the craft", 0.0, least=0.0, most=1e3),
        EffectParameter("Y", "N s^2/m", "suction per squared speed at a distance of 1 m", 0.0, least=0.0),
        EffectParameter("N", "N s^2", "moment that turns the bow away, per squared speed at 1 m", 0.0),
    )
    on_vehicles = "sway and yaw, as far as the craft has them"
    places = ("sway+yaw", "yaw")

    def begin(self, setting: Setting) -> None:
        """Find the craft, and verify that the wall is not across it."""
        if not {"surge", "yaw"} <= set(setting.dofs):
            raise BadEffect("bank-suction needs a hull with surge and yaw")
        self._state, towards = setting.state, self["direction"]
        self._north, self._east = math.cos(towards), math.sin(towards)
        gap, clear = self.gap(), 0.5 * self["beam"]
        if gap <= clear:
            raise BadEffect(
                f"bank-suction: the wall is across the craft, {gap:.3g} m from its origin with a half beam of "
                f"{clear:.3g} m. Set a distance above {self['distance'] - gap + clear:.3g} m"
            )
        self._least = max(clear, _CLOSEST * gap)

    def gap(self) -> float:
        """Return the distance [m] of the craft from the wall."""
        return self["distance"] - self._north * self._state.x - self._east * self._state.y

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add suction and moment to *wrench*."""
        at = self._state
        abeam = math.sin(self["direction"] - at.psi) / max(self.gap(), self._least)
        wrench.Y += self["Y"] * at.u * at.u * abeam
        wrench.N -= self["N"] * at.u * abs(at.u) * abeam
