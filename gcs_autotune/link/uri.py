"""Connection strings, as pymavlink, MAVProxy and MAVSDK users write them, to transports."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from urllib.parse import parse_qsl

from gcs_autotune.errors import UsageError
from gcs_autotune.link.address import parse_host_port
from gcs_autotune.link.child import open_sitl
from gcs_autotune.link.serial_port import SerialPort
from gcs_autotune.link.tcp import TcpIn, TcpOut
from gcs_autotune.link.transport import Transport
from gcs_autotune.link.udp import UdpIn, UdpOut
from gcs_autotune.registry import lookup

__all__ = ["TRANSPORTS", "LinkOptions", "open_link"]


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """What a connection string may leave open: serial speed [baud] and the simulator's noise seed."""

    baud: int = 115200
    seed: int | None = None


def _udp_in(rest: str, options: LinkOptions) -> Transport:
    return UdpIn(parse_host_port(rest))


def _udp_out(rest: str, options: LinkOptions) -> Transport:
    return UdpOut(parse_host_port(rest, default_host="127.0.0.1"))


def _tcp_out(rest: str, options: LinkOptions) -> Transport:
    return TcpOut(parse_host_port(rest, default_host="127.0.0.1", default_port=5760))


def _tcp_in(rest: str, options: LinkOptions) -> Transport:
    return TcpIn(parse_host_port(rest, default_port=5760))


def _serial(rest: str, options: LinkOptions) -> Transport:
    match = re.fullmatch(r"(?P<path>.+?)[,:](?P<baud>\d+)", rest)
    path, baud = (match["path"], int(match["baud"])) if match else (rest, options.baud)
    if not path or not baud:
        raise UsageError(f"'serial:{rest}' names no port; write e.g. serial:/dev/ttyUSB0:57600")
    return SerialPort(path, baud)


def _sitl(rest: str, options: LinkOptions) -> Transport:
    name, _, query = rest.partition("?")
    seed = options.seed
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key != "seed" or not re.fullmatch(r"\d+", value):
            raise UsageError(f"'sitl:{rest}': only ?seed=NUMBER may follow the vehicle's name, not '{key}={value}'")
        seed = int(value)
    return open_sitl(name, seed=seed)


Opener = Callable[[str, LinkOptions], Transport]

TRANSPORTS: Mapping[str, Opener] = {
    "udpin": _udp_in,
    "udp": _udp_in,
    "udpout": _udp_out,
    "tcp": _tcp_out,
    "tcpout": _tcp_out,
    "tcpin": _tcp_in,
    "serial": _serial,
    "sitl": _sitl,
}
"""Scheme -> what opens it. A bare device path or ``COMn`` is ``serial``."""

_BARE_DEVICE = re.compile(r"(/|COM\d|\\\\)", re.IGNORECASE)


def open_link(uri: str, *, baud: int = 115200, seed: int | None = None) -> Transport:
    """Open the connection that *uri* describes.

    ``udpin:HOST:PORT`` (or ``udp:``) listens, ``udpout:HOST:PORT`` calls; ``tcp:HOST:PORT`` calls,
    ``tcpin:HOST:PORT`` listens; ``/dev/ttyUSB0,57600``, ``COM3,57600`` or ``serial:PATH:BAUD`` opens a port;
    ``sitl:NAME`` (``sitl:NAME?seed=3``) starts the embedded simulator. ``scheme://`` is accepted too.

    Parameters
    ----------
    baud : serial speed when the string has none.
    seed : the simulator's noise seed when the string has none.

    Raises
    ------
    UsageError, UnknownName
        The string cannot be understood; unknown scheme or simulated vehicle.
    CannotOpenLink
        It can, but the port or address cannot be had; the message says why and what to try.
    """
    options = LinkOptions(baud, seed)
    if _BARE_DEVICE.match(uri):
        return _serial(uri, options)
    scheme, colon, rest = uri.strip().partition(":")
    if not colon:
        raise UsageError(
            f"'{uri}' is not a connection; write e.g. udpin:0.0.0.0:14550, tcp:127.0.0.1:5760, "
            "/dev/ttyUSB0,57600 or sitl:charlie"
        )
    opener = lookup(TRANSPORTS, scheme.lower(), "kind of connection")
    return opener(rest.removeprefix("//"), options)
