"""Interface of hidden effects: deviations between commands, ideal vehicle and record.

An effect overrides only the methods for what it alters. Effects run in the order of the list. The same effect works in
open loop (:mod:`sitl.open_loop`), where inputs are in SI units, and on a vehicle, where an input is the normalised
output of one axis.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sitl.plants import Parameters, State, Water, Wrench
from sitl.sensors import SensorReading

__all__ = ["FORCE_OF", "BadEffect", "EffectParameter", "HiddenEffect", "Setting"]

FORCE_OF: Mapping[str, str] = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}
"""Degree of freedom -> SNAME name of the force or moment along it."""


class BadEffect(ValueError):
    """Raised for an effect that cannot be applied: unknown, a wrong parameter, or no such place on this craft."""


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect: its name and unit.

    ``meaning``: what it is, for people.
    ``default``: its value if not supplied; None: it must be supplied.
    ``least``, ``most``: allowed range, in ``unit``.
    """

    name: str
    unit: str
    meaning: str = ""
    default: float | None = None
    least: float = -math.inf
    most: float = math.inf

    def refusal(self, value: float) -> str:
        """Return a sentence that states why *value* is not allowed, or an empty text if it is allowed."""
        if not math.isfinite(value):
            return f"{value:g} is not a finite number"
        unit = "" if self.unit == "1" else f" {self.unit}"
        in_degrees = f". Did you mean {math.radians(value):.3g} ({value:g} degrees)?" * (self.unit == "rad")
        if value < self.least:
            return f"{value:g} is too small. The minimum is {self.least:g}{unit}{in_degrees}"
        if value > self.most:
            return f"{value:g} is too large. The maximum is {self.most:g}{unit}{in_degrees}"
        return ""


@dataclass(frozen=True, slots=True)
class Setting:
    """Data of the craft that an effect may use.

    ``state``, ``water``, ``parameters``: the plant's own objects, which change with time.
    ``dofs``: degrees of freedom in which effects may act.
    ``inputs``: channel -> degree of freedom that it drives.
    ``amplitude``: input -> its largest command.
    ``gain``: degree of freedom -> force [N, N m] per unit of its input.
    ``signals``: names of the measured signals.
    ``start``: time [s] at which the run begins.
    ``seed``: seed of the random numbers.
    ``cruise``: rms surge speed [m/s]; on a vehicle its speed at full throttle.
    ``mass``: mass of the craft without added mass [kg], 0 if unknown.
    ``on_vehicle``: whether the effect acts on a vehicle; otherwise it acts in open loop.
    ``axis_names``: other name of an input (``steering`` ...) -> its channel.
    """

    state: State
    water: Water
    parameters: Parameters
    dofs: tuple[str, ...]
    inputs: Mapping[str, str]
    amplitude: Mapping[str, float]
    gain: Mapping[str, float]
    signals: tuple[str, ...]
    start: float = 0.0
    seed: str = "0"
    cruise: float = 0.0
    mass: float = 0.0
    on_vehicle: bool = False
    axis_names: Mapping[str, str] = field(default_factory=dict)

    @property
    def steering(self) -> str:
        """The default input of an actuator effect: the channel that drives yaw, or else the first. Empty without
        inputs.
        """
        return next((name for name, dof in self.inputs.items() if dof == "yaw"), next(iter(self.inputs), ""))


class HiddenEffect:
    """One hidden effect.

    It has a *place* (input, degree of freedom or signal; empty: the default) and parameters in SI units. Every method
    receives the craft's time *t* [s] and alters its last argument in place. :meth:`begin` is called first.

    Raises
    ------
    BadEffect
        The place is unknown, or a parameter is unknown, missing or impossible.
    """

    slug: ClassVar[str] = ""
    meaning: ClassVar[str] = ""
    parameters: ClassVar[tuple[EffectParameter, ...]] = ()
    on_vehicles: ClassVar[str] = "no"
    """Text of the allowed places on a vehicle over MAVLink; ``no`` if not supported there."""
    places: ClassVar[tuple[str, ...]] = ()
    """The allowed places, if they are the same for every craft. Empty: :meth:`begin` verifies the place."""

    def __init__(self, place: str = "", **values: float) -> None:
        self.place = place
        if place and self.places and place not in self.places:
            raise BadEffect(f"{self.slug} cannot act on '{place}'. Use {' or '.join(self.places)}")
        self.values = {p.name: p.default for p in self.parameters if p.default is not None}
        self.values.update(values)
        for name in values:
            if name not in {p.name for p in self.parameters}:
                raise BadEffect(f"{self.slug} has no parameter '{name}'; {self._hint(name)}")
        missing = [p.name for p in self.parameters if p.name not in self.values]
        if missing:
            raise BadEffect(f"{self.slug} needs {', '.join(missing)}")
        for p in self.parameters:
            if refusal := p.refusal(self.values[p.name]):
                raise BadEffect(f"{self.slug}.{p.name}: {refusal}")

    def __getitem__(self, name: str) -> float:
        """Return a parameter."""
        return self.values[name]

    def _hint(self, name: str) -> str:
        names = [p.name for p in self.parameters]
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
        return f"did you mean {near[0]}?" if near else f"it has {', '.join(names) or 'none'}"

    def begin(self, setting: Setting) -> None:
        """Reset, and read the craft's initial state. Raises ``BadEffect`` if the craft has no such place."""

    def quickness(self, setting: Setting) -> float:
        """Return the shortest time constant [s] of this effect, which limits the step in open loop. Infinite:
        no limit.
        """
        return float("inf")

    def lateness(self) -> Mapping[str, float]:
        """Return signal -> its delay [s] relative to the inputs, in open loop. The key ``*`` means all signals."""
        return {}

    # -- from the command to the hull

    def alter_command(self, t: float, pwm: list[int]) -> None:
        """Change the servo pulses [us] before the actuators. It is called only on vehicles."""

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        """Change the actuators' inputs, by channel (``N``, ``X`` ...), for the *dt* [s] that begin at *t*."""

    def alter_force(self, t: float, wrench: Wrench) -> None:
        """Change the forces [N] and moments [N m] on the hull. It is called at every integrator stage."""

    def alter_water(self, t: float, water: Water) -> None:
        """Change the velocity of the water. It is called at every integrator stage, after :meth:`alter_force`."""

    def alter_parameters(self, t: float, parameters: Parameters) -> None:
        """Change the parameters of the plant. It is called every step with the plant's own values."""

    # -- from the hull to the record

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Change the sensor readings *reading* of time *t*."""

    def alter_file(self, columns: dict[str, NDArray[np.float64]]) -> None:
        """Change the file's columns: ``t``, inputs and signals, (n,) each. It is called only in open loop."""

    def alter_report(self, fields: dict[str, float]) -> None:
        """Change the message sent at one moment (see :mod:`sitl.mavlink.streams`). It is called only on vehicles."""

    @classmethod
    def overrides(cls, hook: str) -> bool:
        """Return whether this effect has its own version of the method called *hook*."""
        return getattr(cls, hook) is not getattr(HiddenEffect, hook)
