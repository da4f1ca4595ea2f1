"""The schema of vehicle files: names, units and ranges of their numbers.

Every number is a table ``{ value, unit, source }``. All values are SI and radians. So the unit must be the one in the
table here, or ``SI``. A file with another unit is rejected.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, defstruct

from gcs_autotune_files import clipped, conform, shown
from sitl.effects import EFFECTS, SURROUNDINGS

__all__ = ["HEADINGS", "VehicleFile", "verify_entries", "verify_vehicle_tables"]


@dataclass(frozen=True, slots=True)
class Range:
    """Permitted units of a number in a vehicle file, its permitted range, and whether it may be a list (a schedule)."""

    units: tuple[str, ...]
    least: float = -1e9
    most: float = 1e9
    above: bool = False
    listed: bool = False

    @property
    def form(self) -> Any:
        """Python type that the value must have: a number, or either a number or a list."""
        one: Any = Annotated[
            float, Meta(gt=self.least, le=self.most) if self.above else Meta(ge=self.least, le=self.most)
        ]
        return one | Annotated[list[one], Meta(min_length=1, max_length=100)] if self.listed else one


def _axis_rows(units: tuple[str, ...], *, listed: bool = False) -> dict[str, Range]:
    inertia, linear, square, force = (tuple(each.split(", ")) for each in units)
    return {
        "alpha": Range(inertia, 0.0, above=True, listed=listed),
        "beta": Range(linear, listed=listed),
        "beta2": Range(square, 0.0),
        "authority": Range(force, 0.0),
        "bias": Range(force),
    }


def _noise(unit: str) -> Range:
    return Range((unit,), 0.0, 100.0)


_STRAIGHT = _axis_rows(("kg", "N s/m", "N s^2/m^2", "N"))
_TURNING = ("kg m^2", "N m s", "N m s^2", "N m")
_STEERED = ("kg m^2, s^2, normalised", "N m s, s, normalised", "N m s^2, normalised", "N m, rad, normalised")


def _instrument(unit: str, **more: Range) -> dict[str, Range]:
    """Return the entries of an instrument's heading, which measures in *unit*, and those that only it has."""
    return {
        "rate": Range(("Hz",), 0.0, 1000.0, above=True),
        "lag": Range(("s",), 0.0, 10.0),
        "noise": _noise(unit),
        **{name: Range(("m",), -100.0, 100.0) for name in "xyz"},
        **{name: Range(("s",), 0.0, 1e5) for name in ("lost_every", "lost_for")},
        **more,
    }


_TURN, _WAYS = 2.0 * math.pi, ("ahead", "astern")

HEADINGS: Mapping[str, Mapping[str, Range]] = {
    "surge": _STRAIGHT,
    "sway": _STRAIGHT,
    "heave": _STRAIGHT,
    "yaw": {
        **_axis_rows(_STEERED, listed=True),
        "n2": Range(("V^2",), 0.0, above=True, listed=True),
        "full_rudder": Range(("rad",), 0.0, math.pi / 2.0, above=True),
        "side_force": Range(("N/rad",)),
    },
    "roll": _axis_rows(_TURNING),
    "pitch": {**_axis_rows(_TURNING), "righting": Range(("N m/rad", "N m"), 0.0)},
    "body": {
        "mass": Range(("kg",), 0.0, above=True),
        **{name: Range(("m",), -1e3, 1e3) for name in ("x_G", "y_G", "z_G", "x_B", "y_B", "z_B")},
        **{name: Range(("kg m^2",)) for name in ("I_xy", "I_xz", "I_yz")},
        "weight": Range(("N",), 0.0),
        "buoyancy": Range(("N",), 0.0),
        "waterplane": Range(("N/m",), 0.0),
        "righting_roll": Range(("N m/rad", "N m"), 0.0),
        "righting_pitch": Range(("N m/rad", "N m"), 0.0),
    },
    "thrusters": {
        **{name: Range(("m",), -1e3, 1e3, listed=True) for name in "xyz"},
        "azimuth": Range(("rad",), -_TURN, _TURN, listed=True),
        "dip": Range(("rad",), -_TURN, _TURN, listed=True),
        "hand": Range(("1",), -1.0, 1.0, listed=True),
        **{f"a_{way}": Range(("N s^2", "N", "N/V^2"), 0.0, listed=True) for way in _WAYS},
        **{f"b_{way}": Range(("N s", "N", "N/V"), listed=True) for way in _WAYS},
        **{f"advance_{way}": Range(("N s^2/m", "N s/m"), 0.0, listed=True) for way in _WAYS},
        "torque": Range(("N m s^2", "N m"), 0.0, listed=True),
        "torque_advance": Range(("N s^2", "N s"), 0.0, listed=True),
        "wake": Range(("1",), 0.0, 1.0, listed=True),
        "full_n": Range(("1/s", "1", "V"), 0.0, above=True, listed=True),
    },
    "thruster": {
        "full_thrust": Range(("N",), 0.0, above=True),
        "astern": Range(("1",), 0.0, 10.0),
        "arm": Range(("m",), 0.0, 100.0),
        "odd": Range(("N", "1"), listed=True),
        "dead": Range(("1",), 0.0, 0.99),
    },
    "propeller": {
        "full_n": Range(("V", "1/s", "rad/s"), 0.0, above=True),
        "density": Range(("kg/m^3",), 1.0, 2000.0),
        "diameter": Range(("m",), 0.0, 100.0, above=True),
        "K_T0": Range(("1",), 0.0, 10.0, above=True),
        "K_TJ": Range(("1",), -10.0, 0.0),
        "K_Q0": Range(("1",), 0.0, 10.0),
        "K_QJ": Range(("1",), -10.0, 0.0),
        "astern": Range(("1",), 0.0, 10.0),
    },
    "motor": {
        "time_constant": Range(("s",), 1e-3, 60.0),
        "inertia": Range(("kg m^2",), 1e-9, 1e6),
        "constant": Range(("N m/A", "V s"), 1e-6, 1e6),
        "resistance": Range(("ohm",), 1e-6, 1e6),
        "voltage": Range(("V",), 0.0, 1e5, above=True),
        "friction": Range(("N m s",), 0.0),
        "most_current": Range(("A",), 0.0, 1e6, above=True),
    },
    "heat": {
        "time_constant": Range(("s",), 0.1, 1e5),
        "rise": Range(("K",), 0.0, 1e3, above=True),
        "limit": Range(("K",), 0.0, 1e3),
        "loss": Range(("1/K",), 0.0, 1.0),
    },
    "battery": {
        "voltage": Range(("V",), 0.0, 1e4, above=True),
        "resistance": Range(("ohm",), 0.0, 1e3),
        "full_current": Range(("A",), 0.0, 1e4, above=True),
    },
    "rudder": {
        "x": Range(("m",), -1e3, 1e3, listed=True),
        "y": Range(("m",), -1e3, 1e3, listed=True),
        "coefficient": Range(("N s^2/m^2",), 0.0),
        "stall": Range(("rad",), 0.0, _TURN, above=True),
        "C_T": Range(("m^2/(N s^2)",), 0.0),
        "wake": Range(("1",), 0.0, 1.0),
        "flow": Range(("1",), 0.0, 1.0),
        "full": Range(("rad",), 0.0, math.pi / 2.0, above=True),
        "slew": Range(("rad/s",), 0.0, 1e3, above=True),
        "backlash": Range(("rad",), 0.0, math.pi / 2.0),
    },
    "sensors": {
        "heading_noise": _noise("rad"),
        "heading_quantum": _noise("rad"),
        "gyro_noise": _noise("rad/s"),
        "tilt_noise": _noise("rad"),
        "speed_noise": _noise("m/s"),
        "position_noise": _noise("m"),
        "depth_noise": _noise("m"),
        "climb_noise": _noise("m/s"),
        "acceleration_noise": _noise("m/s^2"),
    },
    "imu": _instrument(
        "m/s^2",
        gyro_noise=_noise("rad/s"),
        **{f"bias_{axis}": Range(("m/s^2",), -20.0, 20.0) for axis in "xyz"},
        **{f"gyro_bias_{axis}": Range(("rad/s",), -10.0, 10.0) for axis in "xyz"},
    ),
    "compass": _instrument(
        "rad",
        quantum=_noise("rad"),
        **{f"iron_{axis}": Range(("1",), -0.9, 0.9) for axis in "xy"},
        **{f"current_{axis}": Range(("1/A",), -0.1, 0.1) for axis in "xy"},
    ),
    "gps": _instrument(
        "m",
        speed_noise=_noise("m/s"),
        jump=_noise("m"),
        **{name: Range(("s",), 0.0, 1e5) for name in ("jump_every", "jump_for")},
    ),
    "dvl": _instrument("m/s"),
    "pressure": _instrument("m", bias=Range(("m",), -100.0, 100.0)),
    "filter": {
        "rate": Range(("Hz",), 0.0, 1000.0, above=True),
        "time_constant": Range(("s",), 1e-3, 1e3),
        "gain": Range(("rad/s",), -_TURN, _TURN),
    },
    "link": {"up_delay": Range(("s",), 0.0, 60.0), "down_delay": Range(("s",), 0.0, 60.0)},
    "start": {
        "heading": Range(("rad",), -2.0 * math.pi, 2.0 * math.pi),
        "depth": Range(("m",), 0.0, 12000.0),
        "bottom": Range(("m",), 0.0, 12000.0, above=True),
        "ready_time": Range(("s",), 0.0, 3600.0),
    },
    "rangefinder": {
        "wall": Range(("m",), 0.0, 1e5),
        "noise": _noise("m"),
        "period": Range(("s",), 0.0, 60.0, above=True),
        "apart": Range(("m",), 0.0, 10.0),
        "aside": Range(("rad",), 0.0, math.pi / 3.0),
    },
    "pool": {
        **{name: Range(("m",), 0.001, 1e5) for name in ("length", "width")},
        "beam": Range(("m",), 0.0, 1e3),
        "direction": Range(("rad",), -10.0, 10.0),
        "Y": Range(("N s^2/m",), 0.0),
        "N": Range(("N s^2",)),
    },
    "waves": {
        **{force: Range(("N",), 0.0) for force in ("X", "Y", "Z", "drift_X", "drift_Y")},
        "N": Range(("N m",), 0.0),
        "frequency": Range(("rad/s",), 1e-6, 100.0),
        "gamma": Range(("1",), 0.0, 10.0, above=True),
        "direction": Range(("rad",), -10.0, 10.0),
    },
    **{
        heading: {p.name: Range((p.unit,), max(p.least, -1e9), min(p.most, 1e9)) for p in EFFECTS[slug].parameters}
        for heading, slug in SURROUNDINGS.items()
    },
}
"""Heading of a vehicle file -> name of a number -> its permitted units and range.

Ranges are wide enough for any craft and narrow enough to detect a typing error. Project choice.
"""


_PARAMETER = "^[A-Za-z_][A-Za-z0-9_]{0,15}$"


class ParameterEntry(Struct, forbid_unknown_fields=True, frozen=True):
    """An autopilot parameter in a vehicle file."""

    value: Annotated[float, Meta(ge=-3.5e38, le=3.5e38)]
    unit: str
    source: str


class Derivative(Struct, forbid_unknown_fields=True, frozen=True):
    """A SNAME derivative of the hull in a vehicle file, or ``coriolis``, which is true or false."""

    value: bool | Annotated[float, Meta(ge=-1e9, le=1e9)]
    unit: str
    source: str


def _struct(heading: str, rows: Mapping[str, Range]) -> type[Struct]:
    entries = []
    for name, row in rows.items():
        units = Literal[(*row.units, "SI")]  # type: ignore[valid-type]
        parts = [("value", row.form), ("unit", units), ("source", str)]
        entry: Any = defstruct(f"{heading}_{name}", parts, forbid_unknown_fields=True, frozen=True)
        entries.append((name, entry | None, None))
    return defstruct(heading.title(), entries, forbid_unknown_fields=True, frozen=True)


VehicleFile: type[Struct] = defstruct(
    "VehicleFile",
    [
        ("title", Annotated[str, Meta(min_length=1, max_length=200)] | None, None),
        *((name, str | None, None) for name in ("firmware", "actuators", "plant", "like")),
        *((heading, _struct(heading, rows) | None, None) for heading, rows in HEADINGS.items()),
        ("parameters", dict[Annotated[str, Meta(pattern=_PARAMETER)], ParameterEntry], {}),
        ("coupling", dict[Annotated[str, Meta(max_length=20)], Derivative], {}),
    ],
    forbid_unknown_fields=True,
    frozen=True,
)
"""A vehicle file, or the changes relative to the vehicle that it is ``like``."""


def verify_vehicle_tables(own: Any, tables: Mapping[str, Any]) -> None:
    """Verify that a file (*own*) matches the schema, and that its vehicle (*tables*, complete) is consistent.

    Raises
    ------
    ValueError
        The file does not match the schema or is inconsistent; the message states where.
    """
    verify_entries(own)
    if not isinstance(tables.get("title"), str):
        raise ValueError("missing entry 'title'")
    for heading in ("surge", "sway", "heave", "roll", "pitch", "yaw"):
        entries = tables.get(heading, {})
        linear = entries.get("beta", {}).get("value", 0.0)
        if (
            min(linear if isinstance(linear, list) else [linear], default=0.0) < 0.0
            and not entries["beta2"]["value"] > 0.0
        ):
            raise ValueError(f"{heading}: negative drag is unstable. Use beta of 0 or more, or beta2 above 0")
    _verify_schedule(tables)
    odd = tables.get("thruster", {}).get("odd", {}).get("value")
    if odd is not None and not sum(odd if isinstance(odd, list) else [odd]) > 0.0:
        raise ValueError(
            "thruster.odd: the coefficients add up to the thrust at full command, so their sum must be above 0"
        )
    for name, entry in tables.get("coupling", {}).items():
        if isinstance(entry["value"], bool) != (name == "coriolis"):
            raise ValueError(f"coupling.{name}: not valid. coriolis must be true or false, every other entry a number")
    start = tables.get("start", {})
    if start and not start["depth"]["value"] < start["bottom"]["value"]:
        raise ValueError("start: the depth must be above the bottom. Use a smaller depth")


def _verify_schedule(tables: Mapping[str, Any]) -> None:
    """Verify that the tables over the propeller's speed are of one length and rising in it, and that only a rudder
    without thrusters of its own has them.
    """
    yaw, steered = tables.get("yaw", {}), tables.get("actuators") == "rudder" and "thrusters" not in tables
    values = {name: yaw[name]["value"] for name in ("n2", "alpha", "beta") if name in yaw}
    n2 = values.pop("n2", 0.0)
    for name, value in values.items():
        if steered and _size(value) != _size(n2):
            raise ValueError(f"yaw.{name}: {_size(value)} values for {_size(n2)} values of n2. Give one for each")
        if not steered and isinstance(value, list):
            raise ValueError(f"yaw.{name}: expected a number, got a list. Only a rudder without [thrusters] has lists")
    for low, high in itertools.pairwise(n2 if isinstance(n2, list) else []):
        if not low < high:
            raise ValueError(f"yaw.n2: {high:g} after {low:g}. Sort the table so that n2 rises")


def _size(value: Any) -> int:
    return len(value) if isinstance(value, list) else 1


def verify_entries(own: Any) -> None:
    """Verify that the entries of a file (*own*) match the schema, each by itself.

    Raises
    ------
    ValueError
        One does not; the message begins with its place.
    """
    _verify_units(own)
    parameters = own.get("parameters")
    for name in parameters if isinstance(parameters, dict) else ():
        if not re.match(_PARAMETER, name):
            raise ValueError(f"parameters.{clipped(name)}: not valid. A name has at most 16 letters, digits and _")
    conform(own, VehicleFile)


def _verify_units(own: Any) -> None:
    for heading, rows in HEADINGS.items():
        table = own.get(heading)
        for name, entry in table.items() if isinstance(table, dict) else ():
            unit = entry.get("unit") if isinstance(entry, dict) else None
            if name in rows and isinstance(unit, str) and unit not in (*rows[name].units, "SI"):
                raise ValueError(f"{heading}.{name} is in {shown(unit)}. Use {' or '.join(rows[name].units)}")
