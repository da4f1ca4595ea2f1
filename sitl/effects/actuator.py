"""Actuators that do not do what they are told: memoryless ones. Each is placed on one input."""

from __future__ import annotations

import math
from collections.abc import MutableMapping

from sitl.effects.effect import FORCE_OF, BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.places import find_input
from sitl.plants import Wrench

__all__ = [
    "SimulatedAdvanceSpeedLoss",
    "SimulatedAsymmetricThrust",
    "SimulatedCommandCoupling",
    "SimulatedDeadZone",
    "SimulatedGainDrift",
    "SimulatedQuadraticActuator",
    "SimulatedRudderStall",
    "SimulatedSaturation",
    "SimulatedSpeedDependentSteering",
]

_WEAKEST = 0.05
"""The least share of its strength an actuator keeps when it drifts."""
_SPEED_OF = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}


class OnInput(HiddenEffect):
    """An effect on one input."""

    on_vehicles = "an axis: steering (default), throttle, vertical; inputs are shares of full"

    def begin(self, setting: Setting) -> None:
        """Find the input."""
        self.channel = find_input(self, setting)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Change that one input."""
        inputs[self.channel] = self.act(t, dt, inputs[self.channel])

    def act(self, t: float, dt: float, u: float) -> float:
        """Return what the actuator does, on average over the *dt* [s] from *t*, when told *u*."""
        raise NotImplementedError


class SimulatedSaturation(OnInput):
    """Clipped at a limit."""

    slug = "saturation"
    meaning = "the actuator cannot do more than a limit"
    parameters = (EffectParameter("limit", "input unit", least=0.0),)

    def act(self, t: float, dt: float, u: float) -> float:
        """Clip."""
        limit = self["limit"]
        return max(-limit, min(limit, u))


class SimulatedDeadZone(OnInput):
    """Nothing happens for small commands, and all larger ones lose as much."""

    slug = "dead-zone"
    meaning = "small commands do nothing (a shaft that does not turn yet, a slack linkage)"
    parameters = (
        EffectParameter(
            "width", "input unit", "half-width: the command at which something begins to happen", least=0.0
        ),
    )

    def act(self, t: float, dt: float, u: float) -> float:
        """Take the dead part away."""
        return math.copysign(max(abs(u) - self["width"], 0.0), u)


class SimulatedQuadraticActuator(OnInput):
    """Thrust goes with n|n| in part."""

    slug = "quadratic-actuator"
    meaning = "thrust goes with n|n|: weak for small commands"
    parameters = (
        EffectParameter("share", "1", "0: proportional, 1: all quadratic"),
        EffectParameter("u_ref", "input unit", "command that is carried out as told; 0: the largest there is", 0.0),
    )

    def begin(self, setting: Setting) -> None:
        """Read off the largest command."""
        super().begin(setting)
        self._full = self["u_ref"] or setting.swing.get(self.channel, 0.0) or 1.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Bend the line."""
        share = self["share"]
        return u * (1.0 - share + share * abs(u) / self._full)


class SimulatedRudderStall(OnInput):
    """Beyond an angle the rudder loses lift."""

    slug = "rudder-stall"
    meaning = "beyond an angle the rudder's force falls again"
    parameters = (
        EffectParameter("angle", "input unit", least=0.0),
        EffectParameter("drop", "1", "slope beyond it, downwards"),
    )

    def act(self, t: float, dt: float, u: float) -> float:
        """Fall beyond the angle, never below nothing."""
        beyond = abs(u) - self["angle"]
        return u if beyond <= 0.0 else math.copysign(max(self["angle"] - self["drop"] * beyond, 0.0), u)


class SimulatedAsymmetricThrust(OnInput):
    """Weaker (or stronger) one way than the other."""

    slug = "asymmetric-thrust"
    meaning = "a negative command does not do as much as a positive one"
    parameters = (EffectParameter("ratio", "1", "strength astern (or to port) over strength ahead"),)

    def act(self, t: float, dt: float, u: float) -> float:
        """Scale what is negative."""
        return u * self["ratio"] if u < 0.0 else u


class SimulatedCommandCoupling(HiddenEffect):
    """What is asked of one axis is in part done on another: ``"N+X"`` lets ``N`` have its share of ``X``."""

    slug = "command-coupling"
    meaning = "another axis' command acts here too (a line of thrust beside the centre, unequal thrusters)"
    on_vehicles = "two axes, what acts and what acts there too: steering+throttle (default)"
    parameters = (EffectParameter("gain", "input unit per unit of the other", "what the other command adds"),)

    def begin(self, setting: Setting) -> None:
        """Find both inputs."""
        there = setting.inputs
        usual = [setting.steering, *(name for name in there if name != setting.steering)][:2]
        names = [setting.axis_names.get(name, name) for name in (self.place.split("+") if self.place else usual)]
        if len(set(names)) != 2 or not set(names) <= set(there):
            raise BadEffect(f"command-coupling sits on two inputs, as N+X; this craft has {', '.join(there) or 'none'}")
        self._here, self._other = names

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add."""
        inputs[self._here] += self["gain"] * inputs[self._other]


class SimulatedGainDrift(OnInput):
    """Weaker with time."""

    slug = "gain-drift"
    meaning = "the actuator grows weaker with time (a battery that sags)"
    parameters = (EffectParameter("rate", "1/s", "share of the first strength lost per second"),)

    def begin(self, setting: Setting) -> None:
        """Note when time begins."""
        super().begin(setting)
        self._start = setting.start

    def act(self, t: float, dt: float, u: float) -> float:
        """Weaken."""
        passed = max(t + 0.5 * dt - self._start, 0.0)
        return u * max(1.0 - self["rate"] * passed, _WEAKEST)


class SimulatedSpeedDependentSteering(OnInput):
    """Rudder force goes with the square of the speed through the water, in part."""

    slug = "speed-dependent-steering"
    meaning = "the rudder's force goes with the square of the speed through the water"
    parameters = (
        EffectParameter("share", "1", "0: none of it goes with speed, 1: all"),
        EffectParameter("U_ref", "m/s", "speed at which it does as told; 0: the rms surge speed", 0.0),
    )
    on_vehicles = "steering; the speed at full throttle is the reference"

    def begin(self, setting: Setting) -> None:
        """Find the speed it goes by."""
        super().begin(setting)
        self._state = setting.state
        self._speed = self["U_ref"] or setting.cruise or 1.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Scale with the square of the speed."""
        share = self["share"]
        return u * (1.0 - share + share * (self._state.u / self._speed) ** 2)


class SimulatedAdvanceSpeedLoss(OnInput):
    """A thruster loses force as it runs into its own race: the bilinear thruster."""

    slug = "advance-speed-loss"
    meaning = "a thruster loses force as the craft moves (bilinear thruster)"
    parameters = (EffectParameter("loss", "s/m or s/rad"),)

    def begin(self, setting: Setting) -> None:
        """Find the speed along the thruster."""
        super().begin(setting)
        dof = setting.inputs[self.channel]
        self._state, self._speed, self._name = setting.state, _SPEED_OF[dof], FORCE_OF[dof]
        self._loss = self["loss"] * setting.gain.get(dof, 1.0)
        self._working = 0.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Note how hard the thruster works."""
        self._working = abs(u)
        return u

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Take the loss off."""
        nu: float = getattr(self._state, self._speed)
        setattr(wrench, self._name, getattr(wrench, self._name) - self._loss * self._working * nu)
