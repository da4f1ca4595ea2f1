"""ArduPilot's firmware on one of our hulls, and a bare ground station, all in one loop.

The hull answers ArduPilot frame by frame (lock step), so between two frames the ground station has all the time it
needs: what it sends arrives in the next frames at any speed. The same holds for the tuner, whose link passes through
here: after every ATTITUDE the sea stands still until the tuner has answered, or a little while. What is measured is
what the autopilot believes (its heading is off the truth by a constant degree or so, which no gain can mend).
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

__all__ = ["BINARIES", "NoAnswer", "Sea"]

BINARIES = {"rover": "ARDUPILOT_ROVER", "sub": "ARDUPILOT_SUB"}
"""Firmware -> environment variable that names its binary."""
_RATE = {"rover": 200, "sub": 400}
_PUMP = 0.02
"""Seconds between looks at the link, and between samples of the truth."""
_PATIENCE = 0.025
"""Wall seconds the sea waits for the tuner after an ATTITUDE; more where nobody commands would only cost time."""
_ATTITUDE, _POSITION = 30, 32
_INTERVAL = 25000.0
"""Of ATTITUDE and LOCAL_POSITION_NED, asked for on our own link [us]."""
_FAST = 100.0
"""--speedup beyond what the machine can do: as fast as it goes."""


class NoAnswer(RuntimeError):
    """The firmware did not do as it was told, or died."""


class Sea:
    """One firmware process on one hull; closes with it."""

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
        self._tuner = _Between(ports[1], ports[2])
        self.log: list[tuple[float, float, float, float, float, float]] = []
        """Time, heading [rad, unwrapped], depth, true speed, shares of full output in yaw and heave."""
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
        """End the firmware and let go of the ports."""
        self._process.kill()
        self._process.wait()
        self._server.close()
        self._socket.close()
        self._tuner.close()
        self._folder.cleanup()

    def host(
        self,
        arguments: Sequence[str],
        said: Path,
        *,
        within: float = 4000.0,
        meanwhile: Callable[[int], None] | None = None,
    ) -> int:
        """Let ``gcs-autotune`` work over its own link (``tuner_uri``), its words in *said*; return its exit code.

        *meanwhile* is called with its process id after every frame; then time on the water is the wall's.
        """
        command = [sys.executable, "-m", "gcs_autotune", *arguments]
        self._tuner.waiting = meanwhile is None
        ahead = time.monotonic() - self.t
        with said.open("wb") as file:
            process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)

            def going() -> bool:
                if meanwhile is not None:
                    meanwhile(process.pid)
                    time.sleep(max(0.0, self.t + ahead - time.monotonic()))
                return process.poll() is None

            try:
                self.run_while(going, within=within)
            finally:
                process.kill()
                self._tuner.waiting = False
        return process.wait()

    def overhear(self, listener: Callable[[Any], None]) -> None:
        """Call *listener* with every message of the tuner's."""
        self._tuner.overhear(listener)

    # -- time

    @property
    def t(self) -> float:
        """Seconds on the water."""
        return self.physics.seconds

    def run(self, seconds: float) -> None:
        """Let *seconds* pass."""
        self.run_while(lambda end=self.t + seconds: self.t < end)

    def run_while(self, going: Callable[[], bool], *, within: float = math.inf) -> None:
        """Let time pass while *going*; ``NoAnswer`` when that lasts longer than *within* [s] or the firmware dies."""
        end = self.t + within
        while going():
            try:
                self._server.serve_one()
            except TimeoutError as error:
                raise NoAnswer(f"{self.data.name}: the firmware has stopped asking ({self._process.poll()})") from error
            if self.t >= self._next_pump:
                self._pump()
            if self.t > end:
                raise NoAnswer(f"{self.data.name}: no success within {within:g} s; it said {self.texts[-3:]}")

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
        """Send one message, as another station where *packer* is given."""
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
        """Write parameters, canonical as in :mod:`gcs_autotune.firmware`, and see them echoed."""
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
                raise NoAnswer(f"{self.data.name}: no parameter {name}")

    def get(self, names: Sequence[str]) -> dict[str, float]:
        """Read parameters, canonical; those the firmware does not have are left out."""
        spelled, found = read_named(self, names)
        return spelled.to_canonical(found)

    def read_any(self, groups: Iterable[Sequence[str]]) -> dict[str, float]:
        """Return name -> value of the first name that answers of each of *groups* of alternative names."""
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
        """Give a command and return its MAV_RESULT (-1: none came)."""
        self._acks.clear()
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        end = self.t + 2.0
        self.run_while(lambda: not any(n == number for n, _ in self._acks) and self.t < end)
        return next((result for n, result in self._acks if n == number), -1)

    def go(self, mode: int) -> None:
        """Arm and enter *mode*, however long the estimator takes."""
        for message in (_ATTITUDE, _POSITION):
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message), _INTERVAL)
        end = self.t + 120.0
        while not (self.armed and self.mode == mode):
            if self.t > end:
                raise NoAnswer(f"{self.data.name}: does not arm in mode {mode}; it said {self.texts[-5:]}")
            if not self.armed:
                self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            if self.mode != mode:
                self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(mode))
            self.run(1.5)

    def rest(self) -> None:
        """Disarm, in MANUAL."""
        self.repeated = lambda: ()
        for _ in range(5):
            self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 0.0 if self.data.firmware == "rover" else 19.0)
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0)
            self.run(1.5)
            if not self.armed:
                return
        raise NoAnswer(f"{self.data.name}: does not disarm")

    def record(self, since: float) -> NDArray[np.float64]:
        """Return the rows (n, 6) of :attr:`log` from *since* [s] on."""
        first = next(i for i, row in enumerate(self.log) if row[0] >= since)
        return np.array(self.log[first:])


class _Between:
    """Passes the tuner's link on, both ways, and waits for its answer to every ATTITUDE."""

    def __init__(self, firmware_port: int, tuner_port: int) -> None:
        self._firmware = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._firmware.bind(("127.0.0.1", firmware_port))
        self._firmware.setblocking(False)
        self._far: tuple[str, int] | None = None
        self._ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._ground.connect(("127.0.0.1", tuner_port))
        self._ground.setblocking(False)
        self.waiting = False
        """Whether there is a tuner to wait for."""
        self._listeners: list[Callable[[Any], None]] = []
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def overhear(self, listener: Callable[[Any], None]) -> None:
        """Call *listener* with every message of the tuner's."""
        self._listeners.append(listener)

    def pass_on(self) -> None:
        """Pass on what has come in; when ATTITUDE was among it, wait for an answer."""
        asked = False
        while True:
            try:
                data, self._far = self._firmware.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                break
            asked = asked or _holds_attitude(data)
            with contextlib.suppress(ConnectionError, BlockingIOError):
                self._ground.send(data)
        self._back(_PATIENCE if asked and self.waiting else 0.0)

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
    """Return whether an ATTITUDE begins anywhere in *data*, MAVLink 2 frames one after the other."""
    at = 0
    while at + 10 <= len(data) and data[at] == 0xFD:
        if int.from_bytes(data[at + 7 : at + 10], "little") == _ATTITUDE:
            return True
        at += 12 + data[at + 1]
    return False
