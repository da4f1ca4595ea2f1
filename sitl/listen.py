"""Links to a free-running vehicle: UDP, a TCP server, a serial device."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Mapping
from typing import Protocol

import serial

from gcs_autotune_files import Refused, shown, whole
from sitl.clock import Pacer
from sitl.mavlink import Server

__all__ = ["LINKS", "AddressError", "CannotListen", "Link", "host_and_port", "open_link", "serve_free_running"]

_CHUNK = 65536
_DATAGRAM = 1400
_BACKLOG_LIMIT = 1 << 20
"""Number of bytes kept for a client that does not read; more are dropped. Project choice."""
_DEFAULT_BAUD = 57600
_SHORTEST_WAIT = 0.002
"""Shortest time between two reads of the link [wall s]. Project choice."""
_LEAST_SERVED = 50
"""Fewest reads of the link per second of vehicle time."""


class AddressError(ValueError):
    """Raised if the address is not valid."""


class CannotListen(OSError):
    """Raised if the address is in use or not available."""


class Link(Protocol):
    """Interface of a link between the vehicle and a ground station. Its methods never block."""

    def read(self) -> bytes:
        """Return the bytes received since the last call; empty if none."""
        ...

    def write(self, data: bytes) -> None:
        """Send, queue or drop *data* without blocking."""
        ...

    def close(self) -> None:
        """Release the address."""
        ...


class UdpLink:
    """A UDP link that is bound to a port and answers the last sender, or sends to a fixed address."""

    def __init__(self, host: str, port: int, *, calls: bool = False) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peer: tuple[str, int] | None = (host, port) if calls else None
        self._socket.setblocking(False)
        if not calls:
            _bind(self._socket, host, port)

    def read(self) -> bytes:
        """Return the content of all datagrams received since the last call, joined."""
        data = bytearray()
        while True:
            try:
                piece, self._peer = self._socket.recvfrom(_CHUNK)
            except BlockingIOError:
                return bytes(data)
            except ConnectionError:
                continue
            data += piece

    def write(self, data: bytes) -> None:
        """Send *data* in one or more datagrams. A message may be split, because MAVLink parsers read a byte stream."""
        if self._peer is None:
            return
        for start in range(0, len(data), _DATAGRAM):
            try:
                self._socket.sendto(data[start : start + _DATAGRAM], self._peer)
            except (BlockingIOError, ConnectionError):
                continue

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpLink:
    """A TCP server for one client at a time. A new client replaces the last."""

    def __init__(self, host: str, port: int) -> None:
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        _bind(self._server, host, port)
        self._server.listen(1)
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._backlog = bytearray()

    def read(self) -> bytes:
        """Accept a new client, if any, and return the bytes received from the client."""
        self._accept()
        if self._client is None:
            return b""
        try:
            data = self._client.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def write(self, data: bytes) -> None:
        """Send the bytes that the client accepts without blocking, and keep the rest for the next call."""
        if self._client is None:
            return
        if len(self._backlog) < _BACKLOG_LIMIT:
            self._backlog += data
        try:
            del self._backlog[: self._client.send(self._backlog)]
        except BlockingIOError:
            return
        except OSError:
            self._drop()

    def close(self) -> None:
        """Close both sockets."""
        self._drop()
        self._server.close()

    def _accept(self) -> None:
        try:
            client, _ = self._server.accept()
        except BlockingIOError:
            return
        self._drop()
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None
        self._backlog.clear()


class SerialLink:
    """A serial device with a baud rate. A pseudo-terminal ignores the baud rate."""

    def __init__(self, device: str, baud: int) -> None:
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0)
        except (OSError, ValueError) as error:
            raise CannotListen(
                f"cannot open {device}: {error}. Check that it exists and that no other program uses it"
            ) from error

    def read(self) -> bytes:
        """Return the bytes received since the last call. Raises ``CannotListen`` if the device has disappeared."""
        try:
            return bytes(self._port.read(_CHUNK))
        except serial.SerialException as error:
            raise CannotListen(f"the serial device {self._port.port} was disconnected: {error}") from error

    def write(self, data: bytes) -> None:
        """Send the bytes that the device accepts without blocking. The others are lost, as on a real serial line."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException:
            return
        except serial.SerialException as error:
            raise CannotListen(f"the serial device {self._port.port} was disconnected: {error}") from error

    def close(self) -> None:
        """Close the device."""
        self._port.close()


def _bind(bound: socket.socket, host: str, port: int) -> None:
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        if error.errno == errno.EADDRINUSE:
            reason = "the port is in use. Stop the other program or choose another port"
        else:
            reason = f"{error.strerror}. Check the address"
        raise CannotListen(f"cannot listen on {host}:{port}: {reason}") from error


def host_and_port(rest: str) -> tuple[str, int]:
    """Return host and port of a text ``HOST:PORT``. Raises ``AddressError`` if it is not valid."""
    host, _, port = rest.rpartition(":")
    try:
        if host:
            return host, whole(port, 65535)
    except Refused:
        pass
    raise AddressError(f"{shown(rest)} is not HOST:PORT, for example 127.0.0.1:14550")


def _open_serial(rest: str) -> Link:
    device, _, baud = rest.partition(",")
    try:
        if device:
            return SerialLink(device, whole(baud, 100_000_000) if baud else _DEFAULT_BAUD)
    except Refused:
        pass
    raise AddressError(f"{shown(rest)} is not DEVICE or DEVICE,BAUD, for example /dev/ttyUSB0,57600")


LINKS: Mapping[str, Callable[[str], Link]] = {
    "udp": lambda rest: UdpLink(*host_and_port(rest)),
    "udpout": lambda rest: UdpLink(*host_and_port(rest), calls=True),
    "udpin": lambda rest: UdpLink(*host_and_port(rest)),
    "tcp": lambda rest: TcpLink(*host_and_port(rest)),
    "tcpin": lambda rest: TcpLink(*host_and_port(rest)),
    "serial": _open_serial,
}
"""Scheme of an address -> function that opens the link for the text after the colon. ``udpin`` (or ``udp``) waits for
a sender, ``udpout`` sends first. ``tcpin`` (or ``tcp``) waits for a client.
"""


def open_link(address: str) -> Link:
    """Return an open link of the address ``udpin:HOST:PORT``, ``udpout:HOST:PORT``, ``tcpin:HOST:PORT`` or
    ``serial:DEVICE[,BAUD]``. ``udp:`` and ``tcp:`` are ``udpin:`` and ``tcpin:``.

    Raises
    ------
    AddressError
        The address has none of these forms.
    CannotListen
        The address is in use, or the system does not permit its use.
    """
    scheme, _, rest = address.partition(":")
    if scheme not in LINKS:
        raise AddressError(
            f"'{address}' is not a valid address. Start it with one of {', '.join(f'{name}:' for name in LINKS)}"
        )
    return LINKS[scheme](rest)


def serve_free_running(server: Server, link: Link, pacer: Pacer, *, until: float = float("inf")) -> None:
    """Run the vehicle at the pacer's speed until simulated time *until* [s].

    The link is served every loop tick, but not more often than is useful in wall-clock time, and at least every 20 ms
    of vehicle time.
    """
    rate = server.vehicle.rate
    stride = min(max(round(rate * pacer.speedup * _SHORTEST_WAIT), 1), rate // _LEAST_SERVED)
    tick = 0
    while tick < until * rate:
        tick += stride
        t = tick / rate
        pacer.wait_until(t)
        server.receive(link.read())
        sent = server.advance_to(t)
        if sent:
            link.write(sent)
