"""The available vehicles, and the loader of their data files.

A data file is TOML. Every number in it is a table ``{ value, unit, source }``. To add a vehicle, add a file in
``vehicles/`` and a line in :data:`VEHICLES`. A vehicle of your own is selected by the path of its file. ``like =
"NAME"`` copies missing values from a vehicle of the table.

With ``[sway]`` (inertia, drag, on vectored frames ``authority``) the vehicle can move sideways. ``[coupling]`` then
contains SNAME derivatives between surge, sway and yaw, and ``coriolis``: whether Coriolis forces follow from the
inertia. With ``[pitch]`` (inertia, drag, ``righting`` moment, ``authority`` of a frame with vertical thrusters fore and
aft) it oscillates in pitch. With ``[rangefinder]`` it faces a wall.
``[imu] [compass] [gps] [dvl] [pressure]`` are its instruments (:mod:`sitl.instruments`). With ``[filter]`` they have no
gyro, and the estimate changes at its rate (:mod:`sitl.estimator`).
``plant`` names the kind of body (``sitl/plants/table.py``). Without it, the vehicle is a planar hull. A
``rigid-body`` moves in each degree of freedom that has a heading, and ``[body]`` has its mass, weight and buoyancy.
With ``[thrusters]`` each thruster has its place and direction; ``[propeller]``, ``[motor]``, ``[thruster]`` and
``[rudder]`` add its parts (``sitl/plants/propulsion.py``). ``[heat]`` weakens hot motors, and ``[battery]`` weakens all
motors under load (``sitl/derating.py``). Without them, thrust depends on neither.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from gcs_autotune_files import Unreadable, read
from sitl.actuators import (
    FRAMES,
    PAIR,
    Actuators,
    Motor,
    RudderBoat,
    ThrustCurve,
    ThrusterFrame,
    ThrusterSet,
    TwinThrusterBoat,
    YawSchedule,
)
from sitl.derating import Derating
from sitl.effects import SURROUNDINGS, BadEffect, HiddenEffect, make_effect
from sitl.instruments import INSTRUMENTS, Instrument
from sitl.plants import RUDDER, TWIN_THRUSTER, Entries, Plant, make_plant, propeller_rows, thruster_count, values_of
from sitl.sensors import Rangefinder, SensorData
from sitl.setting import setting_of
from sitl.vehicle_file import verify_vehicle_tables

__all__ = ["VEHICLES", "BadVehicle", "UnknownVehicle", "VehicleData", "load_vehicle"]

VEHICLES: Mapping[str, str] = {
    "charlie": "charlie.toml",
    "videoray": "videoray.toml",
    "automarine": "automarine.toml",
    "falcon": "falcon.toml",
    "bluerov2": "bluerov2.toml",
    "bluerov2-loaded": "bluerov2_loaded.toml",
    "blueboat": "blueboat.toml",
    "videoray-coupled": "videoray_coupled.toml",
    "bluerov2-sway": "bluerov2_sway.toml",
    "blueboat-sway": "blueboat_sway.toml",
    "charlie-sway": "charlie_sway.toml",
    "cybership2": "cybership2.toml",
    "videoray-wall": "videoray_wall.toml",
    "videoray-lasers": "videoray_lasers.toml",
    "bluerov2-6dof": "bluerov2_6dof.toml",
    "bluerov2-standard": "bluerov2_standard.toml",
    "ies-rov": "ies_rov.toml",
    "tugboat": "tugboat.toml",
    "charlie-rudders": "charlie_rudders.toml",
    "bluerov2-nav": "bluerov2_nav.toml",
    "blueboat-nav": "blueboat_nav.toml",
    "launch": "launch.toml",
    "vectored-boat": "vectored_boat.toml",
    "charlie-sensors": "charlie_sensors.toml",
    "videoray-beams": "videoray_beams.toml",
}
"""Vehicle name -> name of its data file in ``vehicles/``."""

_FOLDER = Path(__file__).parent / "vehicles"
_FIRMWARE = ("rover", "sub")
_SHAPE = ("odd", "dead")
"""Entries of ``[thruster]`` that shape the thrust of each of ``[thrusters]``."""


class UnknownVehicle(KeyError):
    """Raised if there is no vehicle of that name; the message lists the nearest names."""

    def __init__(self, name: str) -> None:
        near = difflib.get_close_matches(name, VEHICLES, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(VEHICLES)}"
        super().__init__(f"unknown vehicle '{name}'; {hint}")

    def __str__(self) -> str:
        return str(self.args[0])


class BadVehicle(ValueError):
    """Raised for a file that does not describe a vehicle; the message states what is wrong."""


@dataclass(frozen=True, slots=True)
class VehicleData:
    """One vehicle's data file, with the numbers without their sources (SI, radians).

    ``parameters`` contains the autopilot parameters set by its owner; ``ready_time`` [s] is when the autopilot's
    estimates become good enough to arm.
    """

    name: str
    title: str
    firmware: str
    sensors: SensorData
    parameters: Mapping[str, float]
    up_delay: float
    down_delay: float
    ready_time: float
    tables: Mapping[str, Any]

    @property
    def is_boat(self) -> bool:
        """Whether the vehicle stays at the surface."""
        return str(self.tables["actuators"]) in (RUDDER, TWIN_THRUSTER)

    @property
    def mass(self) -> float:
        """Mass of the craft without added mass [kg], 0 if the file does not state it."""
        return float(values_of(self.tables.get("body", {})).get("mass", 0.0))

    def make_plant(self) -> Plant:
        """Return a new plant of the vehicle's kind, at its initial position and at rest."""
        return make_plant(self.tables)

    def make_rangefinder(self, seed: int) -> Rangefinder | None:
        """Return the rangefinder that faces a wall ahead, or None if the vehicle has none."""
        if "rangefinder" not in self.tables:
            return None
        at = values_of(self.tables["rangefinder"])
        heading = values_of(self.tables["start"])["heading"]
        return Rangefinder(
            at["wall"], heading, at["noise"], at["period"], seed, at.get("apart", 0.0), at.get("aside", 0.0)
        )

    @property
    def filter_model(self) -> Mapping[str, float]:
        """The filter of a vehicle whose compass replaces the gyro (:mod:`sitl.estimator`); else empty."""
        return values_of(self.tables.get("filter", {}))

    def make_instruments(self, seed: int) -> dict[str, Instrument]:
        """Return the instruments on board, by heading."""
        return {
            heading: kind(values_of(self.tables[heading]), seed)
            for heading, kind in INSTRUMENTS.items()
            if heading in self.tables
        }

    def make_actuators(self) -> Actuators:
        """Return the actuators that convert servo pulses into forces."""
        yaw, surge = values_of(self.tables["yaw"]), values_of(self.tables["surge"])
        if "thrusters" in self.tables:
            return self._make_thrusters()
        if self.tables["actuators"] == TWIN_THRUSTER:
            each = values_of(self.tables["thruster"])
            return TwinThrusterBoat(each["full_thrust"], each["astern"], each["arm"], yaw["bias"], 1, 3)
        if self.is_boat:
            columns = (np.atleast_1d(yaw[name]).tolist() for name in ("n2", "alpha", "beta"))
            rows = tuple(zip(*columns, strict=True))
            full_n = values_of(self.tables["propeller"])["full_n"]
            side = yaw.get("side_force", 0.0)
            return RudderBoat(
                YawSchedule(rows), yaw["full_rudder"], full_n, surge["authority"], yaw["bias"], 1, 3, side
            )
        heave = values_of(self.tables["heave"])
        motors = FRAMES[self.tables["actuators"]]
        full = (yaw["authority"], surge["authority"], heave["authority"])
        curve = self._make_curve()
        others = [values_of(self.tables.get(dof, {})).get("authority", 0.0) for dof in ("sway", "pitch")]
        if others[1] and not any(motor.M for motor in motors):
            raise ValueError(f"frame '{self.tables['actuators']}' has no pitch thrusters. Remove [pitch]")
        return ThrusterFrame(motors, *full, yaw["bias"], heave["bias"], curve, *others)

    @property
    def battery(self) -> Mapping[str, float]:
        """Voltage, internal resistance and full current of the file's battery; empty if it has none."""
        return values_of(self.tables.get("battery", {}))

    def make_derating(self, actuators: Actuators) -> Derating | None:
        """Return the losses of the motors of *actuators* by heat and battery, or None if the file has neither."""
        heat, battery = values_of(self.tables.get("heat", {})), self.battery
        if not heat and not battery:
            return None
        for name, values, needed in (
            ("heat", heat, ("time_constant", "rise", "limit", "loss")),
            ("battery", battery, ("voltage", "resistance")),
        ):
            lacking = [each for each in needed if values and each not in values]
            if lacking:
                raise ValueError(f"{name}: missing entry '{lacking[0]}'. Give {', '.join(needed)}")
        return Derating(actuators.motor_drive, heat, battery)

    def _make_curve(self) -> ThrustCurve | None:
        """Return the thrust of each thruster over its command, or None if the file does not shape it."""
        shape = {name: value for name, value in values_of(self.tables.get("thruster", {})).items() if name in _SHAPE}
        return ThrustCurve(**shape) if shape else None

    def _make_thrusters(self) -> ThrusterSet:
        """Return the thrusters with places of their own, and the rudders behind them."""
        headings = ("thrusters", "propeller", "motor", "rudder")
        parts = [values_of(self.tables.get(heading, Entries({}, heading))) for heading in headings]
        rudder = parts.pop()
        rows = propeller_rows(*parts)
        forces = {"surge": "X", "sway": "Y", "heave": "Z", "roll": "K", "pitch": "M", "yaw": "N"}
        biases = {force: values_of(self.tables.get(dof, {})).get("bias", 0.0) for dof, force in forces.items()}
        curve = self._make_curve()
        kind = self.tables["actuators"]
        if kind == RUDDER:
            steered = (1, rudder["full"], thruster_count(rudder))
            motors = len(rows) * (Motor(X=1.0 / len(rows)),)
            return ThrusterSet(motors, len(rows) * (3,), 500.0, rows, biases, curve=curve, rudder=steered)
        if kind == TWIN_THRUSTER:
            return ThrusterSet(PAIR, (1, 3), 500.0, rows, biases, curve=curve)
        return ThrusterSet(FRAMES[kind], range(1, len(rows) + 1), 400.0, rows, biases, curve=curve)

    def make_effects(self, full: Mapping[str, float] | None = None) -> tuple[HiddenEffect, ...]:
        """Return the effects of the file: slew and backlash of a rudder, and those of the surroundings.

        full : degree of freedom -> force or moment at full output; a sea in SI units needs it.
        """
        rudder = values_of(self.tables.get("rudder", {}))
        slugs = (("backlash", "backlash", "width"), ("slew", "rate-limit", "rate"))
        parts = (
            make_effect(slug, "N", {parameter: rudder[name] / rudder["full"]})
            for name, slug, parameter in slugs
            if name in rudder
        )
        there = (heading for heading in SURROUNDINGS if heading in self.tables)
        around = (make_effect(SURROUNDINGS[heading], "", values_of(self.tables[heading])) for heading in there)
        return (*parts, *around, *self._sea(full or {}), *self._pool())

    def _pool(self) -> Iterator[HiddenEffect]:
        """Yield the walls of ``[pool]``, around a craft that starts in its middle."""
        pool = values_of(self.tables.get("pool", {}))
        lacking = [name for name in ("length", "width") if pool and name not in pool]
        if lacking:
            raise ValueError(f"pool: missing entry '{lacking[0]}'. Give length and width")
        shared = {name: value for name, value in pool.items() if name in ("beam", "Y", "N")}
        for quarter, across in enumerate((("length", "width") * 2) if pool else ()):
            ahead = math.remainder(pool.get("direction", 0.0) + 0.5 * math.pi * quarter, math.tau)
            yield make_effect("bank-suction", "", {"direction": ahead, "distance": 0.5 * pool[across], **shared})

    def _sea(self, full: Mapping[str, float]) -> Iterator[HiddenEffect]:
        """Yield the force of ``[waves]`` in each degree of freedom for which it has one. They share one sea."""
        sea = values_of(self.tables.get("waves", {}))
        if sea and "frequency" not in sea:
            raise ValueError("waves: missing entry 'frequency'")
        for force, dof in (("X", "surge"), ("Y", "sway"), ("Z", "heave"), ("N", "yaw")):
            size, drift = sea.get(force, 0.0) / full.get(dof, 1.0), sea.get(f"drift_{force}", 0.0) / full.get(dof, 1.0)
            if size or drift:
                values: dict[str, float] = {"amplitude": size, "drift": drift, "gamma": 3.3}
                values |= {name: sea[name] for name in ("frequency", "direction", "gamma") if name in sea}
                yield make_effect("wave-disturbance", dof, values)


def _verify_surroundings(data: VehicleData) -> None:
    """Raise ``ValueError`` with the heading of the file if *data* has surroundings that its craft cannot be in."""
    headings = {**SURROUNDINGS, "waves": "wave-disturbance", "pool": "bank-suction"}
    if not set(headings) & set(data.tables):
        return
    plant, actuators = data.make_plant(), data.make_actuators()
    actuators.attach(plant)
    setting = setting_of(plant, actuators, is_boat=data.is_boat, mass=data.mass, seed="0")
    try:
        for effect in data.make_effects(actuators.full):
            effect.begin(setting)
    except BadEffect as error:
        found = ((h, s) for h, s in headings.items() if h in data.tables and str(error).startswith(s))
        heading, slug = next(found, ("", ""))
        raise ValueError(heading + str(error).removeprefix(slug)) from error


def _verify_kinds(tables: Mapping[str, Any]) -> None:
    """Raise ``ValueError`` if the file names a kind that does not exist, or has entries that act on nothing."""
    for name, kinds in (("firmware", _FIRMWARE), ("actuators", (RUDDER, TWIN_THRUSTER, *FRAMES))):
        if tables[name] not in kinds:
            raise ValueError(f"{name}: there is no '{tables[name]}'. Use one of {', '.join(kinds)}")
    if "rudder" in tables and tables["actuators"] != RUDDER:
        raise ValueError(
            f"rudder: actuators '{tables['actuators']}' have no rudder. Use '{RUDDER}', or remove [rudder]"
        )
    shaped = [name for name in _SHAPE if name in tables.get("thruster", {})]
    if shaped and tables["actuators"] in (RUDDER, TWIN_THRUSTER) and "thrusters" not in tables:
        raise ValueError(
            f"thruster: {shaped[0]} is the curve of [thrusters], which this boat does not have. Add [thrusters], or "
            "use --effect quadratic-actuator or dead-zone"
        )


def load_vehicle(name: str) -> VehicleData:
    """Return the data of the vehicle called *name*, or of the file (``.toml``) whose path is *name*.

    Raises
    ------
    UnknownVehicle
        There is no such vehicle; the message states the nearest names.
    BadVehicle
        The file cannot be read, or a required entry is missing.
    """
    if name in VEHICLES:
        return _read(name, _FOLDER / VEHICLES[name])
    if not name.endswith(".toml"):
        raise UnknownVehicle(name)
    try:
        data = _read(Path(name).stem, Path(name))
        _verify_kinds(data.tables)
        data.make_plant()
        data.make_derating(data.make_actuators())
        _verify_surroundings(data)
        data.make_instruments(0)
        data.make_rangefinder(0)
    except Unreadable as error:
        raise BadVehicle(f"the vehicle file {name} cannot be read: {error}") from error
    except KeyError as error:
        heading, _, entry = str(error.args[0]).rpartition(".")
        lacking = f"{heading + ': ' if heading else ''}missing entry '{entry}'"
        raise BadVehicle(f"{name} is not a vehicle file: {lacking}. Start with a copy of one in {_FOLDER}") from error
    except (ValueError, TypeError, ArithmeticError) as error:
        raise BadVehicle(f"{name} is not a vehicle file: {error}") from error
    return data


def _tables(path: Path) -> dict[str, Any]:
    """Return the tables of a file, completed from the vehicle that it is ``like``."""
    own = read(path, "toml")
    name = own.get("like")
    if isinstance(name, str) and name not in VEHICLES:
        raise ValueError(f"like: {UnknownVehicle(name)}")
    tables = _tables(_FOLDER / VEHICLES[name]) if isinstance(name, str) else Entries({})
    for heading, table in own.items():
        tables[heading] = Entries({**tables.get(heading, {}), **table}, heading) if isinstance(table, dict) else table
    tables.pop("like", None)
    verify_vehicle_tables(own, tables)
    return tables


def _read(name: str, path: Path) -> VehicleData:
    tables = _tables(path)
    sensors, link = values_of(tables["sensors"]), values_of(tables["link"])
    return VehicleData(
        name=name,
        title=tables["title"],
        firmware=tables["firmware"],
        sensors=SensorData(**{field.name: sensors[field.name] for field in fields(SensorData)}),
        parameters=values_of(tables["parameters"]),
        up_delay=link["up_delay"],
        down_delay=link["down_delay"],
        ready_time=values_of(tables["start"])["ready_time"],
        tables=tables,
    )
