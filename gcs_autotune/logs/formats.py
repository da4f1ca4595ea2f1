"""The table of file types: those that can be read, and those that are recognised with advice on how to convert them.

A file is recognised by its content, whatever its name. The suffix counts only if the content shows nothing (a log
damaged from its start). Any other file is read as a CSV table.
"""

from __future__ import annotations

import re
import shlex
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from gcs_autotune import mavlink  # whose names bring pymavlink, so only when one is used
from gcs_autotune.csv_table import wide_encoding
from gcs_autotune.errors import BadFile
from gcs_autotune.logs import matlab, rosbag, ulog
from gcs_autotune.logs.dataflash import FMT_LINE, record_dataflash
from gcs_autotune.logs.format import Format, Head
from gcs_autotune.logs.mavlink_csv import is_mavlogdump, is_mission_planner, record_mavlogdump, record_mission_planner
from gcs_autotune.logs.qgc_csv import is_qgc, record_qgc
from gcs_autotune.logs.tlog import record_tlog
from gcs_autotune.untrusted_text import visible

__all__ = ["FORMATS", "LOG_SUFFIXES", "format_of"]

FIRST_FRAMES = 3
"""Number of consecutive MAVLink frames by which a file is recognised. Project choice."""
YEARS = (946_684_800_000_000, 4_102_444_800_000_000)
"""Range of valid stamps of telemetry logs [us since 1970]: the years 2000 to 2099."""
EXPORT = "export it as CSV (comma separated, UTF-8), with a header line like t[s],psi[deg],N[N m]"


def _begins(*magic: bytes) -> Callable[[Head], bool]:
    return lambda head: head.data.startswith(magic)


def _text(pattern: str) -> Callable[[Head], bool]:
    compiled = re.compile(pattern, re.IGNORECASE)
    return lambda head: head.is_text and compiled.match(head.text.lstrip()) is not None


def _of_text(fits: Callable[[str], bool]) -> Callable[[Head], bool]:
    return lambda head: head.is_text and fits(head.text)


def _is_stamped(head: Head) -> bool:
    """Return whether a file begins with a stamp and a MAVLink frame, as telemetry logs do."""
    stamp = int.from_bytes(head.data[:8], "big")
    return head.data[8:9] in (b"\xfd", b"\xfe") and YEARS[0] < stamp < YEARS[1]


def _is_raw(head: Head) -> bool:
    """Return whether a file begins with consecutive MAVLink frames without stamps."""
    data, at = head.data, 0
    for count in range(FIRST_FRAMES):
        if data[at : at + 1] not in (b"\xfd", b"\xfe"):
            return False
        length = mavlink.frame_length(data, at)
        if length is None or at + length >= len(data):
            return count > 0 and at + (length or 0) == len(data)
        at += length
    return True


def _is_dataflash(head: Head) -> bool:
    return head.data.startswith(b"\xa3\x95\x80") or (head.is_text and FMT_LINE.search(head.data[:4096]) is not None)


def _zipped(fits: Callable[[Sequence[str]], bool]) -> Callable[[Head], bool]:
    """Return whether a file is a zip archive with matching member names. An unreadable archive does not match."""

    def is_such(head: Head) -> bool:
        return head.data.startswith(b"PK\x03\x04") and fits(_members(head.path))

    return is_such


def _members(path: Path) -> list[str]:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError):
        return []


FORMATS: tuple[Format, ...] = (
    Format("a telemetry log", _is_stamped, (".tlog",), record=record_tlog),
    Format("an onboard log", _is_dataflash, (".bin", ".log"), record=record_dataflash),
    Format("Mission Planner's CSV of a telemetry log", _of_text(is_mission_planner), record=record_mission_planner),
    Format("mavlogdump's CSV of a telemetry log", _of_text(is_mavlogdump), record=record_mavlogdump),
    Format("QGroundControl's CSV", _of_text(is_qgc), record=record_qgc),
    ulog.FORMAT,
    matlab.FORMAT,
    rosbag.FORMAT,
    Format(
        "MAVLink without timestamps (MAVProxy's .raw)",
        _is_raw,
        advice="use the telemetry log that MAVProxy writes next to it (mav.tlog), which has the same messages with "
        "timestamps",
    ),
    Format(
        "a MATLAB file of version 7.3, or another HDF5 file",
        lambda head: head.data.startswith(b"\x89HDF\r\n\x1a\n") or head.data.startswith(b"MATLAB 7.3 MAT-file"),
        advice="in MATLAB save it with save('run.mat', '-v7'), or " + EXPORT,
    ),
    Format(
        "an Excel workbook",
        _zipped(lambda names: any(n.startswith("xl/") for n in names)),
        (".xlsx", ".xlsm", ".xls"),
        advice=EXPORT,
    ),
    Format("an old Excel workbook", _begins(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"), advice=EXPORT),
    Format(
        "a document of Word or PowerPoint",
        _zipped(lambda names: any(n.startswith(("word/", "ppt/")) for n in names)),
        (".docx", ".pptx"),
        advice="give the data that the document was made from",
    ),
    Format(
        "a spreadsheet of LibreOffice",
        _zipped(lambda names: "content.xml" in names and "mimetype" in names),
        (".ods",),
        advice=EXPORT,
    ),
    Format(
        "NumPy's .npz or .npy",
        lambda head: head.data.startswith(b"\x93NUMPY") or _zipped(lambda n: bool(n) and n[0].endswith(".npy"))(head),
        (".npz", ".npy"),
        advice="write it as CSV: numpy.savetxt('run.csv', columns, delimiter=',', header='t[s],psi[rad],N[N m]')",
    ),
    Format("a zip archive", _begins(b"PK\x03\x04", b"PK\x05\x06"), (".zip",), advice="unpack it: unzip {name}{inside}"),
    Format("compressed by gzip", _begins(b"\x1f\x8b"), (".gz",), advice="unpack it: gunzip -k {name}"),
    Format("compressed by bzip2", _begins(b"BZh"), (".bz2",), advice="unpack it: bunzip2 -k {name}"),
    Format("compressed by xz", _begins(b"\xfd7zXZ\0"), (".xz",), advice="unpack it: unxz -k {name}"),
    Format("compressed by Zstandard", _begins(b"\x28\xb5\x2f\xfd"), (".zst",), advice="unpack it: unzstd {name}"),
    Format("a 7z archive", _begins(b"7z\xbc\xaf\x27\x1c"), (".7z",), advice="unpack it: 7z x {name}"),
    Format("a RAR archive", _begins(b"Rar!\x1a\x07"), (".rar",), advice="unpack it: unrar x {name}"),
    Format("a tar archive", lambda head: head.data[257:262] == b"ustar", (".tar",), advice="unpack it: tar xf {name}"),
    Format("Parquet", _begins(b"PAR1"), (".parquet",), advice="write it as CSV: pandas.read_parquet(...).to_csv(...)"),
    Format("a database (SQLite)", _begins(b"SQLite format 3"), advice=EXPORT),
    Format("a Python pickle", _begins(b"\x80\x03", b"\x80\x04", b"\x80\x05"), (".pkl",), advice="write it as CSV"),
    Format(
        "a log of Betaflight's Blackbox", _begins(b"H Product:Blackbox"), advice="convert it: blackbox_decode {name}"
    ),
    Format("a PDF", _begins(b"%PDF-"), advice="use the original data"),
    Format("an image", _begins(b"\x89PNG", b"\xff\xd8\xff", b"GIF8"), advice="use the original data"),
    Format("a web page", _text(r"<!doctype html|<html"), advice="use the file that the page shows or links to"),
    Format(
        "a track in XML (GPX, KML)", _text(r"<\?xml|<gpx|<kml"), advice="a track has no actuator inputs: use the log"
    ),
    Format(
        "NMEA sentences",
        _text(r"\$[A-Z]{2}[A-Z0-9]{3},"),
        advice="a GPS receiver records no actuator inputs: use the log",
    ),
    Format("a list of waypoints", _text(r"QGC WPL"), advice="use the log of the mission"),
    Format(
        "JSON",
        _text(r"\{\s*[\"}]|\[\s*[\[{\"\d-]"),
        (".json",),
        advice="use CSV with a header line like t[s],psi[deg],N[N m]",
    ),
    Format(
        "an ArduPilot log without FMT lines (before 2012)",
        _text(r"(ATT|GPS|NTUN|CTUN|RAW|IMU|MOD|PM)\s*:"),
        advice="such a log is not supported: use the telemetry log (.tlog)",
    ),
    Format(
        "a list of parameters",
        _text(r"(#[^\n]*\n)*([A-Z][A-Z0-9]+_[A-Z0-9_]+[ ,\t]+-?[0-9.]+\s*\n){3}"),
        advice="use it with --parameters, together with its log",
    ),
)
"""File types, tested in this order by content and then by suffix. To add a format, add a file and a line here."""

LOG_SUFFIXES = tuple(s for f in FORMATS if f.record or f.runs for s in f.suffixes if s not in (".log", ".db3"))
"""Suffixes of the logs that are searched for in a folder."""


def format_of(path: Path) -> Format | None:
    """Return the type of the file at *path*; None for a table of columns (CSV) or an ordinary folder.

    Raises
    ------
    BadFile
        It cannot be read, is empty, or is unsupported; the message states the type, and how to convert it.
    """
    head = Head.of(path)
    if not head.data and not path.is_dir():
        raise BadFile(f"{path} is empty (0 bytes). Check the recording, or copy the file again")
    form = next((f for f in FORMATS if f.fits(head)), None) or _by_suffix(head)
    if form is not None and form.record is None and form.runs is None:
        inside = ", ".join(visible(name) for name in _members(path)[:3])
        advice = form.advice.replace("{name}", shlex.quote(visible(path.name)))
        advice = advice.replace("{inside}", f" (it contains {inside})" if inside else "")
        raise BadFile(f"{path} is {form.name}: {advice}")
    return form


def _by_suffix(head: Head) -> Format | None:
    """Return the type of a file by its name, unless it is a text table with a misleading name."""
    if head.path.is_dir() or wide_encoding(head.data):
        return None
    first = next((line for line in head.text.splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    if head.is_text and "," in first:
        return None
    return next((f for f in FORMATS if head.path.suffix.lower() in f.suffixes), None)
