"""Effects on the inertia, drag and buoyancy of the hull."""

from __future__ import annotations

import math

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.places import find_dof
from sitl.plants import Parameters, Wrench

__all__ = [
    "GroundEffect",
    "LinearDrag",
    "MassChange",
    "NetBuoyancy",
    "QuadraticDrag",
]


class OnAxis(HiddenEffect):
    """An effect on the inertia or drag of the degree of freedom that the place selects."""

    on_vehicles = "yaw (default), surge, heave"

    def begin(self, setting: Setting) -> None:
        """Find the degree of freedom that the effect's place selects."""
        self._dof = find_dof(self, setting)


class LinearDrag(OnAxis):
    """Additional linear drag."""

    slug = "linear-drag"
    meaning = "drag proportional to speed"
    parameters = (EffectParameter("coefficient", "N s/m or N m s/rad"),)

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Add ``coefficient`` to the linear drag of the degree of freedom."""
        parameters[f"{self._dof}.beta"] += self["coefficient"]

    def quickness(self, setting: Setting) -> float:
        """Return the time constant [s] with the additional drag: inertia over linear drag."""
        p, dof = setting.parameters, self._dof
        return p[f"{dof}.alpha"] / max(p[f"{dof}.beta"] + self["coefficient"], 1e-9)


class QuadraticDrag(OnAxis):
    """Additional quadratic drag."""

    slug = "quadratic-drag"
    meaning = "drag proportional to squared speed"
    parameters = (EffectParameter("coefficient", "N s^2/m^2 or N m s^2/rad^2"),)

    def begin(self, setting: Setting) -> None:
        """Find the degree of freedom and the largest force of its input."""
        dof = self._dof = find_dof(self, setting)
        driving = [setting.amplitude[name] for name, driven in setting.inputs.items() if driven == dof]
        self._force = setting.gain.get(dof, 1.0) * max(driving, default=0.0)

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Add ``coefficient`` to the quadratic drag of the degree of freedom."""
        parameters[f"{self._dof}.beta2"] += self["coefficient"]

    def quickness(self, setting: Setting) -> float:
        """Return the time constant [s] at the steady speed of the largest command: alpha/(beta + 2 beta2 nu)."""
        return setting.parameters[f"{self._dof}.alpha"] / max(
            2.0 * math.sqrt(abs(self["coefficient"]) * self._force), 1e-9
        )


class MassChange(HiddenEffect):
    """A payload added or removed. The inertia changes at once; the speed stays the same."""

    slug = "mass-change"
    meaning = "inertia changes during the run (a payload picked up or dropped)"
    parameters = (
        EffectParameter("ratio", "1", "ratio of the new inertia to the old", least=1e-3),
        EffectParameter("time", "s", "since the start"),
    )
    on_vehicles = "all (default), yaw, surge, heave, or several joined by +"

    def begin(self, setting: Setting) -> None:
        """Find the degrees of freedom: those that the place selects, or all."""
        named = tuple(self.place.split("+"))
        if self.place in ("", "all"):
            self._dofs = setting.dofs
        elif len(named) > 1 and set(named) <= set(setting.dofs):  # as a diagnosis writes it into a model file
            self._dofs = named
        else:
            self._dofs = (find_dof(self, setting),)
        self._when = setting.start + self["time"]

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Multiply the inertia by the effect's factor, from the time of the change."""
        if t >= self._when - 1e-9:
            for dof in self._dofs:
                parameters[f"{dof}.alpha"] *= self["ratio"]

    def quickness(self, setting: Setting) -> float:
        """Return the shortest time constant [s], if the mass decreases."""
        p = setting.parameters
        inertia_and_drag = ((p[f"{dof}.alpha"], p[f"{dof}.beta"]) for dof in self._dofs)
        return min(alpha * self["ratio"] / beta if beta > 0.0 else math.inf for alpha, beta in inertia_and_drag)


class NetBuoyancy(HiddenEffect):
    """Positive or negative net buoyancy."""

    slug = "net-buoyancy"
    meaning = "the craft is heavier (positive) or lighter than the water it displaces"
    parameters = (EffectParameter("force", "N", "down positive"),)
    on_vehicles = "heave (ROVs)"

    def begin(self, setting: Setting) -> None:
        """Verify that the craft can heave."""
        find_dof(self, setting, among=("heave",))

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the net weight, positive down, to *wrench*."""
        wrench.Z += self["force"]


class GroundEffect(HiddenEffect):
    """Increased drag near the bottom: factor ``1 + strength exp(-(bottom - z)/length)``."""

    slug = "ground-effect"
    meaning = "drag grows close to the bottom"
    parameters = (
        EffectParameter("strength", "1", "relative drag increase at the bottom"),
        EffectParameter("length", "m", "height over which the increase decays", least=1e-3),
        EffectParameter("bottom", "m", "depth of the bottom; 0: depth of the water", 0.0),
    )
    on_vehicles = "heave (default), yaw, surge (ROVs)"

    def begin(self, setting: Setting) -> None:
        """Find the degree of freedom, and the depth of the bottom."""
        if "heave" not in setting.dofs:
            raise BadEffect("ground-effect needs a craft with heave")
        self._state = setting.state
        self._dof = find_dof(self, setting) if self.place else "heave"
        self._bottom = self["bottom"] or setting.water.bottom

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Multiply the drag by the factor for the present height above the bottom."""
        height = max(self._bottom - self._state.z, 0.0)
        factor = 1.0 + self["strength"] * math.exp(-height / self["length"])
        parameters[f"{self._dof}.beta"] *= factor
        parameters[f"{self._dof}.beta2"] *= factor

    def quickness(self, setting: Setting) -> float:
        """Return the time constant [s] at the bottom, where drag is largest."""
        p, dof = setting.parameters, self._dof
        return p[f"{dof}.alpha"] / max(p[f"{dof}.beta"] * (1.0 + self["strength"]), 1e-9)
