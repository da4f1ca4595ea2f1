"""UDP: listen for a vehicle (``udpin``) or call one (``udpout``)."""

from __future__ import annotations

import select
import socket

from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.link.address import HostPort, resolve
from gcs_autotune.link.transport import Transport

__all__ = ["UdpIn", "UdpOut"]

_DATAGRAM = 65535


class UdpIn(Transport):
    """Bind a port, wait for whoever talks, answer the last one who did."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"udpin:{address}")
        family, target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._peer: tuple[str, int] | None = None
        try:
            self._socket.bind(target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(
                f"cannot listen on UDP {address}: {error.strerror}; is another ground station using that port? "
                "Close it, or choose another port; what listens there itself (a simulator) is reached with udpout:"
            ) from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The port that is really bound (useful after asking for port 0)."""
        return int(self._socket.getsockname()[1])

    def _read_available(self, timeout: float) -> bytes:
        if not select.select([self._socket], [], [], timeout)[0]:
            return b""
        try:
            data, self._peer = self._socket.recvfrom(_DATAGRAM)
        except (BlockingIOError, ConnectionError):
            return b""
        return data

    def _write(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, ConnectionError):
            return
        except OSError as error:
            raise self.lost(str(error.strerror), "check the network") from error

    def _close(self) -> None:
        self._socket.close()


class UdpOut(Transport):
    """Send to a fixed address and listen for its answers."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"udpout:{address}")
        family, target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.connect(target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(f"cannot reach UDP {address}: {error.strerror}; check the address") from error
        self._socket.setblocking(False)

    def _read_available(self, timeout: float) -> bytes:
        if not select.select([self._socket], [], [], timeout)[0]:
            return b""
        try:
            return self._socket.recv(_DATAGRAM)
        except (BlockingIOError, ConnectionError):  # nobody listens there yet: silence, not an end
            return b""

    def _write(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except (BlockingIOError, ConnectionError):
            return
        except OSError as error:
            raise self.lost(str(error.strerror), "check the network") from error

    def _close(self) -> None:
        self._socket.close()
