"""The operator's wish to stop: asked at every pump, raised, or kept for later while something must be finished."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gcs_autotune.errors import OperatorStopped

__all__ = ["OperatorStop"]


class OperatorStop:
    """``asked`` tells whether the operator has wanted to stop; *interrupt* asks him."""

    def __init__(self, interrupt: Callable[[], bool]) -> None:
        self._interrupt = interrupt
        self._shields = 0
        self.asked = False

    def check(self) -> None:
        """Raise ``OperatorStopped`` when the operator wants to stop and no shield is up."""
        if self._interrupt():
            self.asked = True
        if self.asked and not self._shields:
            raise OperatorStopped("stopped by the operator")

    @contextmanager
    def shielded(self, *, raise_after: bool = False) -> Iterator[None]:
        """Keep the stop from interrupting what is inside; with *raise_after* it is raised on leaving."""
        self._shields += 1
        try:
            yield
        finally:
            self._shields -= 1
        if raise_after:
            self.check()
