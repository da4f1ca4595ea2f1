"""ArduPilot's onboard log, read in pieces: binary (``.bin``) and text (``.log``).

Every binary message is ``A3 95``, a type, and a body whose length and layout an earlier FMT message of the same file
contains. There is no checksum, so inconsistent data are skipped and counted. Format letters: ArduPilot's
``AP_Logger/LogStructure.h``. In text (written by Mission Planner and ``mavlogdump``) a line contains the kind and its
values, ``ATT, 1234567, 0.5, ...``; earlier ``FMT`` lines contain the column names, and values are already scaled. A
line that does not fit its FMT is skipped and counted as damaged.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO, TextIO

import numpy as np
from numpy.typing import NDArray

__all__ = ["HEAD", "BinaryLog", "Block", "DataflashTextLog", "Layout", "TextBlock"]

HEAD = b"\xa3\x95"
"""First bytes of every message."""
FMT = 128
FMT_LENGTH = 89
FMT_BODY = struct.Struct("<BB4s16s64s")
PIECE = 4 << 20
"""Number of bytes processed together. Project choice."""
LONGEST = 255

LETTERS: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0),
    "b": ("<i1", 1.0),
    "B": ("<u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "n": ("S4", 0.0),
    "N": ("S16", 0.0),
    "Z": ("S64", 0.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "M": ("<u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
"""Format letter -> (type, factor). Factor 0 marks text."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of one kind of message in the file. ``length`` includes the three header bytes."""

    kind: str
    length: int
    names: tuple[str, ...]
    factors: tuple[float, ...]
    dtype: np.dtype[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Messages of one kind from one piece of the file.

    order : (n,) their numbers in the file. rows : (n,) of the layout's dtype.
    """

    layout: Layout
    order: NDArray[np.int64]
    rows: NDArray[Any]

    @property
    def kind(self) -> str:
        """Name of the message."""
        return self.layout.kind

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its columns."""
        return self.layout.names

    def column(self, name: str) -> NDArray[Any]:
        """Return values scaled by the log's letters (degrees stay degrees), or (n,) texts."""
        raw = self.rows[name]
        factor = self.layout.factors[self.layout.names.index(name)]
        if factor == 0.0:
            return np.array([bytes(v).split(b"\0")[0].decode("ascii", "replace") for v in raw], dtype=object)
        with np.errstate(invalid="ignore"):  # a damaged float may be a signalling NaN
            return raw.astype(np.float64) * factor


@dataclass
class BinaryLog:
    """Iterates over a log: one list of blocks per piece, in order of the file.

    Attributes (complete once the iteration has ended)
    --------------------------------------------------
    messages : whole messages of known kind. damaged : number of stretches that contain no message. damaged_bytes :
        number of bytes in these stretches.
    truncated : whether the file ends within a message. counts : messages of each kind. preamble : lines above the log;
        empty for a binary log.
    """

    stream: BinaryIO
    messages: int = 0
    damaged: int = 0
    damaged_bytes: int = 0
    truncated: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    preamble: tuple[str, ...] = ()
    _layouts: dict[int, Layout] = field(default_factory=dict)
    _is_bad: bool = False

    def __iter__(self) -> Iterator[list[Block]]:
        rest = b""
        with self.stream:
            while True:
                more = self.stream.read(PIECE)
                data = rest + more
                used, offsets, kinds = self._scan(data, is_last=not more)
                if offsets:
                    yield self._blocks(data, np.array(offsets, dtype=np.int64), np.array(kinds, dtype=np.uint8))
                rest = data[used:]
                if not more:
                    self.truncated = bool(rest)
                    return

    def _scan(self, data: bytes, *, is_last: bool) -> tuple[int, list[int], list[int]]:
        """Return how much of *data* was read, and where messages of each type begin."""
        lengths = [0] * 256
        lengths[FMT] = FMT_LENGTH
        for number, layout in self._layouts.items():
            lengths[number] = layout.length
        offsets: list[int] = []
        kinds: list[int] = []
        at, end = 0, len(data) if is_last else len(data) - 2 * LONGEST
        while at < end:
            number = data[at + 2] if data[at : at + 2] == HEAD and at + 2 < len(data) else -1
            length = lengths[number] if number >= 0 else 0
            if length and at + length > len(data):
                break
            follows = data[at + length : at + length + 2]
            if length and (not self._is_bad or follows in (HEAD, b"")):
                if number == FMT:
                    self._define(data[at + 3 : at + FMT_LENGTH], lengths)
                offsets.append(at)
                kinds.append(number)
                self._is_bad = False
                at += length
                continue
            self.damaged += not self._is_bad
            self._is_bad = True
            found = data.find(HEAD, at + 1, end + 1)
            found = end if found < 0 else min(found, end)
            self.damaged_bytes += found - at
            at = found
        self.messages += len(offsets)
        return at, offsets, kinds

    def _define(self, body: bytes, lengths: list[int]) -> None:
        """Process one FMT message.

        One that is inconsistent or contradicts a known layout counts as damaged and is ignored.
        """
        number, length, name, letters, heads = FMT_BODY.unpack(body)
        kind = name.rstrip(b"\0").decode("ascii", "replace")
        names = [h for h in heads.rstrip(b"\0").decode("ascii", "replace").split(",") if h]
        codes = [LETTERS.get(c) for c in letters.rstrip(b"\0").decode("ascii", "replace")]
        if number == FMT or None in codes or len(names) != len(codes) or len(set(names)) != len(names) or not kind:
            return
        known = [c for c in codes if c is not None]
        try:
            dtype = np.dtype([("head", "V3"), *((n, c) for n, (c, _) in zip(names, known, strict=True))])
        except (ValueError, TypeError):
            return
        others = {layout.kind for n, layout in self._layouts.items() if n != number}
        if dtype.itemsize != length or lengths[number] not in (0, length) or kind in others:
            return
        self._layouts[number] = Layout(kind, length, tuple(names), tuple(f for _, f in known), dtype)
        lengths[number] = length

    def _blocks(self, data: bytes, offsets: NDArray[np.int64], kinds: NDArray[np.uint8]) -> list[Block]:
        buffer = np.frombuffer(data, dtype=np.uint8)
        before = self.messages - len(offsets)
        blocks = []
        for number in np.unique(kinds):
            layout = self._layouts.get(int(number))
            if layout is None:
                continue
            which = np.flatnonzero(kinds == number)
            rows = buffer[offsets[which][:, None] + np.arange(layout.length)]
            self.counts[layout.kind] = self.counts.get(layout.kind, 0) + len(which)
            blocks.append(Block(layout, which + before, np.ascontiguousarray(rows).view(layout.dtype)[:, 0]))
        return blocks


LINES_AT_ONCE = 20_000
"""Number of lines processed together. Project choice."""
MOST_ABOVE = 50
"""Number of lines above the first FMT line that do not count as damage. Project choice."""
TEXT = frozenset(letter for letter, (_, factor) in LETTERS.items() if factor == 0.0) | {"M", "a"}
"""Letters whose values may be text, because a flight mode is written by its name."""


@dataclass(frozen=True, slots=True)
class TextBlock:
    """Messages of one kind from one piece of the file, as columns; ``order``: their numbers in the file."""

    kind: str
    order: list[int]
    names: tuple[str, ...]
    letters: str
    rows: list[list[str]]

    def column(self, name: str) -> NDArray[Any]:
        """Return (n,) numbers (NaN for a cell that is not a number) or texts."""
        i = self.names.index(name)
        if self.letters[i] in TEXT:
            return np.array([row[i] for row in self.rows], dtype=object)
        return np.array([_number(row[i]) for row in self.rows], dtype=np.float64)


@dataclass
class DataflashTextLog:
    """Iterates over a log: one list of blocks per piece. Counters are as in ``BinaryLog``; bytes are characters
    here.

    preamble : lines above the first FMT line, e.g. from a terminal that printed the log.
    """

    stream: TextIO
    messages: int = 0
    damaged: int = 0
    damaged_bytes: int = 0
    truncated: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    preamble: list[str] = field(default_factory=list)
    _heads: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)

    def __iter__(self) -> Iterator[list[TextBlock]]:
        pending: dict[str, TextBlock] = {}
        held = 0
        is_bad = False
        with self.stream:
            line = ""
            while line := self.stream.readline(4096):
                cells = [c.strip() for c in line.split(",")]
                if not self.messages and cells[0] != "FMT" and len(self.preamble) < MOST_ABOVE:
                    self.preamble.append(line.strip())
                    continue
                is_good = self._is_head(cells) or self._take(cells, pending)
                self.damaged += not is_good and not is_bad and bool(line.strip())
                self.damaged_bytes += 0 if is_good else len(line.strip())
                is_bad = not is_good
                self.truncated = not line.endswith("\n")
                held += is_good
                if held >= LINES_AT_ONCE:
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
