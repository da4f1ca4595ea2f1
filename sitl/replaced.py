"""A vehicle's hull replaced by a model from a file: the rest (autopilot, mixer, sensors) stays its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.actuators import Actuators
from sitl.body import AxisDynamics, Body, Loads
from sitl.modelfile import BadModel, FlownModel
from sitl.plane import PlaneBody

__all__ = ["ModelActuators", "fit_model"]

_DOF_OF = {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"}
_CHANNEL = {"delta": "N"}
"""A model's channel -> the vehicle's, where the names differ."""
_SIDEWAYS = "Y"
"""What no vehicle commands: a model's input of that name stays 0."""


class ModelActuators(Actuators):
    """The vehicle's own actuators, with forces and dynamics of the modelled degrees of freedom from the model."""

    def __init__(self, own: Actuators, model: FlownModel) -> None:
        self._own = own
        self._axes = {dof: values for dof, values in model.axes.items() if dof != "sway"}
        self._constant = dict(model.forces)
        self._gains = {
            _CHANNEL.get(channel, channel): dict(gains)
            for channel, gains in model.gains.items()
            if channel != _SIDEWAYS
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


def fit_model(model: FlownModel, body: Body, actuators: Actuators) -> tuple[Body, Actuators]:
    """Return hull and actuators that move as *model* says in its degrees of freedom, else as before.

    Raises
    ------
    BadModel
        The model moves in what this vehicle cannot, or is driven by what it does not have.
    """
    lacking = [dof for dof in model.axes if dof not in (*actuators.full, "sway")]
    if lacking:
        raise BadModel(f"the model moves in {', '.join(lacking)}, which this vehicle does not")
    driven = [_CHANNEL.get(channel, channel) for channel in model.gains if channel != _SIDEWAYS]
    known = actuators.read([0] * 16)
    strange = [channel for channel in driven if channel not in known]
    if strange or len(set(driven)) < len(driven):
        raise BadModel(f"the model is driven by {', '.join(model.gains)}; this vehicle has {', '.join(known)}")
    for dof, (alpha, beta, beta2) in model.axes.items():
        if dof != "sway":
            axis = getattr(body, dof)
            axis.alpha, axis.beta, axis.beta2 = alpha, beta, beta2
    if model.coupling is not None:
        sway = AxisDynamics(*model.axes["sway"])
        coupled = PlaneBody(body.surge, sway, body.heave, body.yaw, body.world, model.coupling)
        coupled.z, coupled.psi = body.z, body.psi
        body = coupled
    return body, ModelActuators(actuators, model)
