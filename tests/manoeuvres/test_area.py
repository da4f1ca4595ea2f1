"""Areas: polygons with holes, circles, in degrees and in metres; invalid areas are rejected."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gcs_autotune.errors import BadFile, GuardTripped, UsageError
from gcs_autotune.manoeuvres import Area, Envelope, Zone, read_area
from gcs_autotune.manoeuvres.envelope import Watch

from .toy_craft import at_rest

SQUARE = Zone(((0.0, 0.0), (0.0, 100.0), (100.0, 100.0), (100.0, 0.0)))
LAKE = [[9.0, 45.0], [9.002, 45.0], [9.002, 45.001], [9.0, 45.001], [9.0, 45.0]]
ISLAND = [[9.0008, 45.0004], [9.0012, 45.0004], [9.0012, 45.0006], [9.0008, 45.0006], [9.0008, 45.0004]]


@pytest.mark.parametrize(("x", "y", "out"), [(50, 50, 0), (110, 50, 10), (-3, -4, 5), (50, 99, 0), (50, 130, 30)])
def test_the_distance_outside_a_polygon_is_computed(x: float, y: float, out: float) -> None:
    assert Area((SQUARE,), "a test").beyond(x, y) == pytest.approx(out)


def test_circles_and_exclusion_zones_limit_the_area() -> None:
    rock = Zone(((50.0, 50.0),), radius=10.0, inside=False)
    both = Area((SQUARE, rock), "a test")
    assert both.beyond(50.0, 55.0) == pytest.approx(5.0)
    assert both.beyond(50.0, 61.0) == 0.0
    assert Area((Zone(((0.0, 0.0),), 30.0),), "a test").beyond(30.0, 40.0) == pytest.approx(20.0)


def test_corners_in_degrees_become_metres_relative_to_the_craft_and_its_heading() -> None:
    area = read_area("45.0,9.0 45.0,9.002; 45.001,9.002 45.001,9.0").around(45.0005, 9.001, 5.0, -3.0)
    assert area.beyond(5.0, -3.0) == 0.0
    north, east = 0.0005 * 111_195.0, 0.001 * 111_195.0 * math.cos(math.radians(45.0))
    assert area.beyond(5.0 + north + 2.0, -3.0) == pytest.approx(2.0, abs=0.2)
    assert area.beyond(5.0, -3.0 + east - 1.0) == 0.0
    seen = area.seen_from(5.0, -3.0, math.radians(90.0))  # bow to the east: ahead is east
    assert seen.beyond(east - 1.0, 0.0) == 0.0
    assert seen.beyond(east + 2.0, 0.0) == pytest.approx(2.0, abs=0.2)


def test_a_geojson_file_is_read_with_its_holes(tmp_path: Path) -> None:
    path = tmp_path / "lake.geojson"
    feature = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [LAKE, ISLAND]}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    area = read_area(str(path)).around(45.0005, 9.0005, 0.0, 0.0)
    assert area.source == "lake.geojson"
    assert area.beyond(0.0, 0.0) == 0.0
    assert area.beyond(0.0, 40.0) > 5.0  # on the island


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("45,9 45,10", "2 corners do not enclose an area"),
        ("45,9 45;10 46,9", "'45' is not a corner"),
        ("harbour", "'harbour' is not a corner"),
        ("95,9 45,10 46,9", "95,9 is not a latitude and longitude"),
    ],
)
def test_an_invalid_area_is_rejected(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        read_area(text)


@pytest.mark.parametrize("text", ["{", '{"type": "Point", "coordinates": [9, 45]}', "[]"])
def test_a_file_without_a_polygon_is_rejected_by_name(text: str, tmp_path: Path) -> None:
    path = tmp_path / "area.geojson"
    path.write_text(text)
    with pytest.raises(BadFile, match=r"area\.geojson"):
        read_area(str(path))


def test_leaving_the_area_or_losing_the_position_trips_the_guard() -> None:
    watch = Watch(Envelope(area=Area((SQUARE,), "the lake")), at_rest(x=50.0, y=50.0))
    watch.check(at_rest(x=99.0, y=50.0))
    with pytest.raises(GuardTripped, match=r"2\.0 m outside the lake"):
        watch.check(at_rest(x=102.0, y=50.0))
    with pytest.raises(GuardTripped, match="is 4 cm outside the lake"):
        watch.check(at_rest(x=100.04, y=50.0))
    with pytest.raises(GuardTripped, match="can no longer be monitored"):
        watch.check(at_rest(x=math.nan, y=50.0))


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("bad", ["90.5,5", "-90.5,5", "45,180.5", "45,-180.5", "nan,5", "45,nan"])
def test_an_impossible_latitude_or_longitude_is_rejected(place: int, bad: str) -> None:
    corners = ["45,5", "45,6", "46,6"]
    corners[place] = bad
    with pytest.raises(UsageError, match=r"is not a (corner|latitude and longitude)"):
        read_area(" ".join(corners))


def test_poles_and_date_line_are_valid_corners() -> None:
    (zone,) = read_area("90,0 -90,0 0,180").zones
    assert zone.corners == ((90.0, 0.0), (-90.0, 0.0), (0.0, 180.0))
