"""UDP: listen for a vehicle (``udpin``) or send to one (``udpout``)."""

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
"""Number of datagrams read at once; a parameter list arrives as a thousand of them. Project choice."""
_ROOM = 1 << 20
"""Receive buffer requested from the system [bytes]; it may grant less. Project choice."""
_REMEMBERED = 10.0
"""Silence [s] after which a peer no longer receives our messages, unless it is the only one. Project choice."""
_MOST_PEERS = 8
_GONE = 3.0
"""Silence [s] of the selected sender after which we send to all peers again, since it may have moved. Project
choice."""


class _UdpSocket(Transport):
    """Common part of both kinds of UDP link."""

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
            except (BlockingIOError, ConnectionError):  # refused: the port is not open yet; silence, not an end
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
    """Bind a port, wait for senders, and send to all recent ones, vehicles and relays alike."""

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
                "port, or choose another port. If a simulator itself listens on this port, use udpout:"
            ) from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The bound port, useful if port 0 was requested."""
        return int(self._socket.getsockname()[1])

    def hold(self, origin: str) -> None:
        """Send only to the address *origin* from now on, while it sends. If *origin* is empty, send to all
        peers again.
        """
        self._held = next((peer for peer in self._peers if _named(peer) == origin), None)

    def _read_available(self, timeout: float) -> bytes:
        """Return the bytes of one sender, up to the first datagram of another."""
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
    """Return the text of an address in the usual notation."""
    host, port = str(peer[0]), int(peer[1])
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class UdpOut(_UdpSocket):
    """A UDP link that sends to a fixed address and receives its answers."""

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
