"""UDP: listen for a vehicle (``udpin``) or call one (``udpout``)."""

from __future__ import annotations

import math
import select
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from gcs_autotune.errors import CannotOpenLink
from gcs_autotune.link.transports.address import HostPort, resolve
from gcs_autotune.link.transports.transport import Transport

__all__ = ["UdpIn", "UdpOut"]

_DATAGRAM = 65535
_AT_ONCE = 256
"""Chosen: datagrams taken in one read; a parameter list comes as a thousand of them."""
_ROOM = 1 << 20
"""Chosen: bytes asked of the system for what arrives while we compute; it may give less."""
_REMEMBERED = 10.0
"""Chosen: seconds after which one who has gone silent is not answered any more, unless nobody else is there."""
_MOST_PEERS = 8
_GONE = 3.0
"""Chosen [s]: so long after the last word of the one held to, everybody is talked to again: it may have moved."""


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
        self._inbox: deque[tuple[Any, bytes]] = deque()
        self._held: Any = None
        try:
            self._socket.bind(self._target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(
                f"cannot listen on UDP {address}: {error.strerror}. Close another ground station that uses that "
                "port, or choose another one. For a simulator that listens there itself, use udpout:"
            ) from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The port that is really bound (useful after asking for port 0)."""
        return int(self._socket.getsockname()[1])

    def hold(self, origin: str) -> None:
        """From now on talk to the sender at *origin* alone, as long as it is heard; empty: to everybody again."""
        self._held = next((peer for peer in self._peers if _named(peer) == origin), None)

    def _read_available(self, timeout: float) -> bytes:
        """Return what has come from one sender, up to where another one's begins."""
        if not self._inbox:
            super()._read_available(timeout)
        data = bytearray()
        sender = self._inbox[0][0] if self._inbox else None
        while self._inbox and self._inbox[0][0] == sender:
            data += self._inbox.popleft()[1]
        if sender is not None:
            self.origin = _named(sender)
        return bytes(data)

    def _receive(self) -> bytes:
        data, peer = self._socket.recvfrom(_DATAGRAM)
        self._peers.pop(peer, None)
        self._peers[peer] = self._clock.now()
        self._inbox.append((peer, data))
        if len(self._peers) > _MOST_PEERS:
            del self._peers[next(other for other in self._peers if other != self._held)]
        return data

    def _write(self, data: bytes) -> None:
        held = self._held
        if held is not None and self._clock.now() - self._peers.get(held, -math.inf) < _GONE:
            self._try(lambda: self._socket.sendto(data, held))
            return
        forgotten = self._clock.now() - _REMEMBERED
        latest = next(reversed(self._peers), None)
        for peer, heard in tuple(self._peers.items()):
            if heard < forgotten and peer != latest:
                del self._peers[peer]
                continue
            self._try(lambda peer=peer: self._socket.sendto(data, peer))  # type: ignore[misc]


def _named(peer: Any) -> str:
    """Return an address as a person would write it."""
    host, port = str(peer[0]), int(peer[1])
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class UdpOut(_UdpSocket):
    """Send to a fixed address and listen for its answers."""

    def __init__(self, address: HostPort) -> None:
        super().__init__(f"udpout:{address}", address)
        try:
            self._socket.connect(self._target)
        except OSError as error:
            self._socket.close()
            raise CannotOpenLink(f"cannot reach UDP {address}: {error.strerror}. Check the address") from error
        self._socket.setblocking(False)

    def _write(self, data: bytes) -> None:
        self._try(lambda: self._socket.send(data))
