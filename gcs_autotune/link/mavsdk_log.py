"""MAVSDK's log, which would go to standard output: taken over while a link of ours is open, and its complaints kept.

MAVSDK has one log for the whole process; every open link hears every complaint.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

__all__ = ["LOG", "MavsdkLog"]

_WARNING = 2
_NOISE = ("Sending message failed", "Connection using ")
"""What MAVSDK complains of in ordinary use: a peer that has not called yet, an old form of URL."""
_NEWS = ("TCP connection closed", "TCP client disconnected")
"""What it holds to be no error, and is one to us."""

Complain = Callable[[str], None]


class MavsdkLog:
    """Hands what MAVSDK complains of to whoever has joined."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: list[Complain] = []

    def join(self, module: Any, listener: Complain) -> None:
        """Call *listener* with every complaint, on MAVSDK's thread; *module* is the imported ``mavsdk``."""
        with self._lock:
            self._listeners.append(listener)
            if len(self._listeners) == 1:
                module.log_subscribe(self._take)

    def leave(self, module: Any, listener: Complain) -> None:
        """End what :meth:`join` began; MAVSDK prints again once nobody listens."""
        with self._lock:
            self._listeners.remove(listener)
            if not self._listeners:
                module.log_unsubscribe()

    def _take(self, level: int, text: str, file: str | None, line: int) -> bool:
        if (level >= _WARNING and not text.startswith(_NOISE)) or text.startswith(_NEWS):
            for listener in tuple(self._listeners):
                listener(text)
        return True


LOG = MavsdkLog()
"""The one of this process."""
