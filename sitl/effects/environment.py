"""Disturbances from outside. In open loop forces are in SI. On a vehicle an ``input unit`` is a normalised output."""

from __future__ import annotations

import math
from random import Random
from typing import ClassVar

from sitl.effects.effect import FORCE_OF, BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.places import find_dof
from sitl.plants import GRAVITY, Wrench

__all__ = [
    "InputBias",
    "SteadyCurrent",
    "TetherPull",
    "WaveDisturbance",
    "WindMoment",
]


class InputBias(HiddenEffect):
    """A constant force or moment, added to that of the actuators."""

    slug = "input-bias"
    meaning = "a constant force or moment: trim, list, a slack tether"
    parameters = (EffectParameter("bias", "input unit"),)
    on_vehicles = "yaw (default), surge"

    def begin(self, setting: Setting) -> None:
        """Find the degree of freedom. Heave is excluded, because net-buoyancy has that effect."""
        dof = find_dof(self, setting, among=("yaw", "surge", "sway"))
        self._name, self._force = FORCE_OF[dof], self["bias"] * setting.gain.get(dof, 1.0)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the constant force or moment to *wrench*."""
        setattr(wrench, self._name, getattr(wrench, self._name) + self._force)


class SteadyCurrent(HiddenEffect):
    """A steady current that carries the craft; drag depends on the speed through the water.

    Irrotational and steady, so the equations of motion hold for the velocity through the water (Fossen2011, section
    8.1). Place: the meaning of the file's (or the receiver's) ``u v``: ``over ground`` (default) or ``through water``.
    """

    slug = "steady-current"
    meaning = "a current: the water moves over ground"
    parameters: ClassVar[tuple[EffectParameter, ...]] = (
        EffectParameter("V_x", "m/s", "towards north", 0.0),
        EffectParameter("V_y", "m/s", "towards east", 0.0),
    )
    on_vehicles = "reference of the recorded u and v: 'over ground' (default) or 'through water'"

    def begin(self, setting: Setting) -> None:
        """Set the water's velocity to that of the current, and what the speed sensor measures."""
        self.find_reference(setting)
        setting.water.V_x += self["V_x"]
        setting.water.V_y += self["V_y"]

    def find_reference(self, setting: Setting) -> None:
        """Set what the speed sensor measures, as the effect's place states, and verify that the hull can drift."""
        if self.place not in ("", "over ground", "through water"):
            raise BadEffect(f"{self.slug}: '{self.place}' is neither 'over ground' nor 'through water'")
        if not {"surge", "sway"} & set(setting.dofs):
            raise BadEffect(f"{self.slug} needs a hull with surge or sway")
        setting.water.over_ground = self.place != "through water"


class WindMoment(HiddenEffect):
    """Wind that turns the bow towards ``direction``: ``N += strength sin(direction - psi)``."""

    slug = "wind-moment"
    meaning = "the wind turns the bow (moment proportional to the sine of the heading relative to the wind)"
    parameters = (
        EffectParameter("strength", "input unit", least=0.0),
        EffectParameter("direction", "rad", "heading towards which the wind turns the bow"),
    )
    on_vehicles = "yaw"

    def begin(self, setting: Setting) -> None:
        """Verify that the hull can yaw."""
        dof = find_dof(self, setting, among=("yaw",))
        self._state, self._moment = setting.state, self["strength"] * setting.gain.get(dof, 1.0)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the moment of the wind to *wrench*."""
        wrench.N += self._moment * math.sin(self["direction"] - self._state.psi)

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] of one radian of the oscillation about ``direction``."""
        return math.sqrt(setting.parameters["yaw.alpha"] / max(abs(self._moment), 1e-12))


_SHORTEST, _COMPONENTS = 2.5, 40
"""Highest frequency of a sea over that of its peak, and number of its sinusoids. Project choice."""


def jonswap(peak: float, gamma: float, draw: Random) -> list[tuple[float, float, float]]:
    """Return size, frequency [rad/s] and phase [rad] of the sinusoids of a sea of unit variance.

    JONSWAP spectrum (Hasselmann1973) with its peak at *peak* [rad/s]; *gamma*: peak enhancement. The frequencies are
    drawn, one in each of :data:`_COMPONENTS` equal bands, so that the sea does not repeat.
    """
    width = (_SHORTEST - 0.5) / _COMPONENTS
    sinusoids = []
    for k in range(_COMPONENTS):
        x = 0.5 + width * (k + draw.random())
        spread = 0.07 if x <= 1.0 else 0.09
        enhanced = math.pow(gamma, math.exp(-0.5 * ((x - 1.0) / spread) ** 2))
        sinusoids.append((math.sqrt(math.exp(-1.25 / x**4) / x**5 * enhanced), peak * x, draw.uniform(0.0, math.tau)))
    scale = math.sqrt(2.0 / sum(size * size for size, _, _ in sinusoids))
    return [(scale * size, omega, phase) for size, omega, phase in sinusoids]


class WaveDisturbance(HiddenEffect):
    """A narrow-band force: second-order shaped noise, one sinusoid if ``bandwidth`` is 0, or a sea if ``gamma`` is set.

    The shaped noise is Fossen2011, equation (8.118): ``K s/(s^2 + 2 lambda omega s + omega^2)`` on white noise,
    ``lambda`` the bandwidth. It is computed in exact steps and starts in its stationary distribution.

    A sea has the JONSWAP spectrum (Hasselmann1973) with its peak at ``frequency``. Its long-crested waves travel
    towards ``direction`` in deep water and are met where the craft is over ground. So the craft feels them at the
    frequency of encounter. ``drift`` is the mean of the second-order force towards ``direction``. It varies slowly with
    the square of the envelope of the waves (Newman1974). ``amplitude`` is the standard deviation of the first-order
    force.
    """

    slug = "wave-disturbance"
    meaning = "waves: a narrow-band force"
    parameters = (
        EffectParameter("amplitude", "input unit", "rms", least=0.0),
        EffectParameter("frequency", "rad/s", "peak, as a fixed point meets the waves", least=1e-6),
        EffectParameter("bandwidth", "1", "damping ratio of the shaping filter; 0: one sinusoid", 0.0, least=0.0),
        EffectParameter("gamma", "1", "JONSWAP peak enhancement, usually 3.3; 0: no sea", 0.0, least=0.0, most=10.0),
        EffectParameter("direction", "rad", "of a sea: towards which it travels", 0.0, least=-10.0, most=10.0),
        EffectParameter("drift", "input unit", "of a sea: mean second-order force (surge, sway)", 0.0, least=0.0),
    )
    on_vehicles = "yaw (default), surge, sway, heave"

    def begin(self, setting: Setting) -> None:
        """Find the degree of freedom, and draw the initial state of the noise or the phases of the waves."""
        self._dof = dof = find_dof(self, setting)
        gain = setting.gain.get(dof, 1.0)
        self._name, self._rms, self._drift = FORCE_OF[dof], self["amplitude"] * gain, self["drift"] * gain
        if self._drift and dof not in ("surge", "sway"):
            raise BadEffect(f"wave-disturbance.drift acts on surge or sway, not on {dof}. Name the place: @surge")
        if self._drift and not self["gamma"]:
            raise BadEffect("wave-disturbance.drift needs a sea. Set gamma, usually to 3.3")
        self._state = setting.state
        draw = Random(f"{setting.seed}/{self.slug}" + ("" if self["gamma"] else f"/{dof}"))
        self._sea = jonswap(self["frequency"], self["gamma"], draw) if self["gamma"] else []
        self._gauss = draw.gauss
        self._phase = draw.uniform(0.0, math.tau)
        self._level, self._rise = draw.gauss(0.0, 1.0), draw.gauss(0.0, 1.0)
        self._t, self._dt = -math.inf, math.nan

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the wave force or moment at *t* to *wrench*."""
        if self._sea:
            force = self._met(t)
        elif self["bandwidth"] == 0.0:
            force = self._rms * math.sqrt(2.0) * math.sin(self["frequency"] * t + self._phase)
        else:
            force = self._rms * self._advance(t)
        setattr(wrench, self._name, getattr(wrench, self._name) + force)

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] of one radian of the wave's oscillation; of a sea, of its shortest waves."""
        return 1.0 / (self["frequency"] * (_SHORTEST if self["gamma"] else 1.0))

    def _met(self, t: float) -> float:
        """Return the force of the sea at time *t* [s] where the craft is: first order, and drift."""
        at, towards = self._state, self["direction"]
        travelled = at.x * math.cos(towards) + at.y * math.sin(towards)
        level = slope = 0.0
        for size, omega, phase in self._sea:
            angle = omega * t - omega * omega / GRAVITY * travelled + phase
            level += size * math.cos(angle)
            slope += size * math.sin(angle)
        drift = 0.0
        if self._drift:
            share = math.cos(towards - at.psi) if self._dof == "surge" else math.sin(towards - at.psi)
            drift = self._drift * 0.5 * (level * level + slope * slope) * share
        return self._rms * (level if self._dof == "heave" else slope) + drift

    def _advance(self, t: float) -> float:
        """Return the normalised force at *t*. Time only advances."""
        if self._t == -math.inf:
            self._t = t
        dt = t - self._t
        if dt > 1e-12:
            self._t = t
            if not math.isclose(dt, self._dt, rel_tol=1e-6):
                self._dt = dt
                self._matrix = _step_of(self["frequency"], self["bandwidth"], dt)
            a11, a12, a21, a22, l11, l21, l22 = self._matrix
            e1, e2 = self._gauss(0.0, 1.0), self._gauss(0.0, 1.0)
            level, rise = self._level, self._rise
            self._level = a11 * level + a12 * rise + l11 * e1
            self._rise = a21 * level + a22 * rise + l21 * e1 + l22 * e2
        return self._rise


def _step_of(omega: float, damping: float, dt: float) -> tuple[float, float, float, float, float, float, float]:
    """Return transition (2, 2) and lower Cholesky factor of the noise of one step, for states scaled to unit
    variance.

    The states are the filter's (omega times its integral, itself): ``x1' = omega x2``,
    ``x2' = -omega x1 - 2 lambda omega x2 + noise``; with unit stationary spread the noise of a step is ``I - A A'``.
    """
    decay = math.exp(-damping * omega * dt)
    root = math.sqrt(abs(1.0 - damping * damping))
    if damping < 1.0:
        c, s = math.cos(omega * root * dt), math.sin(omega * root * dt) / root
    elif damping > 1.0:
        c, s = math.cosh(omega * root * dt), math.sinh(omega * root * dt) / root
    else:
        c, s = 1.0, omega * dt
    a11, a12, a21, a22 = decay * (c + damping * s), decay * s, -decay * s, decay * (c - damping * s)
    q11 = max(1.0 - a11 * a11 - a12 * a12, 0.0)
    q12 = -(a11 * a21 + a12 * a22)
    q22 = max(1.0 - a21 * a21 - a22 * a22, 0.0)
    l11 = math.sqrt(q11)
    l21 = q12 / l11 if l11 > 0.0 else 0.0
    return a11, a12, a21, a22, l11, l21, math.sqrt(max(q22 - l21 * l21, 0.0))


class TetherPull(HiddenEffect):
    """Pull of the tether, modelled as a spring to a fixed anchor: in one degree of freedom, or in the horizontal plane
    (``surge+sway``).
    """

    slug = "tether-pull"
    meaning = "the tether pulls like a spring"
    parameters = (
        EffectParameter("stiffness", "N/m or N m/rad"),
        EffectParameter("anchor", "m or rad", "position without pull, in one degree of freedom", 0.0),
        EffectParameter("x", "m", "position without pull, north (motion in the plane)", 0.0),
        EffectParameter("y", "m", "position without pull, east (motion in the plane)", 0.0),
    )
    on_vehicles = "yaw (default), heave, surge+sway (the component along the hull)"

    def begin(self, setting: Setting) -> None:
        """Find the degrees of freedom in which the tether pulls, and verify that the hull has them."""
        self._state = setting.state
        self._on_plane = self.place == "surge+sway"
        if self._on_plane:
            if "surge" not in setting.dofs or not (setting.on_vehicle or "sway" in setting.dofs):
                raise BadEffect("tether-pull@surge+sway needs a hull with surge and sway")
            return
        self._dof = find_dof(self, setting, among=("yaw", "heave", "surge"))
        if self._dof == "surge" and ("yaw" in setting.dofs or "sway" in setting.dofs):
            raise BadEffect("tether-pull of a craft that turns needs the place 'surge+sway'")

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the spring's force or moment to *wrench*."""
        at, stiffness = self._state, self["stiffness"]
        if self._on_plane:
            north, east = stiffness * (self["x"] - at.x), stiffness * (self["y"] - at.y)
            c, s = math.cos(at.psi), math.sin(at.psi)
            wrench.X += c * north + s * east
            wrench.Y += -s * north + c * east
        elif self._dof == "yaw":
            wrench.N -= stiffness * (at.psi - self["anchor"])
        elif self._dof == "heave":
            wrench.Z -= stiffness * (at.z - self["anchor"])
        else:
            wrench.X -= stiffness * (at.x - self["anchor"])

    def quickness(self, setting: Setting) -> float:
        """Return the time [s] of one radian of the hull's oscillation on the spring."""
        held = [dof for dof in ("surge", "sway") if dof in setting.dofs] if self._on_plane else [self._dof]
        inertia = min(setting.parameters[f"{dof}.alpha"] for dof in held)
        return math.sqrt(inertia / max(abs(self["stiffness"]), 1e-12))
