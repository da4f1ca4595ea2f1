"""ArduPilot's firmware on a simulated hull, with a simple ground station, in one loop.

The hull and ArduPilot run in lock step, so messages of the ground station arrive in the next frames at any speed. The
link of the tuner passes through here too: after every ATTITUDE the simulation waits a short time for its reply. The
measurements are those of the autopilot. Its heading has a constant error of about a degree, which no gain removes.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.firmware import read_named
from sitl.ardupilot_json import HOME, JsonServer, Physics, parameter_text
from sitl.catalogue import VehicleData
from sitl.effects import HiddenEffect

__all__ = ["BINARIES", "FirmwareError", "FirmwareLoop"]

BINARIES = {"rover": "ARDUPILOT_ROVER", "sub": "ARDUPILOT_SUB"}
"""Firmware -> environment variable that names its binary."""
_RATE = {"rover": 200, "sub": 400}
_PUMP = 0.02
"""Interval [s] of reading the link, and of samples of the true state."""
_PATIENCE = 0.025
"""Longest wall time [s] that the firmware waits for the tuner after an ATTITUDE."""
_ATTITUDE, _POSITION = 30, 32
_INTERVAL = 25000.0
"""Interval of ATTITUDE and LOCAL_POSITION_NED on this link [us]."""
_FAST = 100.0
"""Value of --speedup that no computer reaches."""


class FirmwareError(RuntimeError):
    """The firmware did not obey a command, or ended."""


class FirmwareLoop:
    """A firmware process on a simulated hull."""

    def __init__(
        self,
        data: VehicleData,
        *,
        instance: int,
        ports: Sequence[int],
        effects: Sequence[HiddenEffect] = (),
        rate: int | None = None,
    ) -> None:
        self.data = data
        self.physics = Physics(data, effects=effects)
        self._folder = tempfile.TemporaryDirectory(prefix="rivals-")
        folder = Path(self._folder.name)
        (folder / "needed.parm").write_text(parameter_text(data))
        self._server = JsonServer(self.physics, port=9002 + 10 * instance, patience=30.0)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", ports[0]))
        self._socket.setblocking(False)
        self._peer: tuple[str, int] | None = None
        self._mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._mav.robust_parsing = True
        self.tuner_uri = f"udpin:127.0.0.1:{ports[2]}"
        self._tuner = _TunerLink(ports[1], ports[2])
        self.log: list[tuple[float, float, float, float, float, float]] = []
        """Time, heading [rad, unwrapped], depth, true speed, normalised outputs of yaw and heave."""
        self.psi = self.z = 0.0
        self.armed, self.mode = False, -1
        self.armed_seconds = 0.0
        self.texts: list[str] = []
        self._values: dict[str, float] = {}
        self._acks: list[tuple[int, int]] = []
        self._next_pump = 0.0
        self.repeated: Callable[[], Sequence[Any]] = lambda: ()
        self._next_repeat = 0.0
        command = [
            os.environ[BINARIES[data.firmware]],
            *("--model", "JSON:127.0.0.1", "-I", str(instance), "--rate", str(rate or _RATE[data.firmware])),
            *("--speedup", f"{_FAST:g}", "--defaults", str(folder / "needed.parm"), "--home", HOME, "-w"),
            *("--serial0", f"udpclient:127.0.0.1:{ports[0]}", "--serial1", f"udpclient:127.0.0.1:{ports[1]}"),
        ]
        with (folder / "firmware.log").open("wb") as log:
            self._process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)

    def close(self) -> None:
        """End the firmware and close the ports."""
        self._process.kill()
        self._process.wait()
        self._server.close()
        self._socket.close()
        self._tuner.close()
        self._folder.cleanup()

    def host(
        self,
        arguments: Sequence[str],
        output: Path,
        *,
        within: float = 4000.0,
        while_running: Callable[[int], None] | None = None,
    ) -> int:
        """Run ``gcs-autotune`` over its own link (``tuner_uri``), with its output in a file; return its exit code.

        *while_running* is called with its process id after every frame; the simulation then runs in real time.
        """
        command = [sys.executable, "-m", "gcs_autotune", *arguments]
        self._tuner.waiting = while_running is None
        ahead = time.monotonic() - self.t
        with output.open("wb") as file:
            process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)

            def going() -> bool:
                if while_running is not None:
                    while_running(process.pid)
                    time.sleep(max(0.0, self.t + ahead - time.monotonic()))
                return process.poll() is None

            try:
                self.run_while(going, within=within)
            finally:
                process.kill()
                self._tuner.waiting = False
        return process.wait()

    def add_listener(self, listener: Callable[[Any], None]) -> None:
        """Call *listener* with every message of the tuner."""
        self._tuner.add_listener(listener)

    # -- time

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self.physics.seconds

    def run(self, seconds: float) -> None:
        """Simulate *seconds*."""
        self.run_while(lambda end=self.t + seconds: self.t < end)

    def run_while(self, going: Callable[[], bool], *, within: float = math.inf) -> None:
        """Simulate while *going*; raise FirmwareError after *within* [s], or if the firmware ends."""
        end = self.t + within
        while going():
            try:
                self._server.serve_one()
            except TimeoutError as error:
                raise FirmwareError(f"{self.data.name}: the firmware has stopped ({self._process.poll()})") from error
            if self.t >= self._next_pump:
                self._pump()
            if self.t > end:
                raise FirmwareError(
                    f"{self.data.name}: not finished within {within:g} s; last messages {self.texts[-3:]}"
                )

    def _pump(self) -> None:
        self._next_pump = self.t + _PUMP
        self._tuner.pass_on()
        self.armed_seconds += _PUMP if self.armed else 0.0
        while True:
            try:
                data, self._peer = self._socket.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                break
            for message in self._mav.parse_buffer(data) or ():
                self._hear(message)
        if self.t >= self._next_repeat:
            self._next_repeat = self.t + 0.5
            for message in self.repeated():
                self.send(message)

    # -- the link

    def send(self, message: Any, packer: Any = None) -> None:
        """Send one message; *packer*: of another station."""
        if self._peer is not None:
            self._socket.sendto(message.pack(packer or self._mav), self._peer)

    def _hear(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.mode = message.custom_mode
        elif kind == "PARAM_VALUE":
            self._values[message.param_id] = message.param_value
        elif kind == "COMMAND_ACK":
            self._acks.append((message.command, message.result))
        elif kind == "ATTITUDE":
            self.psi += math.remainder(message.yaw - self.psi, math.tau)
            shares = self.physics.shares
            speed = self.physics.craft.plant.state.u
            self.log.append((self.t, self.psi, self.z, speed, shares.get("N", 0.0), shares.get("Z", 0.0)))
        elif kind == "LOCAL_POSITION_NED":
            self.z = message.z
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)

    def set(self, gains: Mapping[str, float]) -> None:
        """Write parameters with canonical names (:mod:`gcs_autotune.firmware`), and wait for their echo."""
        spelled, _ = read_named(self, gains)
        for name, value in spelled.to_own(gains).items():
            for _ in range(5):
                self._values.pop(name, None)
                self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32))
                end = self.t + 1.0
                self.run_while(lambda name=name, end=end: name not in self._values and self.t < end)
                if name in self._values:
                    break
            else:
                raise FirmwareError(f"{self.data.name}: no parameter {name}")

    def get(self, names: Sequence[str]) -> dict[str, float]:
        """Return parameters by canonical name, without those that the firmware does not have."""
        spelled, found = read_named(self, names)
        return spelled.to_canonical(found)

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return name -> value of the first available name in each of *groups* of alternative names."""
        return dict(answer for group in groups if (answer := self._first_of(group)))

    def _first_of(self, group: Sequence[str]) -> tuple[str, float] | None:
        for _ in range(3):
            for name in group:
                self._values.pop(name, None)
                self.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
            end = self.t + 1.0
            self.run_while(lambda end=end: self._values.keys().isdisjoint(group) and self.t < end)
            for name in group:
                if name in self._values:
                    return name, self._values[name]
        return None

    def command(self, number: int, *values: float) -> int:
        """Send a command and return its MAV_RESULT (-1: none received)."""
        self._acks.clear()
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        end = self.t + 2.0
        self.run_while(lambda: not any(n == number for n, _ in self._acks) and self.t < end)
        return next((result for n, result in self._acks if n == number), -1)

    def go(self, mode: int) -> None:
        """Arm and enter *mode*, within 120 s."""
        for message in (_ATTITUDE, _POSITION):
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message), _INTERVAL)
        end = self.t + 120.0
        while not (self.armed and self.mode == mode):
            if self.t > end:
                raise FirmwareError(f"{self.data.name}: does not arm in mode {mode}; last messages {self.texts[-5:]}")
            if not self.armed:
                self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            if self.mode != mode:
                self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(mode))
            self.run(1.5)

    def rest(self) -> None:
        """Disarm in MANUAL."""
        self.repeated = lambda: ()
        for _ in range(5):
            self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 0.0 if self.data.firmware == "rover" else 19.0)
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0)
            self.run(1.5)
            if not self.armed:
                return
        raise FirmwareError(f"{self.data.name}: does not disarm")

    def record(self, since: float) -> NDArray[np.float64]:
        """Return the rows (n, 6) of :attr:`log` from *since* [s] on."""
        first = next(i for i, row in enumerate(self.log) if row[0] >= since)
        return np.array(self.log[first:])


class _TunerLink:
    """Forward the tuner's link both ways, and wait for its reply to every ATTITUDE."""

    def __init__(self, firmware_port: int, tuner_port: int) -> None:
        self._firmware = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._firmware.bind(("127.0.0.1", firmware_port))
        self._firmware.setblocking(False)
        self._far: tuple[str, int] | None = None
        self._ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._ground.connect(("127.0.0.1", tuner_port))
        self._ground.setblocking(False)
        self.waiting = False
        """Whether to wait for a tuner."""
        self._listeners: list[Callable[[Any], None]] = []
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def add_listener(self, listener: Callable[[Any], None]) -> None:
        """Call *listener* with every message of the tuner."""
        self._listeners.append(listener)

    def pass_on(self) -> None:
        """Forward the received data; after an ATTITUDE wait for a reply."""
        is_attitude = False
        while True:
            try:
                data, self._far = self._firmware.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                break
            is_attitude = is_attitude or _holds_attitude(data)
            with contextlib.suppress(ConnectionError, BlockingIOError):
                self._ground.send(data)
        self._back(_PATIENCE if is_attitude and self.waiting else 0.0)

    def _back(self, patience: float) -> None:
        if patience and not select.select([self._ground], [], [], patience)[0]:
            return
        while True:
            try:
                data = self._ground.recv(4096)
            except (BlockingIOError, ConnectionError):
                return
            if self._far is not None:
                self._firmware.sendto(data, self._far)
            for message in (self._parser.parse_buffer(data) or ()) if self._listeners else ():
                for listener in self._listeners:
                    listener(message)

    def close(self) -> None:
        """Close both sockets."""
        self._firmware.close()
        self._ground.close()


def _holds_attitude(data: bytes) -> bool:
    """Return whether one of the MAVLink 2 frames in *data* is an ATTITUDE."""
    at = 0
    while at + 10 <= len(data) and data[at] == 0xFD:
        if int.from_bytes(data[at + 7 : at + 10], "little") == _ATTITUDE:
            return True
        at += 12 + data[at + 1]
    return False
