"""A vehicle on a pseudo-terminal with a limited rate, in simulated time."""

from __future__ import annotations

import os
import pty
import select
import tty
from collections import deque

from gcs_autotune.link import Transport, open_link
from gcs_autotune.link.transports.memory import Peer
from gcs_autotune.link.transports.transport import SteppedTransport
from gcs_autotune.mavlink import split_frames

BITS_PER_BYTE = 10
"""Bits per byte: start bit, eight data bits, stop bit."""
AUTOPILOT_BUFFER = 2048
"""Size of the buffer in the autopilot's serial driver; a message that does not fit is not sent."""
_STEP = 0.01
_PATIENCE = 10.0


class Wire:
    """One direction: it takes whole frames, and returns bytes at ``rate`` [bytes/s].

    Attributes
    ----------
    passed, dropped : bytes that passed, frames that did not fit.
    longest : largest number of waiting bytes.
    """

    def __init__(self, rate: float, room: float) -> None:
        self.rate, self.room = rate, room
        self.passed = self.dropped = self.longest = 0
        self._held: deque[int] = deque()
        self._credit = 0.0

    def put(self, data: bytes) -> None:
        """Take as many frames as fit."""
        for frame in split_frames(data):
            if len(self._held) + len(frame) > self.room:
                self.dropped += 1
            else:
                self._held += frame
        self.longest = max(self.longest, len(self._held))

    def take(self, seconds: float) -> bytes:
        """Return the bytes that pass within *seconds*."""
        self._credit = min(self._credit + self.rate * seconds, self.rate * seconds + 1.0)
        count = min(int(self._credit), len(self._held))
        self._credit -= count
        self.passed += count
        return bytes(self._held.popleft() for _ in range(count))


class ThrottledPty(SteppedTransport):
    """The serial transport on one end of a pseudo-terminal, with *peer* behind two wires on the other."""

    def __init__(self, peer: Peer, baud: int) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self.port: Transport = open_link(f"serial://{os.ttyname(slave)}:{baud}")
        os.close(slave)
        super().__init__(self.port.description)
        self.peer = peer
        self.up = Wire(baud / BITS_PER_BYTE, float("inf"))
        self.down = Wire(baud / BITS_PER_BYTE, AUTOPILOT_BUFFER)

    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        if outgoing:
            self.port.write(outgoing)
            self.up.put(self._from_port(len(outgoing)))
        now, came = self._clock.now(), bytearray()
        while now < grant - 1e-9:
            step = min(_STEP, grant - now)
            now += step
            self.peer.receive(self.up.take(step))
            self.down.put(self.peer.advance_to(now))
            came += self._through_port(self.down.take(step))
        return grant, bytes(came)

    def _from_port(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            assert select.select([self._master], [], [], _PATIENCE)[0], "the port swallowed bytes"
            data += os.read(self._master, count - len(data))
        return data

    def _through_port(self, data: bytes) -> bytes:
        came = b""
        os.write(self._master, data)
        while len(came) < len(data):
            piece = self.port.read(_PATIENCE)
            assert piece, "the port swallowed bytes"
            came += piece
        return came

    def unplug(self) -> None:
        """Close the terminal."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def _close(self) -> None:
        self.port.close()
        self.unplug()
