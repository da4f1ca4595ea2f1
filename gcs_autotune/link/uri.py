"""Connection strings, as pymavlink, MAVProxy and MAVSDK users write them, to transports."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from urllib.parse import unquote

from gcs_autotune.errors import UsageError
from gcs_autotune.link.address import parse_host_port
from gcs_autotune.link.child import Rehearsal, open_sitl
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
    given: dict[str, list[str]] = {key: [] for key in ("seed", "effect", "param", "model", "names")}
    for piece in filter(None, query.split("&")):
        key, equals, value = piece.partition("=")
        if key not in given or not equals or not value:
            raise UsageError(
                f"'sitl:{rest}': what may follow the vehicle's name is ?seed=NUMBER, effect=SLUG[@PLACE].PARAM=VALUE, "
                f"param=NAME=VALUE, names=GENERATION and model=FILE, joined by &; not '{piece}'"
            )
        given[key].append(unquote(value))
    for key in ("seed", "model", "names"):
        if len(given[key]) > 1:
            raise UsageError(f"'sitl:{rest}': give one {key} only")
    if any(not re.fullmatch(r"\d+", seed) for seed in given["seed"]):
        raise UsageError(f"'sitl:{rest}': a seed is a whole number of 0 or more, not '{given['seed'][0]}'")
    seed = int(given["seed"][0]) if given["seed"] else options.seed
    model, names = (given[key][0] if given[key] else None for key in ("model", "names"))
    return open_sitl(Rehearsal(name, seed, tuple(given["effect"]), tuple(given["param"]), model, names))


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
    ``sitl:NAME`` starts the embedded simulator, and what follows a ``?`` is told to it, joined by ``&``:
    ``sitl:videoray?effect=dead-zone.width=0.05&effect=gyro-bias.bias=0.01&seed=3`` hides effects behind the wire
    (as ``gcs-autotune sitl --effect``), ``model=FILE`` flies a model file, ``param=NAME=VALUE`` sets a parameter
    before boot, ``names=4.7`` gives it that firmware's parameter names; a ``&`` in a value is written ``%26``.
    ``scheme://`` is accepted too.

    Parameters
    ----------
    baud : serial speed when the string has none.
    seed : the simulator's noise seed when the string has none.

    Raises
    ------
    UsageError, UnknownName
        The string cannot be understood; unknown scheme, simulated vehicle or effect.
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
