"""Telemetry logs: an 8-byte big-endian time [us since 1970] before each raw frame, as every ground station writes.

Reading survives truncation and damage: what cannot be a stamped frame is stepped over and counted.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.clock import Clock
from gcs_autotune.errors import BadFile
from gcs_autotune.link.transport import Transport
from gcs_autotune.link.wire import Frame, decode_frame, frame_length, mavlink

__all__ = ["SIMULATED_EPOCH", "TlogReader", "TlogRecord", "TlogWriter", "read_tlog", "time_base"]

SIMULATED_EPOCH = 1_577_836_800.0
"""2020-01-01 00:00 UTC [s]. Chosen: simulated records count from here, so equal seeds give equal bytes."""

_STAMP = struct.Struct(">Q")


def time_base(transport: Transport) -> Callable[[], float]:
    """Return the clock that a log of *transport* is stamped with [s since 1970]."""
    if transport.is_simulated:
        return _simulated(transport.clock)
    return time.time


def _simulated(clock: Clock) -> Callable[[], float]:
    return lambda: SIMULATED_EPOCH + clock.now()


class TlogWriter:
    """Appends frames, both directions, in the order they are handed over.

    Raises
    ------
    BadFile
        When the file cannot be written, at opening or later (a full disk).
    """

    def __init__(self, path: Path, now: Callable[[], float]) -> None:
        self._path = path
        self._now = now
        try:
            self._stream = path.open("wb")
        except OSError as error:
            raise BadFile(f"the telemetry log {path} cannot be written: {error.strerror}; check the folder") from error

    def write(self, frame: bytes) -> None:
        """Append one frame, stamped now."""
        try:
            self._stream.write(_STAMP.pack(round(self._now() * 1e6)) + frame)
        except OSError as error:
            raise self._unwritable(error) from error

    def flush(self) -> None:
        """Hand what is buffered to the operating system."""
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
        return BadFile(f"the telemetry log {self._path} cannot be written: {error.strerror}; check the disk")


@dataclass(frozen=True, slots=True)
class TlogRecord:
    """One logged frame; ``time`` [s since 1970] as stamped by whoever logged it."""

    time: float
    frame: Frame


class TlogReader:
    """Iterates over a log's frames.

    Attributes (complete once the iteration has ended)
    --------------------------------------------------
    frames : frames yielded.
    damaged : stretches that were no stamped frame.
    damaged_bytes : bytes in them.
    truncated : whether the file ends within a frame.
    """

    def __init__(self, data: bytes) -> None:
        self._data = bytearray(data)
        self.frames = 0
        self.damaged = 0
        self.damaged_bytes = 0
        self.truncated = False

    def __iter__(self) -> Iterator[TlogRecord]:
        decoder = mavlink.MAVLink(None)
        data, position, damaged_at = self._data, 0, -1
        while position + _STAMP.size < len(data):
            length = frame_length(data, position + _STAMP.size)
            end = position + _STAMP.size + (length or 0)
            frame = None
            if length is not None and end <= len(data):
                frame = decode_frame(decoder, data[position + _STAMP.size : end])
            if frame is not None and self._plausible(frame, end):
                self.frames += 1
                yield TlogRecord(_STAMP.unpack_from(data, position)[0] * 1e-6, frame)
                position = end
                continue
            self.damaged += damaged_at != position - 1
            self.damaged_bytes += 1
            damaged_at = position
            position += 1
        self.truncated = position < len(data) or damaged_at == position - 1 >= 0

    def _plausible(self, frame: Frame, end: int) -> bool:
        """Whether a frame of unknown kind, whose checksum nobody can test, is followed by another."""
        follower = end + _STAMP.size
        known = not frame.name.startswith("UNKNOWN_")
        return known or end == len(self._data) or (follower < len(self._data) and self._data[follower] in (0xFE, 0xFD))


def read_tlog(path: Path) -> TlogReader:
    """Open the log at *path* for reading.

    Raises
    ------
    BadFile
        When it cannot be read, or is empty.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror}") from error
    if not data:
        raise BadFile(f"{path} is empty: nothing was logged")
    return TlogReader(data)
