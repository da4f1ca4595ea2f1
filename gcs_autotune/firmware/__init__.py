"""Names in each autopilot firmware: modes, channels, loops, parameters. Data only, without I/O.

To add a firmware, add a file with a :class:`Firmware` and a line in :data:`FIRMWARE`.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.firmware import ardurover, ardusub
from gcs_autotune.firmware.aliases import ALIASES, Alias
from gcs_autotune.firmware.failsafe import DISARMS, Failsafe, SetFailsafe
from gcs_autotune.firmware.fixed_outputs import Outputs, with_outputs
from gcs_autotune.firmware.names import Names, read_named
from gcs_autotune.firmware.profile import Axis, Firmware, Gain, Unsuited
from gcs_autotune.firmware.servo import LEVELLING, Output, ParameterSource, ServoMap, read_servo_map
from gcs_autotune.firmware.values import checked, checked_all

__all__ = [
    "ALIASES",
    "DISARMS",
    "FIRMWARE",
    "LEVELLING",
    "Alias",
    "Axis",
    "Failsafe",
    "Firmware",
    "Gain",
    "Names",
    "Output",
    "Outputs",
    "ParameterSource",
    "ServoMap",
    "SetFailsafe",
    "Unsuited",
    "checked",
    "checked_all",
    "firmware_for",
    "read_named",
    "read_servo_map",
    "with_outputs",
]

FIRMWARE: Mapping[str, Firmware] = {
    "ardurover": ardurover.FIRMWARE,
    "ardusub": ardusub.FIRMWARE,
}
"""Name -> firmware profile."""


def firmware_for(autopilot: int, vehicle_type: int) -> Firmware | None:
    """Return the firmware profile for a HEARTBEAT's ``autopilot`` and ``type``; None if it is not supported."""
    return next((f for f in FIRMWARE.values() if autopilot == f.autopilot and vehicle_type in f.vehicle_types), None)
