"""Memoryless actuator effects. Each one acts on one input."""

from __future__ import annotations

import math
from collections.abc import MutableMapping

from sitl.effects.effect import FORCE_OF, BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.places import find_input
from sitl.plants import Wrench

__all__ = [
    "AdvanceSpeedLoss",
    "AsymmetricThrust",
    "CommandCoupling",
    "DeadZone",
    "GainDrift",
    "PropellerWash",
    "QuadraticActuator",
    "RudderStall",
    "Saturation",
    "SpeedDependentSteering",
]

_WEAKEST = 0.05
"""Smallest remaining gain of an actuator whose gain decreases."""
_SPEED_OF = {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}


class OnInput(HiddenEffect):
    """An actuator effect on one input."""

    on_vehicles = "an axis: steering (default), throttle or vertical. Inputs are normalised output (-1 to 1)"

    def begin(self, setting: Setting) -> None:
        """Find the input that the effect's place selects."""
        self.channel = find_input(self, setting)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Replace the command of the effect's input by the result of :meth:`act`."""
        inputs[self.channel] = self.act(t, dt, inputs[self.channel])

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the actuator's mean output over the *dt* [s] from *t* for the command *u*."""
        raise NotImplementedError


class Saturation(OnInput):
    """Saturation: the actuator's output is limited to ``limit`` in both directions."""

    slug = "saturation"
    meaning = "the actuator saturates at a limit"
    parameters = (EffectParameter("limit", "input unit", least=0.0),)

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the command *u*, limited to ``limit`` in both directions."""
        limit = self["limit"]
        return max(-limit, min(limit, u))


class DeadZone(OnInput):
    """Dead zone: no output for small commands. Its half-width is subtracted from larger commands."""

    slug = "dead-zone"
    meaning = "small commands have no effect, as with a shaft that does not turn yet or a slack linkage"
    parameters = (
        EffectParameter(
            "width",
            "input unit",
            "half-width of the dead zone, which is the smallest command with an effect",
            least=0.0,
        ),
    )

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the command *u* reduced by the half-width of the dead zone, or 0 within it."""
        return math.copysign(max(abs(u) - self["width"], 0.0), u)


class QuadraticActuator(OnInput):
    """Thrust partly proportional to n|n|."""

    slug = "quadratic-actuator"
    meaning = "thrust is proportional to n|n|, so it is weak for small commands"
    parameters = (
        EffectParameter("share", "1", "0: proportional, 1: fully quadratic"),
        EffectParameter("u_ref", "input unit", "command at which the thrust is unchanged; 0: the largest command", 0.0),
    )

    def begin(self, setting: Setting) -> None:
        """Find the input, and the reference command at which the thrust is unchanged."""
        super().begin(setting)
        self._full = self["u_ref"] or setting.amplitude.get(self.channel, 0.0) or 1.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the output for the command *u*: the weighted sum of a proportional and a quadratic term."""
        share = self["share"]
        return u * (1.0 - share + share * abs(u) / self._full)


class RudderStall(OnInput):
    """Loss of rudder lift beyond an angle."""

    slug = "rudder-stall"
    meaning = "the rudder's force falls beyond an angle"
    parameters = (
        EffectParameter("angle", "input unit", least=0.0),
        EffectParameter("drop", "1", "slope of the force beyond the stall angle, positive downwards"),
    )

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the lift as an equivalent command. Beyond the stall angle it decreases, but its sign does not
        change.
        """
        beyond = abs(u) - self["angle"]
        return u if beyond <= 0.0 else math.copysign(max(self["angle"] - self["drop"] * beyond, 0.0), u)


class TwoInputs(HiddenEffect):
    """An effect of one input on another. Place: the affected input and the other, such as ``N+X``."""

    on_vehicles = "two axes, the affected one and the other: steering+throttle (default)"

    def begin(self, setting: Setting) -> None:
        """Find the affected input and the other one."""
        there = setting.inputs
        usual = [setting.steering, *(name for name in there if name != setting.steering)][:2]
        names = [setting.axis_names.get(name, name) for name in (self.place.split("+") if self.place else usual)]
        if len(set(names)) != 2 or not set(names) <= set(there):
            known = ", ".join(there) or "none"
            raise BadEffect(f"{self.slug} needs two inputs, e.g. N+X. This craft has {known}")
        self._here, self._other = names


class AsymmetricThrust(TwoInputs):
    """Weaker (or stronger) thrust in one direction. With place ``N+X`` it applies to each of two thrusters that steer
    and drive together.
    """

    slug = "asymmetric-thrust"
    meaning = "a negative command has less effect than a positive one"
    on_vehicles = (
        f"{OnInput.on_vehicles}. For steering+throttle, it applies to each of the two thrusters that share both"
    )
    parameters = (EffectParameter("ratio", "1", "ratio of the strength astern (or to port) to the strength ahead"),)

    def begin(self, setting: Setting) -> None:
        """Find the input or, with a place of two, both inputs."""
        self._here, self._other = "", ""
        if "+" in self.place:
            super().begin(setting)
        else:
            self._here = find_input(self, setting)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Multiply negative commands of the input, or of each thruster, by ``ratio``."""
        u = inputs[self._here]
        if not self._other:
            inputs[self._here] = self._act(u)
            return
        left, right = self._act(inputs[self._other] + u), self._act(inputs[self._other] - u)
        inputs[self._here], inputs[self._other] = 0.5 * (left - right), 0.5 * (left + right)

    def _act(self, u: float) -> float:
        return u * self["ratio"] if u < 0.0 else u


class CommandCoupling(TwoInputs):
    """A fraction of one axis' command acts on another. With place ``N+X`` a fraction of ``X`` is added to ``N``."""

    slug = "command-coupling"
    meaning = "the command of another axis also acts on this one (off-centre thrust, unequal thrusters)"
    parameters = (EffectParameter("gain", "input unit per unit of the other", "gain of the other command"),)

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Add the fraction of the other axis' command."""
        inputs[self._here] += self["gain"] * inputs[self._other]


class GainDrift(OnInput):
    """Gain that decreases with time."""

    slug = "gain-drift"
    meaning = "the actuator weakens with time (battery sag)"
    parameters = (EffectParameter("rate", "1/s", "fraction of the initial strength lost per second"),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and record the start time."""
        super().begin(setting)
        self._start = setting.start

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the command *u* times the gain remaining at the middle of the step."""
        passed = max(t + 0.5 * dt - self._start, 0.0)
        return u * max(1.0 - self["rate"] * passed, _WEAKEST)


class SpeedDependentSteering(OnInput):
    """Rudder force partly proportional to the square of the speed through the water."""

    slug = "speed-dependent-steering"
    meaning = "the rudder's force is proportional to the squared speed through the water"
    parameters = (
        EffectParameter("share", "1", "0: no dependence on speed, 1: full dependence"),
        EffectParameter("U_ref", "m/s", "speed at which the force is unchanged; 0: the rms surge speed", 0.0),
    )
    on_vehicles = "steering. The speed at full throttle is the reference"

    def begin(self, setting: Setting) -> None:
        """Find the input, the craft's state and the reference speed."""
        super().begin(setting)
        self._state = setting.state
        self._speed = self["U_ref"] or setting.cruise or 1.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Return the rudder command *u*, scaled partly with the square of the surge speed."""
        share = self["share"]
        return u * (1.0 - share + share * (self._state.u / self._speed) ** 2)


class PropellerWash(TwoInputs):
    """A rudder behind a propeller: its force depends partly on the square of the commanded thrust."""

    slug = "propeller-wash"
    meaning = "the rudder's force is proportional to the square of the propeller's command"
    parameters = (
        EffectParameter("share", "1", "0: the force does not depend on thrust, 1: it depends entirely on thrust"),
        EffectParameter("X_ref", "input unit", "command at which the gain is 1; 0: full output", 0.0),
    )

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Scale the rudder command partly with the square of the propeller's command. Astern the effect is reversed."""
        share, ahead = self["share"], inputs[self._other] / (self["X_ref"] or 1.0)
        inputs[self._here] *= 1.0 - share + share * ahead * abs(ahead)


class AdvanceSpeedLoss(OnInput):
    """Loss of thrust with the speed of the flow through the thruster: the bilinear thruster model."""

    slug = "advance-speed-loss"
    meaning = "a thruster loses force as the craft gains speed (bilinear thruster)"
    parameters = (EffectParameter("loss", "s/m or s/rad"),)

    def begin(self, setting: Setting) -> None:
        """Find the input, and the speed and force along the thruster."""
        super().begin(setting)
        dof = setting.inputs[self.channel]
        self._state, self._speed, self._name = setting.state, _SPEED_OF[dof], FORCE_OF[dof]
        self._loss = self["loss"] * setting.gain.get(dof, 1.0)
        self._working = 0.0

    def act(self, t: float, dt: float, u: float) -> float:
        """Record the magnitude of the command *u*, and return *u* unchanged."""
        self._working = abs(u)
        return u

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Subtract the loss of thrust, which is proportional to the command's magnitude and the speed."""
        nu: float = getattr(self._state, self._speed)
        setattr(wrench, self._name, getattr(wrench, self._name) - self._loss * self._working * nu)
