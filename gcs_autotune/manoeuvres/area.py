"""Where a craft may go: polygons and circles it must stay in, or out of, as guard in flight and in the preview.

Latitudes and longitudes are what people and vehicles give; :meth:`Area.around` makes them metres about the craft.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.frames import flat

__all__ = ["Area", "Zone", "how_far", "read_area"]

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Zone:
    """One polygon (three corners or more) or circle (one corner, ``radius`` [m]) to stay in, or out of (``inside``).

    ``corners`` are latitude and longitude [deg], or north and east [m].
    """

    corners: tuple[Point, ...]
    radius: float = 0.0
    inside: bool = True

    def beyond(self, x: float, y: float) -> float:
        """Return how far (x, y) [m] is on the wrong side; negative on the right one."""
        if len(self.corners) == 1:
            out = math.hypot(x - self.corners[0][0], y - self.corners[0][1]) - self.radius
        else:
            out = _distance(self.corners, x, y) * (-1.0 if _holds(self.corners, x, y) else 1.0)
        return out if self.inside else -out


@dataclass(frozen=True, slots=True)
class Area:
    """All of ``zones`` at once; ``source`` in words, for messages."""

    zones: tuple[Zone, ...]
    source: str

    def beyond(self, x: float, y: float) -> float:
        """Return how far (x, y) [m] is outside; 0 within."""
        return max(0.0, *(zone.beyond(x, y) for zone in self.zones))

    def around(self, lat: float, lon: float, x: float, y: float) -> Area:
        """Return an area given in degrees in metres, where the craft at *lat*, *lon* [deg] is at (x, y) [m]."""

        def local(point: Point) -> Point:
            north, east = flat(point[0], point[1], (lat, lon))
            return x + north, y + east

        return replace(self, zones=tuple(replace(z, corners=tuple(map(local, z.corners))) for z in self.zones))

    def seen_from(self, x: float, y: float, psi: float) -> Area:
        """Return an area in metres as a craft at (x, y) sees it that calls its place the origin and its bow north."""
        c, s = math.cos(psi), math.sin(psi)

        def seen(point: Point) -> Point:
            north, east = point[0] - x, point[1] - y
            return north * c + east * s, east * c - north * s

        return replace(self, zones=tuple(replace(z, corners=tuple(map(seen, z.corners))) for z in self.zones))

    def and_(self, other: Area | None) -> Area:
        """Return what both allow."""
        return self if other is None else Area((*self.zones, *other.zones), f"{self.source} and {other.source}")


def _holds(corners: Sequence[Point], x: float, y: float) -> bool:
    """Whether a polygon holds a point: a ray to the north crosses its sides an odd number of times."""
    odd = False
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            odd = not odd
    return odd


def _distance(corners: Sequence[Point], x: float, y: float) -> float:
    """Return the distance to the nearest side."""
    nearest = math.inf
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        along, across = x2 - x1, y2 - y1
        length = along**2 + across**2
        share = 0.0 if length == 0.0 else max(0.0, min(1.0, ((x - x1) * along + (y - y1) * across) / length))
        nearest = min(nearest, math.hypot(x - x1 - share * along, y - y1 - share * across))
    return nearest


def how_far(distance: float) -> str:
    """Return a *distance* [m] in words for people: none, however short, reads as nothing."""
    if distance < 1.0:
        return f"{max(100.0 * distance, 1.0):.0f} cm"
    if distance < 10.0:
        return f"{distance:.1f} m"
    return f"{distance:.0f} m" if distance < 10e3 else f"{distance / 1e3:.0f} km"


def read_area(text: str) -> Area:
    """Return the area that *text* says: corners ``lat,lon lat,lon lat,lon ...`` in degrees, or a GeoJSON file.

    Of a file the outer rings of its polygons are stayed in (of several: of the first), their holes stayed out of.

    Raises
    ------
    UsageError
        Fewer than three corners, or no latitude and longitude.
    BadFile
        The file cannot be read, or has no polygon.
    """
    path = Path(text)
    if path.suffix.lower() in (".geojson", ".json"):
        return _of_file(path)
    corners = []
    for pair in text.replace(";", " ").split():
        try:
            lat, lon = (float(number) for number in pair.split(","))
        except ValueError:
            raise UsageError(
                f"--area: '{pair}' is no corner; write 'lat,lon lat,lon lat,lon' in degrees, or name a .geojson file"
            ) from None
        corners.append((lat, lon))
    return Area((_zone(corners, "--area"),), "--area")


def _zone(corners: Sequence[Point], where: str, *, inside: bool = True) -> Zone:
    points = tuple(corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners)
    if len(points) < 3:
        raise UsageError(f"{where}: {len(points)} corners hold no water; give three or more")
    for lat, lon in points:
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            raise UsageError(f"{where}: {lat:g},{lon:g} is no latitude and longitude in degrees")
    return Zone(points, inside=inside)


def _of_file(path: Path) -> Area:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rings = next(iter(_polygons(data)), None)
        if not rings:
            raise BadFile(f"{path} has no polygon: draw the water as a GeoJSON Polygon")
        zones = [
            _zone([(float(p[1]), float(p[0])) for p in ring], str(path), inside=k == 0) for k, ring in enumerate(rings)
        ]
    except (OSError, UnicodeDecodeError, ValueError, TypeError, IndexError, AttributeError) as error:
        raise BadFile(f"{path} cannot be read as GeoJSON: {error}") from error
    return Area(tuple(zones), path.name)


def _polygons(thing: Any) -> list[Any]:
    """Return the rings of every polygon in a GeoJSON object."""
    kind = thing.get("type")
    if kind == "FeatureCollection":
        return [rings for feature in thing["features"] for rings in _polygons(feature)]
    if kind == "Feature":
        return _polygons(thing["geometry"])
    if kind == "GeometryCollection":
        return [rings for one in thing["geometries"] for rings in _polygons(one)]
    if kind == "MultiPolygon":
        return list(thing["coordinates"])
    return [thing["coordinates"]] if kind == "Polygon" else []
