"""A current that changes with time and depth: tide, gyre, shear."""

from __future__ import annotations

import math

from sitl.effects.effect import BadEffect, EffectParameter, Setting
from sitl.effects.environment import SteadyCurrent
from sitl.plants import Water, Wrench

__all__ = ["ChangingCurrent"]


class ChangingCurrent(SteadyCurrent):
    """A current whose speed and direction change, with shear over depth.

    At time *t* since the start and depth *z* it is ``(1 + growth t) (1 - shear z)`` times ``V_x``, ``V_y``, turned by
    ``turn t``. Below the depth where the shear stops it, the water is at rest.

    The equations of motion hold for the velocity through the water (Fossen2011, section 8.3). Water that speeds up
    everywhere carries a craft of its own density along, because the pressure gradient acts on both. A craft that dives
    through shear keeps the momentum of its mass, so it moves through the water. That force needs ``[body] mass``.
    """

    slug = "changing-current"
    meaning = "a current that changes with time and depth (tide, gyre, shear)"
    parameters = (
        EffectParameter("V_x", "m/s", "towards north, at the surface and the start", 0.0),
        EffectParameter("V_y", "m/s", "towards east, at the surface and the start", 0.0),
        EffectParameter("growth", "1/s", "growth of the speed, as a fraction of the first speed", 0.0, -1.0, 1.0),
        EffectParameter("turn", "rad/s", "rotation of the direction, clockwise positive", 0.0, -1.0, 1.0),
        EffectParameter("shear", "1/m", "decrease of the speed with depth, as a fraction of the surface's", 0.0),
    )

    def begin(self, setting: Setting) -> None:
        """Find the water and the craft. Raises ``BadEffect`` if the current is faster than the craft."""
        self._water, self._state, self._start = setting.water, setting.state, setting.start
        self._mass = setting.mass
        self._now, self._rate = (0.0, 0.0), 0.0
        speed = math.hypot(self["V_x"], self["V_y"])
        if setting.on_vehicle and speed > setting.cruise:
            raise BadEffect(
                f"{self.slug}: the current of {speed:.3g} m/s is faster than the craft at full throttle "
                f"({setting.cruise:.3g} m/s). Use a slower current"
            )
        self.find_reference(setting)
        self.alter_water(self._start, setting.water)

    def alter_water(self, t: float, water: Water) -> None:
        """Set the velocity of the water to that at time *t* [s] and the craft's depth."""
        since, before = t - self._start, self._now
        share = (1.0 + self["growth"] * since) * max(1.0 - self["shear"] * self._state.z, 0.0)
        c, s = math.cos(self["turn"] * since), math.sin(self["turn"] * since)
        self._now = share * (c * self["V_x"] - s * self["V_y"]), share * (s * self["V_x"] + c * self["V_y"])
        water.V_x += self._now[0] - before[0]
        water.V_y += self._now[1] - before[1]

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the inertia of the mass that a dive carries into slower water."""
        at, sheared = self._state, self["shear"] * self._mass
        share = 1.0 - self["shear"] * at.z
        if sheared and share > 0.0:
            c, s = math.cos(at.psi), math.sin(at.psi)
            lost = sheared * at.w / share
            wrench.X += lost * (c * self._now[0] + s * self._now[1])
            wrench.Y += lost * (c * self._now[1] - s * self._now[0])

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] in which the current turns by one radian or grows by itself."""
        return 1.0 / max(abs(self["growth"]), abs(self["turn"]), 1e-9)
