from __future__ import annotations

import json
import math
import statistics
from pathlib import Path
from typing import Any

import pytest

from sitl import VEHICLES, UnknownVehicle, load_vehicle, open_vehicle

PUBLISHED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "published_tables.json"
DEGREE = math.pi / 180


def _published(table: str) -> list[list[float]]:
    if not PUBLISHED.exists():
        pytest.skip(f"the published tables are not beside this checkout ({PUBLISHED})")
    return json.loads(PUBLISHED.read_text())[table]["rows"]


def _value(name: str, table: str, key: str) -> Any:
    return load_vehicle(name).tables[table][key]["value"]


@pytest.mark.parametrize("name", VEHICLES)
def test_every_number_of_a_vehicle_says_where_it_comes_from(name):
    tables = load_vehicle(name).tables
    assert sum(len(table) for table in tables.values() if isinstance(table, dict)) > 5
    for heading, table in tables.items():
        if isinstance(table, dict):
            for key, entry in table.items():
                assert set(entry) == {"value", "unit", "source"}, (heading, key)
                assert entry["source"].startswith(
                    ("Chosen: ", "ArduSub: ", "ArduRover: ", "Miskovic20", "Benzon2022", "jankristia")
                ), (heading, key)


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_opens_and_rests(name):
    server = open_vehicle(name)
    server.advance_to(1.0)
    assert abs(server.vehicle.body.r) < 0.2
    assert abs(server.vehicle.body.u) < 0.01


def test_an_unknown_vehicle_names_the_nearest():
    with pytest.raises(UnknownVehicle, match=r"no vehicle called 'chrlie'; did you mean charlie\?"):
        load_vehicle("chrlie")


def test_a_name_near_nothing_lists_them_all():
    with pytest.raises(UnknownVehicle, match="there are charlie, videoray, automarine, falcon, bluerov2"):
        load_vehicle("zzz")


def test_charlies_yaw_is_the_mean_of_both_days():
    rows = _published("charlie_ls_table_7_12")
    assert len(_value("charlie", "yaw", "n2")) > 1
    for n2, alpha, beta in zip(*(_value("charlie", "yaw", key) for key in ("n2", "alpha", "beta")), strict=True):
        days = [row for row in rows if row[1] == n2]
        assert alpha == pytest.approx(statistics.mean(row[2] for row in days), abs=1e-9)
        assert beta == pytest.approx(-statistics.mean(row[3] for row in days), abs=1e-9)


def test_videorays_yaw_is_the_mean_of_its_experiments():
    rows = _published("videoray_iso_table_7_9")
    assert _value("videoray", "yaw", "alpha") == pytest.approx(
        statistics.mean(r[5] for r in rows) * 1e-4 / DEGREE, rel=1e-4
    )
    assert _value("videoray", "yaw", "beta2") == pytest.approx(
        statistics.mean(r[7] for r in rows) * 1e-6 / DEGREE**2, rel=1e-4
    )
    assert _value("videoray", "yaw", "authority") == max(r[0] for r in rows) / 100


def test_automarines_yaw_is_the_mean_of_its_step_responses():
    rows = _published("automarine_step_table_7_10")
    assert _value("automarine", "yaw", "alpha") == pytest.approx(
        statistics.mean(r[5] for r in rows) * 1e-4 / DEGREE, rel=1e-3
    )
    assert _value("automarine", "yaw", "beta2") == pytest.approx(
        statistics.mean(r[4] for r in rows) * 1e-6 / DEGREE**2, rel=1e-3
    )


def test_charlie_does_one_and_a_half_metres_per_second():
    authority, drag = _value("charlie", "surge", "authority"), _value("charlie", "surge", "beta2")
    assert math.sqrt(authority / drag) == pytest.approx(1.5)
