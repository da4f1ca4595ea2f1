"""Telemetry logs with an 8-byte big-endian time [us since 1970] before each raw frame, as in all ground stations.

Truncated and damaged logs can be read. Bytes that are not part of a stamped frame are skipped and counted.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from gcs_autotune.errors import BadFile
from gcs_autotune.mavlink.framing import Frame, decode_frame, frame_length, mavlink

__all__ = ["TlogReader", "TlogRecord", "TlogWriter", "read_tlog"]

_STAMP = struct.Struct(">Q")
_START = re.compile(b"[\xfd\xfe]")
_CHUNK = 1 << 20
"""Number of bytes read at once. Project choice."""
_LOOKAHEAD = 512
"""Number of bytes needed ahead: more than a stamp, the longest frame, and the stamp and first byte of the next one."""


class TlogWriter:
    """Appends frames of both directions, in the order of the calls.

    Raises
    ------
    BadFile
        The file cannot be written, at opening or later (a full disk).
    """

    def __init__(self, path: Path, now: Callable[[], float]) -> None:
        self._path = path
        self._now = now
        try:
            self._stream = path.open("wb")
        except OSError as error:
            raise BadFile(f"the telemetry log {path} cannot be written: {error.strerror}. Check the folder") from error

    def write(self, frame: bytes) -> None:
        """Append one frame with the present time."""
        try:
            self._stream.write(_STAMP.pack(round(self._now() * 1e6)) + frame)
        except OSError as error:
            raise self._unwritable(error) from error

    def flush(self) -> None:
        """Pass the buffered data to the operating system."""
        try:
            self._stream.flush()
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Flush and close the file."""
        try:
            self._stream.close()
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> BadFile:
        return BadFile(f"the telemetry log {self._path} cannot be written: {error.strerror}. Check the disk")


@dataclass(frozen=True, slots=True)
class TlogRecord:
    """One logged frame. ``time`` [s since 1970] is the recorder's timestamp."""

    time: float
    frame: Frame


class TlogReader:
    """Iterates over a log's frames piece by piece, so that the log may be larger than the memory.

    data : the log itself, or an open binary stream of it, closed at the end of the iteration.

    Attributes (complete once the iteration has ended)
    --------------------------------------------------
    frames : number of frames yielded.
    damaged : number of stretches that are not stamped frames.
    damaged_bytes : number of bytes in these stretches.
    truncated : whether the file ends within a frame.
    """

    def __init__(self, data: bytes | BinaryIO) -> None:
        self._stream: BinaryIO = io.BytesIO(data) if isinstance(data, bytes) else data
        self._buffer = bytearray()
        self._position = 0
        self._is_whole = False
        self.frames = 0
        self.damaged = 0
        self.damaged_bytes = 0
        self.truncated = False

    def __iter__(self) -> Iterator[TlogRecord]:
        decoder = mavlink.MAVLink(None)
        is_bad = False
        with self._stream:
            while self._fill():
                buffer, position = self._buffer, self._position
                length = frame_length(buffer, position + _STAMP.size)
                end = position + _STAMP.size + (length or 0)
                frame = None
                if length is not None and end <= len(buffer):
                    frame = decode_frame(decoder, buffer[position + _STAMP.size : end])
                if frame is not None and self._plausible(frame, end):
                    self.frames += 1
                    is_bad = False
                    self._position = end
                    yield TlogRecord(_STAMP.unpack_from(buffer, position)[0] * 1e-6, frame)
                    continue
                step = self._to_next_start(position)
                self.damaged += not is_bad
                self.damaged_bytes += step
                is_bad = True
                self._position = position + step
            self.truncated = self._position < len(self._buffer) or is_bad

    def _fill(self) -> bool:
        """Read more if less than the longest frame is left. Return whether another frame may follow."""
        if not self._is_whole and len(self._buffer) - self._position < _LOOKAHEAD:
            del self._buffer[: self._position]
            self._position = 0
            try:
                more = self._stream.read(_CHUNK)
            except OSError as error:
                raise BadFile(f"the telemetry log cannot be read completely: {error.strerror}") from error
            self._is_whole = not more
            self._buffer += more
        return self._position + _STAMP.size < len(self._buffer)

    def _to_next_start(self, position: int) -> int:
        """Return how many bytes to skip (at least one) until a frame with its stamp may start."""
        last = len(self._buffer) if self._is_whole else len(self._buffer) - _LOOKAHEAD
        found = _START.search(self._buffer, position + _STAMP.size + 1, max(last, position + _STAMP.size + 1))
        stop = found.start() if found else max(last, position + _STAMP.size + 1)
        return stop - _STAMP.size - position

    def _plausible(self, frame: Frame, end: int) -> bool:
        """Return whether another frame follows a frame of unknown type, whose checksum cannot be tested."""
        follower = end + _STAMP.size
        known = not frame.name.startswith("UNKNOWN_")
        return (
            known
            or end == len(self._buffer)
            or (follower < len(self._buffer) and self._buffer[follower] in (0xFE, 0xFD))
        )


def read_tlog(path: Path) -> TlogReader:
    """Open the log at *path* for reading.

    Raises
    ------
    BadFile
        It cannot be read, or is empty.
    """
    try:
        stream = path.open("rb")
        is_empty = not stream.peek(1)
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror}") from error
    if is_empty:
        stream.close()
        raise BadFile(f"the telemetry log {path} is empty. Check the recording")
    return TlogReader(stream)
