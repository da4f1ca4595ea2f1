"""A minimal ground station for testing how a firmware behaves. It sends the same requests to ArduPilot's and to ours.

All times are the vehicle's own stamps, so that it does not matter how fast its clock runs beside the wall's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import CommandDenied
from gcs_autotune.firmware import Firmware, firmware_for
from gcs_autotune.link import Commands, Parameters, Rates, Session

__all__ = ["BareStation"]

_IGNORE = 65535
_STICKS = 0.03
"""Vehicle seconds between two repetitions of the sticks."""


class BareStation:
    """Attributes: ``t`` vehicle time [s]; ``pwm`` last servo outputs [us]; ``texts`` (t, text) of every STATUSTEXT.

    ``sticks`` is called for the message to repeat about 30 times a second of vehicle time, None for silence.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        vehicle = session.vehicle or session.discover(30.0, 1)
        firmware = firmware_for(vehicle.autopilot, vehicle.vehicle_type)
        assert firmware is not None
        self.firmware: Firmware = firmware
        self.commands = Commands(session, firmware)
        self.parameters = Parameters(session)
        self.rates = Rates(session, self.commands)
        self.t = math.nan
        self.pwm: tuple[int, ...] = ()
        self.texts: list[tuple[float, str]] = []
        self.sticks: Callable[[], Any] | None = None
        self._sticks_t = -math.inf
        session.listen("SYSTEM_TIME", lambda m: self._see(m.time_boot_ms * 1e-3))
        session.listen("ATTITUDE", lambda m: self._see(m.time_boot_ms * 1e-3))
        session.listen("SERVO_OUTPUT_RAW", self._on_outputs)
        session.listen("STATUSTEXT", lambda m: self.texts.append((self.t, m.text)))
        session.wait_for(lambda: None if math.isnan(self.t) else True, 5.0)

    def _see(self, t: float) -> None:
        self.t = t if math.isnan(self.t) else max(self.t, t)
        if self.sticks is not None and self.t - self._sticks_t >= _STICKS:
            self._sticks_t = self.t
            self.session.send(self.sticks())

    def _on_outputs(self, m: Any) -> None:
        self.pwm = tuple(getattr(m, f"servo{n}_raw") for n in range(1, 9))
        self._see(m.time_usec * 1e-6)

    @property
    def is_boat(self) -> bool:
        return self.firmware.kind == "boat"

    @property
    def mode(self) -> str:
        return self.commands.mode

    def wait(self, condition: Callable[[], bool], within: float) -> float:
        """Pump until *condition*; return the vehicle time [s] that took, at most *within*."""
        begun = self.t
        while not condition():
            if self.t - begun > within:
                raise AssertionError(f"not within {within:g} s; outputs {self.pwm}, texts {self.texts[-3:]}")
            self.session.pump(0.01)
        return self.t - begun

    def run(self, seconds: float) -> None:
        """Let vehicle time pass."""
        end = self.t + seconds
        self.wait(lambda: self.t >= end, seconds + 1.0)

    def override(self, sticks: Mapping[int, int]) -> Any:
        """Return RC_CHANNELS_OVERRIDE with these PWMs [us] per channel (1-based); the others are ignored."""
        return mavlink.MAVLink_rc_channels_override_message(
            1, 1, *(sticks.get(channel, _IGNORE) for channel in range(1, 9))
        )

    def neutral(self) -> Any:
        """Return the override that keeps every channel that we drive at its trim."""
        return self.override(dict.fromkeys(self.firmware.channels.values(), 1500))

    def hold(self, make: Callable[[], Any] | None, seconds: float = 0.0) -> None:
        """From now on repeat what *make* returns, and let *seconds* pass."""
        self.sticks, self._sticks_t = make, -math.inf
        if seconds:
            self.run(seconds)

    def command(self, number: int, *values: float) -> int:
        """Give a command and return its MAV_RESULT."""
        try:
            self.commands.command_long(number, *values)
        except CommandDenied as error:
            return int(error.result)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def arm(self) -> None:
        """Arm in manual mode with neutral sticks flowing."""
        self.commands.set_mode(self.firmware.manual_mode)
        self.hold(self.neutral, 1.0)
        self.commands.arm()

    def leave(self) -> None:
        """Disarm, release everything, manual mode."""
        release = self.override(dict.fromkeys(range(1, 9), 0))
        self.sticks = None
        if self.session.armed:
            self.session.send(self.neutral())
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0)
        self.session.send(release)
        self.commands.set_mode(self.firmware.manual_mode)
        self.rates.restore()
