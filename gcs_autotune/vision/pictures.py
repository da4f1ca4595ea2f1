"""Read pictures one by one from a video, a camera, or a folder of PNG or JPEG files."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.csv_table import cells_of, numbers_of
from gcs_autotune.errors import BadFile
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import parse_header, to_si
from gcs_autotune.vision.opencv import opencv

__all__ = ["TIMES", "Picture", "is_live", "pictures"]

TIMES = "times.csv"
"""File with the times of the pictures of a folder: a column ``t[s]``, one row per picture."""
RATE = 10.0
"""Pictures per second of a folder without times: the period of 100 ms of Miskovic2010, section 3.5.2."""
_KINDS = (".png", ".jpg", ".jpeg")
_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class Picture(Displayed):
    """One picture: its number from 1, its time [s], and ``bgr`` (height, width, 3): blue, green, red, 0 to 255."""

    number: int
    t: float
    bgr: NDArray[np.uint8]


def is_live(source: str) -> bool:
    """Return whether *source* is a camera: its number, or the address of a stream."""
    return source.isdecimal() or "://" in source


def pictures(source: str, rate: float | None = None) -> Iterator[Picture]:
    """Yield the pictures of *source*.

    source : a video file, a folder, the number of a camera or the address of a stream. rate : pictures per second,
    instead of the times of the video or folder.

    Raises
    ------
    BadFile
        There is no picture, one cannot be read, sizes differ, or a time does not follow the one before.
    UsageError
        OpenCV is not installed.
    """
    path = Path(source)
    if not is_live(source) and not path.exists():
        raise BadFile(f"{source} does not exist. Give a video, or a folder of PNG or JPEG pictures")
    last: Picture | None = None
    for picture in _of_folder(path, rate) if path.is_dir() else _of_video(source, rate):
        if last is not None and picture.bgr.shape != last.bgr.shape:
            sizes = " and ".join(f"{p.bgr.shape[1]} x {p.bgr.shape[0]}" for p in (last, picture))
            raise BadFile(f"{source}, picture {picture.number}: its size differs from the last one ({sizes} pixels)")
        if last is not None and picture.t <= last.t:
            raise BadFile(
                f"{source}, picture {picture.number}: its time {picture.t:g} s does not follow {last.t:g} s. "
                "Use --frame-rate, or correct the times"
            )
        yield picture
        last = picture
    if last is None:
        raise BadFile(f"{source} contains no picture")


def _of_folder(folder: Path, rate: float | None) -> Iterator[Picture]:
    cv2 = opencv()
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in _KINDS), key=_order)
    times = _times(folder, len(files), rate)
    for number, (file, t) in enumerate(zip(files, times, strict=True), start=1):
        data = np.frombuffer(file.read_bytes(), dtype=np.uint8)
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
        if bgr is None:
            raise BadFile(f"{file} cannot be read as a picture ({len(data)} bytes). Remove it, or copy it again")
        yield Picture(number, t, bgr)


def _order(file: Path) -> list[tuple[int, str]]:
    """Return the sort key of a file: numbers in its name count as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _DIGITS.split(file.name)]


def _times(folder: Path, count: int, rate: float | None) -> Sequence[float]:
    path = folder / TIMES
    if rate is not None or not path.exists():
        return [number / (rate or RATE) for number in range(count)]
    cells = cells_of(path, "t[s]")
    table = numbers_of(cells)
    heads = [parse_header(cells.head[i]) for i in table.columns]
    columns = [(i, to_si(unit)[1]) for i, (name, unit) in enumerate(heads) if name == "t"]
    if not columns:
        raise BadFile(f"{path} has no time column t[s]")
    times = table.values[:, columns[0][0]] * columns[0][1]
    if len(times) != count:
        raise BadFile(f"{path} has {len(times)} times for {count} pictures. Write one row per picture")
    if not np.isfinite(times).all():
        raise BadFile(f"{path}, row {cells.first + int(np.argmin(np.isfinite(times)))}: t is not a number")
    return [float(t) for t in times]


def _of_video(source: str, rate: float | None) -> Iterator[Picture]:
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # its errors are reported by us
    cv2 = opencv()
    video = cv2.VideoCapture(int(source) if source.isdecimal() else source)
    try:
        if not video.isOpened():
            raise BadFile(f"{source} cannot be opened as a video. Check the file, or give a folder of pictures")
        per_second = rate or float(video.get(cv2.CAP_PROP_FPS)) or RATE
        number, started = 0, time.monotonic()
        while True:
            there, bgr = video.read()
            if not there:
                return
            number += 1
            stamp = float(video.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
            if is_live(source):
                stamp = time.monotonic() - started
            elif rate is not None or (number > 1 and stamp <= 0.0):
                stamp = (number - 1) / per_second
            yield Picture(number, stamp, bgr)
    finally:
        video.release()
