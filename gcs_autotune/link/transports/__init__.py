"""Open a transport from a connection string in the notation of pymavlink, MAVProxy or MAVSDK.

To add a transport, write a class with ``_read_available``, ``_write`` and ``_close``. Add a line to :data:`TRANSPORTS`,
and both ends to the conformance suite (``tests/link/link_ends.py``). Another package uses an entry point
(:data:`OFFERED`) instead of the line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from urllib.parse import unquote

from gcs_autotune.errors import UsageError
from gcs_autotune.link.transports.address import HostPort, SerialName, parse_host_port, parse_serial
from gcs_autotune.link.transports.mavsdk import MavsdkLink
from gcs_autotune.link.transports.serial_port import SerialPort
from gcs_autotune.link.transports.sitl_process import SitlArguments, open_sitl
from gcs_autotune.link.transports.tcp import TcpIn, TcpOut
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.link.transports.udp import UdpIn, UdpOut
from gcs_autotune.registry import lookup
from gcs_autotune_files import Refused, whole

__all__ = ["BACKENDS", "TRANSPORTS", "LinkOptions", "is_serial", "not_mavlink_advice", "open_link"]


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Defaults for a connection string: serial speed [baud] and noise seed of the simulator."""

    baud: int = 115200
    seed: int | None = None


Opener = Callable[[str, LinkOptions], Transport]
_ANYWHERE = ("", "0.0.0.0", "::")


def _called(rest: str) -> HostPort:
    return parse_host_port(rest, default_host="127.0.0.1", default_port=14550)


def _called_tcp(rest: str) -> HostPort:
    return parse_host_port(rest, default_host="127.0.0.1", default_port=5760)


def _serial_name(rest: str, options: LinkOptions) -> SerialName:
    return parse_serial(rest, default_baud=options.baud)


def _flow_controlled(rest: str, options: LinkOptions) -> SerialName:
    return parse_serial(rest, default_baud=options.baud, flow_control=True)


_MOST_SEED = 2**32 - 1


def _sitl(rest: str, options: LinkOptions) -> Transport:
    name, _, query = rest.partition("?")
    given: dict[str, list[str]] = {key: [] for key in ("seed", "effect", "param", "model", "names")}
    for piece in filter(None, query.split("&")):
        key, equals, value = piece.partition("=")
        if key not in given or not equals or not value:
            raise UsageError(
                f"'sitl:{rest}': '{piece}' is not an option. Use ?seed=NUMBER, effect=SLUG[@PLACE].PARAM=VALUE, "
                "param=NAME=VALUE, names=GENERATION and model=FILE after the vehicle's name, joined by &"
            )
        given[key].append(unquote(value))
    for key in ("seed", "model", "names"):
        if len(given[key]) > 1:
            raise UsageError(f"'sitl:{rest}': the option {key} occurs more than once. Use it once")
    try:
        seed = whole(given["seed"][0], _MOST_SEED) if given["seed"] else options.seed
    except Refused as error:
        raise UsageError(f"'sitl:{name}': the seed is invalid: {error}") from None
    model, names = (given[key][0] if given[key] else None for key in ("model", "names"))
    return open_sitl(SitlArguments(name, seed, tuple(given["effect"]), tuple(given["param"]), model, names))


def _no_lockstep(rest: str, options: LinkOptions) -> Transport:
    name = rest.partition("?")[0]
    raise UsageError(
        f"sitl:{rest} runs in lock-step, but MAVSDK uses the wall clock. Omit --backend "
        f"mavsdk, or run the vehicle as a process (`gcs-autotune sitl {name} --listen udp:127.0.0.1:14550`) and "
        "connect to udpout://127.0.0.1:14550"
    )


TRANSPORTS: Mapping[str, Opener] = {
    "udpin": lambda rest, _: UdpIn(parse_host_port(rest)),
    "udpout": lambda rest, _: UdpOut(_called(rest)),
    "tcpout": lambda rest, _: TcpOut(_called_tcp(rest)),
    "tcpin": lambda rest, _: TcpIn(parse_host_port(rest, default_port=5760)),
    "serial": lambda rest, options: SerialPort(_serial_name(rest, options)),
    "serial_flowcontrol": lambda rest, options: SerialPort(_flow_controlled(rest, options)),
    "sitl": _sitl,
}
"""Scheme of a connection string -> function that opens the link with this package's own sockets and serial ports."""

OFFERED = "gcs_autotune.transports"
"""Name of the entry-point group by which other packages provide further schemes."""

MAVSDK_TRANSPORTS: Mapping[str, Opener] = {
    "udpin": lambda rest, _: MavsdkLink("udpin", parse_host_port(rest)),
    "udpout": lambda rest, _: MavsdkLink("udpout", _called(rest)),
    "tcpout": lambda rest, _: MavsdkLink("tcpout", _called_tcp(rest)),
    "tcpin": lambda rest, _: MavsdkLink("tcpin", parse_host_port(rest, default_port=5760)),
    "serial": lambda rest, options: MavsdkLink("serial", _serial_name(rest, options)),
    "serial_flowcontrol": lambda rest, options: MavsdkLink("serial", _flow_controlled(rest, options)),
    "sitl": _no_lockstep,
}
"""Scheme of a connection string -> function that opens the link with MAVSDK."""

BACKENDS: Mapping[str, Mapping[str, Opener]] = {"pymavlink": TRANSPORTS, "mavsdk": MAVSDK_TRANSPORTS}
"""Libraries that can carry the frames: our own sockets and ports with pymavlink's messages, or MAVSDK."""

_BARE_DEVICE = re.compile(r"(/|COM\d|\\\\)", re.IGNORECASE)


def not_mavlink_advice(uri: str) -> str:
    """Return what to check if bytes on the link *uri* (or its description) are not MAVLink."""
    return "Check the baud rate" if is_serial(uri) else "Check the address and port"


def is_serial(uri: str) -> bool:
    """Return whether *uri*, or the description of an open link, names a serial port. Only these have a baud rate."""
    return bool(_BARE_DEVICE.match(uri)) or uri.strip().lower().startswith("serial")


def open_link(uri: str, *, baud: int = 115200, seed: int | None = None, backend: str = "pymavlink") -> Transport:
    """Return the open connection that *uri* describes.

    * UDP: ``udpin:HOST:PORT`` (or ``udp:``) listens, ``udpout:HOST:PORT`` sends first.
    * TCP: ``tcp:HOST:PORT`` (or ``tcpout:``) connects, ``tcpin:HOST:PORT`` listens.
    * Serial: ``/dev/ttyUSB0,57600``, ``COM3,57600`` or ``serial:PATH:BAUD`` opens a port. ``serial_flowcontrol:`` also
      uses its RTS and CTS wires.
    * Simulator: ``sitl:NAME`` starts the embedded one (``sitl:FILE.toml``: with a vehicle of your own).

    Options of the simulator follow a ``?``, joined by ``&``; a ``&`` in a value is written ``%26``.
    ``sitl:videoray?effect=dead-zone.width=0.05&effect=gyro-bias.bias=0.01&seed=3`` adds hidden effects to the vehicle
    (as ``gcs-autotune sitl --effect``). ``model=FILE`` flies a model file. ``param=NAME=VALUE`` sets a parameter before
    boot. ``names=4.7`` selects that firmware's parameter names.

    MAVSDK's ``scheme://`` is accepted too, with every *backend*. Its old ``udp://`` has two meanings: with a host it
    sends first, and as ``udp://:PORT`` or ``udp://0.0.0.0:PORT`` it listens.

    Parameters
    ----------
    baud : serial speed when the string has none.
    seed : the simulator's noise seed when the string has none.
    backend : a name in ``BACKENDS``.

    Raises
    ------
    UsageError, UnknownName
        The string is not valid. Or a scheme, backend, simulated vehicle or effect is unknown, or not supported.
    CannotOpenLink
        The port or address cannot be opened. The message states why and what to try.
    """
    options = LinkOptions(baud, seed)
    table = lookup(BACKENDS, backend, "backend")
    if _BARE_DEVICE.match(uri):
        return table["serial"](uri, options)
    scheme, colon, rest = uri.strip().partition(":")
    if not colon:
        raise UsageError(
            f"'{uri}' is not a connection URI. Write e.g. udpin:0.0.0.0:14550, tcp:127.0.0.1:5760, "
            "/dev/ttyUSB0,57600 or sitl:charlie"
        )
    rest, has_slashes = rest.removeprefix("//"), rest.startswith("//")
    scheme = scheme.lower()
    if scheme == "udp":
        calls = has_slashes and rest.partition(":")[0] not in _ANYWHERE
        scheme = "udpout" if calls else "udpin"
    elif scheme == "tcp":
        scheme = "tcpout"
    group = OFFERED if table is TRANSPORTS else ""
    return lookup(table, scheme, "kind of connection", group=group)(rest, options)
