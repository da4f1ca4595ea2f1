"""Links whose other end waits for us: simulated time advances only by our grants (decision 1)."""

from __future__ import annotations

import math
from abc import abstractmethod

from gcs_autotune.clock import ManualClock
from gcs_autotune.link.transport import Transport

__all__ = ["SteppedTransport"]

_ROUNDING = 1e-6


class SteppedTransport(Transport):
    """A transport that owns its time.

    ``quantum`` [s] is the control period: one grant never runs past its next multiple (counted from ``phase``),
    so what is decided on a message reaches the vehicle at the tick at which that message was sent.
    """

    is_simulated = True

    def __init__(self, description: str, quantum: float = 0.1) -> None:
        self._manual = ManualClock()
        super().__init__(description, self._manual)
        self.quantum = quantum
        self.phase = 0.0
        self._outgoing = bytearray()

    def follow_tick(self, at: float, period: float) -> None:
        """Grant time up to ``at + k * period`` [s] from now on."""
        self.phase, self.quantum = at, period

    def _read_available(self, timeout: float) -> bytes:
        now = self._manual.now()
        grant = min(_round_up(now + timeout), self._next_boundary(now)) if timeout > 0.0 else now
        outgoing, self._outgoing = bytes(self._outgoing), bytearray()
        reached, data = self._step(grant, outgoing)
        self._manual.advance_to(max(grant, reached))
        return data

    def _next_boundary(self, now: float) -> float:
        count = math.floor((now - self.phase) / self.quantum + _ROUNDING) + 1
        return round(self.phase + count * self.quantum, 9)

    def _write(self, data: bytes) -> None:
        self._outgoing += data

    @abstractmethod
    def _step(self, grant: float, outgoing: bytes) -> tuple[float, bytes]:
        """Hand over *outgoing*, run to *grant* [s]; return the time reached and what was sent meanwhile."""


def _round_up(t: float) -> float:
    """Return *t* [s] on the next whole nanosecond, so that a grant always reaches the deadline it is for."""
    return round(t + 0.5e-9, 9)
