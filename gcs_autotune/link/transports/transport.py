"""Base class of all connections: read bytes with a deadline, write bytes, and provide a clock.

A backend supplies three small methods; deadlines, closing and error texts are here. The clock belongs to the transport
because only the transport determines whether time is real or simulated. There are two subclasses: streams that
reconnect, and links whose other end runs only in time steps that we grant (decision 1).
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
    """Wait *seconds* [s] of real time, on a link without a file descriptor to wait on."""
    time.sleep(seconds)


class Transport(ABC):
    """A two-way stream of bytes to one vehicle.

    Parameters
    ----------
    description : text for the user that identifies this connection, e.g. ``udpin:0.0.0.0:14550``.
    clock : the clock for time-outs on this link.
    """

    is_simulated = False
    """Whether the link's time is simulated, so that a record is reproducible bit for bit."""

    stays_open = False
    """Whether :meth:`close` leaves the link open, because a later run of the same job uses it."""

    origin = ""
    """Sender of the bytes returned by the last :meth:`read`, on links with several senders; else empty."""

    repeat_period = 0.04
    """Period [s] after which a command in force is repeated: 25 Hz.

    ArduRover without a receiver assumes that its pilot is lost after half a second, in which twelve repetitions fit.
    """

    def __init__(self, description: str, clock: Clock | None = None) -> None:
        self._description = description
        self._clock: Clock = clock or WallClock()
        self._closed = False

    @property
    def clock(self) -> Clock:
        """The clock for time-outs on this link, in real or simulated time."""
        return self._clock

    @property
    def description(self) -> str:
        """Text that identifies this connection, e.g. ``udpin:0.0.0.0:14550``."""
        return self._description

    @property
    def carrier(self) -> str:
        """Name and version of the library that transports the bytes, if it is not this package, e.g. ``MAVSDK 4.1.0``;
        else empty.
        """
        return ""

    @property
    def trouble(self) -> str:
        """Last problem of the link or its library as text, for the error about a silence; empty if there is none."""
        return ""

    def read(self, timeout: float) -> bytes:
        """Return the bytes that arrive within *timeout* [s of the link's clock]; ``b""`` if there are none.

        It returns as soon as any bytes arrive.

        Raises
        ------
        LinkLost
            The other end is permanently lost, or this end was closed.
        """
        self._check_open()
        deadline = Deadline.after(self._clock, max(timeout, 0.0))
        while True:
            data = self._read_available(deadline.remaining)
            if data or deadline.expired:
                return data

    def write(self, data: bytes) -> None:
        """Send *data* to the other end.

        Raises
        ------
        LinkLost
            The other end is permanently lost, or this end was closed.
        """
        self._check_open()
        if data:
            self._write(data)

    def follow_tick(self, at: float, period: float) -> None:  # noqa: B027 - real links ignore it
        """Announce that control decisions are made at ``at + k * period`` [s of the link's clock]. Real links ignore
        this. A simulated link advances time in these steps.
        """

    def hold(self, origin: str) -> None:  # noqa: B027 - most links have one peer only
        """Send only to the address *origin* from now on, while it sends. If *origin* is empty, send to all
        peers again.
        """

    def close(self) -> None:
        """Close the port, socket or process, unless it stays open. It may be called twice."""
        if not (self._closed or self.stays_open):
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
        """Return the error for a lost link, with reason and remedy."""
        return LinkLost(f"link {self._description} lost: {cause}. To fix it: {cure}")

    @abstractmethod
    def _read_available(self, timeout: float) -> bytes:
        """Wait at most *timeout* for bytes; return them, or ``b""``."""

    @abstractmethod
    def _write(self, data: bytes) -> None:
        """Send all of *data*, or raise ``LinkLost``."""

    @abstractmethod
    def _close(self) -> None:
        """Release the backend's resources."""


_RETRY = 1.0
"""Time [s] between two attempts to reconnect. Project choice."""


class ReconnectingTransport(Transport):
    """A transport that reports a loss once and then reconnects.

    The read or write that detects the broken stream raises ``LinkLost``. Later reads try to reconnect once a second.
    Writes are dropped, as on a radio. So a session can wait for the vehicle to return.
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
        """Wait at most *timeout* [s] for bytes. Raises ``OSError`` or ``EOFError`` if the stream is broken."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Send all of *data*. Raises ``OSError`` if the stream is broken."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Close this end of a broken or finished stream; it may be called twice."""

    @abstractmethod
    def _call_again(self) -> bool:
        """Try to reconnect; return whether it succeeded."""

    @abstractmethod
    def _loss(self, error: Exception) -> LinkLost:
        """Return the message for a stream broken with *error*."""


_ROUNDING = 1e-6


class SteppedTransport(Transport):
    """A transport that advances simulated time in steps.

    ``quantum`` [s] is the control period. A time step never goes beyond the next multiple of ``quantum`` after
    ``phase`` [s]. So a decision based on a message reaches the vehicle in the tick in which that message was sent.
    """

    is_simulated = True

    def __init__(self, description: str, quantum: float = 0.1) -> None:
        self._manual = ManualClock()
        super().__init__(description, self._manual)
        self.quantum = quantum
        self.phase = 0.0
        self._outgoing = bytearray()

    def follow_tick(self, at: float, period: float) -> None:
        """Let each time step end at the next ``at + k * period`` [s], at the latest."""
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
        """Send *outgoing* and run to *grant* [s]. Return the time reached and the bytes received."""


def _round_up(t: float) -> float:
    """Return *t* [s] rounded up to a whole nanosecond, so that a time step always reaches its deadline."""
    return round(t + 0.5e-9, 9)
