"""The state of the current run, and its viewers.

Viewers get the whole state once and then changes, ten times a second. A slow viewer gets the whole state again. It
delays neither other viewers nor the run, which is another process.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator, Mapping
from typing import Any

from gcs_autotune.untrusted_text import visible

__all__ = ["Live"]

EVERY = 0.1
"""Time between two updates to the viewers [s]. Project choice."""
ALIVE = 1.0
"""Longest time between messages to a viewer [s], after which an empty message is sent. Project choice."""
ROWS, WORDS = 4000, 300
"""Number of samples and of sentences kept for later viewers. Project choice."""
BEHIND = 30
"""Number of pending updates above which a viewer gets the whole state again. Project choice."""
MOST_VIEWERS = 32
"""Largest number of simultaneous viewers. Above it, a viewer with the token replaces one without. Project choice."""
_KEPT = ("intentions", "now", "vitals", "room", "cost", "proposal", "track", "steps", "left", "dropped")
"""Types of messages of which only the last one is kept, unchanged."""
_LONGEST = 2000
"""Number of characters of a sentence that are kept. Project choice."""
_EXPECTED: Mapping[str, str] = {
    "radio failsafe": "Expected here: the run no longer sends stick positions. A transmitter that is on clears it."
}
"""Part of a vehicle's message, in small letters, that is expected once a run has ended -> what it means."""
_OVER = ""
"""Value in a viewer's queue that marks the end of the stream."""


class Live:
    """The state of the page: a document, its changes, and the viewers' queues.

    Everything happens on the event loop's thread.
    """

    def __init__(self) -> None:
        self._viewers: dict[asyncio.Queue[str | None], bool] = {}
        self._state: dict[str, Any] = {"run": None}
        self._legs: list[dict[str, Any]] = []
        self._rows: deque[list[Any]] = deque(maxlen=ROWS)
        self._words: deque[dict[str, Any]] = deque(maxlen=WORDS)
        self._count = 0
        self._changed: dict[str, Any] = {}
        self._new: dict[str, list[Any]] = {"legs": [], "rows": [], "words": []}

    # --- what happens ---------------------------------------------------------------------------------------

    def begin(self, run: dict[str, Any]) -> None:
        """Clear the state of the last run, because another one begins."""
        desk = {key: value for key, value in self._state.items() if key == "desk"}
        self._state, self._changed = dict(desk), dict(desk)
        self._legs.clear()
        self._rows.clear()
        self._words.clear()
        self._new = {"legs": [], "rows": [], "words": []}
        self.put("run", run)
        self._changed["fresh"] = True

    def put(self, key: str, value: Any) -> None:
        """Set *key* of the document to *value*."""
        self._state[key] = self._changed[key] = value

    def get(self, key: str) -> Any:
        """Return *key* of the document; None if it has no such key."""
        return self._state.get(key)

    @property
    def sentences(self) -> list[str]:
        """The latest sentences of the tool, without those of the vehicle."""
        return [words["text"] for words in self._words if words["severity"] is None]

    def say(self, text: str, severity: int | None = None) -> None:
        """Add a sentence to the document. With a *severity* it is a message of the vehicle."""
        self._count += 1
        words = {"n": self._count, "text": visible(text)[:_LONGEST], "severity": severity}
        if severity is not None and self._has_released():
            words["note"] = next((note for part, note in _EXPECTED.items() if part in text.casefold()), "")
        self._words.append(words)
        self._new["words"] = [*self._new["words"], words][-WORDS:]

    def _has_released(self) -> bool:
        """Whether the run no longer holds the sticks: it was stopped, or has restored the vehicle."""
        return any(self._state.get(key) for key in ("stopping", "left", "end"))

    def take(self, line: bytes) -> None:
        """Process one line of a job. A line with an unknown key is ignored."""
        try:
            message = json.loads(line)
            ((key, value),) = message.items()
            if key == "samples":
                self._sample(value)
            elif key == "say":
                self.say(str(value))
            elif key == "words":
                self.say(str(value["text"]), int(value["severity"]))
            elif key == "question":
                self.put(key, {"id": int(value["id"]), "text": visible(str(value["text"]))})
            elif key in _KEPT:
                if key == "steps" and any(step["state"] == "flying" for step in value["steps"]):
                    self._forget(("proposal", "cost", "track"))
                self.put(key, value)
        except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError):
            return

    def _forget(self, keys: tuple[str, ...]) -> None:
        """Remove what the last step of a job reported, because the next one begins."""
        for key in keys:
            if self._state.get(key) is not None:
                self.put(key, None)

    def _sample(self, value: dict[str, Any]) -> None:
        leg = {name: str(value[name]) for name in ("stage", "manoeuvre", "signal")}
        if not self._legs or self._legs[-1] != leg:
            self._legs.append(leg)
            self._new["legs"].append(leg)
        number = len(self._legs) - 1
        rows = [[number, *row] for row in value["rows"]]
        self._rows.extend(rows)
        self._new["rows"] = [*self._new["rows"], *rows][-ROWS:]

    # --- who looks ------------------------------------------------------------------------------------------

    def whole(self) -> str:
        """Return the whole document as JSON."""
        lists = {"legs": self._legs, "rows": list(self._rows), "words": list(self._words)}
        return _packed({"whole": {**self._state, **lists}})

    async def watch(self, *, owner: bool = False) -> AsyncIterator[str]:
        """Yield the whole document, then its changes, while the viewer is connected.

        It yields nothing if there are too many viewers. An *owner* of the token then replaces a viewer without it.
        """
        queue: asyncio.Queue[str | None] = asyncio.Queue(BEHIND)
        if len(self._viewers) >= MOST_VIEWERS:
            guest = next((viewer for viewer, owns in self._viewers.items() if not owns), None)
            if not owner or guest is None:
                return
            self._let_go(guest)
        self._viewers[queue] = owner
        try:
            yield self._again(queue)
            while True:
                message = await queue.get()
                if message == _OVER:
                    return
                yield self._again(queue) if message is None else message
        finally:
            self._viewers.pop(queue, None)

    def close(self) -> None:
        """Disconnect every viewer, because the server ends."""
        for queue in list(self._viewers):
            self._let_go(queue)

    def _let_go(self, queue: asyncio.Queue[str | None]) -> None:
        """Close the stream of a viewer and free its seat."""
        del self._viewers[queue]
        while not queue.empty():
            queue.get_nowait()
        queue.put_nowait(_OVER)

    def _again(self, queue: asyncio.Queue[str | None]) -> str:
        """Return the whole document for a viewer, and discard the viewer's pending changes."""
        self.tell()
        while not queue.empty():
            queue.get_nowait()
        return self.whole()

    async def run(self) -> None:
        """Send changes to the viewers until cancelled."""
        waited = 0.0
        while True:
            await asyncio.sleep(EVERY)
            waited += EVERY
            if self.tell(even_nothing=waited >= ALIVE):
                waited = 0.0

    def tell(self, *, even_nothing: bool = False) -> bool:
        """Send the changes since the last call to the viewers. Return whether there were any."""
        new = {f"+{key}": items for key, items in self._new.items() if items}
        if not (self._changed or new or even_nothing):
            return False
        delta = {**self._changed, **new}
        self._changed, self._new = {}, {"legs": [], "rows": [], "words": []}
        if self._viewers:
            text = _packed(delta)
            for queue in self._viewers:
                _hand(queue, text)
        return True


def _hand(queue: asyncio.Queue[str | None], text: str) -> None:
    """Queue *text* for a viewer. A viewer that is too far behind gets the whole document again."""
    if queue.full():
        while not queue.empty():
            queue.get_nowait()
        queue.put_nowait(None)
    else:
        queue.put_nowait(text)


def _packed(thing: object) -> str:
    return json.dumps(thing, separators=(",", ":"))
