"""A simulated vehicle with an ArduRover- or ArduSub-style autopilot and MAVLink 2. It is independent of the tuner.

``catalogue`` and ``vehicles/`` define the available craft. ``vehicle`` is one craft, with ``plants/``, ``actuators``,
``sensors``, ``battery`` and ``autopilot/``. ``mavlink/`` is its MAVLink interface. ``lockstep`` and ``listen`` connect
it to a pipe or a link. ``camera`` renders pictures. ``many`` flies thousands of craft at once.
``python -m sitl --help`` shows how to run it as a separate process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.catalogue import VEHICLES, BadVehicle, UnknownVehicle, load_vehicle
from sitl.effects import EFFECTS, BadEffect, HiddenEffect, make_effect
from sitl.mavlink import Server
from sitl.modelfile import BadModel, FlownModel, read_model
from sitl.vehicle import Vehicle

__all__ = [
    "EFFECTS",
    "VEHICLES",
    "BadEffect",
    "BadModel",
    "BadVehicle",
    "HiddenEffect",
    "Server",
    "UnknownVehicle",
    "load_vehicle",
    "make_effect",
    "open_vehicle",
    "read_model",
]


def open_vehicle(
    name: str,
    *,
    seed: int = 0,
    parameters: Mapping[str, float] | None = None,
    effects: Sequence[HiddenEffect] = (),
    model: FlownModel | None = None,
    names: str = "own",
) -> Server:
    """Return the MAVLink server of a new vehicle. The vehicle is at rest and just booted. *name* is in the table of
    vehicles, or is the path of a vehicle file.

    Parameters
    ----------
    seed : seed of the sensors' noise. The same seed and the same input bytes at the same times give the same output
        bytes.
    parameters : autopilot parameters set before boot.
    effects : hidden effects, in order.
    model : hull dynamics to fly instead of the vehicle's own (:func:`sitl.modelfile.read_model`).
    names : the firmware generation whose parameter names and units are used (``autopilot.parameter_dialect``).

    Raises
    ------
    UnknownVehicle
        There is no such vehicle. BadVehicle Its file is not valid. KeyError
        The firmware has no such parameter.
    UnknownGeneration
        There is no such firmware generation.
    BadEffect
        The vehicle has no place for an effect.
    BadModel
        The vehicle cannot fly the model.
    """
    data = load_vehicle(name)
    return Server(Vehicle(data, seed=seed, parameters=parameters, effects=effects, model=model, names=names))
