from __future__ import annotations

import json
import math
import statistics
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sitl import VEHICLES, UnknownVehicle, load_vehicle, open_vehicle
from sitl.plants import Wrench

PUBLISHED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "published_tables.json"
DEGREE = math.pi / 180


def _published(table: str) -> list[list[float]]:
    if not PUBLISHED.exists():
        pytest.skip(f"the published tables are not beside this checkout ({PUBLISHED})")
    return json.loads(PUBLISHED.read_text())[table]["rows"]


def _value(name: str, table: str, key: str) -> Any:
    return load_vehicle(name).tables[table][key]["value"]


@pytest.mark.parametrize("name", VEHICLES)
def test_every_number_of_a_vehicle_has_a_source(name):
    tables = load_vehicle(name).tables
    assert sum(len(table) for table in tables.values() if isinstance(table, dict)) > 5
    for heading, table in tables.items():
        if isinstance(table, dict):
            for key, entry in table.items():
                assert set(entry) == {"value", "unit", "source"}, (heading, key)
                assert entry["source"].startswith(
                    (
                        "Chosen: ",
                        "ArduSub: ",
                        "ArduRover: ",
                        "Miskovic20",
                        "Benzon2022",
                        "jankristia",
                        "Skjetne2004",
                        "ZhaoUSV",
                        "Gomes2003",
                        "Erunsal2017",
                        "Wu2018",
                    )
                ), (heading, key)


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_opens_and_rests(name):
    server = open_vehicle(name)
    server.advance_to(1.0)
    assert abs(server.vehicle.state.r) < 0.2
    assert abs(server.vehicle.state.u) < 0.01


def test_the_error_for_an_unknown_vehicle_names_the_nearest():
    with pytest.raises(
        UnknownVehicle, match=r"unknown vehicle 'chrlie'; did you mean charlie or charlie-sway or charlie-sensors\?"
    ):
        load_vehicle("chrlie")


def test_the_error_for_a_distant_name_lists_all_vehicles():
    with pytest.raises(UnknownVehicle, match="known: charlie, videoray, automarine, falcon, bluerov2"):
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


def test_charlie_reaches_one_and_a_half_metres_per_second():
    authority, drag = _value("charlie", "surge", "authority"), _value("charlie", "surge", "beta2")
    assert math.sqrt(authority / drag) == pytest.approx(1.5)


def test_a_vehicle_based_on_another_differs_only_in_its_own_entries():
    plain, coupled = load_vehicle("videoray"), load_vehicle("videoray-coupled")
    assert coupled.sensors == plain.sensors
    assert coupled.up_delay == plain.up_delay
    assert _value("videoray-coupled", "yaw", "alpha") == 0.0372
    assert _value("videoray-coupled", "yaw", "authority") == _value("videoray", "yaw", "authority")


@pytest.mark.parametrize("name", [n for n in VEHICLES if "sway" in load_vehicle(n).tables])
def test_a_vehicle_that_sways_drifts_outwards_in_a_turn_ahead(name):
    body, wrench = load_vehicle(name).make_plant(), Wrench()
    actuators = load_vehicle(name).make_actuators()
    actuators.attach(body)
    for _ in range(1500):
        actuators.apply({"N": 0.3, "X": 0.5, "Z": 0.0}, body.parameters, wrench)
        body.step(wrench, 0.02)
    assert body.state.r > 0.02
    assert body.state.v < -0.005


def test_the_rudders_of_a_boat_with_sway_first_push_the_stern_sideways():
    vehicle = load_vehicle("charlie-sway")
    body, wrench = vehicle.make_plant(), Wrench()
    vehicle.make_actuators().apply({"N": 1.0, "X": 1.0}, body.parameters, wrench)
    assert wrench.N > 0.0 > wrench.Y


def test_a_lateral_stick_moves_a_vectored_frame_sideways():
    frame = load_vehicle("bluerov2-sway").make_actuators()
    pulses = frame.write([1500] * 8, {"N": 0.0, "X": 0.0, "Z": 0.0, "Y": 0.5})
    assert frame.read(pulses) == pytest.approx({"N": 0.0, "X": 0.0, "Z": 0.0, "Y": 0.5}, abs=0.01)
    assert "Y" not in load_vehicle("bluerov2").make_actuators().read(pulses)


def test_a_coupled_vehicle_follows_its_equations_written_by_hand():
    body = load_vehicle("cybership2").make_plant()
    body.state.psi, wrench = 0.0, Wrench(X=2.0, N=0.1)

    def rates(_, s):
        psi, u, v, r = s[2:]
        X = 2.0 - (0.72253 + 1.32742 * abs(u)) * u + (33.8 * v + 1.0948 * r) * r
        Y = -(0.88965 + 36.47287 * abs(v)) * v - (7.25 + 3.45 * abs(r)) * r - 25.8 * u * r
        N = 0.1 + (0.0313 + 3.95645 * abs(v)) * v - (1.9 + 0.75 * abs(r)) * r
        N += 25.8 * u * v - (33.8 * v + 1.0948 * r) * u
        vdot, rdot = np.linalg.solve([[33.8, 1.0948], [1.0948, 2.76]], [Y, N])
        c, n = math.cos(psi), math.sin(psi)
        return [u * c - v * n, u * n + v * c, r, X / 25.8, vdot, rdot]

    for _ in range(500):
        body.step(wrench, 0.02)
    end = solve_ivp(rates, (0.0, 10.0), [0.0] * 6, rtol=1e-9, atol=1e-11).y[:, -1]
    assert (body.state.x, body.state.y, body.state.psi, body.state.u, body.state.v, body.state.r) == pytest.approx(
        end, abs=1e-5
    )
