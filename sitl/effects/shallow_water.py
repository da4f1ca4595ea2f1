"""Shallow water: resistance and added mass grow as the water under the keel becomes less."""

from __future__ import annotations

import math

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.plants import Parameters, Wrench

__all__ = ["ShallowWater"]

_AGROUND = 0.05
"""Least water under the keel, as a fraction of that at the origin. Project choice: no hull is stopped by the bottom."""


class ShallowWater(HiddenEffect):
    """Shallow water over a plane bottom: all terms are proportional to ``zeta = T / (h - T)``.

    ``T`` is the draught and ``h`` the depth of the water where the craft is. ``zeta`` adds ``-drag zeta |u| u`` in
    surge, and multiplies the inertia of sway and yaw by ``1 + sway zeta`` and ``1 + yaw zeta`` (Norrbin1971). The
    tanker of Berlekom1972 has sway 0.19, yaw 0.037, and a drag of 0.16 of its quadratic drag in deep water.
    """

    slug = "shallow-water"
    meaning = "over a shallow bottom resistance and the inertia of sway and yaw grow"
    parameters = (
        EffectParameter("draught", "m", "draught of the craft", least=1e-3, most=100.0),
        EffectParameter("depth", "m", "depth of the water at the origin", least=1e-3, most=1e5),
        EffectParameter("north", "1", "growth of the depth per metre north", 0.0, least=-1.0, most=1.0),
        EffectParameter("east", "1", "growth of the depth per metre east", 0.0, least=-1.0, most=1.0),
        EffectParameter(
            "drag", "N s^2/m^2", "drag ahead per squared speed, at draught/(depth - draught) = 1", 0.0, least=0.0
        ),
        EffectParameter("sway", "1", "relative growth of the inertia of sway, likewise", 0.19, least=0.0, most=100.0),
        EffectParameter("yaw", "1", "relative growth of the inertia of yaw, likewise", 0.037, least=0.0, most=100.0),
    )
    on_vehicles = "surge, sway and yaw, as far as the craft has them"
    places = ("surge+sway+yaw", "surge+yaw")

    def begin(self, setting: Setting) -> None:
        """Find the craft, and verify that it floats over the bottom at the origin."""
        if not {"surge", "sway", "yaw"} & set(setting.dofs):
            raise BadEffect("shallow-water needs a hull with surge, sway or yaw. For a diving craft use ground-effect")
        self._state = setting.state
        self._dofs = [dof for dof in ("sway", "yaw") if dof in setting.dofs]
        T, h = self["draught"], self["depth"]
        if h <= T:
            raise BadEffect(f"shallow-water: the depth of {h:g} m at the origin must exceed the draught of {T:g} m")

    def zeta(self) -> float:
        """Return draught over water under the keel, where the craft is."""
        at, T = self._state, self["draught"]
        clear = self["depth"] - T
        return T / max(clear + self["north"] * at.x + self["east"] * at.y, _AGROUND * clear)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Subtract the additional resistance from *wrench*."""
        u = self._state.u
        wrench.X -= self["drag"] * self.zeta() * abs(u) * u

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Multiply the inertia of sway and yaw."""
        zeta = self.zeta()
        for dof in self._dofs:
            parameters[f"{dof}.alpha"] *= 1.0 + self[dof] * zeta

    def quickness(self, setting: Setting) -> float:
        """Return the time constant [s] of surge at its fastest with the additional drag at the origin."""
        most = self["drag"] * self.zeta() * max(abs(setting.cruise), 1e-9)
        return setting.parameters.get("surge.alpha", math.inf) / max(2.0 * most, 1e-12)
