"""How long the vehicle has been silent, counted in time that was spent listening for it."""

from __future__ import annotations

from collections import deque

__all__ = ["Hearing"]

_LONGEST_PUMP = 0.5
"""Chosen: of a longer time from pump to pump [s] this much counts as listened: then it was we who were away (a machine
that is busy or was suspended), and what has come meanwhile is still to be read."""
_WORTH_KEEPING = 0.5
_KEPT = 50


class Hearing:
    """The time listened and the last word heard.

    Attributes
    ----------
    listened : seconds of link time spent pumping.
    last_heard : what ``listened`` was when the vehicle was last heard.
    """

    def __init__(self, now: float) -> None:
        self._last_pump = now
        self.listened = 0.0
        self.last_heard = 0.0
        self._word = 0.0
        self._silences: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    @property
    def silence(self) -> float:
        """Seconds spent listening since the vehicle was last heard."""
        return self.listened - self.last_heard

    def count(self, now: float) -> None:
        """We have just listened, at link time *now* [s]: count the time since we did so last."""
        self.listened += min(now - self._last_pump, _LONGEST_PUMP)
        self._last_pump = now

    @property
    def unheard(self) -> float:
        """The same, whatever silence is borne."""
        return self.listened - self._word

    def longest(self, span: float) -> float:
        """Return the longest silence [s] that ended within the last *span* [s] listened."""
        return max((silence for end, silence in self._silences if end >= self.listened - span), default=0.0)

    def heard(self) -> None:
        """The vehicle has just said something."""
        if self.unheard > _WORTH_KEEPING:
            self._silences.append((self.listened, self.unheard))
        self.last_heard = self._word = self.listened

    def bear(self, silence: float) -> None:
        """Count the silence from *silence* [s] ahead: so long the vehicle may still be quiet."""
        self.last_heard = self.listened + silence
