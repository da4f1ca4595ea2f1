"""What a log reader hands back: the tapes, what was counted on the way, and what to doubt."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from gcs_autotune.logs.tape import Note, Tape

__all__ = ["Census", "Heard", "LogReader", "Recording"]


@dataclass(frozen=True, slots=True)
class Heard:
    """One MAVLink message as any ground log tells it: ``time`` [s since 1970], who sent it, its fields by name."""

    time: float
    system: int
    component: int
    name: str
    message: Any


@dataclass(slots=True)
class Census:
    """Kinds of messages: how many, and the first and last moment [s, of whatever clock] of each."""

    seen: dict[str, list[float]] = field(default_factory=dict)

    def count(self, kind: str, t: float, how_many: int = 1, until: float | None = None) -> None:
        """Count *how_many* messages of a *kind* at *t* (or from *t* to *until*); a moment not known is not finite."""
        row = self.seen.setdefault(kind, [0, math.inf, -math.inf])
        row[0] += how_many
        if math.isfinite(t):
            row[1] = min(row[1], t)
            row[2] = max(row[2], t if until is None else until)

    def rate(self, kind: str) -> float:
        """Return messages per second between the first and the last one; 0 when there are fewer than two."""
        count, first, last = self.seen.get(kind, [0, 0.0, 0.0])
        return (count - 1) / (last - first) if last > first else 0.0


@dataclass(frozen=True, slots=True)
class Recording:
    """A log as read.

    Attributes
    ----------
    form : of the file, in words.
    tapes : one per boot of the vehicle, in order of time.
    meta : goes into the meta data of every run: ``source messages damaged damaged_bytes truncated system``...
    notes : goes into what is doubted of every run.
    """

    form: str
    tapes: list[Tape]
    meta: dict[str, Any]
    notes: list[Note]
    census: Census


LogReader: TypeAlias = Callable[[Path, int | None], Recording]
"""Reads (path, system id of the vehicle meant); raises ``BadFile`` or ``UsageError``."""
