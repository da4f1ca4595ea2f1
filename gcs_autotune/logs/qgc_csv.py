"""QGroundControl's own CSV (settings: "Save CSV log of telemetry data"): displayed values, once a second.

Its header line is ``Timestamp,roll,pitch,heading,rollRate,...,gps.lat,...,localPosition.x,...``. Values are as
displayed: whole degrees of heading, speeds in the unit set in the settings (metres per second by default), ``--.--``
for missing. It contains neither actuator outputs nor mode nor arming, so nothing can be identified from it. If
batteries were detected after the header line was written, all later columns are shifted (qgroundcontrol issue 11763).
From such rows only the columns in front of the groups are read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

from gcs_autotune.errors import BadFile
from gcs_autotune.logs.sample_store import Census, Note, Recording, SampleStore

__all__ = ["is_qgc", "record_qgc"]

HEADS = frozenset({"Timestamp", "roll", "pitch", "heading"})
LONGEST_LINE = 1 << 16
RAD = math.pi / 180.0

COLUMNS: tuple[tuple[tuple[tuple[str, str, float], ...], ...], ...] = (
    (
        (("roll", "attitude.phi", RAD), ("pitch", "attitude.theta", RAD), ("heading", "attitude.psi", RAD)),
        (("rollRate", "rate.p", RAD), ("pitchRate", "rate.q", RAD), ("yawRate", "rate.r", RAD)),
        (("groundSpeed", "hud.U", 1.0),),
        (("altitudeRelative", "global.z", -1.0),),
    ),
    (
        (("localPosition.x", "local.x", 1.0), ("localPosition.y", "local.y", 1.0), ("localPosition.z", "local.z", 1.0),
         ("localPosition.vx", "local.vn", 1.0), ("localPosition.vy", "local.ve", 1.0)),
        (("gps.lat", "gps.lat", 1.0), ("gps.lon", "gps.lon", 1.0)),
    ),
)  # fmt: skip
"""Columns that belong together -> source and factor. First those in front of all groups, then those within one."""

MOTION_ONLY: Note = (
    "motion-only",
    "QGroundControl's CSV contains no actuator outputs, and its values are displayed values, once a second",
    "use the .tlog that QGroundControl saves next to it (settings: Save log after each flight)",
)


def is_qgc(head: str) -> bool:
    """Return whether the first lines of a file are those of QGroundControl's CSV."""
    return set(head.partition("\n")[0].strip().split(",")) >= HEADS


def record_qgc(path: Path, system: int | None = None) -> Recording:
    """Read QGroundControl's CSV at *path*. *system* is ignored, because the file is of one vehicle.

    Raises
    ------
    BadFile
        The file is unreadable or contains no valid row.
    """
    store = SampleStore(path.stem, "ground station")
    census = Census()
    rows = bad = shifted = 0
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            heads = stream.readline(LONGEST_LINE).strip().split(",")
            place = {name: i for i, name in reversed(list(enumerate(heads)))}
            while line := stream.readline(LONGEST_LINE):
                cells = line.strip().split(",")
                t = _time(cells[0])
                if math.isnan(t):
                    bad += bool(line.strip())
                    continue
                rows += 1
                shifted += len(cells) != len(heads)
                census.count("row", t)
                for values in _samples(cells, heads, place):
                    store.take(t, values)
    except OSError as error:
        raise BadFile(f"{path} cannot be read: {error.strerror or error}") from error
    if not rows:
        raise BadFile(f"{path} contains QGroundControl's header line but no row with a time. Use the .tlog")
    notes: list[Note] = [MOTION_ONLY]
    if bad:
        notes.append(("damaged-log", f"{bad} rows of the log were damaged and skipped", "use the .tlog"))
    meta = {"source": path.name, "messages": rows, "damaged": bad, "shifted_rows": shifted, "truncated": False}
    return Recording("QGroundControl CSV", [store], meta, notes, census)


def _samples(cells: list[str], heads: list[str], place: Mapping[str, int]) -> Iterator[dict[str, float]]:
    """Yield the complete groups of signals in one row.

    From a row with too many or too few cells, use only the first columns.
    """
    for groups in COLUMNS[: 1 if len(cells) != len(heads) else None]:
        for group in groups:
            values = {s: _number(cells, place.get(name, -1)) * factor for name, s, factor in group}
            if not any(math.isnan(v) for v in values.values()):
                yield values


def _number(cells: list[str], at: int) -> float:
    try:
        return float(cells[at]) if 0 <= at < len(cells) else math.nan
    except ValueError:
        return math.nan


def _time(text: str) -> float:
    try:
        return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
    except (ValueError, OverflowError):
        return math.nan
