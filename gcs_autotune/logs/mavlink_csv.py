"""MAVLink messages from CSV files: Mission Planner's conversion of a tlog, and ``mavlogdump.py --format csv``.

Mission Planner writes one line per message: its local time, the head of the frame in hexadecimal (7 cells of MAVLink 1,
8 of MAVLink 2, the last three being system, component and message id), the name of its structure
(``mavlink_attitude_t``), then ``name,value`` pairs and a tail after an empty cell. Numbers use the locale of its
computer, so a decimal comma splits a value into two cells. Such values are reassembled from the names that follow.
``mavlogdump`` writes one table for all requested kinds: ``timestamp`` [s since 1970], then ``ATTITUDE.roll``...
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import TextIO

from gcs_autotune import mavlink  # whose names bring pymavlink, so only when one is used
from gcs_autotune.errors import BadFile
from gcs_autotune.logs.mavlink_decoder import decode_messages
from gcs_autotune.logs.sample_store import Heard, Note, Recording

__all__ = ["is_mavlogdump", "is_mission_planner", "record_mavlogdump", "record_mission_planner"]

LONGEST_LINE = 1 << 16
STRUCTURE = re.compile(r",\s*mavlink_(\w+)_t\s*,")
DUMPED = re.compile(r"^timestamp[,;\t][A-Z][A-Z0-9_]+\.\w+")
GROUND_STATION = (255, 190)
VEHICLE = (1, 1)
TEXTS = frozenset({"param_id", "text"})
TAIL = "Len"
TAIL_CELLS = 5
"""Number of cells at the end of a line: ``Len`` and a number, in later versions followed by a checksum."""
OLD_STAMP = "%m/%d/%Y %I:%M:%S %p"


def is_mission_planner(head: str) -> bool:
    """Return whether the first lines of a file look like Mission Planner's conversion."""
    return STRUCTURE.search(head) is not None


def is_mavlogdump(head: str) -> bool:
    """Return whether the first lines of a file look like mavlogdump's table of a telemetry log."""
    return DUMPED.match(head) is not None


def record_mission_planner(path: Path, system: int | None = None) -> Recording:
    """Return the content of Mission Planner's CSV file at *path*. It raises the errors of ``record_tlog``."""
    lines = _Lines(path)
    return _recording(path, "Mission Planner CSV", lines, _planner(lines), system, ())


def record_mavlogdump(path: Path, system: int | None = None) -> Recording:
    """Return the content of mavlogdump's CSV file at *path*, which contains no senders. It raises the errors of
    ``record_tlog``.
    """
    lines = _Lines(path)
    note = (
        "senders-unknown",
        "this CSV does not state the senders of messages. All messages are assigned to one vehicle",
        "use the .tlog itself if the link carried several vehicles",
    )
    return _recording(path, "mavlogdump CSV", lines, _dumped(lines), None, (note,))


class _Lines:
    """The lines of a file, and the number of unusable ones."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.read = 0
        self.bad = 0
        self.bad_bytes = 0

    def __iter__(self) -> Iterator[str]:
        try:
            with self.path.open(encoding="utf-8-sig", errors="replace") as stream:
                yield from self._of(stream)
        except OSError as error:
            raise BadFile(f"{self.path} cannot be read: {error.strerror or error}") from error

    def _of(self, stream: TextIO) -> Iterator[str]:
        while line := stream.readline(LONGEST_LINE):
            if line.strip():
                self.read += 1
                yield line.rstrip("\r\n")

    def damaged(self, line: str) -> None:
        """Count an unusable line of the file."""
        self.bad += 1
        self.bad_bytes += len(line)


def _recording(
    path: Path, form: str, lines: _Lines, heard: Iterator[Heard], system: int | None, notes: Sequence[Note]
) -> Recording:
    decoded = decode_messages(path, heard, system)
    damaged = lines.bad + decoded.misfits
    if damaged > lines.read / 2:
        raise BadFile(
            f"{path}: {damaged} of {lines.read} lines cannot be read as {form}. Convert the log again, or use the .tlog"
        )
    if damaged:
        cure = "use the .tlog itself, which has checksums"
        notes = (*notes, ("damaged-log", f"{damaged} lines of the log could not be read and were skipped", cure))
    meta = {
        "source": path.name,
        "messages": decoded.messages,
        "damaged": damaged,
        "damaged_bytes": lines.bad_bytes,
        "truncated": False,
        "system": decoded.vehicle[0],
    }
    return Recording(form, decoded.stores, meta, [*decoded.notes, *notes], decoded.census)


def _planner(lines: _Lines) -> Iterator[Heard]:
    for line in lines:
        cells = line.split(",")
        at = next((i for i, c in enumerate(cells) if c.startswith("mavlink_") and c.endswith("_t")), 0)
        time = _time(cells[0].strip())
        if at < 4 or math.isnan(time) or TAIL not in cells[-TAIL_CELLS:]:
            lines.damaged(line)
            continue
        name = cells[at].removeprefix("mavlink_").removesuffix("_t").upper()
        try:
            sender = int(cells[at - 3], 16), int(cells[at - 2], 16)
        except ValueError:
            lines.damaged(line)
            continue
        yield Heard(time, *sender, name, _message(name, _pairs(cells[at + 1 :], mavlink.message_fields(name))))


def _pairs(cells: list[str], known: frozenset[str]) -> dict[str, str]:
    """Read ``name,value`` pairs until the empty cell before the tail. A value may contain commas."""
    found: dict[str, str] = {}
    at = 0
    while at + 1 < len(cells) and cells[at].strip():
        end = at + 2
        while known and end < len(cells) and cells[end].strip() and cells[end] not in known:
            end += 1
        found[cells[at]] = ",".join(cells[at + 1 : end])
        at = end
    return found


def _dumped(lines: _Lines) -> Iterator[Heard]:
    rows = iter(lines)
    head = next(rows, "")
    separator = next((s for s in ",;\t" if s in head), ",")
    heads = [h.strip().partition(".") for h in head.split(separator)]
    for line in rows:
        cells = line.split(separator)
        filled = [i for i in range(1, min(len(cells), len(heads))) if cells[i].strip()]
        kinds = {heads[i][0] for i in filled}
        try:
            time = float(cells[0])
        except ValueError:
            time = math.nan
        if len(cells) != len(heads) or len(kinds) != 1 or not math.isfinite(time):
            lines.damaged(line)
            continue
        name = kinds.pop()
        message = _message(name, {heads[i][2]: cells[i].strip() for i in filled})
        is_ground = name == "MANUAL_CONTROL" or (name == "HEARTBEAT" and getattr(message, "autopilot", 0) == 8)
        yield Heard(time, *(GROUND_STATION if is_ground else VEHICLE), name, message)


def _message(name: str, values: dict[str, str]) -> SimpleNamespace:
    """Return a message with numeric fields.

    In MAVLink 1, SERVO_OUTPUT_RAW has no ``port``, and the first one is used.
    """
    fields: dict[str, float | int | str] = {k: v if k in TEXTS else _number(v) for k, v in values.items()}
    if name == "SERVO_OUTPUT_RAW":
        fields.setdefault("port", 0)
    return SimpleNamespace(**fields)


def _number(text: str) -> float | int | str:
    for piece in (text.strip(), text.strip().replace(",", ".", 1)):
        try:
            return int(piece)
        except ValueError:
            pass
        try:
            return float(piece)
        except ValueError:
            pass
    return text


def _time(text: str) -> float:
    """Return Mission Planner's local time in seconds since 1970; NaN if it is invalid."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        try:
            moment = datetime.strptime(text, OLD_STAMP)
        except ValueError:
            return math.nan
    try:
        return moment.replace(tzinfo=UTC).timestamp()
    except (OverflowError, ValueError):
        return math.nan
