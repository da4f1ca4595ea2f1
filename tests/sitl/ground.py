"""A bare ground station for the tests: pymavlink on one side of a server, simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl
from sitl.__main__ import main

IGNORE = 65535
MANUAL, ACRO, STEERING, HOLD, GUIDED = 0, 1, 3, 4, 15
SUB_STABILIZE, SUB_ALT_HOLD, SUB_GUIDED, SUB_MANUAL = 0, 2, 4, 19


def quaternion(yaw: float) -> list[float]:
    return [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]


class Ground:
    """Talks to a :class:`sitl.Server`. ``heard`` keeps all messages; ``sticks`` are repeated at 10 Hz."""

    def __init__(self, name: str, *, system: int = 255, heartbeats: bool = True, **options: Any) -> None:
        self.server = sitl.open_vehicle(name, **options)
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self._ear = mavlink.MAVLink(None)
        self.heard: list[Any] = []
        self.sticks: dict[int, int] | None = None
        self.repeated: Callable[[], Any] | None = None
        self._heartbeats = heartbeats
        self._next_heartbeat = 0.0

    @property
    def t(self) -> float:
        return self.server.now

    @property
    def vehicle(self) -> Any:
        return self.server.vehicle

    def send(self, message: Any) -> None:
        self.server.receive(message.pack(self.mav))

    def run(self, seconds: float) -> list[Any]:
        """Let time pass in steps of 0.1 s at most; return what was heard."""
        first, end = len(self.heard), self.t + seconds
        while self.t < end - 1e-9:
            self._speak()
            step = self.server.advance_to(min(end, round(self.t + 0.1, 9)))
            self.heard += self._ear.parse_buffer(step) or []
        return self.heard[first:]

    def _speak(self) -> None:
        if self._heartbeats and self.t >= self._next_heartbeat:
            self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            self._next_heartbeat = self.t + 1.0
        if self.sticks is not None:
            self.override(self.sticks)
        if self.repeated is not None:
            self.send(self.repeated())

    def override(self, sticks: dict[int, int]) -> None:
        pwm = [sticks.get(channel, IGNORE) for channel in range(1, 9)]
        self.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pwm))

    def manual_control(self, x: int = 0, y: int = 0, z: int = 0, r: int = 0, target: int = 1) -> None:
        self.send(mavlink.MAVLink_manual_control_message(target, x, y, z, r, 0))

    def command(self, number: int, *parameters: float) -> int:
        """Send COMMAND_LONG and return the MAV_RESULT of its ACK."""
        seven = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *seven))
        for _ in range(10):
            for message in self.run(0.02 if not self.server.vehicle.data.up_delay else 0.1):
                if message.get_type() == "COMMAND_ACK" and message.command == number:
                    return int(message.result)
        raise AssertionError(f"command {number} was not acknowledged")

    def mode(self, number: int) -> int:
        return self.command(176, 1, number)

    def stream(self, message: int, hertz: float) -> int:
        return self.command(511, message, 1e6 / hertz)

    def set(self, name: str, value: float) -> None:
        self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))

    def last(self, kind: str) -> Any:
        return next(m for m in reversed(self.heard) if m.get_type() == kind)

    def all(self, kind: str) -> list[Any]:
        return [m for m in self.heard if m.get_type() == kind]

    def texts(self) -> list[str]:
        return [m.text for m in self.all("STATUSTEXT")]

    @property
    def servos(self) -> Sequence[int]:
        return list(self.server.vehicle.autopilot.pwm)

    @property
    def armed(self) -> bool:
        return bool(self.server.vehicle.autopilot.armed)

    @property
    def mode_number(self) -> int:
        return int(self.server.vehicle.autopilot.mode.number)

    def hold_heading(self, heading: float, *, thrust: float = 1.0) -> None:
        """From now on ask for *heading* [rad] at 10 Hz, with neutral sticks."""
        is_boat = self.server.vehicle.data.is_boat
        mask = 7 if is_boat else 7 | 64
        q = quaternion(heading)
        self.repeated = lambda: mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0, 0, 0, thrust)


def refusal_of(arguments: list[str], capsys: Any) -> str:
    """Return the one line by which the command line refuses *arguments*."""
    assert main(arguments) == 2
    error = str(capsys.readouterr().err)
    assert error.count("\n") == 1
    return error


def boat(*, armed: bool = True, mode: int = MANUAL, **options: Any) -> Ground:
    """Return a ground station with charlie: neutral sticks flowing, armed by default."""
    ground = Ground("charlie", **options)
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(5.0)
    assert ground.mode(mode) == 0
    if armed:
        assert ground.command(400, 1) == 0
    return ground


def rov(name: str = "automarine", *, armed: bool = True, mode: int = SUB_MANUAL, **options: Any) -> Ground:
    """Return a ground station with an ROV: neutral sticks flowing, armed by default."""
    ground = Ground(name, **options)
    ground.sticks = {3: 1500, 4: 1500, 5: 1500, 6: 1500}
    ground.run(5.0)
    assert ground.mode(mode) == 0
    if armed:
        assert ground.command(400, 1) == 0
    return ground
