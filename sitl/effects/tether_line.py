"""A tether in three dimensions: slack up to its length, taut beyond, with the drag of the line."""

from __future__ import annotations

import math

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.plants import Wrench, quaternion_of, rotate

__all__ = ["TetherLine"]

Vector = tuple[float, float, float]

_SPACE, _PLANE, _DOWN = "surge+sway+heave", "surge+sway", "heave"


class TetherLine(HiddenEffect):
    """A line from the craft to a fixed point: one element of a lumped-mass line (Hall2015).

    Beyond its ``length`` it pulls with ``stiffness`` per metre towards its other end. The water resists its motion
    across itself with ``drag |U| U``; half of the line's drag acts on the craft. ``drag`` is that half: ``rho C_d d
    length / 4`` of a line of diameter ``d``. Its weight in water is left out: ``net-buoyancy`` has that effect.
    """

    slug = "tether-line"
    meaning = "the tether is slack up to its length, pulls beyond it, and is dragged through the water"
    parameters = (
        EffectParameter("stiffness", "N/m", "pull per metre beyond the length", 0.0, least=0.0),
        EffectParameter("length", "m", "length of the slack line", least=0.0),
        EffectParameter("drag", "N s^2/m^2", "drag on the craft per squared speed across the line", 0.0, least=0.0),
        EffectParameter("x", "m", "other end of the line, north", 0.0),
        EffectParameter("y", "m", "other end of the line, east", 0.0),
        EffectParameter("z", "m", "other end of the line, depth", 0.0),
    )
    on_vehicles = "surge+sway+heave (default), surge+sway, heave, as far as the craft moves there"
    places = (_SPACE, _PLANE, _DOWN)

    def begin(self, setting: Setting) -> None:
        """Find the craft and its water, and verify that the craft can pull at a line."""
        self._level, self._upright = float(self.place != _DOWN), float(self.place != _PLANE)
        if not {"surge", "heave"} & set(setting.dofs):
            raise BadEffect("tether-line needs a hull with surge or heave. For a craft that only turns use tether-pull")
        self._state, self._water = setting.state, setting.water

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the pull and the drag of the line to *wrench*."""
        at, water = self._state, self._water
        attitude = quaternion_of(at.phi, at.theta, at.psi) if at.tilts else quaternion_of(0.0, 0.0, at.psi)
        level, upright = self._level, self._upright
        away = (level * (self["x"] - at.x), level * (self["y"] - at.y), upright * (self["z"] - at.z))
        north, east, down = rotate(attitude, (at.u, at.v, at.w))
        force = _on_craft(self.values, away, (level * north, level * east, upright * down))
        X, Y, Z = rotate((attitude[0], -attitude[1], -attitude[2], -attitude[3]), force)
        wrench.X += X
        wrench.Y += Y
        wrench.Z += Z * (not water.floats)

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] of one radian of the hull's oscillation on the taut line."""
        held = [dof for dof in ("surge", "sway", "heave") if dof in setting.dofs]
        inertia = min(setting.parameters[f"{dof}.alpha"] for dof in held)
        return math.sqrt(inertia / max(self["stiffness"], 1e-12))


def _on_craft(line: dict[str, float], away: Vector, through: Vector) -> Vector:
    """Return the force (3,) [N] on the craft, NED, of a *line* whose other end is *away* (3,) [m].

    through : velocity (3,) [m/s] of the craft through the water, NED.
    """
    distance = math.hypot(*away)
    along = (away[0] / distance, away[1] / distance, away[2] / distance) if distance > 0.0 else (0.0, 0.0, 0.0)
    pull = line["stiffness"] * max(distance - line["length"], 0.0)
    lengthwise = sum(v * e for v, e in zip(through, along, strict=True))
    across = [v - lengthwise * e for v, e in zip(through, along, strict=True)]
    lost = line["drag"] * math.hypot(*across)
    X, Y, Z = (pull * e - lost * v for e, v in zip(along, across, strict=True))
    return X, Y, Z
