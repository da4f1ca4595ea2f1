"""The permitted area: polygons and circles that a craft must stay inside or outside of.

It is used as a guard in flight and in the preview. Users and vehicles supply latitudes and longitudes;
:meth:`Area.around` converts them to metres relative to the craft.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from gcs_autotune.documents import conformed, load_json
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.frames import flat
from gcs_autotune_files import number, shown

__all__ = ["Area", "Zone", "how_far", "read_area"]

Point = tuple[float, float]
MOST_CORNERS = 2000
"""Largest number of corners of an outline, because the outline is checked at every sample. Project choice."""
_THINNEST = 1e-4
"""Ratio of width to length below which corners count as collinear: 10 cm in a kilometre. Project choice."""


@dataclass(frozen=True, slots=True)
class Zone:
    """One polygon (at least three corners) or circle (one corner, ``radius`` [m]); ``inside``: stay inside, else
    outside.

    ``corners`` are latitude and longitude [deg], or north and east [m].
    """

    corners: tuple[Point, ...]
    radius: float = 0.0
    inside: bool = True

    def beyond(self, x: float, y: float) -> float:
        """Return the distance [m] of (x, y) [m] from the outline: positive on the forbidden side, negative on the
        permitted side.
        """
        if len(self.corners) == 1:
            out = math.hypot(x - self.corners[0][0], y - self.corners[0][1]) - self.radius
        else:
            out = _distance(self.corners, x, y) * (-1.0 if _holds(self.corners, x, y) else 1.0)
        return out if self.inside else -out


@dataclass(frozen=True, slots=True)
class Area:
    """All of ``zones`` together; ``source`` is their origin as text for messages."""

    zones: tuple[Zone, ...]
    source: str

    def beyond(self, x: float, y: float) -> float:
        """Return how far [m] the position (x, y) [m] is outside the area; 0 inside."""
        return max(0.0, *(zone.beyond(x, y) for zone in self.zones))

    def around(self, lat: float, lon: float, x: float, y: float) -> Area:
        """Return this area, in degrees, converted to metres for a craft at *lat*, *lon* [deg] and (x, y) [m]."""

        def local(point: Point) -> Point:
            north, east = flat(point[0], point[1], (lat, lon))
            return x + north, y + east

        return replace(self, zones=tuple(replace(z, corners=tuple(map(local, z.corners))) for z in self.zones))

    def seen_from(self, x: float, y: float, psi: float) -> Area:
        """Return this area, in metres, relative to a craft at (x, y) [m], with the craft as origin and its bow
        as north.
        """
        c, s = math.cos(psi), math.sin(psi)

        def seen(point: Point) -> Point:
            north, east = point[0] - x, point[1] - y
            return north * c + east * s, east * c - north * s

        return replace(self, zones=tuple(replace(z, corners=tuple(map(seen, z.corners))) for z in self.zones))

    def and_(self, other: Area | None) -> Area:
        """Return the area permitted by both this area and *other*."""
        return self if other is None else Area((*self.zones, *other.zones), f"{self.source} and {other.source}")


def _holds(corners: Sequence[Point], x: float, y: float) -> bool:
    """Return whether a polygon contains a point: a ray to the north crosses its sides an odd number of times."""
    odd = False
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            odd = not odd
    return odd


def _distance(corners: Sequence[Point], x: float, y: float) -> float:
    """Return the distance of a point to the nearest side of a polygon."""
    nearest = math.inf
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        along, across = x2 - x1, y2 - y1
        length = along**2 + across**2
        share = 0.0 if length == 0.0 else max(0.0, min(1.0, ((x - x1) * along + (y - y1) * across) / length))
        nearest = min(nearest, math.hypot(x - x1 - share * along, y - y1 - share * across))
    return nearest


def how_far(distance: float) -> str:
    """Return a *distance* [m] as text. Even a very short distance is not shown as zero."""
    if distance < 1.0:
        return f"{max(100.0 * distance, 1.0):.0f} cm"
    if distance < 10.0:
        return f"{distance:.1f} m"
    return f"{distance:.0f} m" if distance < 10e3 else f"{distance / 1e3:.0f} km"


def read_area(text: str) -> Area:
    """Return the area in *text*: corners ``lat,lon lat,lon lat,lon ...`` in degrees, or the path of a GeoJSON file.

    The craft must stay inside the outer ring of the file's first polygon, and outside its holes.

    Raises
    ------
    UsageError
        There are fewer than three corners, or they are not latitude and longitude.
    BadFile
        The file cannot be read, or has no polygon.
    """
    path = Path(text)
    if path.suffix.lower() in (".geojson", ".json"):
        return _of_file(path)
    corners = []
    for pair in text.replace(";", " ").split():
        try:
            lat, lon = (number(piece) for piece in pair.split(","))
        except ValueError:
            raise UsageError(
                f"--area: {shown(pair)} is not a corner. Write 'lat,lon lat,lon lat,lon' in degrees, or give a "
                ".geojson file"
            ) from None
        corners.append((lat, lon))
    return Area((_zone(corners, "--area"),), "--area")


def _zone(corners: Sequence[Point], where: str, *, inside: bool = True) -> Zone:
    points = tuple(corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners)
    if len(points) < 3:
        raise UsageError(f"{where}: {len(points)} corners do not enclose an area. Use three or more")
    if len(points) > MOST_CORNERS:
        raise UsageError(f"{where}: {len(points)} corners are too many. Simplify the outline to at most {MOST_CORNERS}")
    for lat, lon in points:
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            raise UsageError(f"{where}: {lat:g},{lon:g} is not a latitude and longitude in degrees")
    _check_outline(points, where)
    return Zone(points, inside=inside)


def _check_outline(points: Sequence[Point], where: str) -> None:
    """Reject an outline that spans more than half of the globe, has no area, or crosses itself."""
    if max(lon for _, lon in points) - min(lon for _, lon in points) > 180.0:
        raise UsageError(
            f"{where}: the area crosses 180 degrees of longitude. Use an area on one side of this meridian, or two "
            "flights"
        )
    middle = sum(lat for lat, _ in points) / len(points), points[0][1]
    metres = [flat(lat, lon, middle) for lat, lon in points]
    sides = list(zip(metres, (*metres[1:], metres[0]), strict=True))
    doubled = next((k + 1 for k, (a, b) in enumerate(sides) if a == b), None)
    far = max(metres, key=lambda p: math.dist(metres[0], p))
    wide = max(abs(_turn(metres[0], far, p)) for p in metres)
    if doubled is not None or wide <= _THINNEST * math.dist(metres[0], far) ** 2:
        why = "the corners are on one line" if doubled is None else f"corner {doubled} occurs twice"
        raise UsageError(f"{where}: {why}. Give the corners in order, once each")
    crossing = _crossing(sides)
    if crossing is not None:
        one, two = (f"corner {k + 1} to {(k + 1) % len(sides) + 1}" for k in crossing)
        raise UsageError(
            f"{where}: the side from {one} crosses the side from {two}. Give the corners in order around the area"
        )


def _crossing(sides: Sequence[tuple[Point, Point]]) -> tuple[int, int] | None:
    """Return the first two non-adjacent sides with a common point; None if there are none.

    Only pairs with overlapping north-south extents are checked.
    """
    extent = [(min(a[0], b[0]), max(a[0], b[0])) for a, b in sides]
    order = sorted(range(len(sides)), key=lambda k: extent[k][0])
    for place, i in enumerate(order):
        for j in order[place + 1 :]:
            if extent[j][0] > extent[i][1]:
                break
            neighbours = abs(i - j) in (1, len(sides) - 1)
            if not neighbours and _meet(*sides[i], *sides[j]):
                return min(i, j), max(i, j)
            if neighbours and _folds_back(sides[min(i, j)], sides[max(i, j)], first=abs(i - j) != 1):
                return min(i, j), max(i, j)
    return None


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Return whether the segments ab and cd have a point in common."""
    one, two, three, four = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if one * two < 0.0 and three * four < 0.0:
        return True
    touching = ((one, a, b, c), (two, a, b, d), (three, c, d, a), (four, c, d, b))
    return any(turn == 0.0 and _between(p, q, r) for turn, p, q, r in touching)


def _between(a: Point, b: Point, c: Point) -> bool:
    """Return whether c, on the line through a and b, is on the segment."""
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


def _folds_back(one: tuple[Point, Point], two: tuple[Point, Point], *, first: bool) -> bool:
    """Return whether two neighbouring sides lie on each other and form a spike.

    *first*: they meet at the first corner.
    """
    (a, b), (c, d) = (two, one) if first else (one, two)
    return _turn(a, b, d) == 0.0 and (b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1]) < 0.0


def _of_file(path: Path) -> Area:
    contents: _GeoJson = conformed(load_json(path, "GeoJSON"), _GeoJson, path)  # type: ignore[arg-type]
    rings = next(iter(_polygons(contents)), None)
    if not rings:
        raise BadFile(f"{path} contains no polygon. Draw the area as a GeoJSON Polygon")
    try:
        zones = [_zone([(p[1], p[0]) for p in ring], str(path), inside=k == 0) for k, ring in enumerate(rings)]
    except UsageError as error:
        raise BadFile(str(error)) from error
    return Area(tuple(zones), path.name)


_Position = Annotated[list[float], Meta(min_length=2, max_length=4)]
_Ring = Annotated[list[_Position], Meta(min_length=4)]
_Rings = Annotated[list[_Ring], Meta(min_length=1)]


class _Polygon(Struct, tag_field="type", tag="Polygon"):
    coordinates: _Rings


class _MultiPolygon(Struct, tag_field="type", tag="MultiPolygon"):
    coordinates: list[_Rings]


class _Point(Struct, tag_field="type", tag="Point"):
    coordinates: _Position


class _MultiPoint(Struct, tag_field="type", tag="MultiPoint"):
    coordinates: list[_Position]


class _LineString(Struct, tag_field="type", tag="LineString"):
    coordinates: list[_Position]


class _MultiLineString(Struct, tag_field="type", tag="MultiLineString"):
    coordinates: list[list[_Position]]


class _GeometryCollection(Struct, tag_field="type", tag="GeometryCollection"):
    geometries: list[_Geometry]


_Geometry = _Polygon | _MultiPolygon | _Point | _MultiPoint | _LineString | _MultiLineString | _GeometryCollection


class _Feature(Struct, tag_field="type", tag="Feature"):
    geometry: _Geometry | None


class _FeatureCollection(Struct, tag_field="type", tag="FeatureCollection"):
    features: list[_Feature]


_GeoJson = _Geometry | _Feature | _FeatureCollection
"""A GeoJSON document by RFC 7946. Members that the standard calls foreign are ignored."""


def _polygons(thing: _GeoJson) -> list[_Rings]:
    """Return the rings of every polygon in a GeoJSON object."""
    if isinstance(thing, _FeatureCollection):
        return [rings for feature in thing.features for rings in _polygons(feature)]
    if isinstance(thing, _Feature):
        return [] if thing.geometry is None else _polygons(thing.geometry)
    if isinstance(thing, _GeometryCollection):
        return [rings for one in thing.geometries for rings in _polygons(one)]
    if isinstance(thing, _MultiPolygon):
        return list(thing.coordinates)
    return [thing.coordinates] if isinstance(thing, _Polygon) else []
