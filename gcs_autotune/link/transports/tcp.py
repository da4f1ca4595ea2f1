"""TCP: connect to a vehicle or simulator (``tcp``), or wait for a connection (``tcpin``)."""

from __future__ import annotations

import select
import socket
from typing import Any

from gcs_autotune.errors import CannotOpenLink, LinkLost
from gcs_autotune.link.transports.address import HostPort, resolve
from gcs_autotune.link.transports.transport import ReconnectingTransport

__all__ = ["TcpIn", "TcpOut"]

_CHUNK = 65536
_CONNECT_TIMEOUT = 5.0
_RECONNECT_TIMEOUT = 0.5
_WRITE_TIMEOUT = 2.0
_DEAF = 3.0
"""Silence [s] after which another client replaces the present one. Project choice."""


class _TcpStream(ReconnectingTransport):
    """Common part of both ends: reading, writing and losing one connection."""

    _connection: socket.socket | None = None
    _heard_at = 0.0

    def _receive(self, timeout: float) -> bytes:
        assert self._connection is not None
        if not select.select([self._connection], [], [], timeout)[0]:
            return b""
        data = self._connection.recv(_CHUNK)
        if not data:
            raise EOFError("the other end closed the connection")
        self._heard_at = self._clock.now()
        return data

    def _send(self, data: bytes) -> None:
        assert self._connection is not None
        self._connection.sendall(data)

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _loss(self, error: Exception) -> LinkLost:
        if isinstance(error, TimeoutError):
            return self.lost("the other end accepts no more data", "start it again and reconnect")
        cause = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        return self.lost(cause, "start it again and reconnect")

    def _take(self, connection: socket.socket) -> None:
        connection.settimeout(_WRITE_TIMEOUT)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._heard_at = self._clock.now()


class TcpOut(_TcpStream):
    """A TCP client, e.g. of ArduPilot's simulator on port 5760."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"tcp:{address}")
        self._family, self._target = resolve(address, socket.SOCK_STREAM)
        try:
            self._take(_connect(self._family, self._target, _CONNECT_TIMEOUT))
        except OSError as error:
            raise CannotOpenLink(
                f"cannot connect to TCP {address}: {error.strerror or error}. "
                "Check that the vehicle or simulator is running, and its port"
            ) from error

    def _call_again(self) -> bool:
        try:
            self._take(_connect(self._family, self._target, _RECONNECT_TIMEOUT))
        except OSError:
            return False
        return True


class TcpIn(_TcpStream):
    """A TCP server for one client at a time. Data written before a client connects is dropped, as on a radio.

    A new client is accepted when the previous one has closed, or has been silent for 3 s.
    """

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"tcpin:{address}")
        family, target = resolve(address, socket.SOCK_STREAM)
        self._server = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(target)
            self._server.listen(1)
        except OSError as error:
            self._server.close()
            raise CannotOpenLink(
                f"cannot listen on TCP {address}: {error.strerror}. Close another program that uses that "
                "port, or choose another port"
            ) from error

    @property
    def port(self) -> int:
        """The bound port, useful if port 0 was requested."""
        return int(self._server.getsockname()[1])

    def _receive(self, timeout: float) -> bytes:
        if self._connection is None:
            self._accept(timeout)
            return b""
        if self._clock.now() - self._heard_at > _DEAF and self._accept(0.0):
            return b""  # the caller lost its power without a word, and calls again
        return super()._receive(timeout)

    def _send(self, data: bytes) -> None:
        if self._connection is not None:
            super()._send(data)

    def _look(self, timeout: float) -> None:
        self._is_down = not self._accept(timeout)

    def _accept(self, timeout: float) -> bool:
        if not select.select([self._server], [], [], timeout)[0]:
            return False
        caller, _ = self._server.accept()
        self._hang_up()
        self._take(caller)
        return True

    def _call_again(self) -> bool:
        return self._accept(0.0)

    def _close(self) -> None:
        super()._close()
        self._server.close()


def _connect(family: int, target: Any, timeout: float) -> socket.socket:
    connection = socket.socket(family, socket.SOCK_STREAM)
    connection.settimeout(timeout)
    try:
        connection.connect(target)
    except OSError:
        connection.close()
        raise
    return connection
