"""What every connection has in common: bytes in within a deadline, bytes out, a clock.

A backend supplies three small methods; deadlines, closing and error texts live here. The clock belongs to
the transport because only it knows whether time is the machine's or a simulator's. Streams whose other end may go and
come back, and links whose other end waits for our grants of time (decision 1), are two kinds of their own.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from gcs_autotune.clock import Clock, Deadline, ManualClock, WallClock
from gcs_autotune.errors import LinkLost

__all__ = ["ReconnectingTransport", "SteppedTransport", "Transport", "idle"]


def idle(seconds: float) -> None:
    """Let real time pass on a link that has nothing to wait on."""
    time.sleep(seconds)


class Transport(ABC):
    """A two-way stream of bytes to one vehicle.

    Parameters
    ----------
    description : how to name this connection to a person, e.g. ``udpin:0.0.0.0:14550``.
    clock : the clock that time-outs on this link are measured with.
    """

    is_simulated = False
    """True when the link's time is simulated, so that a record may be repeated to the last bit."""

    origin = ""
    """Where what the last :meth:`read` returned came from, on links that have several senders; else empty."""

    repeat_period = 0.04
    """Seconds after which a command in force is sent again: 25 Hz, a dozen in the half second after which ArduRover
    without a receiver takes its pilot for lost."""

    def __init__(self, description: str, clock: Clock | None = None) -> None:
        self._description = description
        self._clock: Clock = clock or WallClock()
        self._closed = False

    @property
    def clock(self) -> Clock:
        """The link's clock."""
        return self._clock

    @property
    def description(self) -> str:
        """The connection as a person would write it."""
        return self._description

    @property
    def carrier(self) -> str:
        """What carries the bytes when it is not this package itself, e.g. ``MAVSDK 4.1.0``; else empty."""
        return ""

    @property
    def trouble(self) -> str:
        """What the carrier last complained of, for the error that tells of silence; empty when it did not."""
        return ""

    def read(self, timeout: float) -> bytes:
        """Return what arrives within *timeout* [s of the link's clock]; ``b""`` when nothing does.

        Returns as soon as there is something.

        Raises
        ------
        LinkLost
            The other end is gone for good, or this end was closed.
        """
        self._check_open()
        deadline = Deadline.after(self._clock, max(timeout, 0.0))
        while True:
            data = self._read_available(deadline.remaining)
            if data or deadline.expired:
                return data

    def write(self, data: bytes) -> None:
        """Send *data*.

        Raises
        ------
        LinkLost
            The other end is gone for good, or this end was closed.
        """
        self._check_open()
        if data:
            self._write(data)

    def follow_tick(self, at: float, period: float) -> None:  # noqa: B027 - real time needs no telling
        """Learn that control decisions fall on ``at + k * period`` [s of the link's clock].

        Real links ignore it; simulated time is granted in these portions.
        """

    def hold(self, origin: str) -> None:  # noqa: B027 - a link with one other end has nobody else to talk to
        """From now on talk to the sender at *origin* alone, as long as it is heard; empty: to everybody again."""

    def close(self) -> None:
        """Let go of the port, socket or process. Closing twice does nothing."""
        if not self._closed:
            self._closed = True
            self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise LinkLost(f"the link {self._description} has been closed")

    def lost(self, cause: str, cure: str) -> LinkLost:
        """Return the error that says this link is gone, why, and what to try."""
        return LinkLost(f"link {self._description} lost: {cause}. To fix it: {cure}")

    @abstractmethod
    def _read_available(self, timeout: float) -> bytes:
        """Wait at most *timeout* for bytes; return them, or ``b""``."""

    @abstractmethod
    def _write(self, data: bytes) -> None:
        """Send all of *data*, or raise ``LinkLost``."""

    @abstractmethod
    def _close(self) -> None:
        """Release what the backend holds."""


_RETRY = 1.0
"""Chosen: seconds between two looks for the other end."""


class ReconnectingTransport(Transport):
    """A transport that says a loss once and then looks for the other end again.

    The read or write that finds the stream broken raises ``LinkLost``. Later reads wait, and try once a second to have
    the stream back; writes are dropped meanwhile, as by a radio. So a session can await the vehicle's return.
    """

    def __init__(self, description: str) -> None:
        super().__init__(description)
        self._is_down = False
        self._next_look = -math.inf

    def _read_available(self, timeout: float) -> bytes:
        if self._is_down:
            self._look(timeout)
            return b""
        try:
            return self._receive(timeout)
        except (OSError, EOFError, TypeError) as error:  # pyserial: TypeError when the descriptor vanished underneath
            raise self._lose(error) from error

    def _write(self, data: bytes) -> None:
        if self._is_down:
            return
        try:
            self._send(data)
        except OSError as error:
            raise self._lose(error) from error

    def _lose(self, error: Exception) -> LinkLost:
        self._is_down = True
        self._next_look = self._clock.now() + _RETRY
        self._hang_up()
        return self._loss(error)

    def _look(self, timeout: float) -> None:
        ahead = self._next_look - self._clock.now()
        if ahead > 0.0:
            idle(min(timeout, ahead))
            return
        self._next_look = self._clock.now() + _RETRY
        self._is_down = not self._call_again()

    def _close(self) -> None:
        self._hang_up()

    @abstractmethod
    def _receive(self, timeout: float) -> bytes:
        """Wait at most *timeout* [s] for bytes. ``OSError`` or ``EOFError``: the stream is broken."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Send all of *data*. ``OSError``: the stream is broken."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Release this end of a broken or finished stream; doing so twice does nothing."""

    @abstractmethod
    def _call_again(self) -> bool:
        """Try to have the stream back; return whether that worked."""

    @abstractmethod
    def _loss(self, error: Exception) -> LinkLost:
        """Return what to tell when the stream broke with *error*."""


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
