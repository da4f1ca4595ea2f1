"""Effects that are in nobody's book, each on the main input or degree of freedom. The diagnosis has to say so.

They work in the tank only. What looks foreign but is an effect of the book under another name is left out on purpose:
a lagging sensor is nearly late, a constant pull is a bias.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableMapping
from random import Random

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.craft import Craft, log_uniform
from sitl.effects import EffectParameter, HiddenEffect, Setting
from sitl.plants import Wrench
from sitl.sensors import SensorReading

__all__ = ["FOREIGN"]

Rng = np.random.Generator
_SPEED = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}
_FORCE = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}


class Foreign(HiddenEffect):
    """An effect on the input named by its place."""

    def begin(self, setting: Setting) -> None:
        """Find channel, degree of freedom and motion."""
        self.channel = self.place
        self.dof = setting.inputs[self.channel]
        self.state = setting.state
        self.full = setting.amplitude[self.channel]
        self.alpha = setting.parameters[f"{self.dof}.alpha"]
        self.draw = Random(f"{setting.seed}/{self.slug}")
        self.reset()

    def reset(self) -> None:
        """Forget everything."""

    @property
    def speed(self) -> float:
        """Of the degree of freedom [m/s or rad/s]."""
        return float(getattr(self.state, _SPEED[self.dof]))

    @classmethod
    def differs(cls, told: NDArray[np.float64]) -> bool:
        """Whether on these commands (n,) it is anything but an effect of the book."""
        return True

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return random numbers for it."""
        raise NotImplementedError


class CubicDrag(Foreign):
    """Drag that goes with the cube of speed: a hull that makes waves."""

    slug = "cubic-drag"
    parameters = (EffectParameter("coefficient", "N s^3/m^3"),)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Brake."""
        name = _FORCE[self.dof]
        setattr(wrench, name, getattr(wrench, name) - self["coefficient"] * self.speed**3)

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Up to several times the linear drag."""
        return {"coefficient": craft.linear[craft.main] / craft.top[craft.main] ** 2 * log_uniform(rng, 0.3, 10.0)}


class DryFriction(Foreign):
    """Friction that only knows the direction: a hull on a rope, a vehicle on the ground."""

    slug = "dry-friction"
    parameters = (EffectParameter("force", "N"), EffectParameter("creep", "m/s"))

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Brake."""
        name = _FORCE[self.dof]
        setattr(wrench, name, getattr(wrench, name) - self["force"] * math.tanh(self.speed / self["creep"]))

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Up to a third of full command; creeping at a twentieth of top speed."""
        return {
            "force": craft.full[craft.input] * log_uniform(rng, 0.03, 0.35),
            "creep": 0.05 * craft.top[craft.main],
        }


class ResonantActuator(Foreign):
    """The actuator follows its command as a mass on a spring."""

    slug = "resonant-actuator"
    parameters = (EffectParameter("frequency", "rad/s"), EffectParameter("damping", "1"))

    def reset(self) -> None:
        """At the first command, at rest."""
        self._where, self._rate = math.nan, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Swing towards the command."""
        told, omega, zeta = inputs[self.channel], self["frequency"], self["damping"]
        if math.isnan(self._where):
            self._where = told
        count = max(1, math.ceil(omega * dt / 0.05))
        h, total = dt / count, 0.0
        for _ in range(count):
            self._rate += h * (omega * omega * (told - self._where) - 2.0 * zeta * omega * self._rate)
            self._where += h * self._rate
            total += self._where
        inputs[self.channel] = total / count

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """About as fast as the hull, ringing."""
        return {"frequency": log_uniform(rng, 1.0, 5.0) / craft.pace, "damping": log_uniform(rng, 0.03, 0.25)}


class Sloshing(Foreign):
    """A body of water inside swings against the hull."""

    slug = "sloshing"
    parameters = (EffectParameter("mass", "kg"), EffectParameter("frequency", "rad/s"), EffectParameter("damping", "1"))

    def reset(self) -> None:
        """At rest."""
        self._apart, self._inside = 0.0, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Pull back and forth."""
        omega, zeta = self["frequency"], self["damping"]
        count = max(1, math.ceil(omega * dt / 0.05))
        h, total = dt / count, 0.0
        for _ in range(count):
            slip = self.speed - self._inside
            pull = omega * omega * self._apart + 2.0 * zeta * omega * slip
            self._inside += h * pull
            self._apart += h * (self.speed - self._inside)
            total += pull
        inputs[self.channel] -= self["mass"] * total / count

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Up to half the hull's inertia."""
        return {
            "mass": craft.inertia[craft.main] * log_uniform(rng, 0.05, 0.5),
            "frequency": log_uniform(rng, 1.0, 6.0) / craft.pace,
            "damping": log_uniform(rng, 0.02, 0.1),
        }


class PeriodicGain(Foreign):
    """The actuator is strong and weak by turns: a cavitating or ventilating propeller in waves."""

    slug = "periodic-gain"
    parameters = (EffectParameter("depth", "1"), EffectParameter("frequency", "rad/s"))

    def reset(self) -> None:
        """Begin anywhere."""
        self._phase = self.draw.uniform(0.0, math.tau)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Scale."""
        swing = math.sin(self["frequency"] * (t + 0.5 * dt) + self._phase)
        inputs[self.channel] *= 1.0 + self["depth"] * swing

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Several times in a run."""
        frequency = log_uniform(rng, 3.0 * math.tau / craft.duration, 2.0 / craft.pace)
        return {"depth": rng.uniform(0.15, 0.9), "frequency": frequency}


class WanderingForce(Foreign):
    """A force that wanders: gusts without a period."""

    slug = "wandering-force"
    parameters = (EffectParameter("spread", "N"), EffectParameter("memory", "s"))

    def reset(self) -> None:
        """Begin anywhere."""
        self._force = self.draw.gauss(0.0, self["spread"])

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Push."""
        keep = math.exp(-dt / self["memory"])
        self._force = keep * self._force + self.draw.gauss(0.0, self["spread"] * math.sqrt(1.0 - keep * keep))
        inputs[self.channel] += self._force

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Remembered for a fraction of the run."""
        return {
            "spread": craft.full[craft.input] * log_uniform(rng, 0.05, 0.4),
            "memory": craft.duration * log_uniform(rng, 0.02, 0.15),
        }


class GainHysteresis(Foreign):
    """Stronger after the command has grown than after it has shrunk: a variable pitch that sticks."""

    slug = "gain-hysteresis"
    parameters = (EffectParameter("difference", "1"),)

    def reset(self) -> None:
        """As if it had grown."""
        self._last, self._side = math.nan, 1.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Scale."""
        told = inputs[self.channel]
        if told != self._last:
            self._side = 1.0 if math.isnan(self._last) or told > self._last else -1.0
            self._last = told
        inputs[self.channel] = told * (1.0 + 0.5 * self["difference"] * self._side)

    @classmethod
    def differs(cls, told: NDArray[np.float64]) -> bool:
        """Between two levels the way the command came is its sign, and this is a thrust that differs with the sign."""
        return len(np.unique(told)) > 3

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Up to three quarters."""
        return {"difference": rng.uniform(0.15, 0.75)}


class WakeMemory(Foreign):
    """Drag on the difference to the speed of a while ago: the hull runs in its own wake."""

    slug = "wake-memory"
    parameters = (EffectParameter("coefficient", "N s/m"), EffectParameter("memory", "s"))

    def reset(self) -> None:
        """Still water."""
        self._wake = 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Brake, and let the wake follow."""
        inputs[self.channel] -= self["coefficient"] * (self.speed - self._wake)
        self._wake += (self.speed - self._wake) * -math.expm1(-dt / self["memory"])

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Half to three times the linear drag, remembered for a few time constants."""
        return {
            "coefficient": craft.linear[craft.main] * log_uniform(rng, 0.3, 3.0),
            "memory": craft.pace * log_uniform(rng, 0.7, 4.0),
        }


class BentGyro(Foreign):
    """A speed sensor that shows too little of large speeds."""

    slug = "bent-sensor"
    parameters = (EffectParameter("bend", "1"), EffectParameter("top", "m/s"))

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Bend the scale."""
        name = _SPEED[self.dof]
        value = getattr(reading, name)
        setattr(reading, name, value * (1.0 - self["bend"] * min((value / self["top"]) ** 2, 1.5)))

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Up to half missing at top speed."""
        return {"bend": rng.uniform(0.05, 0.5), "top": craft.top[craft.main]}


FOREIGN: Mapping[str, type[Foreign]] = {
    kind.slug: kind
    for kind in (
        CubicDrag,
        DryFriction,
        ResonantActuator,
        Sloshing,
        PeriodicGain,
        WanderingForce,
        GainHysteresis,
        WakeMemory,
        BentGyro,
    )
}
"""Slug -> class. None of these slugs is in the book."""
