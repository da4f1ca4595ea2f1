"""Wind on the superstructure: surge, sway and yaw, with gusts."""

from __future__ import annotations

import math
from random import Random

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.plants import Wrench

__all__ = ["WindLoad"]

_AIR = 1.225
"""Density of air [kg/m^3] at 15 degrees and sea level (ISO 2533)."""
_SLOWEST, _FASTEST, _WAVES = 1.0 / 1200.0, 0.25, 40
"""Lowest and highest frequency [Hz] of the gusts, and number of sinusoids. Faster gusts do not move a craft. Project
choice."""


def gust_density(f: float, speed: float) -> float:
    """Return the spectral density [m^2/s] of gusts at *f* [Hz] in a mean wind of *speed* [m/s], both at 10 m.

    NORSOK spectrum (Fossen2011, section 8.1).
    """
    scaled = 172.0 * f / math.pow(speed / 10.0, 0.75)
    return 320.0 * (speed / 10.0) ** 2 / math.pow(1.0 + math.pow(scaled, 0.468), 5.0 / (3.0 * 0.468))


class WindLoad(HiddenEffect):
    """Wind on the superstructure: forces ahead and aside and a moment, from the relative wind.

    ``X = q A_F C_X``, ``Y = q A_L C_Y``, ``N = q A_L L C_N`` with ``q = rho V^2 / 2`` of the relative wind, ``C_X =
    -c_x cos(gamma)``, ``C_Y = c_y sin(gamma)``, ``C_N = c_n sin(2 gamma)`` (Fossen2011, section 8.1, for a
    superstructure that is symmetric fore and aft). ``X``, ``Y``, ``N`` add the forces that were identified at
    ``speed``.
    """

    slug = "wind-load"
    meaning = "wind on the superstructure pushes the craft and turns it, with gusts"
    parameters = (
        EffectParameter("speed", "m/s", "mean wind; 0: still air", 10.0, least=0.0),
        EffectParameter("direction", "rad", "towards which the wind blows", least=-10.0, most=10.0),
        EffectParameter("X", "N", "force ahead on the craft at rest, wind from astern", 0.0),
        EffectParameter("Y", "N", "force to starboard on the craft at rest, wind from port", 0.0),
        EffectParameter("N", "N m", "moment to starboard on the craft at rest, wind 45 degrees on the port bow", 0.0),
        EffectParameter("A_F", "m^2", "frontal area above the water", 0.0, least=0.0, most=1e5),
        EffectParameter("A_L", "m^2", "lateral area above the water", 0.0, least=0.0, most=1e5),
        EffectParameter("L", "m", "length over all", 0.0, least=0.0, most=1e3),
        EffectParameter("c_x", "1", "0.50 to 0.90 for most craft", 0.7, least=0.0, most=5.0),
        EffectParameter("c_y", "1", "0.70 to 0.95 for most craft", 0.8, least=0.0, most=5.0),
        EffectParameter("c_n", "1", "0.05 to 0.20 for most craft", 0.1, least=-5.0, most=5.0),
        EffectParameter("gust", "1", "size of the gusts: 0 none, 1 the NORSOK spectrum", 0.0, least=0.0, most=5.0),
    )
    on_vehicles = "surge, sway and yaw, as far as the craft has them"
    places = ("surge+sway+yaw", "surge+yaw")

    def begin(self, setting: Setting) -> None:
        """Find the craft, and draw the phases of the gusts."""
        if not {"surge", "yaw"} <= set(setting.dofs):
            raise BadEffect("wind-load needs a hull with surge and yaw. For a craft that only turns use wind-moment")
        self._state, self._water = setting.state, setting.water
        speed, draw = self["speed"], Random(f"{setting.seed}/{self.slug}")
        area = 0.5 * _AIR
        if speed == 0.0 and any(self[force] for force in "XYN"):
            raise BadEffect("wind-load: X, Y and N are forces at speed, which is 0. Set speed, or A_F and A_L instead")
        known = speed**2 or 1.0
        self._X = area * self["c_x"] * self["A_F"] + self["X"] / known
        self._Y = area * self["c_y"] * self["A_L"] + self["Y"] / known
        self._N = area * self["c_n"] * self["A_L"] * self["L"] + self["N"] / known
        ratio = (_FASTEST / _SLOWEST) ** (1.0 / _WAVES)
        middles = [_SLOWEST * ratio ** (k + 0.5) for k in range(_WAVES)] if self["gust"] and speed > 0.0 else []
        spread = math.sqrt(ratio) - 1.0 / math.sqrt(ratio)
        sizes = [self["gust"] * math.sqrt(2.0 * gust_density(f, speed) * f * spread) for f in middles]
        self._gusts = [
            (size, math.tau * f, draw.uniform(0.0, math.tau)) for size, f in zip(sizes, middles, strict=True)
        ]

    def wind(self, t: float) -> float:
        """Return the speed of the wind [m/s] at time *t* [s], at least 0."""
        gusts = sum(size * math.cos(omega * t + phase) for size, omega, phase in self._gusts)
        return max(self["speed"] + gusts, 0.0)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add forces and moment of the wind at time *t* [s] to *wrench*."""
        at, water, wind = self._state, self._water, self.wind(t)
        c, s = math.cos(at.psi), math.sin(at.psi)
        towards = self["direction"] - at.psi
        ahead = at.u + c * water.V_x + s * water.V_y - wind * math.cos(towards)
        aside = at.v + c * water.V_y - s * water.V_x - wind * math.sin(towards)
        size = math.hypot(ahead, aside)
        wrench.X -= self._X * size * ahead
        wrench.Y -= self._Y * size * aside
        wrench.N -= 2.0 * self._N * ahead * aside

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] of one radian of the fastest gust, or of the oscillation of the bow in the wind."""
        gusts = 1.0 / (math.tau * _FASTEST) if self._gusts else math.inf
        stiffness = 4.0 * abs(self._N) * self["speed"] ** 2
        return min(gusts, math.sqrt(setting.parameters["yaw.alpha"] / max(stiffness, 1e-12)))
