"""MAVLink on the vehicle's side, without any input or output.

``server`` joins it together; ``commands``, ``parameter_protocol`` and ``control`` handle what comes in,
``telemetry``, ``pid_tuning`` and ``streams`` make what goes out.
"""

from __future__ import annotations

from sitl.mavlink.server import Server
from sitl.mavlink.signing import demand_signatures, read_key

__all__ = [
    "Server",
    "demand_signatures",
    "read_key",
]
