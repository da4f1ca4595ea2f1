"""ArduPilot's log on board (dataflash: ``.bin`` binary, ``.log`` text) to tapes."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from pymavlink import DFReader

from gcs_autotune.errors import BadFile
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.logs.stretches import runs_of
from gcs_autotune.logs.tape import Tape
from gcs_autotune.trial import Trial

__all__ = ["load_dataflash"]

Message: TypeAlias = Any
"""A pymavlink dataflash message: columns as attributes, names verbatim from the log's own FMT."""

EV_ARMED, EV_DISARMED = 10, 11
"""Event numbers of ArduPilot, for logs older than the ARM message."""
HEAD = b"\xa3\x95"
"""What every binary message begins with."""
RAD = math.pi / 180.0


def load_dataflash(path: Path, system: int | None = None) -> list[Trial]:
    """Return the runs in the dataflash log at *path*; a log on board is of one vehicle, so *system* is not looked at.

    Raises
    ------
    BadFile
        Unreadable, or not a dataflash log.
    NotInformative
        No stretch of it is armed, driven and moves.
    """
    tape = Tape(path.stem, "vehicle (TimeUS)")
    count = 0
    for message in _messages(path):
        count += 1
        _write(tape, message)
    if not count:
        raise BadFile(f"{path} holds no dataflash message: it is no ArduPilot log, or damaged from its start")
    if tape.arming:
        tape.arming.insert(0, (tape.span[0], not tape.arming[0][1]))
    elif not tape.parameters.get("LOG_DISARMED", 0.0):
        tape.arming.append((tape.span[0], True))
    return runs_of([tape], {"source": path.name, "messages": count}, [])


def _messages(path: Path) -> Iterator[Message]:
    """Yield what pymavlink reads; what it cannot is the log's end."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror}") from error
    is_binary = HEAD in data[:4096]
    if not is_binary and not data.lstrip().startswith(b"FMT"):
        raise BadFile(f"{path} is no ArduPilot log: it begins with neither a binary message nor a FMT line")
    reader = DFReader.DFReader_binary if is_binary else DFReader.DFReader_text
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        log: Any = reader.__new__(reader)  # in two steps, so that what it opened can be closed when it fails
        try:
            try:
                log.__init__(str(path))
            except Exception as error:
                raise BadFile(f"{path} cannot be read as an ArduPilot log: {error}") from error
            while True:
                try:
                    message = log.recv_msg()
                except Exception:  # noqa: BLE001  # pymavlink raises bare Exception, among others
                    return
                if message is None:
                    return
                yield message
        finally:
            opened = getattr(log, "filehandle", None)
            if opened is not None:
                opened.close()


def _write(tape: Tape, m: Message) -> None:
    kind = m.get_type()
    if kind == "PARM":
        if isinstance(m.Value, (int, float)):
            tape.parameters[str(m.Name)] = float(m.Value)
        return
    if not hasattr(m, "TimeUS"):
        return
    t = m.TimeUS * 1e-6
    if kind == "MSG":
        _said(tape, t, str(m.Message))
    elif kind == "MODE":
        tape.modes.append((t, int(getattr(m, "ModeNum", m.Mode))))
    elif kind == "ARM":
        tape.arming.append((t, bool(m.ArmState)))
    elif kind == "EV" and m.Id in (EV_ARMED, EV_DISARMED):
        tape.arming.append((t, m.Id == EV_ARMED))
    elif kind in _SIGNALS:
        try:
            values = _SIGNALS[kind](m)
        except AttributeError:
            return
        tape.take(t, values)


def _said(tape: Tape, t: float, text: str) -> None:
    tape.texts.append((t, text))
    if tape.firmware is None:
        for name, firmware in FIRMWARE.items():
            if text.lower().startswith((name, name.removeprefix("ardu"))):
                tape.firmware = firmware
                tape.vehicle = text


def _first(m: Message) -> bool:
    """Whether a message is of the first instance of its sensor or filter."""
    return getattr(m, "C", getattr(m, "I", 0)) == 0


def _attitude(m: Message) -> dict[str, float]:
    return {"attitude.phi": m.Roll * RAD, "attitude.theta": m.Pitch * RAD, "attitude.psi": m.Yaw * RAD}


def _rate(m: Message) -> dict[str, float]:
    return {"rate.p": m.R * RAD, "rate.q": m.P * RAD, "rate.r": m.Y * RAD}


def _imu(m: Message) -> dict[str, float]:
    return {"imu.p": m.GyrX, "imu.q": m.GyrY, "imu.r": m.GyrZ} if _first(m) else {}


def _ekf(m: Message) -> dict[str, float]:
    if not _first(m):
        return {}
    return {"ekf.x": m.PN, "ekf.y": m.PE, "ekf.z": m.PD, "ekf.vn": m.VN, "ekf.ve": m.VE, "ekf.w": m.VD}


def _gps(m: Message) -> dict[str, float]:
    if not _first(m) or m.Status < 3:
        return {}
    course = m.GCrs * RAD
    return {
        "gps.lat": m.Lat,
        "gps.lon": m.Lng,
        "gps.U": m.Spd,
        "gps.vn": m.Spd * math.cos(course),
        "gps.ve": m.Spd * math.sin(course),
    }


def _numbered(source: str) -> Callable[[Message], dict[str, float]]:
    def read(m: Message) -> dict[str, float]:
        return {f"{source}.{n}": float(getattr(m, f"C{n}")) for n in range(1, 15) if hasattr(m, f"C{n}")}

    return read


_SIGNALS: Mapping[str, Callable[[Message], dict[str, float]]] = {
    "ATT": _attitude,
    "RATE": _rate,
    "IMU": _imu,
    "XKF1": _ekf,
    "NKF1": _ekf,
    "GPS": _gps,
    "CTUN": lambda m: {"control.z": -m.Alt},
    "BARO": lambda m: {"baro.z": -m.Alt} if _first(m) else {},
    "RCOU": _numbered("servo"),
    "RCIN": _numbered("rc"),
}
"""Message -> sources on the tape. Degrees end here."""
