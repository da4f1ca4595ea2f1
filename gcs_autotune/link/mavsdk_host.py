"""What an open MAVSDK link needs of the whole process: MAVSDK's log, and quicker switching between threads.

MAVSDK logs to standard output, once for the whole process: while a link of ours is open the log is ours, and what it
complains of is kept. Every frame it receives is handed over on its own thread, which has to wait until our thread lets
go of the interpreter: at Python's usual 5 ms that is 200 frames a second while we compute, and a parameter list from a
fast simulator overruns the socket (measured: 1241 parameters in 3 to 32 s with losses; 0.20 s at 0.1 ms).
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

__all__ = ["HOST", "Complain", "MavsdkHost"]

_SWITCH_INTERVAL = 1e-4
_WARNING = 2
_NOISE = ("Sending message failed", "Connection using ")
"""What MAVSDK complains of in ordinary use: a peer that has not called yet, an old form of URL."""
_NEWS = ("TCP connection closed", "TCP client disconnected")
"""What it holds to be no error, and is one to us."""

Complain = Callable[[str], None]


class MavsdkHost:
    """Counts the open links; the first to come sets the process up, the last to leave puts it back."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: list[Complain] = []
        self._usual_interval = 0.0

    def join(self, module: Any, complain: Complain) -> None:
        """Call *complain* with every complaint, on MAVSDK's thread; *module* is the imported ``mavsdk``."""
        with self._lock:
            self._listeners.append(complain)
            if len(self._listeners) == 1:
                self._usual_interval = sys.getswitchinterval()
                sys.setswitchinterval(min(self._usual_interval, _SWITCH_INTERVAL))
                module.log_subscribe(self._take)

    def leave(self, module: Any, complain: Complain) -> None:
        """End what :meth:`join` began."""
        with self._lock:
            self._listeners.remove(complain)
            if not self._listeners:
                module.log_unsubscribe()
                sys.setswitchinterval(self._usual_interval)

    def _take(self, level: int, text: str, file: str | None, line: int) -> bool:
        if (level >= _WARNING and not text.startswith(_NOISE)) or text.startswith(_NEWS):
            for complain in tuple(self._listeners):
                complain(text)
        return True


HOST = MavsdkHost()
"""The one of this process."""
