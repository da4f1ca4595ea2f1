"""ArduPilot's own simulator as a child process, and a witness that listens on a separate link.

The tool under test talks to SERIAL0 (UDP, as a telemetry radio would); the witness to SERIAL1 (TCP), as another ground
station that only looks. What a test claims about the vehicle it asks the witness, never the tool.
"""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = ["KINDS", "ArduPilot", "Kind", "Witness", "binary_of"]


@dataclass(frozen=True)
class Kind:
    """One of ArduPilot's simulated vehicles: the variable with its binary's path, its model, its own parameter files.

    ``least`` is what it needs set where those files are not at hand. ``manual`` and ``guided`` are mode numbers.
    """

    variable: str
    model: str
    files: tuple[str, ...]
    least: Mapping[str, float]
    manual: int
    home: str


KINDS = {
    "rover": Kind(
        "ARDUPILOT_ROVER",
        "motorboat",
        ("rover.parm", "motorboat.parm"),
        {
            "FRAME_CLASS": 2,
            "BATT_MONITOR": 4,
            "ATC_STR_RAT_FF": 0.75,
            "ATC_SPEED_P": 0.1,
            "CRUISE_SPEED": 5,
            "CRUISE_THROTTLE": 30,
            "WP_SPEED": 5,
            "RC1_MIN": 1000,
            "RC1_MAX": 2000,
            "RC3_MIN": 1000,
            "RC3_MAX": 2000,
            "SERVO1_MIN": 1000,
            "SERVO1_MAX": 2000,
            "SERVO3_MIN": 1000,
            "SERVO3_MAX": 2000,
        },
        0,
        "-35.362938,149.165085,0,0",
    ),
    "sub": Kind(
        "ARDUPILOT_SUB",
        "vectored",
        ("sub.parm",),
        {
            "BATT_MONITOR": 4,
            "BARO_EXT_BUS": 1,
            "COMPASS_OFS_X": 5,
            "COMPASS_OFS_Y": 13,
            "COMPASS_OFS_Z": -18,
            "COMPASS_OFS2_X": 5,
            "COMPASS_OFS2_Y": 13,
            "COMPASS_OFS2_Z": -18,
            "COMPASS_OFS3_X": 5,
            "COMPASS_OFS3_Y": 13,
            "COMPASS_OFS3_Z": -18,
            "PILOT_SPEED_UP": 200,
            "RC_OPTIONS": 0,
            "RC_PROTOCOLS": 1,
        },
        19,
        "33.810313,-118.393867,0,185",
    ),
}
"""Name -> vehicle. INS_ACC*, which both kinds need to pass their arming checks, are added by ``_least``."""


def binary_of(kind: Kind) -> Path | None:
    """Return the binary that the environment names, None without one.

    Raises
    ------
    FileNotFoundError
        It names one that is not there: a typing error must not look like a skipped test.
    """
    named = os.environ.get(kind.variable, "")
    if not named:
        return None
    path = Path(named)
    if not path.is_file():
        raise FileNotFoundError(f"{kind.variable}={named}: there is no such file")
    return path


def _defaults(kind: Kind, binary: Path, folder: Path) -> list[Path]:
    """Return the parameter files to start with: ArduPilot's own where they can be found, else the few needed."""
    folder_name = os.environ.get("ARDUPILOT_PARAMS")
    places = (
        [Path(folder_name)] if folder_name else [p / "Tools/autotest/default_params" for p in binary.resolve().parents]
    )
    for place in places:
        if all((place / name).is_file() for name in kind.files):
            return [place / name for name in kind.files]
    if folder_name:
        raise FileNotFoundError(f"ARDUPILOT_PARAMS={folder_name}: {' and '.join(kind.files)} are not in it")
    return [_write(folder / "least.parm", _least(kind))]


def _least(kind: Kind) -> dict[str, float]:
    imu = {f"INS_ACC{n}{what}_{axis}": value for n in ("", "2") for what, value in _IMU.items() for axis in "XYZ"}
    return {**kind.least, **imu}


_IMU = {"OFFS": 0.001, "SCAL": 1.001}
"""The simulated accelerometers count as calibrated once these are not their defaults."""


def _write(path: Path, values: Mapping[str, float]) -> Path:
    path.write_text("".join(f"{name} {value:g}\n" for name, value in values.items()))
    return path


def _free_instance() -> int:
    """Return an instance number whose ports are free: SERIAL0 to SERIAL2 and the RC input."""
    first = int(os.environ.get("ARDUPILOT_INSTANCE", "10"))
    for number in range(first, first + 10):
        if all(_is_free(5760 + 10 * number + k, socket.SOCK_STREAM) for k in (0, 2, 3)) and _is_free(
            5501 + 10 * number, socket.SOCK_DGRAM
        ):
            return number
    raise RuntimeError(f"no free ports for ArduPilot instances {first} to {first + 9}; set ARDUPILOT_INSTANCE")


def _is_free(port: int, kind: int) -> bool:
    with socket.socket(socket.AF_INET, kind) as s:
        try:
            s.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@dataclass
class ArduPilot:
    """A running ArduPilot. Use as a context manager.

    Attributes
    ----------
    kind : which vehicle. extra : parameters in addition to its defaults. speedup : its time over wall time.
    uri : the argument of ``--connect``.
    """

    kind: Kind
    binary: Path
    extra: Mapping[str, float] = field(default_factory=dict)
    speedup: float = float(os.environ.get("ARDUPILOT_SPEEDUP", "5"))
    model: str = ""
    options: Sequence[str] = ()

    def __post_init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="ardupilot-")
        self.folder = Path(self._folder.name)
        self.instance = _free_instance()
        self._port = _free_udp_port()
        self.uri = f"udpin:127.0.0.1:{self._port}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, *, wipe: bool = True) -> None:
        """Start it; without *wipe* with the parameters that it had saved."""
        files = _defaults(self.kind, self.binary, self.folder)
        if self.extra:
            files.append(_write(self.folder / "extra.parm", self.extra))
        command = [str(self.binary), "--model", self.model or self.kind.model, "--speedup", f"{self.speedup:g}"]
        command += ["--home", self.kind.home, "--defaults", ",".join(map(str, files)), "-I", str(self.instance)]
        command += ["--serial0", f"udpclient:127.0.0.1:{self._port}", *self.options, *(["-w"] if wipe else [])]
        output = (self.folder / "console.txt").open("ab")
        with output:
            self._process = subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
            )

    def kill(self) -> None:
        """Cut its power."""
        if self._process is not None:
            self._process.kill()
            self._process.wait(10.0)
            self._process = None

    def witness(self) -> Witness:
        """Return a second ground station, on SERIAL1."""
        return Witness(5762 + 10 * self.instance)

    def __enter__(self) -> ArduPilot:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._folder.cleanup()


class Witness:
    """Looks at the vehicle as another ground station (system 200), which ArduPilot takes no overrides from.

    Every value is requested when it is needed and comes from a message that arrived after the request. Waits count wall
    time, because a vehicle that has died has no other.
    """

    def __init__(self, port: int, patience: float = 20.0) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=200, srcComponent=190)
        self._mav.robust_parsing = True
        self._socket = self._connect(port, patience)

    @staticmethod
    def _connect(port: int, patience: float) -> socket.socket:
        until = time.monotonic() + patience
        while True:
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=1.0)
            except OSError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.05)

    def send(self, message: Any) -> None:
        self._socket.sendall(message.pack(self._mav))

    def messages(self, seconds: float) -> Any:
        """Yield what arrives for *seconds* of wall time."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(65536)
            except TimeoutError:
                return
            if not data:
                raise ConnectionError("the vehicle has closed its second wire")
            yield from self._mav.parse_buffer(data) or []

    def _drain(self) -> None:
        self._socket.setblocking(False)
        try:
            while self._socket.recv(65536):
                pass
        except BlockingIOError:
            pass
        finally:
            self._socket.setblocking(True)

    def wait(self, name: str, condition: Callable[[Any], bool] = lambda _: True, seconds: float = 10.0) -> Any:
        """Return the next message called *name* that fulfils *condition*."""
        for message in self.messages(seconds):
            if message.get_type() == name and condition(message):
                return message
        raise TimeoutError(f"no such {name} within {seconds:g} s")

    def _answer(self, question: Any, name: str, condition: Callable[[Any], bool]) -> Any:
        """Send *question* once a second until it is answered; a firmware that is still booting drops what it hears."""
        self._drain()
        for _ in range(20):
            self.send(question)
            try:
                return self.wait(name, condition, 1.0)
            except TimeoutError:
                continue
        raise TimeoutError(f"no {name} in answer to {question.get_type()}")

    def ask_for(self, name: str, hz: float = 10.0) -> None:
        """Request a message on this link."""
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hz)

    def command(self, number: int, *values: float) -> int:
        """Send a command and return its MAV_RESULT."""
        filled = [float(v) for v in values] + [0.0] * (7 - len(values))
        question = mavlink.MAVLink_command_long_message(1, 1, number, 0, *filled)
        return int(self._answer(question, "COMMAND_ACK", lambda m: m.command == number).result)

    def parameter(self, name: str) -> float:
        """Return a parameter as the vehicle holds it now."""
        question = mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
        return float(self._answer(question, "PARAM_VALUE", lambda m: m.param_id == name).param_value)

    def parameters(self, names: Sequence[str]) -> dict[str, float]:
        return {name: self.parameter(name) for name in names}

    def name_of(self, *alternatives: str) -> str:
        """Return the one of several names of a parameter that this vehicle has."""
        for _ in range(20):
            for name in alternatives:
                self.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
            try:
                return str(self.wait("PARAM_VALUE", lambda m: m.param_id in alternatives, 1.0).param_id)
            except TimeoutError:
                continue
        raise TimeoutError(f"it has none of {', '.join(alternatives)}")

    def set_parameter(self, name: str, value: float) -> None:
        question = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9)
        self._answer(question, "PARAM_VALUE", lambda m: m.param_id == name)

    def mode_and_armed(self) -> tuple[int, bool]:
        """Return the custom mode number and whether it is armed."""
        self._drain()
        beat = self.wait("HEARTBEAT", lambda m: m.autopilot != mavlink.MAV_AUTOPILOT_INVALID)
        return int(beat.custom_mode), bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def outputs(self) -> tuple[int, ...]:
        """Return the PWM [us] of the eight outputs; 0 where there is no pulse."""
        self.ask_for("SERVO_OUTPUT_RAW")
        self._drain()
        m = self.wait("SERVO_OUTPUT_RAW")
        return tuple(getattr(m, f"servo{n}_raw") for n in range(1, 9))

    def close(self) -> None:
        self._socket.close()
