"""A narrow pipe before a peer: bytes per second, latency, jitter and loss, each way. Simulated time, seeded."""

from __future__ import annotations

import random
from collections import deque

from gcs_autotune.link import Peer
from gcs_autotune.mavlink import split_frames

STEP = 0.02


class Narrow:
    """Frames beyond the capacity are dropped, as an autopilot does when its port is full.

    rate : bytes/s downwards. latency, jitter : s each way (jitter uniform, never overtaking). loss : of frames.
    """

    def __init__(
        self, peer: Peer, rate: float = 1e9, latency: float = 0.0, jitter: float = 0.0, loss: float = 0.0, seed: int = 1
    ) -> None:
        self.peer, self.rate, self.latency, self.jitter, self.loss = peer, rate, latency, jitter, loss
        self.carried = self.dropped = 0
        self._random = random.Random(seed)
        self._up: deque[tuple[float, bytes]] = deque()
        self._down: deque[tuple[float, bytes]] = deque()
        self._free = self._now = 0.0

    def receive(self, data: bytes) -> None:
        for frame in split_frames(data):
            if frame and self._random.random() >= self.loss:
                before = self._up[-1][0] if self._up else 0.0
                self._up.append((max(before, self._now + self._late()), frame))

    def advance_to(self, t: float) -> bytes:
        while self._now + STEP <= t + 1e-9:
            self._now += STEP
            while self._up and self._up[0][0] <= self._now + 1e-9:
                self.peer.receive(self._up.popleft()[1])
            for frame in split_frames(self.peer.advance_to(self._now)):
                self._send(frame)
        out = bytearray()
        while self._down and self._down[0][0] <= t + 1e-9:
            out += self._down.popleft()[1]
        return bytes(out)

    def _send(self, frame: bytes) -> None:
        """The port takes a tenth of a second of traffic, at least two frames, and nothing more."""
        if self._free > self._now + max(0.1, 600.0 / self.rate) or self._random.random() < self.loss:
            self.dropped += len(frame)
            return
        self.carried += len(frame)
        self._free = max(self._free, self._now) + len(frame) / self.rate
        before = self._down[-1][0] if self._down else 0.0
        self._down.append((max(before, self._free + self._late()), frame))

    def _late(self) -> float:
        return self.latency + self.jitter * self._random.random()
