"""Send distances ahead as DISTANCE_SENSOR messages, like a companion computer with rangefinders."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_autotune.link.frame_port import FramePort
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.mavlink import Packer, SigningKey, mavlink

__all__ = ["COMPANION", "DistanceSender"]

COMPANION = int(mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
"""Component id of the sender."""
_BEAT = 1.0
"""Period of the sender's HEARTBEAT [s]."""
_AHEAD = int(mavlink.MAV_SENSOR_ROTATION_NONE)
_LASER = int(mavlink.MAV_DISTANCE_SENSOR_LASER)
_SLICE = 0.1


class DistanceSender:
    """Sends the distances of rangefinders over *transport*, with the ids of *system*'s companion computer."""

    def __init__(self, transport: Transport, system: int, signing: SigningKey | None = None) -> None:
        self._transport = transport
        self._port = FramePort(transport, Packer(system, COMPANION), None, signing, [])
        self._started = transport.clock.now()
        self._next_beat = self._started

    def wait(self, t: float) -> None:
        """Wait until *t* [s] after the start, and send the HEARTBEAT that is due."""
        clock = self._transport.clock
        self._beat()
        while (remaining := self._started + t - clock.now()) > 0.0:
            self._transport.read(min(remaining, _SLICE))  # what the vehicle sends is not needed
            self._beat()

    def _beat(self) -> None:
        now = self._transport.clock.now()
        if now >= self._next_beat:
            self._next_beat = now + _BEAT
            message = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
            )
            self._port.send(message)

    def send(self, distances: Sequence[float], nearest: float, furthest: float) -> None:
        """Send *distances* [m], that of port first; NaN is sent as out of range.

        nearest, furthest : range of the rangefinders [m]. Messages contain whole centimetres.
        """
        ms = round(1000.0 * (self._transport.clock.now() - self._started)) & 0xFFFFFFFF
        low, high = max(0, math.floor(100.0 * nearest)), math.ceil(100.0 * furthest)
        for number, distance in enumerate(distances):
            cm = min(high + 1, max(0, round(100.0 * distance))) if math.isfinite(distance) else high + 1
            self._port.send(mavlink.MAVLink_distance_sensor_message(ms, low, high, cm, _LASER, number, _AHEAD, 255))
