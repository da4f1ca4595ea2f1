"""A serial port: telemetry radio, USB cable, or one end of a pseudo-terminal."""

from __future__ import annotations

import errno
import os
from typing import Any

import serial

from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.link.transport import Transport

__all__ = ["SerialPort"]

_WRITE_TIMEOUT = 2.0
_CURE = "check the cable and its power, then reconnect"

_CURES = {
    errno.ENOENT: "there is no such device; is it plugged in? `ls /dev/tty*` shows what there is",
    errno.EACCES: "you may not open it; add yourself to the dialout group (`sudo usermod -aG dialout $USER`) "
    "and log in again",
    errno.EBUSY: "another program is using it; close the other ground station first",
    errno.EAGAIN: "another program is using it; close the other ground station first",
}


class SerialPort(Transport):
    """A serial port at *baud*, opened for us alone."""

    def __init__(self, path: str, baud: int) -> None:
        super().__init__(f"{path},{baud}")
        exclusive = True if os.name == "posix" else None
        try:
            self._port: Any = serial.Serial(path, baud, timeout=0, write_timeout=_WRITE_TIMEOUT, exclusive=exclusive)
        except (OSError, ValueError) as error:
            raise CannotOpenLink(f"cannot open the serial port {path}: {_cause(error)}") from error

    def _read_available(self, timeout: float) -> bytes:
        try:
            self._port.timeout = timeout
            first = bytes(self._port.read(1))
            waiting = self._port.in_waiting if first else 0
            return first + bytes(self._port.read(waiting)) if waiting else first
        except (OSError, TypeError) as error:  # pyserial: TypeError when the descriptor vanished underneath it
            raise self.lost(f"the serial port stopped working ({error})", _CURE) from error

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise self.lost(f"the serial port takes no bytes ({error})", _CURE) from error

    def _close(self) -> None:
        self._port.close()


def _cause(error: OSError | ValueError) -> str:
    number = error.errno if isinstance(error, OSError) else None
    if number is None and "lock" in str(error):
        number = errno.EAGAIN
    return _CURES.get(number or 0, f"{error}; check its name and that nothing else uses it")
