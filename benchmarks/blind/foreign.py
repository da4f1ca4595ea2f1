"""Effects that are not in the catalogue, each on the main input or degree of freedom.

The diagnosis must not report a confident cause for them. They work in the open-loop simulator only. Effects that
resemble one of the catalogue are left out: a lagging sensor resembles a delay, and a constant pull is a bias.
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

__all__ = ["FOREIGN", "SEEDED_AS"]

Rng = np.random.Generator
_SPEED = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}
_FORCE = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}


SEEDED_AS = {
    "process-noise": "weather",
    "correct-model": "honest",
    "correct-model-and-effect": "honest-and-effect",
    "correct-simulation": "honest-simulation",
    "drifting-moment": "weather",
    "drifting-force": "wandering-force",
    "run-to-run": "day",
}
"""Kind of case or effect -> earlier name, from which its random seed is computed.

Recorded seeds thus give the same cases.
"""


class Foreign(HiddenEffect):
    """An effect on the input that its place names."""

    def begin(self, setting: Setting) -> None:
        """Look up the channel, degree of freedom and state, and reset."""
        self.channel = self.place
        self.dof = setting.inputs[self.channel]
        self.state = setting.state
        self.full = setting.amplitude[self.channel]
        self.alpha = setting.parameters[f"{self.dof}.alpha"]
        self.draw = Random(f"{setting.seed}/{SEEDED_AS.get(self.slug, self.slug)}")
        self.reset()

    def reset(self) -> None:
        """Set the initial state."""

    @property
    def speed(self) -> float:
        """Return the speed of the degree of freedom [m/s or rad/s]."""
        return float(getattr(self.state, _SPEED[self.dof]))

    @classmethod
    def differs(cls, commands: NDArray[np.float64]) -> bool:
        """Return whether, with these commands (n,), it differs from every effect of the catalogue."""
        return True

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return random parameters."""
        raise NotImplementedError


class CubicDrag(Foreign):
    """Drag proportional to the cube of speed, like wave-making resistance."""

    slug = "cubic-drag"
    parameters = (EffectParameter("coefficient", "N s^3/m^3"),)

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the drag."""
        name = _FORCE[self.dof]
        setattr(wrench, name, getattr(wrench, name) - self["coefficient"] * self.speed**3)

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return 0.3 to 10 times the linear drag at top speed."""
        return {"coefficient": craft.linear[craft.main] / craft.top[craft.main] ** 2 * log_uniform(rng, 0.3, 10.0)}


class DryFriction(Foreign):
    """Friction that depends on the direction of motion only, as of a hull on a rope or a vehicle on the bottom."""

    slug = "dry-friction"
    parameters = (EffectParameter("force", "N"), EffectParameter("creep", "m/s"))

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Add the drag."""
        name = _FORCE[self.dof]
        setattr(wrench, name, getattr(wrench, name) - self["force"] * math.tanh(self.speed / self["creep"]))

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return 3 to 35 % of full command, reached at 5 % of top speed."""
        return {
            "force": craft.full[craft.input] * log_uniform(rng, 0.03, 0.35),
            "creep": 0.05 * craft.top[craft.main],
        }


class ResonantActuator(Foreign):
    """An actuator that follows its command as a mass on a spring."""

    slug = "resonant-actuator"
    parameters = (EffectParameter("frequency", "rad/s"), EffectParameter("damping", "1"))

    def reset(self) -> None:
        """Start at the first command, at rest."""
        self._position, self._rate = math.nan, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Oscillate about the command."""
        command, omega, zeta = inputs[self.channel], self["frequency"], self["damping"]
        if math.isnan(self._position):
            self._position = command
        count = max(1, math.ceil(omega * dt / 0.05))
        h, total = dt / count, 0.0
        for _ in range(count):
            self._rate += h * (omega * omega * (command - self._position) - 2.0 * zeta * omega * self._rate)
            self._position += h * self._rate
            total += self._position
        inputs[self.channel] = total / count

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return a natural period close to the time constant of the hull, with little damping."""
        return {"frequency": log_uniform(rng, 1.0, 5.0) / craft.pace, "damping": log_uniform(rng, 0.03, 0.25)}


class Sloshing(Foreign):
    """Water inside the hull that sloshes."""

    slug = "sloshing"
    parameters = (EffectParameter("mass", "kg"), EffectParameter("frequency", "rad/s"), EffectParameter("damping", "1"))

    def reset(self) -> None:
        """Start at rest."""
        self._offset, self._inside = 0.0, 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the force of the water."""
        omega, zeta = self["frequency"], self["damping"]
        count = max(1, math.ceil(omega * dt / 0.05))
        h, total = dt / count, 0.0
        for _ in range(count):
            slip = self.speed - self._inside
            pull = omega * omega * self._offset + 2.0 * zeta * omega * slip
            self._inside += h * pull
            self._offset += h * (self.speed - self._inside)
            total += pull
        inputs[self.channel] -= self["mass"] * total / count

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return a mass of 5 to 50 % of the hull's inertia."""
        return {
            "mass": craft.inertia[craft.main] * log_uniform(rng, 0.05, 0.5),
            "frequency": log_uniform(rng, 1.0, 6.0) / craft.pace,
            "damping": log_uniform(rng, 0.02, 0.1),
        }


class PeriodicGain(Foreign):
    """A gain that varies sinusoidally, as of a cavitating or ventilating propeller in waves."""

    slug = "periodic-gain"
    parameters = (EffectParameter("depth", "1"), EffectParameter("frequency", "rad/s"))

    def reset(self) -> None:
        """Start at random."""
        self._phase = self.draw.uniform(0.0, math.tau)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Scale the command."""
        wave = math.sin(self["frequency"] * (t + 0.5 * dt) + self._phase)
        inputs[self.channel] *= 1.0 + self["depth"] * wave

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return a frequency of at least three periods in a run."""
        frequency = log_uniform(rng, 3.0 * math.tau / craft.duration, 2.0 / craft.pace)
        return {"depth": rng.uniform(0.15, 0.9), "frequency": frequency}


class DriftingForce(Foreign):
    """A drifting force (Ornstein-Uhlenbeck process), such as of gusts."""

    slug = "drifting-force"
    parameters = (EffectParameter("spread", "N"), EffectParameter("memory", "s"))

    def reset(self) -> None:
        """Start at random."""
        self._force = self.draw.gauss(0.0, self["spread"])

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the force."""
        keep = math.exp(-dt / self["memory"])
        self._force = keep * self._force + self.draw.gauss(0.0, self["spread"] * math.sqrt(1.0 - keep * keep))
        inputs[self.channel] += self._force

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return a correlation time of 2 to 15 % of the run."""
        return {
            "spread": craft.full[craft.input] * log_uniform(rng, 0.05, 0.4),
            "memory": craft.duration * log_uniform(rng, 0.02, 0.15),
        }


class GainHysteresis(Foreign):
    """A gain that is larger after an increase of the command than after a decrease, as of a pitch that sticks."""

    slug = "gain-hysteresis"
    parameters = (EffectParameter("difference", "1"),)

    def reset(self) -> None:
        """Start as after an increase."""
        self._last, self._side = math.nan, 1.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Scale the command."""
        command = inputs[self.channel]
        if command != self._last:
            self._side = 1.0 if math.isnan(self._last) or command > self._last else -1.0
            self._last = command
        inputs[self.channel] = command * (1.0 + 0.5 * self["difference"] * self._side)

    @classmethod
    def differs(cls, commands: NDArray[np.float64]) -> bool:
        """Return False for two levels. The sign then shows the direction, as it does for asymmetric thrust."""
        return len(np.unique(commands)) > 3

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return a difference of 15 to 75 %."""
        return {"difference": rng.uniform(0.15, 0.75)}


class WakeMemory(Foreign):
    """Drag on the speed relative to a filtered speed, as of a hull in its own wake."""

    slug = "wake-memory"
    parameters = (EffectParameter("coefficient", "N s/m"), EffectParameter("memory", "s"))

    def reset(self) -> None:
        """Start in still water."""
        self._wake = 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the drag, and update the speed of the wake."""
        inputs[self.channel] -= self["coefficient"] * (self.speed - self._wake)
        self._wake += (self.speed - self._wake) * -math.expm1(-dt / self["memory"])

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return 0.3 to 3 times the linear drag, and a memory of 0.7 to 4 time constants."""
        return {
            "coefficient": craft.linear[craft.main] * log_uniform(rng, 0.3, 3.0),
            "memory": craft.pace * log_uniform(rng, 0.7, 4.0),
        }


class NonlinearSensor(Foreign):
    """A speed sensor that reads large speeds too low."""

    slug = "bent-sensor"
    parameters = (EffectParameter("bend", "1"), EffectParameter("top", "m/s"))

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Lower the reading."""
        name = _SPEED[self.dof]
        value = getattr(reading, name)
        setattr(reading, name, value * (1.0 - self["bend"] * min((value / self["top"]) ** 2, 1.5)))

    @classmethod
    def drawn(cls, rng: Rng, craft: Craft) -> Mapping[str, float]:
        """Return an error of 5 to 50 % at top speed."""
        return {"bend": rng.uniform(0.05, 0.5), "top": craft.top[craft.main]}


FOREIGN: Mapping[str, type[Foreign]] = {
    kind.slug: kind
    for kind in (
        CubicDrag,
        DryFriction,
        ResonantActuator,
        Sloshing,
        PeriodicGain,
        DriftingForce,
        GainHysteresis,
        WakeMemory,
        NonlinearSensor,
    )
}
"""Slug -> class. None of these slugs is in the catalogue."""
