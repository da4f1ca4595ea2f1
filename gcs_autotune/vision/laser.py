"""Distance to a flat surface from two laser dots in a camera picture (Miskovic2010, 3.4).

The distance of each dot from the picture's centre gives the length of its beam: ``L = a exp(b x) + c exp(d x)`` (3.9).
The two lengths give the craft's distance (3.8) and its angle to the surface. (3.7) prints the complement of the angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, least_squares

from gcs_autotune.control import WallReading
from gcs_autotune.csv_table import cells_of, numbers_of
from gcs_autotune.documents import conformed, load_json
from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.notebook import Displayed
from gcs_autotune.plain_json import json_text
from gcs_autotune.sname import parse_header, to_si
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.vision.dots import DotFinder, Dots, Line
from gcs_autotune.vision.pictures import Picture, pictures

__all__ = [
    "Calibration",
    "LaserCurve",
    "LaserModule",
    "LaserReading",
    "calibrate",
    "calibrate_laser",
    "laser_run",
    "load_lasers",
    "read_lasers",
    "save_lasers",
]

Array = NDArray[np.float64]
_SIDES = ("port", "starboard")
_LEAST_POINTS = 8
"""Pictures with a dot that are needed to know the line on which it moves. Project choice."""


class LaserCurve(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Curve from a dot's distance from the picture's centre to the length of its beam.

    ``a``, ``c`` are in the unit of the distance, ``b``, ``d`` per pixel (Miskovic2010, Table 3.1: per cm).
    """

    a: float
    b: float
    c: float
    d: float

    def length(self, pixels: ArrayLike) -> Array:
        """Return the beam's length at *pixels* from the picture's centre, any shape (Miskovic2010, eq. (3.9))."""
        x = np.asarray(pixels, dtype=np.float64)
        value: Array = self.a * np.exp(self.b * x) + self.c * np.exp(self.d * x)
        return value

    def pixels(self, length: float) -> float:
        """Return the position of the dot of a beam of that *length*; it is unique, because the curve falls.

        Raises
        ------
        NotInformative
            A length of 0 or less, or a length beyond the picture's centre.
        """
        if not 0.0 < length <= float(self.length(0.0)):
            raise NotInformative(
                f"a distance of {length:g} is outside the calibrated range (0 to {float(self.length(0.0)):g}). "
                "Calibrate over a wider range"
            )
        far = 1.0
        while float(self.length(far)) > length:
            far *= 2.0
        return float(brentq(lambda x: float(self.length(x)) - length, 0.0, far))


class LaserModule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A calibrated laser distance module, as in its file; lengths in metres.

    port, starboard : curves of the two dots. apart : distance between the lasers. nearest, furthest : calibrated range.
    width, height : size of the pictures [pixels], 0 if a table was calibrated. lines : the line of each dot, or None.
    """

    port: LaserCurve
    starboard: LaserCurve
    apart: float
    nearest: float
    furthest: float
    width: int = 0
    height: int = 0
    lines: tuple[Line | None, Line | None] = (None, None)

    def beams(self, dots: Dots) -> tuple[float, float]:
        """Return the lengths [m] of the beams of port and starboard; NaN if a dot is missing or out of range."""
        lengths = []
        for curve, dot in zip((self.port, self.starboard), (dots.port, dots.starboard), strict=True):
            length = math.nan if dot is None else float(curve.length(math.hypot(*dot)))
            beyond = 1.0 + _BEYOND
            lengths.append(length if self.nearest / beyond <= length <= self.furthest * beyond else math.nan)
        return lengths[0], lengths[1]


_BEYOND = 0.15
"""Part of the calibrated range by which a beam may leave it. An oblique beam is shorter or longer. Project choice."""


@dataclass(frozen=True, slots=True)
class LaserReading(Displayed):
    """One picture: lengths of the two beams [m], NaN if not measured. ``searched`` is as in :class:`Dots`."""

    number: int
    t: float
    port: float
    starboard: float
    searched: str
    missing: str
    apart: float

    @property
    def distance(self) -> float:
        """Distance straight ahead from the middle between the lasers [m] (Miskovic2010, (3.8))."""
        return 0.5 * (self.port + self.starboard)

    @property
    def angle(self) -> float:
        """Heading minus that at a right angle to the surface [rad].

        It is the complement of Phi of Miskovic2010, (3.7).
        """
        return WallReading.of_two(0.0, self.port, self.starboard, self.apart).phi


@dataclass(frozen=True, slots=True, eq=False)
class Calibration(Displayed):
    """A calibrated module, and the table it was made from.

    distances : (n,) [m]. pixels : (n, 2) distances of the dots from the centre [pixels], port and starboard.
    """

    module: LaserModule
    distances: Array
    pixels: Array

    @property
    def errors(self) -> Array:
        """Curve minus measured distance (n, 2) [m]."""
        curves = (self.module.port, self.module.starboard)
        return np.column_stack([c.length(self.pixels[:, i]) - self.distances for i, c in enumerate(curves)])

    def to_dict(self) -> dict[str, Any]:
        """Return the calibration as plain data for JSON."""
        return {
            "schema": 1,
            **msgspec.to_builtins(self.module),
            "distances": self.distances.tolist(),
            "pixels": self.pixels.tolist(),
            "errors": self.errors.tolist(),
        }


def calibrate_laser(table: Path, source: str = "", *, apart: float, colour: str = "red") -> Calibration:
    """Calibrate the two curves over known distances, each at a right angle to the surface.

    table : CSV file with ``d[cm]`` and the pixel positions ``x_L`` and ``x_R``, or with ``d[cm]`` alone, one row per
    picture of *source*. apart : distance between the lasers [m].

    Raises
    ------
    BadFile
        The table has no such columns, other rows than pictures, or a picture does not show two dots.
    NotInformative
        Too few distances.
    """
    columns = _columns(table)
    distances = columns["d"]
    if source:
        finder, places, size = DotFinder(colour), [], (0, 0)
        for picture in pictures(source):
            finder.forget()  # the distances may be in any order
            dots = finder.find(picture.bgr)
            if dots.port is None or dots.starboard is None:
                raise BadFile(f"{source}, picture {picture.number}: {dots.missing}. Remove the picture and its row")
            places.append((*dots.port, *dots.starboard))
            size = (picture.bgr.shape[1], picture.bgr.shape[0])
        if len(places) != len(distances):
            raise BadFile(f"{table} has {len(distances)} rows for {len(places)} pictures. Write one row per picture")
        measured = np.array(places)
        pixels = np.column_stack([np.hypot(*measured[:, :2].T), np.hypot(*measured[:, 2:].T)])
        lines = (_line(measured[:, 0], measured[:, 1]), _line(measured[:, 2], measured[:, 3]))
    elif "x_L" in columns and "x_R" in columns:
        pixels, lines, size = np.column_stack([columns["x_L"], columns["x_R"]]), (None, None), (0, 0)
    else:
        raise BadFile(
            f"{table} has no pixel positions x_L and x_R. Add these columns, or give the pictures: --pictures FOLDER"
        )
    curves = []
    for side, x in zip(_SIDES, pixels.T, strict=True):
        try:
            curves.append(calibrate(x, distances))
        except NotInformative as error:
            raise NotInformative(f"{table}, {side} dot: {error}") from None
    module = LaserModule(
        curves[0], curves[1], apart, float(distances.min()), float(distances.max()), size[0], size[1], lines
    )
    return Calibration(module, distances, pixels)


def _columns(table: Path) -> dict[str, Array]:
    """Return the columns of a calibration table: ``d`` [m], and positions [pixels]."""
    cells = cells_of(table, "d[cm],x_L,x_R")
    numbers = numbers_of(cells)
    columns = {}
    for i, index in enumerate(numbers.columns):
        name, unit = parse_header(cells.head[index])
        values = numbers.values[:, i]
        if name == "d":
            if not unit:
                raise BadFile(f"{table}: the distance d has no unit. Write d[cm] or d[m]")
            values = values * to_si(unit)[1]
        if name in ("d", "x_L", "x_R"):
            bad = ~np.isfinite(values) | (values <= 0.0 if name == "d" else values < 0.0)
            if bad.any():
                row = cells.first + int(np.argmax(bad))
                raise BadFile(
                    f"{table}, row {row}: {name} is {values[bad][0]:g}{' m' if name == 'd' else ''}. It must be above 0"
                )
            columns[name] = values
    if "d" not in columns:
        raise BadFile(f"{table} has no column d[cm] with the distances. Its columns are {', '.join(cells.head)}")
    return columns


def _line(x: Array, y: Array) -> Line | None:
    """Return the line through the places of one dot; None if they are too few or too close."""
    if len(x) < _LEAST_POINTS or float(np.ptp(x)) < 20.0:
        return None
    slope, level = np.polyfit(x, y, 1)
    return float(level), float(slope)


def save_lasers(module: LaserModule, path: Path) -> None:
    """Write the calibration file.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    try:
        path.write_text(json_text({"schema": 1, **msgspec.to_builtins(module)}), encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}") from error


def load_lasers(path: Path) -> LaserModule:
    """Return the module in a calibration file.

    Raises
    ------
    BadFile
        The file is not a calibration; the message names the quantity.
    """
    data = load_json(path, "a calibration of lasers")
    where = f"{path} is not a calibration of lasers (write one with `gcs-autotune calibrate laser`)"
    if not isinstance(data, dict) or data.get("schema") != 1:
        raise BadFile(where)
    module = conformed({k: v for k, v in data.items() if k != "schema"}, LaserModule, where)
    for name in ("apart", "nearest"):
        if getattr(module, name) <= 0.0:
            raise BadFile(f"{path}: {name} is {getattr(module, name):g} m. It must be above 0")
    if module.furthest <= module.nearest:
        raise BadFile(f"{path}: furthest ({module.furthest:g} m) is not above nearest ({module.nearest:g} m)")
    for side in _SIDES:
        curve: LaserCurve = getattr(module, side)
        if not (curve.b < 0.0 and curve.d < 0.0):
            raise BadFile(f"{path}: the curve of {side} does not fall: b = {curve.b:g}, d = {curve.d:g} per pixel")
    return module


def read_lasers(
    module: LaserModule, source: str, *, rate: float | None = None, colour: str = "red", window: int | None = None
) -> Iterator[LaserReading]:
    """Yield the reading of each picture of *source* (:func:`~gcs_autotune.vision.pictures.pictures`).

    window : side of the search windows [pixels]; None for the usual one.

    Raises
    ------
    BadFile
        A picture cannot be read, or its size is not that of the calibration.
    """
    lines = module.lines
    finder = DotFinder(colour, lines) if window is None else DotFinder(colour, lines, window)
    for picture in pictures(source, rate):
        _verify_size(module, source, picture)
        dots = finder.find(picture.bgr)
        port, starboard = module.beams(dots)
        missing = dots.missing
        if not missing and math.isnan(port + starboard):
            missing = "a distance outside the calibrated range"
        yield LaserReading(picture.number, picture.t, port, starboard, dots.searched, missing, module.apart)


def _verify_size(module: LaserModule, source: str, picture: Picture) -> None:
    height, width, _ = picture.bgr.shape
    if module.width and (width, height) != (module.width, module.height):
        raise BadFile(
            f"{source}, picture {picture.number}: {width} x {height} pixels, but the lasers are calibrated for "
            f"{module.width} x {module.height}. Record pictures of that size, or calibrate again"
        )


def laser_run(readings: Sequence[LaserReading], name: str) -> Trial:
    """Return a run with the beams as ``d`` (port) and ``d_starboard`` [m]; pictures without two dots are left out.

    Raises
    ------
    NotInformative
        No picture shows two dots in the calibrated range.
    """
    valid = [r for r in readings if not r.missing]
    if not valid:
        first = readings[0]
        raise NotInformative(
            f"{name}: none of {len(readings)} pictures shows two laser dots in range. Picture {first.number} shows "
            f"{first.missing}. Check the lasers, --colour and the calibration"
        )
    t = np.array([r.t for r in valid])
    port, starboard = np.array([r.port for r in valid]), np.array([r.starboard for r in valid])
    channels = {"d": Channel("d", "m", t, port), "d_starboard": Channel("d_starboard", "m", t, starboard)}
    return Trial(name, channels, meta={"source": name, "apart": valid[0].apart, "pictures": len(readings)})


def calibrate(pixels: Sequence[float] | Array, lengths: Sequence[float] | Array) -> LaserCurve:
    """Fit the curve to pairs measured at right angles to a surface.

    The *lengths* themselves are fitted, not their logarithms, because a tape measure has constant errors.

    Raises
    ------
    NotInformative
        Fewer than five pairs, or all at one place.
    """
    x, y = np.asarray(pixels, dtype=np.float64), np.asarray(lengths, dtype=np.float64)
    if len(x) < 5 or float(np.ptp(x)) <= 0.0 or float(y.min()) <= 0.0:
        raise NotInformative("a laser calibration needs at least five different distances above 0")
    near = x > np.median(x)
    slope = float(np.polyfit(x[near], np.log(y[near]), 1)[0])
    best = min((_fit(x, y, slope * steeper, slope) for steeper in (2.0, 4.0, 8.0)), key=lambda found: found[1])
    return best[0]


def _fit(x: Array, y: Array, b: float, d: float) -> tuple[LaserCurve, float]:
    """Search over the two rates; for given rates the two amplitudes follow from linear least squares."""

    def amplitudes(rates: Array) -> tuple[Array, Array]:
        table = np.exp(np.outer(x, rates))
        sizes = np.asarray(np.linalg.lstsq(table, y, rcond=None)[0], dtype=np.float64)
        return sizes, np.asarray(table @ sizes - y, dtype=np.float64)

    scale = abs(d)

    def error_of(p: Array) -> Array:
        return amplitudes(p * scale)[1]

    search = least_squares(error_of, np.array([b, d]) / scale, xtol=1e-14, ftol=1e-14)
    rates = np.sort(search.x * scale)
    (a, c), error = amplitudes(rates)
    return LaserCurve(float(a), float(rates[0]), float(c), float(rates[1])), float(error @ error)
