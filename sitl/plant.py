"""A craft without its autopilot: hull, actuators and hidden effects, in steps of any length.

Its hull may be replaced by a model from a file: the rest (autopilot, mixer, sensors) stays its own. For effects it is
a setting whose inputs are shares of full, and whose signals are what its sensors measure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sitl.actuators import Actuators
from sitl.catalogue import VehicleData
from sitl.effects import HiddenEffect, Setting
from sitl.hull import AxisDynamics, Body, Loads
from sitl.modelfile import BadModel, FlownModel
from sitl.sensors import SensorReading

__all__ = ["SimulatedPlant"]

_DOF_OF = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"}
_CHANNEL = {"delta": "N"}
"""A model's channel -> the vehicle's, where the names differ."""
_SIDEWAYS = "Y"
"""What most vehicles do not command: a model's input of that name then stays 0."""
_CHANNELS = {"yaw": "N", "surge": "X", "heave": "Z", "sway": "Y"}
_NAMES = {
    "N": ("steering", "rudder", "yaw", "delta"),
    "X": ("throttle", "surge"),
    "Z": ("vertical", "heave"),
    "Y": ("lateral", "sway"),
}


class SimulatedPlant:
    """The hull of a vehicle in its water, moved by servo pulses.

    Parameters
    ----------
    data : its data file.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of its own, with effects that come first. ``BadModel`` when it cannot.
    """

    def __init__(
        self, data: VehicleData, *, effects: Sequence[HiddenEffect] = (), model: FlownModel | None = None
    ) -> None:
        self.data = data
        self.effects = (*(model.effects if model else ()), *effects)
        self.body = data.make_body()
        self.actuators = data.make_actuators()
        if model is not None:
            self.actuators = _fit_model(model, self.body, self.actuators)
        self._loads = Loads()
        self._plain = self.body.axes()

    def begin(self, seed: str) -> None:
        """Let the effects begin; *seed* is that of their chances. ``BadEffect`` when there is no place for one."""
        for effect in self.effects:
            effect.begin(_describe(self, seed))

    def move(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Let *dt* [s] pass, up to time *t* [s], under servo pulses *pwm* [us]."""
        if self.effects:
            self._drive_altered(t, dt, pwm)
        else:
            self.actuators.drive(pwm, self.body, self._loads)
        for effect in self.effects:
            effect.alter_force(t, self._loads)
            effect.alter_parameters(t, self.body)
        self.body.step(self._loads, dt)

    def alter(self, t: float, reading: SensorReading) -> None:
        """Let the effects at what the sensors tell."""
        for effect in self.effects:
            effect.alter_measurement(t, reading)

    def _drive_altered(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Drive with what the effects make of *pwm*, on the hull's plain inertia and drag."""
        pulses = list(pwm)
        for effect in self.effects:
            effect.alter_command(t, pulses)
        shares = self.actuators.read(pulses)
        for effect in self.effects:
            effect.alter_input(t, dt, shares)
        self.body.set_axes(self._plain)
        self.actuators.apply(shares, self.body, self._loads)


class _ModelActuators(Actuators):
    """The vehicle's own actuators, with forces and dynamics of the modelled degrees of freedom from the model."""

    def __init__(self, own: Actuators, model: FlownModel) -> None:
        self._own = own
        self._axes = {dof: values for dof, values in model.axes.items() if dof != "sway"}
        self._constant = dict(model.forces)
        self._gains = {
            _CHANNEL.get(channel, channel): dict(gains)
            for channel, gains in model.gains.items()
            if channel != _SIDEWAYS or "sway" in own.full
        }
        self._full = dict(own.full)
        for channel, gains in self._gains.items():
            if _DOF_OF[channel] in self._axes:
                self._full[_DOF_OF[channel]] = gains.get(channel, 0.0)

    @property
    def full(self) -> Mapping[str, float]:
        """Degree of freedom -> force at a share of 1."""
        return self._full

    def read(self, pwm: Sequence[int]) -> dict[str, float]:
        """Return the shares of full asked for."""
        return self._own.read(pwm)

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return the pulses that ask for *shares*."""
        return self._own.write(pwm, shares)

    def apply(self, shares: Mapping[str, float], body: Body, loads: Loads) -> None:
        """Fill *loads*; modelled degrees of freedom get the model's forces, inertia and drag."""
        self._own.apply(shares, body, loads)
        for dof, values in self._axes.items():
            axis = getattr(body, dof)
            axis.alpha, axis.beta, axis.beta2 = values
        for force, constant in self._constant.items():
            pushed = (gains[force] * shares[channel] for channel, gains in self._gains.items() if force in gains)
            setattr(loads, force, constant + sum(pushed))


def _fit_model(model: FlownModel, body: Body, actuators: Actuators) -> Actuators:
    """Make *body* move as *model* says in its degrees of freedom, else as before; return the actuators that fit.

    Raises
    ------
    BadModel
        The model moves in what this vehicle cannot, or is driven by what it does not have.
    """
    lacking = [dof for dof in model.axes if dof not in (*actuators.full, "sway")]
    if lacking:
        raise BadModel(f"the model moves in {', '.join(lacking)}, which this vehicle does not")
    known = actuators.read([0] * 16)
    driven = [_CHANNEL.get(channel, channel) for channel in model.gains if channel != _SIDEWAYS or channel in known]
    strange = [channel for channel in driven if channel not in known]
    if strange or len(set(driven)) < len(driven):
        raise BadModel(f"the model is driven by {', '.join(model.gains)}; this vehicle has {', '.join(known)}")
    for dof, (alpha, beta, beta2) in model.axes.items():
        if dof != "sway":
            axis = getattr(body, dof)
            axis.alpha, axis.beta, axis.beta2 = alpha, beta, beta2
    if model.coupling is not None:
        body.couple(AxisDynamics(*model.axes["sway"]), model.coupling)
    return _ModelActuators(actuators, model)


def _describe(plant: SimulatedPlant, seed: str) -> Setting:
    """Return what effects may know of *plant* at power-up."""
    body, full = plant.body, plant.actuators.full
    inputs = {_CHANNELS[dof]: dof for dof in full}
    signals = ("psi", "r", "phi", "theta", "p", "q", "u", *["v"][: body.sways], "x", "y")
    return Setting(
        motion=body,
        axes={dof: getattr(body, dof) for dof in dict.fromkeys((*full, *["sway"][: body.sways]))},
        inputs=inputs,
        swing=dict.fromkeys(inputs, 1.0),
        gain=full,
        signals=signals if plant.data.is_boat else (*signals, "z", "w"),
        seed=seed,
        cruise=_full_speed(plant),
        bottom=body.world.bottom,
        on_vehicle=True,
        axis_names={name: channel for channel in inputs for name in _NAMES[channel]},
    )


def _full_speed(plant: SimulatedPlant) -> float:
    """Return the speed ahead [m/s] that full throttle holds."""
    axis, force = plant.body.surge, plant.actuators.full["surge"]
    if axis.beta2 <= 0.0 >= axis.beta:
        return 0.0
    if axis.beta2 > 0.0:
        return (math.sqrt(axis.beta**2 + 4.0 * axis.beta2 * force) - axis.beta) / (2.0 * axis.beta2)
    return force / axis.beta
