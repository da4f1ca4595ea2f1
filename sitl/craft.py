"""A craft without its autopilot: a plant, its actuators and hidden effects, in steps of any length.

A model from a file may replace the plant's dynamics; autopilot, mixer and sensors remain those of the vehicle. For
effects, inputs are normalised (-1 to 1) and signals are those measured by the sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sitl.actuators import Actuators, MotorDrive, ThrusterSet
from sitl.catalogue import VehicleData
from sitl.effects import HiddenEffect
from sitl.modelfile import BadModel, FlownModel
from sitl.plants import DOFS, AxisDynamics, Parameters, PlanarHull, Plant, RigidBody, Wrench
from sitl.sensors import SensorReading
from sitl.setting import setting_of

__all__ = ["Craft", "Diverged"]

_DOF_OF = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"}
_CHANNEL = {"delta": "N"}
"""Channel of a model -> channel of the vehicle, if the names differ."""
_SIDEWAYS = "Y"
"""Input that most vehicles do not command. A model's input of that name stays 0."""
_FASTEST = 1e6
"""No craft is faster [m/s, rad/s], nor any shaft [1/s]: the integration diverges. Project choice."""


class Diverged(ValueError):
    """Raised if the integration of the motion diverges; the message states the vehicle and the heading of its file."""


class Craft:
    """The plant of a vehicle in its water, driven by servo pulses.

    Parameters
    ----------
    data : the vehicle's data file.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of the vehicle's own. Its effects are applied first. ``BadModel`` if this is
    not possible.
    plant : the body to drive instead of the vehicle's own hull; not together with *model*, which describes a hull.
    """

    def __init__(
        self,
        data: VehicleData,
        *,
        effects: Sequence[HiddenEffect] = (),
        model: FlownModel | None = None,
        plant: Plant | None = None,
    ) -> None:
        self.data = data
        self.actuators = data.make_actuators()
        if plant is not None and model is not None:
            raise BadModel("a model replaces the vehicle's own hull. Supply either plant or model, not both")
        self.plant = plant or data.make_plant()
        if model is not None:
            if not isinstance(self.plant, PlanarHull):
                raise BadModel(f"a model replaces a planar hull, and {data.name} is another plant. Omit the model")
            if isinstance(self.actuators, ThrusterSet):
                raise BadModel(
                    f"a model brings its own forces, and {data.name} has thrusters of its own. Omit the model"
                )
            self.actuators = _fit_model(model, self.plant, self.actuators)
        self.actuators.attach(self.plant)
        self.effects = (*data.make_effects(self.actuators.full), *(model.effects if model else ()), *effects)
        self.derating = data.make_derating(self.actuators)
        self._wrench = Wrench()
        self._plain = dict(self.plant.parameters)

    def begin(self, seed: str) -> None:
        """Start the effects; *seed*: seed of their random numbers. Raises ``BadEffect`` if one has no place."""
        setting = setting_of(self.plant, self.actuators, is_boat=self.data.is_boat, mass=self.data.mass, seed=seed)
        for effect in self.effects:
            effect.begin(setting)

    def move(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Advance by *dt* [s] to time *t* [s] under servo pulses *pwm* [us]."""
        if self.effects:
            self._drive_altered(t, dt, pwm)
        else:
            acting = self.derating.weaken(dt, pwm) if self.derating else pwm
            self.actuators.drive(acting, self.plant.parameters, self._wrench)
        for effect in self.effects:
            effect.alter_force(t, self._wrench)
            effect.alter_water(t, self.plant.water)
            effect.alter_parameters(t, self.plant.parameters)
        self.plant.step(self._wrench, dt)
        at = self.plant.state
        if not abs(at.u) + abs(at.v) + abs(at.w) + abs(at.p) + abs(at.q) + abs(at.r) < _FASTEST:
            raise self._diverged(t, dt)

    def alter(self, t: float, reading: SensorReading) -> None:
        """Change the sensor reading of time *t* [s] by all effects."""
        for effect in self.effects:
            effect.alter_measurement(t, reading)

    def _diverged(self, t: float, dt: float) -> Diverged:
        """Return the error that the motion diverges at *t* [s]. It names the shafts, or else the fastest axis."""
        at, shafts = self.plant.state, self.plant.rotors if isinstance(self.plant, RigidBody) else ()
        speeds = dict(zip(DOFS, (at.u, at.v, at.w, at.p, at.q, at.r), strict=True))
        heading = max(self.plant.dofs, key=lambda dof: math.inf if math.isnan(speeds[dof]) else abs(speeds[dof]))
        if any(not abs(n) < _FASTEST for n in shafts):
            heading = "motor"
        cure = "a slower motor" if heading == "motor" else "more inertia, less drag or less force"
        return Diverged(
            f"{self.data.name}: {heading}: the motion diverges after {t:.3g} s, with time steps of {dt:g} s. Use {cure}"
        )

    def _drive_altered(self, t: float, dt: float, pwm: Sequence[int]) -> None:
        """Apply the effects to *pwm*, and drive the plant with its own parameters."""
        pulses = list(pwm)
        for effect in self.effects:
            effect.alter_command(t, pulses)
        acting = self.derating.weaken(dt, pulses) if self.derating else pulses
        shares = self.actuators.read(acting)
        for effect in self.effects:
            effect.alter_input(t, dt, shares)
        self.plant.parameters.update(self._plain)
        self.actuators.apply(shares, self.plant.parameters, self._wrench)


class _ModelActuators(Actuators):
    """The vehicle's own actuators, but with the model's forces and dynamics in the modelled degrees of freedom."""

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
        """Degree of freedom -> force [N] or moment [N m] at full output, of the model where it has that degree."""
        return self._full

    @property
    def motor_drive(self) -> MotorDrive:
        """The vehicle's own motors."""
        return self._own.motor_drive

    def read(self, pwm: Sequence[float]) -> dict[str, float]:
        """Return the normalised outputs (-1 to 1) that the pulses *pwm* [us] command, by SNAME force."""
        return self._own.read(pwm)

    def write(self, pwm: Sequence[int], shares: Mapping[str, float]) -> list[int]:
        """Return *pwm* [us] with those pulses changed that set the outputs to *shares* (-1 to 1)."""
        return self._own.write(pwm, shares)

    def apply(self, shares: Mapping[str, float], parameters: Parameters, wrench: Wrench) -> None:
        """Write the forces of *shares* into *wrench*. Modelled degrees of freedom get the model's forces, inertia and
        drag.
        """
        self._own.apply(shares, parameters, wrench)
        for dof, values in self._axes.items():
            for name, value in zip(("alpha", "beta", "beta2"), values, strict=True):
                parameters[f"{dof}.{name}"] = value
        for force, constant in self._constant.items():
            pushed = (gains[force] * shares[channel] for channel, gains in self._gains.items() if force in gains)
            setattr(wrench, force, constant + sum(pushed))


def _fit_model(model: FlownModel, plant: PlanarHull, actuators: Actuators) -> Actuators:
    """Make *plant* move like *model* in the model's degrees of freedom, and return the matching actuators.

    Raises
    ------
    BadModel
        The model has a degree of freedom or an input that this vehicle does not have.
    """
    lacking = [dof for dof in model.axes if dof not in (*actuators.full, "sway")]
    if lacking:
        raise BadModel(f"the model has {', '.join(lacking)}, which this vehicle does not have")
    known = actuators.read([0] * 16)
    driven = [_CHANNEL.get(channel, channel) for channel in model.gains if channel != _SIDEWAYS or channel in known]
    strange = [channel for channel in driven if channel not in known]
    if strange or len(set(driven)) < len(driven):
        raise BadModel(f"the model is driven by {', '.join(model.gains)}, but this vehicle has {', '.join(known)}")
    for dof, values in model.axes.items():
        if dof != "sway":
            plant.set_axis(dof, AxisDynamics(*values))
    if model.coupling is not None:
        plant.couple(AxisDynamics(*model.axes["sway"]), model.coupling)
    return _ModelActuators(actuators, model)
