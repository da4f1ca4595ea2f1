"""Read telemetry logs of ground stations (``.tlog``: Mission Planner, QGroundControl, MAVProxy, this program) into
stores."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gcs_autotune import mavlink  # whose names bring pymavlink, so only when one is used
from gcs_autotune.logs.mavlink_decoder import decode_messages
from gcs_autotune.logs.sample_store import Heard, Recording

__all__ = ["record_tlog"]


def record_tlog(path: Path, system: int | None = None) -> Recording:
    """Return the content of the telemetry log at *path*. At most one piece of the file is in memory.

    Parameters
    ----------
    system : the vehicle's system id, if the log contains several; None: the one with most messages.

    Raises
    ------
    BadFile
        The file is unreadable or not a telemetry log.
    UsageError
        The log contains no vehicle of that *system*.
    """
    log = mavlink.read_tlog(path)
    decoded = decode_messages(path, _heard(log), system)
    notes = list(decoded.notes)
    if log.damaged:
        notes.append(
            (
                "damaged-log",
                f"{log.damaged} segments of the log ({log.damaged_bytes} bytes) were damaged and skipped",
                "record within good radio range, or use the onboard log (.bin)",
            )
        )
    meta = {
        "source": path.name,
        "messages": log.frames,
        "damaged": log.damaged,
        "damaged_bytes": log.damaged_bytes,
        "truncated": log.truncated,
        "system": decoded.vehicle[0],
    }
    return Recording("telemetry log", decoded.stores, meta, notes, decoded.census)


def _heard(log: mavlink.TlogReader) -> Iterator[Heard]:
    for record in log:
        frame = record.frame
        yield Heard(record.time, frame.system, frame.component, frame.name, frame.message)
