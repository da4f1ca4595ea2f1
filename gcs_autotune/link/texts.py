"""The vehicle's own words: STATUSTEXT, with long texts joined from their pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gcs_autotune.link.wire import Message

__all__ = ["StatusText", "TextLog"]

_PIECE = 50
_KEPT = 500
_LONGEST = 1000
"""Characters kept of a text in pieces: 255 of them may come."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """One message from the vehicle; ``severity`` 0 (emergency) to 7 (debug), ``t`` link-clock time [s]."""

    t: float
    severity: int
    text: str


class TextLog:
    """Collects STATUSTEXTs, newest last, at most 500."""

    def __init__(self) -> None:
        self._texts: list[StatusText] = []
        self._open: tuple[int, int, str] | None = None
        self.count = 0

    def take(self, message: Message, t: float) -> StatusText | None:
        """Take in one STATUSTEXT; return the text it completes, if it does."""
        piece = str(message.text)
        ident, sequence = int(getattr(message, "id", 0)), int(getattr(message, "chunk_seq", 0))
        if ident == 0:
            return self._add(StatusText(t, int(message.severity), piece))
        before = ""
        if self._open is not None and self._open[0] == ident and self._open[1] == sequence - 1:
            before = self._open[2]
        joined = before + piece
        if len(piece) == _PIECE:
            self._open = (ident, sequence, joined[:_LONGEST])
            return None
        self._open = None
        return self._add(StatusText(t, int(message.severity), joined))

    def _add(self, text: StatusText) -> StatusText:
        self.count += 1
        self._texts.append(text)
        del self._texts[:-_KEPT]
        return text

    def since(self, count: int) -> list[StatusText]:
        """Return what was added after :attr:`count` had the given value."""
        new = self.count - count
        return self._texts[-new:] if new > 0 else []

    def recent(self, t: float, *, at_most: int = 3) -> list[str]:
        """Return the last few texts heard since link time *t*."""
        return [text.text for text in self._texts if text.t >= t][-at_most:]

    def __iter__(self) -> Iterator[StatusText]:
        return iter(self._texts)
