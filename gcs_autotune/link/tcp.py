"""TCP: call a vehicle or simulator (``tcp``), or wait for one to call (``tcpin``)."""

from __future__ import annotations

import select
import socket

from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.link.address import HostPort, resolve
from gcs_autotune.link.transport import Transport

__all__ = ["TcpIn", "TcpOut"]

_CHUNK = 65536
_CONNECT_TIMEOUT = 5.0
_WRITE_TIMEOUT = 2.0
_CURE = "start it again and reconnect"


class TcpOut(Transport):
    """A client of somebody else's server, e.g. ArduPilot's simulator on port 5760."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"tcp:{address}")
        family, target = resolve(address, socket.SOCK_STREAM)
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.settimeout(_CONNECT_TIMEOUT)
        try:
            self._socket.connect(target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(
                f"cannot connect to TCP {address}: {error.strerror or error}; "
                "is the vehicle or simulator running, and is that its port?"
            ) from error
        _tune(self._socket)

    def _read_available(self, timeout: float) -> bytes:
        return _receive(self, self._socket, timeout)

    def _write(self, data: bytes) -> None:
        _send(self, self._socket, data)

    def _close(self) -> None:
        self._socket.close()


class TcpIn(Transport):
    """A server for one caller. What is written before anybody called is dropped, as on a radio."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"tcpin:{address}")
        family, target = resolve(address, socket.SOCK_STREAM)
        self._server = socket.socket(family, socket.SOCK_STREAM)
        self._caller: socket.socket | None = None
        try:
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(target)
            self._server.listen(1)
        except OSError as error:
            self._server.close()
            raise CannotOpenLink(
                f"cannot listen on TCP {address}: {error.strerror}; is another program using that port? "
                "Close it, or choose another port"
            ) from error

    @property
    def port(self) -> int:
        """The port that is really bound (useful after asking for port 0)."""
        return int(self._server.getsockname()[1])

    def _read_available(self, timeout: float) -> bytes:
        if self._caller is None:
            if not select.select([self._server], [], [], timeout)[0]:
                return b""
            self._caller, _ = self._server.accept()
            _tune(self._caller)
            return b""
        return _receive(self, self._caller, timeout)

    def _write(self, data: bytes) -> None:
        if self._caller is not None:
            _send(self, self._caller, data)

    def _close(self) -> None:
        self._server.close()
        if self._caller is not None:
            self._caller.close()


def _tune(connection: socket.socket) -> None:
    connection.settimeout(_WRITE_TIMEOUT)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _receive(transport: Transport, connection: socket.socket, timeout: float) -> bytes:
    if not select.select([connection], [], [], timeout)[0]:
        return b""
    try:
        data = connection.recv(_CHUNK)
    except OSError as error:
        raise transport.lost(error.strerror or str(error), _CURE) from error
    if not data:
        raise transport.lost("the other end closed the connection", _CURE)
    return data


def _send(transport: Transport, connection: socket.socket, data: bytes) -> None:
    try:
        connection.sendall(data)
    except TimeoutError as error:
        raise transport.lost("the other end takes no more bytes", _CURE) from error
    except OSError as error:
        raise transport.lost(error.strerror or str(error), _CURE) from error
