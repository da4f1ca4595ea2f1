"""What every connection has in common: bytes in within a deadline, bytes out, a clock.

A backend supplies three small methods; deadlines, closing and error texts live here. The clock belongs to
the transport because only it knows whether time is the machine's or a simulator's.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from gcs_autotune.clock import Clock, Deadline, WallClock
from gcs_autotune.errors import LinkLost

__all__ = ["Transport", "idle"]


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
        return LinkLost(f"link {self._description} lost: {cause}; {cure}")

    @abstractmethod
    def _read_available(self, timeout: float) -> bytes:
        """Wait at most *timeout* for bytes; return them, or ``b""``."""

    @abstractmethod
    def _write(self, data: bytes) -> None:
        """Send all of *data*, or raise ``LinkLost``."""

    @abstractmethod
    def _close(self) -> None:
        """Release what the backend holds."""
