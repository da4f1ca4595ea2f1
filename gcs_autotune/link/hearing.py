"""How long the vehicle has been silent, counted in time that was spent listening for it."""

from __future__ import annotations

__all__ = ["Hearing"]

_LONGEST_PUMP = 0.5
"""Chosen: of a longer time from pump to pump [s] this much counts as listened: then it was we who were away (a machine
that is busy or was suspended), and what has come meanwhile is still to be read."""


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

    @property
    def silence(self) -> float:
        """Seconds spent listening since the vehicle was last heard."""
        return self.listened - self.last_heard

    def count(self, now: float) -> None:
        """We have just listened, at link time *now* [s]: count the time since we did so last."""
        self.listened += min(now - self._last_pump, _LONGEST_PUMP)
        self._last_pump = now

    def heard(self) -> None:
        """The vehicle has just said something."""
        self.last_heard = self.listened

    def bear(self, silence: float) -> None:
        """Count the silence from *silence* [s] ahead: so long the vehicle may still be quiet."""
        self.last_heard = self.listened + silence
