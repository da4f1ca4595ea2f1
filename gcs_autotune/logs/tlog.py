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
    """Read the telemetry log at *path*, with at most one piece of it in memory.

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
    told = decode_messages(path, _heard(log), system)
    notes = list(told.notes)
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
        "system": told.vehicle[0],
    }
    return Recording("telemetry log", told.stores, meta, notes, told.census)


def _heard(log: mavlink.TlogReader) -> Iterator[Heard]:
    for record in log:
        frame = record.frame
        yield Heard(record.time, frame.system, frame.component, frame.name, frame.message)
