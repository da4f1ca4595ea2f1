"""UDP: listen for a vehicle (``udpin``) or call one (``udpout``)."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.link.address import HostPort, resolve
from gcs_autotune.link.transport import Transport

__all__ = ["UdpIn", "UdpOut"]

_DATAGRAM = 65535
_AT_ONCE = 256
"""Chosen: datagrams taken in one read; a parameter list comes as a thousand of them."""
_ROOM = 1 << 20
"""Chosen: bytes asked of the system for what arrives while we compute; it may give less."""
_REMEMBERED = 10.0
"""Chosen: seconds after which one who has gone silent is not answered any more, unless nobody else is there."""
_MOST_PEERS = 8


class _UdpSocket(Transport):
    """What both kinds share."""

    def __init__(self, description: str, address: HostPort) -> None:
        super().__init__(description)
        family, self._target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        with suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)

    def _read_available(self, timeout: float) -> bytes:
        if not select.select([self._socket], [], [], timeout)[0]:
            return b""
        data = bytearray()
        for _ in range(_AT_ONCE):
            try:
                data += self._receive()
            except (BlockingIOError, ConnectionError):  # refused: nobody listens there yet; silence, not an end
                break
        return bytes(data)

    def _try(self, send: Callable[[], object]) -> None:
        try:
            send()
        except (BlockingIOError, ConnectionError):
            return
        except OSError as error:
            raise self.lost(str(error.strerror), "check the network") from error

    def _receive(self) -> bytes:
        return self._socket.recv(_DATAGRAM)

    def _close(self) -> None:
        self._socket.close()


class UdpIn(_UdpSocket):
    """Bind a port, wait for whoever talks, answer everybody who talked lately (vehicle and relays alike)."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"udpin:{address}", address)
        self._peers: dict[Any, float] = {}
        try:
            self._socket.bind(self._target)
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

    def _receive(self) -> bytes:
        data, peer = self._socket.recvfrom(_DATAGRAM)
        self._peers.pop(peer, None)
        self._peers[peer] = self._clock.now()
        if len(self._peers) > _MOST_PEERS:
            del self._peers[next(iter(self._peers))]
        return data

    def _write(self, data: bytes) -> None:
        forgotten = self._clock.now() - _REMEMBERED
        latest = next(reversed(self._peers), None)
        for peer, heard in tuple(self._peers.items()):
            if heard < forgotten and peer != latest:
                del self._peers[peer]
                continue
            self._try(lambda peer=peer: self._socket.sendto(data, peer))  # type: ignore[misc]


class UdpOut(_UdpSocket):
    """Send to a fixed address and listen for its answers."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"udpout:{address}", address)
        try:
            self._socket.connect(self._target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(f"cannot reach UDP {address}: {error.strerror}; check the address") from error
        self._socket.setblocking(False)

    def _write(self, data: bytes) -> None:
        self._try(lambda: self._socket.send(data))
