"""A hull under ArduPilot's own firmware, by its external-physics interface (``--model JSON``).

``wire`` is the format, ``physics`` the hull and what ArduPilot's simulated sensors need of it, ``firmware`` the
parameters and the command line ArduPilot needs, ``serve`` the loop. The autopilot, its sensors' noise and its clock
are ArduPilot's; nothing here speaks MAVLink.
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
