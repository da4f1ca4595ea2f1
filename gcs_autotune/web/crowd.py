"""Limit idle connections: they are closed after a while, the oldest first if there are many.

A program that opens a thousand connections and sends nothing would use up the file descriptors, and a STOP could not be
accepted. Therefore the number of connections without a complete request is limited. A new connection is always
accepted, and idle ones are closed for it. Requests in progress are counted by :mod:`.access`.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["HEADERS_WITHIN", "OF_ONE_ADDRESS", "WAITING", "Seldom", "WaitingRoom", "guarded"]

HEADERS_WITHIN = 5.0
"""Time [s] within which the header of a request must arrive; a radio's round trip is at most 2 s. Project choice."""
WAITING, OF_ONE_ADDRESS = 128, 96
"""Most connections without a complete request, in total and from one address; a browser opens six. Project choice."""
_AGAIN, _OFTEN = 60.0, 3
"""Time window [s], and most repeats of a log line within it. Project choice."""


class WaitingRoom:
    """Connections without a request, the oldest first. Excess ones are closed through their ``close``."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[object, tuple[str, Callable[[], object]]] = OrderedDict()

    def __len__(self) -> int:
        return len(self._waiting)

    def enter(self, who: object, address: str, close: Callable[[], object]) -> None:
        """Register *who* as idle.

        If there are too many idle connections, close the oldest of its *address* or of all.
        """
        self._waiting[who] = address, close
        same = [other for other, (where, _) in self._waiting.items() if where == address]
        if len(same) > OF_ONE_ADDRESS:
            self._close(same[0])
        elif len(self._waiting) > WAITING:
            self._close(next(iter(self._waiting)))

    def leave(self, who: object) -> None:
        """Unregister *who*, because it sent a request or closed."""
        self._waiting.pop(who, None)

    def _close(self, who: object) -> None:
        _, close = self._waiting.pop(who)
        close()


def guarded() -> type[H11Protocol]:
    """Return uvicorn's HTTP protocol class with its own waiting room."""
    room = WaitingRoom()

    class Guarded(H11Protocol):
        _timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            asked = self.cycle is not None and not self.cycle.response_complete
            if asked or self.transport.get_protocol() is not self:
                self._go()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            if not self.transport.is_closing():
                self._wait()

        def connection_lost(self, exc: Exception | None) -> None:
            self._go()
            super().connection_lost(exc)

        def _wait(self) -> None:
            self._go()
            self._timer = self.loop.call_later(HEADERS_WITHIN, self._end)
            room.enter(self, self.client[0] if self.client else "", self._end)

        def _go(self) -> None:
            room.leave(self)
            if self._timer is not None:
                self._timer.cancel()

        def _end(self) -> None:
            self._go()
            self.transport.abort()

    return Guarded


class Seldom(logging.Filter):
    """Log filter that passes the same line only a few times a minute."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._now = now
        self._seen: OrderedDict[str, list[float]] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether *record* is written."""
        now = self._now()
        times = self._seen.setdefault(str(record.msg)[:100], [])
        times[:] = [t for t in times if now - t < _AGAIN]
        while len(self._seen) > _MOST_LINES:
            self._seen.popitem(last=False)
        if len(times) >= _OFTEN:
            return False
        times.append(now)
        return True


_MOST_LINES = 100
