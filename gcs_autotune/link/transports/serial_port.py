"""A serial port: a telemetry radio, a USB cable, or one end of a pseudo-terminal."""

from __future__ import annotations

import errno
import os
from typing import Any

import serial

from gcs_autotune.errors import CannotOpenLink, LinkLost
from gcs_autotune.link.transports.address import SerialName
from gcs_autotune.link.transports.transport import ReconnectingTransport

__all__ = ["SerialPort", "cause_and_cure"]

_WRITE_TIMEOUT = 2.0
_LONGEST_QUEUE = 0.5
"""Time [s] of unsent bytes above which a message is dropped, because a late command is harmful. Project choice."""
_BITS_PER_BYTE = 10

_CURES = {
    errno.ENOENT: "the device does not exist. Check that it is plugged in; `ls /dev/tty*` lists the devices",
    errno.EACCES: "no permission. Add yourself to the dialout group (`sudo usermod -aG dialout $USER`) "
    "then log in again",
    errno.EBUSY: "another program is using it. Close the other ground station first",
    errno.EAGAIN: "another program is using it. Close the other ground station first",
}


class SerialPort(ReconnectingTransport):
    """A serial port, opened exclusively. If its device disappears and returns under the same name, it is reopened.

    Attributes
    ----------
    dropped : messages not sent because the driver still had half a second of earlier ones.
    """

    def __init__(self, name: SerialName) -> None:
        super().__init__(str(name))
        self._name = name
        self._room = _LONGEST_QUEUE * name.baud / _BITS_PER_BYTE
        self.dropped = 0
        try:
            self._port: Any = _open(name)
        except (OSError, ValueError) as error:
            raise CannotOpenLink(f"cannot open the serial port {name.path}: {cause_and_cure(error)}") from error

    def _receive(self, timeout: float) -> bytes:
        self._port.timeout = timeout
        first = bytes(self._port.read(1))
        waiting = self._port.in_waiting if first else 0
        return first + bytes(self._port.read(waiting)) if waiting else first

    @property
    def trouble(self) -> str:
        """Text that reports dropped messages; empty if there are none."""
        return (
            (f"{self.dropped} messages were dropped: the serial line is too slow. Use a higher baud rate")
            if self.dropped
            else ""
        )

    def _send(self, data: bytes) -> None:
        if self._unsent() > self._room:
            self.dropped += 1
        else:
            self._port.write(data)

    def _unsent(self) -> int:
        """Return the bytes waiting in the driver; 0 if it does not report them."""
        try:
            return int(self._port.out_waiting)
        except OSError:
            return 0

    def _hang_up(self) -> None:
        self._port.close()

    def _call_again(self) -> bool:
        try:
            self._port = _open(self._name)
        except (OSError, ValueError):
            return False
        return True

    def _loss(self, error: Exception) -> LinkLost:
        if isinstance(error, serial.SerialTimeoutException):
            cause = f"the serial port accepts no data ({error})"
        else:
            cause = f"the serial port stopped working ({error})"
        return self.lost(cause, "check the cable and its power, then reconnect")


def _open(name: SerialName) -> Any:
    options: dict[str, Any] = {"timeout": 0, "write_timeout": _WRITE_TIMEOUT}
    if os.name == "posix":
        options["exclusive"] = True
    if name.flow_control:
        options["rtscts"] = True
    return serial.Serial(name.path, name.baud, **options)


def cause_and_cure(error: OSError | ValueError) -> str:
    """Return why a serial port could not be opened, and the remedy."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None and "lock" in str(error):
        number = errno.EAGAIN
    return _CURES.get(number or 0, f"{error}. Check its name, and that no other program uses it")
