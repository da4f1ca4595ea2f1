"""A hull controlled by ArduPilot's own firmware, through its external-physics interface (``--model JSON``).

``wire`` is the data format. ``physics`` is the hull, with the data for ArduPilot's simulated sensors. ``firmware`` has
the parameters and the command line for ArduPilot, and ``serve`` the loop. The autopilot, sensor noise and clock are
ArduPilot's own. MAVLink is not used here.
"""

from sitl.ardupilot_json.command import add_options, run_json, write_parameters
from sitl.ardupilot_json.firmware import HOME, needed_parameters, parameter_text, start_commands
from sitl.ardupilot_json.physics import Physics
from sitl.ardupilot_json.serve import DEFAULT_PORT, JsonServer

__all__ = [
    "DEFAULT_PORT",
    "HOME",
    "JsonServer",
    "Physics",
    "add_options",
    "needed_parameters",
    "parameter_text",
    "run_json",
    "start_commands",
    "write_parameters",
]
