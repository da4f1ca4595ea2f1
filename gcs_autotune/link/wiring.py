"""How a vehicle's inputs and outputs are connected, as read from its parameters."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_autotune.firmware import ServoMap
from gcs_autotune.link.overrides import OverrideMap
from gcs_autotune.link.rate_stick import RateStick

__all__ = ["Wiring"]


@dataclass(frozen=True, slots=True)
class Wiring:
    """See the module's text.

    ``full_speed`` [m/s] is what full thrust asks for in guided mode (WP_SPEED), 0 when there is none;
    ``loop_period`` [s] that of the autopilot's main loop, 0 when unknown; ``rate_lag`` [s] how late its gyro filter
    makes turn rates; ``rate_stick`` what turn rate the yaw stick asks for in the stabilised modes, None where targets
    do that (boats).
    """

    overrides: OverrideMap
    servos: ServoMap
    full_speed: float = 0.0
    loop_period: float = 0.0
    rate_lag: float = 0.0
    rate_stick: RateStick | None = None
