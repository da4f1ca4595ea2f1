"""A vehicle file outside the package, as in docs/developing.md: copied, changed, named by its path."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_autotune.cli import main as gcs_autotune
from sitl import BadVehicle, load_vehicle
from sitl.__main__ import main as sitl
from sitl.craft import Craft

TAKEN = Path(__file__).parents[2] / "sitl" / "vehicles" / "blueboat.toml"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    text = TAKEN.read_text(encoding="utf-8")
    path.write_text(text.replace("CRUISE_THROTTLE = { value = 40", "CRUISE_THROTTLE = { value = 47"), encoding="utf-8")
    return path


def test_a_user_vehicle_is_opened_from_the_command_line(mine: Path, tmp_path: Path) -> None:
    assert gcs_autotune(["params", "save", "--connect", f"sitl:{mine}", str(tmp_path / "mine.param")]) == 0
    assert "CRUISE_THROTTLE,47" in (tmp_path / "mine.param").read_text()


def test_a_user_vehicle_moves_by_its_own_numbers(mine: Path) -> None:
    mine.write_text(mine.read_text().replace("alpha = { value = 41.77", "alpha = { value = 80.0"))
    assert load_vehicle(str(mine)).make_plant().axis("surge").alpha == 80.0
    assert load_vehicle("blueboat").make_plant().axis("surge").alpha == 41.77


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("[sensors]", "[senses]"), "unknown entry 'senses'"),
        (lambda text: text.replace("arm = {", "leg = {"), "thruster: unknown entry 'leg'"),
        (lambda text: text.replace("arm = {", "# {"), "thruster: missing entry 'arm'. Start with a copy of one in"),
        (lambda text: text.replace("value = 41.77", "value = -41.77"), r"surge.alpha.value: expected a number > 0"),
        (lambda text: text.replace("value = 41.77", "value = inf"), "surge.alpha.value: inf is not a finite number"),
        (lambda text: text.replace("value = 41.77", 'value = "41.77"'), "surge.alpha.value: expected a number, got"),
        (lambda text: text.replace('unit = "kg"', 'unit = "lb"'), "surge.alpha is in 'lb'. Use kg"),
        (lambda text: text.replace("value = 29.35", "value = -29.35"), "negative drag is unstable"),
        (lambda text: text.replace("[start]", "[start]\nx = " + "[" * 5000), "nested more than"),
        (lambda text: text.replace("value = 41.77", "value = " + "9" * 5000), "is not a vehicle file"),
        (lambda text: text + "= 3", "is not a vehicle file"),
        (
            lambda text: text.replace('firmware = "rover"', 'firmware = "plane"'),
            "firmware: there is no 'plane'. Use one of rover",
        ),
    ],
)
def test_an_invalid_vehicle_file_is_explained_in_one_line(mine, change, said, capsys):
    mine.write_text(change(mine.read_text()))
    with pytest.raises(BadVehicle, match=said):
        load_vehicle(str(mine))
    assert sitl([str(mine), "--lockstep"]) == 2
    assert said in capsys.readouterr().err


def test_a_missing_file_is_reported(capsys):
    assert sitl(["nowhere.toml", "--lockstep"]) == 2
    assert "nowhere.toml cannot be read: No such file" in capsys.readouterr().err


def test_a_file_based_on_another_vehicle_needs_only_the_differences(tmp_path: Path) -> None:
    short = tmp_path / "heavier.toml"
    short.write_text(
        'title = "heavier"\nlike = "blueboat"\n[surge]\nalpha = { value = 80.0, unit = "kg", source = "x" }\n'
    )
    assert load_vehicle(str(short)).make_plant().axis("surge").alpha == 80.0
    short.write_text('title = "heavier"\nlike = "bluebot"\n')
    with pytest.raises(BadVehicle, match="did you mean blueboat"):
        load_vehicle(str(short))


FORE_AND_AFT = """
title = "lifting thrusters fore and aft"
like = "videoray"
actuators = "rov-4-fore-aft"
[pitch]
alpha = { value = 0.05, unit = "kg m^2", source = "x" }
beta = { value = 0.02, unit = "N m s", source = "x" }
beta2 = { value = 0.0, unit = "N m s^2", source = "x" }
righting = { value = 0.8, unit = "N m/rad", source = "x" }
authority = { value = 0.4, unit = "N m", source = "x" }
"""


def tilted(craft: Craft, seconds: float, *lift: int) -> list[float]:
    """Return the pitch [rad] every 10 ms under these pulses [us] of the lifting thrusters."""
    seen = []
    for k in range(round(100.0 * seconds)):
        craft.move(0.01 * k, 0.01, (1500, 1500, *lift))
        seen.append(craft.plant.state.theta)
    return seen


def test_a_craft_with_fore_and_aft_lift_thrusters_pitches_and_rights_itself(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(FORE_AND_AFT)
    craft = Craft(load_vehicle(str(path)))
    assert max(map(abs, tilted(craft, 5.0, 1800, 1800))) == 0.0 and craft.plant.state.w > 0.1
    tilted(craft, 60.0, 1500, 1700)
    assert craft.plant.state.theta == pytest.approx(0.5 * 0.5 * 0.4 / 0.8, rel=1e-3)
    swing = tilted(craft, 8.0, 1500, 1500)
    down = [k for k in range(1, len(swing)) if swing[k - 1] > 0.0 >= swing[k]]
    assert 0.01 * (down[1] - down[0]) == pytest.approx(2.0 * math.pi / math.sqrt(0.8 / 0.05 - 0.04), rel=0.02)


def test_a_pitch_moment_for_a_frame_that_cannot_pitch_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(FORE_AND_AFT.replace("rov-4-fore-aft", "simple-rov-3"))
    with pytest.raises(BadVehicle, match="frame 'simple-rov-3' has no pitch thrusters"):
        load_vehicle(str(path))
