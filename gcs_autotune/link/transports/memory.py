"""A link inside this process to an object that simulates the vehicle, in simulated time.

It delivers reliably and in order unless configured otherwise; bandwidth is not modelled.
"""

from __future__ import annotations

import random
from collections import deque
from typing import Protocol

from gcs_autotune.link.transports.transport import SteppedTransport
from gcs_autotune.mavlink import split_frames

__all__ = ["MemoryLink", "Peer"]


class Peer(Protocol):
    """The simulated vehicle at the other end of a link. It receives bytes, runs to a time, and returns the bytes sent
    until then.
    """

    def receive(self, data: bytes) -> object:
        """Receive *data*, which arrives at the peer's present time."""
        ...

    def advance_to(self, t: float) -> bytes:
        """Run to time *t* [s] and return the bytes sent until then."""
        ...


class MemoryLink(SteppedTransport):
    """A link to a :class:`Peer` in memory.

    Parameters
    ----------
    loss : probability that a frame is lost, in each direction.
    delay : delay of a frame [s], in each direction.
    seed : seed of the random losses.
    """

    def __init__(
        self, peer: Peer, *, quantum: float = 0.1, loss: float = 0.0, delay: float = 0.0, seed: int = 0
    ) -> None:
        super().__init__("memory", quantum)
        self._peer = peer
        self._loss = loss
        self._delay = delay
        self._random = random.Random(seed)
        self._up: deque[tuple[float, bytes]] = deque()
        self._down: deque[tuple[float, bytes]] = deque()

    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        now = self._clock.now()
        self._up.append((now + self._delay, self._lossy(outgoing)))
        while self._up and self._up[0][0] <= grant:
            due, data = self._up.popleft()
            if due > now:
                self._collect(due)
            if data:
                self._peer.receive(data)
        self._collect(grant)
        return grant, self._arrived(grant)

    def _collect(self, t: float) -> None:
        self._down.append((t + self._delay, self._lossy(self._peer.advance_to(t))))

    def _arrived(self, t: float) -> bytes:
        arrived = bytearray()
        while self._down and self._down[0][0] <= t:
            arrived += self._down.popleft()[1]
        return bytes(arrived)

    def _lossy(self, data: bytes) -> bytes:
        if not self._loss or not data:
            return data
        return b"".join(f for f in split_frames(data) if self._random.random() >= self._loss)

    def _close(self) -> None:
        self._up.clear()
        self._down.clear()
