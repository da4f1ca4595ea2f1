"""MAVLink on the vehicle's side, without any input or output.

``server`` connects the parts. ``commands``, ``parameter_protocol`` and ``control`` process received messages.
``telemetry`` and ``streams`` create the messages to send.
"""

from __future__ import annotations

from sitl.mavlink.server import Server
from sitl.mavlink.signing import demand_signatures, read_key

__all__ = [
    "Server",
    "demand_signatures",
    "read_key",
]
