"""Parse host and port, or serial port and speed, as users write them."""

from __future__ import annotations

import re
import socket
from dataclasses import dataclass
from typing import Any

from gcs_autotune.errors import CannotOpenLink, UsageError
from gcs_autotune_files import Refused, shown, whole

__all__ = ["HostPort", "SerialName", "parse_host_port", "parse_serial", "resolve"]


@dataclass(frozen=True, slots=True)
class HostPort:
    """An internet address; an empty host means every interface of this computer."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def parse_host_port(text: str, *, default_host: str = "0.0.0.0", default_port: int = 14550) -> HostPort:
    """Return host and port of a text ``HOST:PORT``, ``HOST``, ``:PORT`` or ``PORT``.

    Raises
    ------
    UsageError
        The port is not a number from 0 to 65535.
    """
    host, colon, port = text.strip().rstrip("/").rpartition(":")
    if not colon:
        host, port = ("", port) if port.isascii() and port.isdigit() else (port, "")
    try:
        number = whole(port, 65535) if port else default_port
    except Refused:
        raise UsageError(
            f"{shown(port)} in {shown(text)} is not a port number. Write HOST:PORT, e.g. 127.0.0.1:14550"
        ) from None
    return HostPort(host.strip("[]") or default_host, number)


@dataclass(frozen=True, slots=True)
class SerialName:
    """A serial port and its speed ``baud``; ``flow_control`` uses the RTS and CTS wires."""

    path: str
    baud: int
    flow_control: bool = False

    def __str__(self) -> str:
        return f"serial_flowcontrol:{self.path}:{self.baud}" if self.flow_control else f"{self.path},{self.baud}"


def parse_serial(text: str, *, default_baud: int, flow_control: bool = False) -> SerialName:
    """Return path and speed of a serial port from a text ``PATH``, ``PATH:BAUD`` or ``PATH,BAUD``.

    Raises
    ------
    UsageError
        There is no path, or the speed is 0.
    """
    match = re.fullmatch(r"(?P<path>.+?)[,:](?P<baud>[0-9]{1,9})", text)
    path, baud = (match["path"], int(match["baud"])) if match else (text, default_baud)
    if not path or not baud:
        raise UsageError(f"'serial:{text}' has no port. Write e.g. serial:/dev/ttyUSB0:57600")
    return SerialName(path, baud, flow_control)


def resolve(address: HostPort, kind: int) -> tuple[int, Any]:
    """Return the socket family and address to use for *address*.

    Raises
    ------
    CannotOpenLink
        The host name is not known.
    """
    try:
        family, _, _, _, target = socket.getaddrinfo(address.host, address.port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise CannotOpenLink(f"cannot find the host '{address.host}': {error}. Check its name") from error
    return family, target
