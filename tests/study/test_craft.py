"""The vehicle of a case is a vehicle file with changed numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.errors import UsageError
from gcs_autotune.study.craft import link_of
from sitl import load_vehicle


def file_of(link: str) -> str:
    return link.removeprefix("sitl:").partition("?")[0]


def test_a_vehicle_without_changes_is_used_by_name(tmp_path: Path) -> None:
    assert link_of({"vehicle.like": "blueboat", "seed": 1}, tmp_path, tmp_path) == "sitl:blueboat"


def test_numbers_are_set_or_multiplied(tmp_path: Path) -> None:
    given = {"vehicle.like": "bluerov2-loaded", "vehicle.yaw.alpha": 0.9, "vehicle.yaw.beta2.times": 1.5,
             "vehicle.sensors.gyro_noise": 0.02, "vehicle.parameters.ATC_RAT_YAW_P": 0.3}  # fmt: skip
    base, own = load_vehicle("bluerov2-loaded"), load_vehicle(file_of(link_of(given, tmp_path, tmp_path)))
    assert own.tables["yaw"]["alpha"]["value"] == 0.9
    assert own.tables["yaw"]["beta2"]["value"] == pytest.approx(1.5 * base.tables["yaw"]["beta2"]["value"])
    assert own.tables["yaw"]["beta"]["value"] == base.tables["yaw"]["beta"]["value"]
    assert own.sensors.gyro_noise == 0.02
    assert own.parameters["ATC_RAT_YAW_P"] == 0.3


@pytest.mark.parametrize("name", ["blueboat", "charlie", "bluerov2", "videoray-coupled"])
def test_a_scaled_craft_has_the_same_motion_in_scaled_time(name: str, tmp_path: Path) -> None:
    """By Froude's law, time grows with the root of the length, so alpha / beta of an axis does."""
    own = load_vehicle(file_of(link_of({"vehicle.like": name, "vehicle.scale": 4.0}, tmp_path, tmp_path)))
    surge, old = own.tables["surge"], load_vehicle(name).tables["surge"]
    assert surge["alpha"]["value"] == pytest.approx(64.0 * old["alpha"]["value"])
    if old["beta"]["value"]:
        constants = [t["alpha"]["value"] / t["beta"]["value"] for t in (surge, old)]
        assert constants[0] == pytest.approx(2.0 * constants[1])
    assert own.sensors == load_vehicle(name).sensors


def test_a_vehicle_file_of_the_user_is_found_next_to_the_study(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('title = "mine"\nlike = "blueboat"\n')
    case = tmp_path / "case"
    case.mkdir()
    link = link_of({"vehicle.like": "mine.toml", "vehicle.yaw.alpha.times": 2.0}, case, tmp_path)
    old = load_vehicle("blueboat").tables["yaw"]["alpha"]["value"]
    assert load_vehicle(file_of(link)).tables["yaw"]["alpha"]["value"] == pytest.approx(2.0 * old)


def test_effects_are_written_in_the_simulator_s_notation(tmp_path: Path) -> None:
    plain = {"vehicle.like": "videoray"}
    two = {
        **plain,
        "effect.wave-disturbance.amplitude": 0.1,
        "effect.wave-disturbance.period": 3,
        "effect.gyro-bias.bias": 0.01,
    }
    link = link_of(two, tmp_path, tmp_path)
    assert link == "sitl:videoray?effect=wave-disturbance.amplitude=0.1,period=3&effect=gyro-bias.bias=0.01"
    assert link_of({**plain, "effect": "none"}, tmp_path, tmp_path) == "sitl:videoray"
    both = link_of({**plain, "effect": "a.b=1+c.d=2"}, tmp_path, tmp_path)
    assert both == "sitl:videoray?effect=a.b=1&effect=c.d=2"


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({}, "vehicle.like is missing"),
        ({"vehicle.like": "bluboat", "vehicle.scale": 2.0}, "'bluboat' cannot be read"),
        ({"vehicle.like": "blueboat", "vehicle.yaw.alfa.times": 2.0}, "no number yaw.alfa"),
        ({"vehicle.like": "blueboat", "vehicle.yaw.alpha.plus": 2.0}, "only 'times'"),
        ({"vehicle.like": "blueboat", "vehicle.length": 2.0}, "one level deeper"),
    ],
)
def test_a_wrong_vehicle_is_rejected_with_its_key(given: dict[str, object], why: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=why):
        link_of(given, tmp_path, tmp_path)


def test_an_unknown_vehicle_is_rejected_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"'vidoray'.* Did you mean videoray"):
        link_of({"vehicle.like": "vidoray", "vehicle.yaw.alpha": 1.0}, tmp_path, tmp_path)
