"""Parameters and command line with which ArduPilot's outputs drive this hull."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sitl.ardupilot_json.serve import DEFAULT_PORT
from sitl.catalogue import VehicleData

__all__ = ["HOME", "needed_parameters", "parameter_text", "start_commands"]

_INSTANCE_STEP = 10
_BINARY = {"rover": "ardurover", "sub": "ardusub"}
HOME = "44.4000,8.9200,0,0"
"""Value of --home: latitude, longitude, altitude [m], heading.

The position off Genoa, the home of the boat Charlie, is a project choice. The altitude must be 0, because ArduPilot's
simulated water pressure starts at altitude 0.
"""
_RATE = {"rover": 200, "sub": 400}
"""Value of --rate [Hz], at least SCHED_LOOP_RATE (Rover 50, Sub 400)."""

_SENSORS: Mapping[str, float] = {
    **{f"INS_ACC{n}OFFS_{axis}": 0.001 for n in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{n}SCAL_{axis}": 1.001 for n in ("", "2") for axis in "XYZ"},
    **{
        f"COMPASS_OFS{n}_{axis}": value for n in ("", "2", "3") for axis, value in zip("XYZ", (5, 13, -18), strict=True)
    },
    "BATT_MONITOR": 4,
    "BATT_CAPACITY": 30000,
}
"""Parameters that differ from the defaults.

With these, ArduPilot treats its simulated accelerometers as calibrated, and knows the offsets of its simulated
magnetometers. The default simulated battery (3.3 Ah at 50 A of full throttle) would be empty after five minutes of an
experiment at Charlie's cruise.
"""
_OUTPUTS: Mapping[str, float] = {
    f"SERVO{n}_{key}": value for n in (1, 3) for key, value in (("MIN", 1000), ("MAX", 2000), ("TRIM", 1500))
}
_BOAT: Mapping[str, float] = {
    "FRAME_CLASS": 2,
    "RC1_MIN": 1000,
    "RC1_MAX": 2000,
    "RC3_MIN": 1000,
    "RC3_MAX": 2000,
    **_OUTPUTS,
}
_ROV: Mapping[str, float] = {
    **{f"INS_ACC3OFFS_{axis}": 0.0 for axis in "XYZ"},
    **{f"INS_ACC3SCAL_{axis}": 1.0 for axis in "XYZ"},
    "BARO_EXT_BUS": 1,
    "BARO_SPEC_GRAV": 1.024,
    "SIM_BARO_RND": 0.02,
    "BTN0_FUNCTION": 0,
    "BTN11_FUNCTION": 42,
    "BTN12_FUNCTION": 43,
}
"""Parameters of an ROV: the third simulated accelerometer is ideal, the pressure sensor is outside in salt water, and
two joystick buttons change the gain."""
_BY_ACTUATORS: Mapping[str, Mapping[str, float]] = {
    "rudder": {**_BOAT, "SERVO1_FUNCTION": 26, "SERVO3_FUNCTION": 70},
    "twin-thruster": {**_BOAT, "SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 74},
    "vectored": {**_ROV, "FRAME_CONFIG": 1},
    "vectored-6dof": {**_ROV, "FRAME_CONFIG": 2},
    "vectored-6dof-90": {**_ROV, "FRAME_CONFIG": 3},
    "simple-rov-3": {**_ROV, "FRAME_CONFIG": 4, "BATT_MONITOR": 0},
    "simple-rov-5": {**_ROV, "FRAME_CONFIG": 5, "BATT_MONITOR": 0},
    "rov-4-fore-aft": {**_ROV, "FRAME_CONFIG": 5, "BATT_MONITOR": 0},
    "bluerov1": {**_ROV, "FRAME_CONFIG": 0},
    "ies-rov": {**_ROV, "FRAME_CONFIG": 6, "BATT_MONITOR": 0},
}
"""The vehicle file's ``actuators`` -> parameters.

ArduPilot's simulated battery always feeds six thrusters. An output without a pulse takes 45 A, so a frame with fewer
thrusters would empty it within minutes. Therefore such a frame has no simulated battery.
"""


_RANGEFINDER_SITL = 100
_EIGHTH = 0.25 * math.pi
"""Step of RNGFNDn_ORIENT [rad]; its values 0 to 7 are the yaw of a rangefinder."""


def _rangefinders(data: VehicleData) -> dict[str, float]:
    """Return the parameters of the rangefinders on board: simulated, and their orientation."""
    finder = data.make_rangefinder(0)
    parameters: dict[str, float] = {}
    for n, yaw in enumerate(() if finder is None else finder.yaws, start=1):
        parameters |= {f"RNGFND{n}_TYPE": _RANGEFINDER_SITL, f"RNGFND{n}_ORIENT": round(yaw / _EIGHTH) % 8}
    return parameters


def needed_parameters(data: VehicleData) -> dict[str, float]:
    """Return name -> value of the parameters that ArduPilot needs for the vehicle of *data*, including those set by its
    owner.
    """
    return {**_SENSORS, **_BY_ACTUATORS[str(data.tables["actuators"])], **_rangefinders(data), **data.parameters}


def parameter_text(data: VehicleData) -> str:
    """Return the parameters as the text of a file for ``--defaults``, one ``NAME VALUE`` per line."""
    lines = (f"{name} {value:.9g}" for name, value in needed_parameters(data).items())
    return f"# {data.title}\n" + "\n".join(lines) + "\n"


def start_commands(data: VehicleData, port: int, parameter_file: str, *, host: str = "127.0.0.1") -> str:
    """Return the command lines that start ArduPilot with the hull served on UDP port *port*."""
    instance, rest = divmod(port - DEFAULT_PORT, _INSTANCE_STEP)
    numbered = rest == 0 and instance >= 0
    where = f"-I {instance}" if numbered else f"--sim-port-out {port}"
    calls = 14550 + (_INSTANCE_STEP * instance if numbered else 0)
    return (
        f"{_BINARY[data.firmware]} --model JSON:{host} {where} --rate {_RATE[data.firmware]} --speedup 1 "
        f"--home {HOME} --defaults {parameter_file} --serial0 udpclient:127.0.0.1:{calls}"
    )
