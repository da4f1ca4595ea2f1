"""The available vehicles, and the loader of their data files.

A data file is TOML. Every number in it is a table ``{ value, unit, source }``. To add a vehicle, add a file in
``vehicles/`` and a line in :data:`VEHICLES`. A vehicle of your own is selected by the path of its file. ``like =
"NAME"`` copies missing values from a vehicle of the table.

With ``[sway]`` (inertia, drag, on vectored frames ``authority``) the vehicle can move sideways. ``[coupling]`` then
contains SNAME derivatives between surge, sway and yaw, and ``coriolis``: whether Coriolis forces follow from the
inertia. With ``[pitch]`` (inertia, drag, ``righting`` moment, ``authority`` of a frame with vertical thrusters fore and
aft) it oscillates in pitch. With ``[rangefinder]`` it faces a wall.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from gcs_autotune_files import Unreadable, read
from sitl.actuators import (
    FRAMES,
    Actuators,
    RudderBoat,
    ThrustCurve,
    ThrusterFrame,
    TwinThrusterBoat,
    YawSchedule,
)
from sitl.plants import AxisDynamics, Coupling, PlanarHull, Water, coupling_of
from sitl.sensors import Rangefinder, SensorData
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
}
"""Name -> data file in ``vehicles/``."""

_FOLDER = Path(__file__).parent / "vehicles"
_RUDDER, _TWIN = "rudder", "twin-thruster"
_FIRMWARE = ("rover", "sub")


class UnknownVehicle(KeyError):
    """Raised if there is no vehicle of that name; the message lists the nearest ones."""

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
        """Whether it stays at the surface."""
        return str(self.tables["actuators"]) in (_RUDDER, _TWIN)

    def make_plant(self) -> PlanarHull:
        """Return a new hull at its initial position, at rest."""
        start = _values(self.tables["start"])
        water = Water(bottom=start["bottom"], floats=self.is_boat)
        by_propeller = self.tables["actuators"] == _RUDDER
        yaw = AxisDynamics(1.0, 0.0, 0.0) if by_propeller else _axis(self.tables["yaw"])
        heave = AxisDynamics(1.0, 0.0, 0.0) if self.is_boat else _axis(self.tables["heave"])
        sways, pitches = "sway" in self.tables, "pitch" in self.tables
        hull = PlanarHull(
            _axis(self.tables["surge"]),
            heave,
            yaw,
            water,
            sway=_axis(self.tables["sway"]) if sways else None,
            coupling=self._coupling() if sways else None,
            pitch=_axis(self.tables["pitch"]) if pitches else None,
            righting=_values(self.tables["pitch"])["righting"] if pitches else 0.0,
        )
        hull.state.z, hull.state.psi = start["depth"], start["heading"]
        return hull

    def make_rangefinder(self, seed: int) -> Rangefinder | None:
        """Return the rangefinder that faces a wall ahead, or None."""
        if "rangefinder" not in self.tables:
            return None
        at = _values(self.tables["rangefinder"])
        heading = _values(self.tables["start"])["heading"]
        return Rangefinder(at["wall"], heading, at["noise"], at["period"], seed, at.get("apart", 0.0))

    def _coupling(self) -> Coupling:
        derivatives = _values(self.tables["coupling"])
        coriolis = bool(derivatives.pop("coriolis"))
        return coupling_of(derivatives, coriolis=coriolis)

    def make_actuators(self) -> Actuators:
        """Return the actuators that convert servo pulses into forces."""
        yaw, surge = _values(self.tables["yaw"]), _values(self.tables["surge"])
        if self.tables["actuators"] == _TWIN:
            each = _values(self.tables["thruster"])
            return TwinThrusterBoat(each["full_thrust"], each["astern"], each["arm"], yaw["bias"], 1, 3)
        if self.is_boat:
            rows = tuple(zip(yaw["n2"], yaw["alpha"], yaw["beta"], strict=True))
            full_n = _values(self.tables["propeller"])["full_n"]
            side = yaw.get("side_force", 0.0)
            return RudderBoat(
                YawSchedule(rows), yaw["full_rudder"], full_n, surge["authority"], yaw["bias"], 1, 3, side
            )
        heave = _values(self.tables["heave"])
        motors = FRAMES[self.tables["actuators"]]
        full = (yaw["authority"], surge["authority"], heave["authority"])
        curve = ThrustCurve(**_values(self.tables["thruster"])) if "thruster" in self.tables else None
        others = [_values(self.tables.get(dof, {})).get("authority", 0.0) for dof in ("sway", "pitch")]
        if others[1] and not any(motor.M for motor in motors):
            raise ValueError(f"frame '{self.tables['actuators']}' has no pitch thrusters. Remove [pitch]")
        return ThrusterFrame(motors, *full, yaw["bias"], heave["bias"], curve, *others)


def _values(table: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {name: entry["value"] for name, entry in table.items()}


def _axis(table: Mapping[str, Mapping[str, Any]]) -> AxisDynamics:
    values = _values(table)
    return AxisDynamics(values["alpha"], values["beta"], values["beta2"])


def load_vehicle(name: str) -> VehicleData:
    """Return the data of the vehicle called *name*, or of the file (``.toml``) whose path is *name*.

    Raises
    ------
    UnknownVehicle
        There is no such vehicle; the message states the nearest names.
    BadVehicle
        The file cannot be read, or lacks something.
    """
    if name in VEHICLES:
        return _read(name, _FOLDER / VEHICLES[name])
    if not name.endswith(".toml"):
        raise UnknownVehicle(name)
    try:
        data = _read(Path(name).stem, Path(name))
        data.make_plant()
        data.make_actuators()
    except Unreadable as error:
        raise BadVehicle(f"the vehicle file {name} cannot be read: {error}") from error
    except KeyError as error:
        raise BadVehicle(f"the vehicle file {name} lacks {error}. Start with a copy of one in {_FOLDER}") from error
    except (ValueError, TypeError, ArithmeticError) as error:
        raise BadVehicle(f"{name} is not a vehicle file: {error}") from error
    if data.firmware not in _FIRMWARE:
        raise BadVehicle(f"the vehicle file {name} has firmware '{data.firmware}'. Use one of {', '.join(_FIRMWARE)}")
    return data


def _tables(path: Path) -> dict[str, Any]:
    """Return the tables of a file, completed from the vehicle that it is ``like``."""
    own = read(path, "toml")
    name = own.get("like")
    if isinstance(name, str) and name not in VEHICLES:
        raise ValueError(str(UnknownVehicle(name)))
    tables = _tables(_FOLDER / VEHICLES[name]) if isinstance(name, str) else {}
    for heading, table in own.items():
        tables[heading] = {**tables.get(heading, {}), **table} if isinstance(table, dict) else table
    tables.pop("like", None)
    verify_vehicle_tables(own, tables)
    return tables


def _read(name: str, path: Path) -> VehicleData:
    tables = _tables(path)
    sensors, link = _values(tables["sensors"]), _values(tables["link"])
    return VehicleData(
        name=name,
        title=tables["title"],
        firmware=tables["firmware"],
        sensors=SensorData(**{field.name: sensors[field.name] for field in fields(SensorData)}),
        parameters=_values(tables["parameters"]),
        up_delay=link["up_delay"],
        down_delay=link["down_delay"],
        ready_time=_values(tables["start"])["ready_time"],
        tables=tables,
    )
