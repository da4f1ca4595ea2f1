"""Streams whose other end may go and come back: a rebooted autopilot, a cable pulled and plugged in again."""

from __future__ import annotations

import math
from abc import abstractmethod

from gcs_autotune.errors import LinkLost
from gcs_autotune.link.transport import Transport, idle

__all__ = ["ReturningTransport"]

_RETRY = 1.0
"""Chosen: seconds between two looks for the other end."""


class ReturningTransport(Transport):
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
