"""ArduPilot's log on board as text (``.log``, written by Mission Planner and ``mavlogdump``), read line by line.

A line is the kind and its values, ``ATT, 1234567, 0.5, ...``; ``FMT`` lines told the names of the columns before.
Values are scaled already. A line that does not fit its FMT is damage: left out and counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.logs.dataflash_binary import LETTERS

__all__ = ["TextBlock", "TextLog"]

PIECE = 20_000
"""Chosen: lines looked at together."""
TEXT = frozenset(letter for letter, (_, factor) in LETTERS.items() if factor == 0.0) | {"M", "a"}
"""Letters whose values may be words: a flight mode is written by its name."""


@dataclass(frozen=True, slots=True)
class TextBlock:
    """Messages of one kind from one piece of the file, values as columns; ``order`` their numbers in the file."""

    kind: str
    order: list[int]
    names: tuple[str, ...]
    letters: str
    rows: list[list[str]]

    def column(self, name: str) -> NDArray[Any]:
        """Return (n,) numbers (NaN where a cell is none) or texts."""
        i = self.names.index(name)
        if self.letters[i] in TEXT:
            return np.array([row[i] for row in self.rows], dtype=object)
        return np.array([_number(row[i]) for row in self.rows], dtype=np.float64)


@dataclass
class TextLog:
    """Iterates over a log: one list of blocks per piece. Counters as of ``BinaryLog``; bytes are characters here."""

    stream: TextIO
    messages: int = 0
    damaged: int = 0
    damaged_bytes: int = 0
    truncated: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    _heads: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)

    def __iter__(self) -> Iterator[list[TextBlock]]:
        pending: dict[str, TextBlock] = {}
        held = 0
        is_bad = False
        with self.stream:
            line = ""
            while line := self.stream.readline(4096):
                cells = [c.strip() for c in line.split(",")]
                is_good = self._is_head(cells) or self._take(cells, pending)
                self.damaged += not is_good and not is_bad and bool(line.strip())
                self.damaged_bytes += 0 if is_good else len(line.strip())
                is_bad = not is_good
                self.truncated = not line.endswith("\n")
                held += is_good
                if held >= PIECE:
                    yield list(pending.values())
                    pending, held = {}, 0
        if pending:
            yield list(pending.values())

    def _is_head(self, cells: list[str]) -> bool:
        if cells[0] != "FMT" or len(cells) < 6:
            return False
        names = tuple(n for n in cells[5:] if n)
        if len(names) == len(cells[4]) == len(set(names)) and cells[3] not in self._heads:
            self._heads[cells[3]] = (names, cells[4])
        self.messages += 1
        self.counts["FMT"] = self.counts.get("FMT", 0) + 1
        return True

    def _take(self, cells: list[str], pending: dict[str, TextBlock]) -> bool:
        head = self._heads.get(cells[0])
        if head is None:
            return False
        names, letters = head
        values = cells[1:]
        if len(values) > len(names) and letters[-1] in TEXT:
            values = [*values[: len(names) - 1], ", ".join(values[len(names) - 1 :])]
        if len(values) != len(names):
            return False
        block = pending.get(cells[0])
        if block is None:
            block = pending[cells[0]] = TextBlock(cells[0], [], names, letters, [])
        block.order.append(self.messages)
        block.rows.append(values)
        self.messages += 1
        self.counts[cells[0]] = self.counts.get(cells[0], 0) + 1
        return True


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
