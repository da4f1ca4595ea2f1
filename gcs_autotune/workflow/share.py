"""Pack a run directory into one file to share: no signing key, and positions moved if requested."""

from __future__ import annotations

import math
import re
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.documents import SETTING_OUT
from gcs_autotune.errors import BadFile
from gcs_autotune.mavlink import Frame, mavlink, read_tlog

__all__ = ["Shared", "share_run"]

PACKED = (".html", ".csv", ".json", ".jsonl", ".param", ".params", ".txt", ".toml", ".tlog", ".bin", ".log", ".lua")
"""Ends of the names of the files that are packed. A key has none of them."""

SECRET = ("SETUP_SIGNING",)
"""Messages with a signing key. The recorder never logs them; another station's log may contain them."""

_PAIRS = (("lat", "lon"), ("lat", "lng"), ("latitude", "longitude"), ("lat_int", "lon_int"))
"""Fields of MAVLink with latitude and longitude: whole numbers are 1e-7 degrees, others degrees."""

_OTHERWISE = re.compile(
    "MISSION_ITEM|COMMAND_(INT|LONG)|FENCE|RALLY|LOG_|FILE_TRANSFER|GPS_(RTCM|INJECT|INPUT)|SERIAL_|"
    "UNKNOWN|STATUSTEXT|ADSB|AIS|TUNNEL|DATA|HIGH_LATENCY|TERRAIN|OPEN_DRONE_ID|FOLLOW|ACTUATOR|V2_EXT|ENCAPSULATED"
)
"""Messages left out when positions are moved: they can contain a position in a way that is not known here."""

_STAMP = struct.Struct(">Q")


@dataclass(frozen=True, slots=True)
class Shared:
    """A packed run: the *files* in it, those *left_out* with the reason, and its size [bytes]."""

    path: Path
    files: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]
    size: int


def share_run(run: Path, out: Path, *, hide_position: bool = False) -> Shared:
    """Pack the files of a *run* into the zip file *out*, with a README that lists them.

    hide_position : move every position of a telemetry log so that the run begins at 0 degrees north and east; distances
        stay. A file that contains the place of the run in another way is left out.

    Raises
    ------
    BadFile
        *run* is not a run directory, or *out* cannot be written.
    """
    found = [p for p in sorted(run.rglob("*")) if p.is_file() and not p.is_symlink() and p.resolve() != out.resolve()]
    if not any(p.name in ("summary.json", "journal.jsonl", SETTING_OUT) for p in found):
        raise BadFile(f"{run} is not a run directory. Give the folder that contains report.html")
    place = next(filter(None, (_place(p) for p in found if p.suffix == ".tlog")), None) if hide_position else None
    files: list[str] = []
    left_out: list[tuple[str, str]] = []
    draft = out.with_name(out.name + ".part")
    try:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as packed:
            for path in found:
                name = path.relative_to(run).as_posix()
                reason = _reason_against(path, place, hide_position=hide_position)
                if reason:
                    left_out.append((name, reason))
                    continue
                if path.suffix == ".tlog":
                    packed.writestr(f"{run.resolve().name}/{name}", b"".join(_frames(path, place, hide_position)))
                else:
                    packed.write(path, f"{run.resolve().name}/{name}")
                files.append(name)
            packed.writestr(f"{run.resolve().name}/README.txt", _readme(files, left_out, hide_position))
        draft.replace(out)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise BadFile(f"{out} cannot be written: {error.strerror or error}. Check the folder and the disk") from error
    return Shared(out, tuple(files), tuple(left_out), out.stat().st_size)


def _reason_against(path: Path, place: tuple[float, float] | None, *, hide_position: bool) -> str:
    """Return why a file is left out; empty if it is packed."""
    if path.suffix.lower() not in PACKED:
        return "not a file of a run"
    if hide_position and path.suffix.lower() in (".bin", ".log"):
        return "an onboard log contains positions"
    if place is not None and path.suffix != ".tlog" and _contains(path.read_text("utf-8", errors="replace"), place):
        return "contains the place of the run"
    return ""


def _contains(text: str, place: tuple[float, float]) -> bool:
    """Return whether *text* contains latitude and longitude of *place* to 1 km, in degrees or 1e-7 deg."""
    told = [float(number) for number in re.findall(r"(?<![\w.])-?\d{1,3}\.\d{3,}", text)]
    told += [1e-7 * int(number) for number in re.findall(r"(?<![\w.])-?\d{6,10}(?![\w.])", text)]
    return all(any(abs(number - angle) < 0.01 for number in told) for angle in place)


def _pairs(frame: Frame) -> list[tuple[str, str]]:
    """Return the names of the fields with latitude and longitude."""
    names = frame.message.get_fieldnames()
    return [pair for pair in _PAIRS if pair[0] in names and pair[1] in names]


def _has_unknown_place(frame: Frame) -> bool:
    """Return whether a message can contain a position in a way that is not known here."""
    known = {name for pair in _pairs(frame) for name in pair}
    is_other = any(re.match("lat|lon|lng", name) for name in frame.message.get_fieldnames() if name not in known)
    parameter = str(getattr(frame.message, "param_id", ""))
    return is_other or bool(_OTHERWISE.match(frame.name) or re.search("_LAT|_LNG|_LON", parameter))


def _scale(value: float | int) -> float:
    return 1e-7 if isinstance(value, int) else 1.0


def _place(path: Path) -> tuple[float, float] | None:
    """Return the first latitude and longitude of a log [deg]; None without one."""
    for record in read_tlog(path):
        for pair in _pairs(record.frame):
            north, east = (getattr(record.frame.message, name) for name in pair)
            if north or east:
                return north * _scale(north), east * _scale(east)
    return None


def _frames(path: Path, place: tuple[float, float] | None, hide_position: bool) -> Iterator[bytes]:
    """Yield the stamped frames of a log without keys and, if requested, with positions relative to *place*."""
    packer = mavlink.MAVLink(None)
    for record in read_tlog(path):
        frame = record.frame
        if frame.name in SECRET or (hide_position and _has_unknown_place(frame)):
            continue
        moved = place is not None and any(getattr(frame.message, name) for pair in _pairs(frame) for name in pair)
        raw = _moved(frame, place, packer) if moved and place is not None else frame.raw
        yield _STAMP.pack(round(record.time * 1e6)) + raw


def _moved(frame: Frame, place: tuple[float, float], packer: mavlink.MAVLink) -> bytes:
    """Return a frame with its positions moved; distances stay, because a degree east shrinks with the latitude."""
    message = frame.message
    for pair in _pairs(frame):
        north, east = (getattr(message, name) for name in pair)
        scale = _scale(north)
        moved = (north * scale - place[0], (east * scale - place[1]) * math.cos(math.radians(place[0])))
        for name, value in zip(pair, moved, strict=True):
            setattr(message, name, round(value / scale) if scale < 1.0 else value)
    packer.srcSystem, packer.srcComponent, packer.seq = frame.system, frame.component, message.get_seq()
    return bytes(message.pack(packer))


def _readme(files: list[str], left_out: list[tuple[str, str]], hide_position: bool) -> str:
    lines = [
        "A run of gcs-autotune. Open report.html in a browser; it works offline.",
        "",
        "The files contain messages of the vehicle, the parameters that the run read, the address of the link, and the",
        "id of the autopilot. They contain no signing key.",
        "Positions in the telemetry log were moved: the run begins at 0 degrees north and east. Distances are\n"
        "unchanged. The log's texts and commands, and other messages that can contain a position, were left out."
        if hide_position
        else "They contain the position of the vehicle.",
        "",
        "Files:",
        *(f"  {name}" for name in files),
        *(("", "Left out:") if left_out else ()),
        *(f"  {name}: {reason}" for name, reason in left_out),
    ]
    return "\n".join(lines) + "\n"
