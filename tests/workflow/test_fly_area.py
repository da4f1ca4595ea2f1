"""An area, or the vehicle's own fence: refused before anything is armed, and guarded in flight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import GuardTripped, PreconditionFailed
from gcs_autotune.manoeuvres import Area, Zone
from gcs_autotune.workflow import FlightPlan, FlySettings, Unattended, fly_plan
from sitl.place import HOME

from .sitl_harness import WHEN, Ear, SitlHarness

STEPS = {"duration": 20.0, "steering": 0.8}
FENCED = {"parameters": {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 4.0}}


def square(half: float, north: float = 0.0) -> tuple[tuple[float, float], ...]:
    """Return corners [deg] of a square of water about home, or *north* [m] of it."""
    d, at = half / 111_195.0, HOME[0] + north / 111_195.0
    return tuple((at + a * d, HOME[1] + b * d * 1.41) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1)))


def fly(harness: SitlHarness, corners: tuple[tuple[float, float], ...] | None, name: str = "zig-zag") -> Any:
    common = harness.common()
    area = None if corners is None else Area((Zone(corners),), "the pond")
    settings = FlySettings("steps", common, STEPS, force="X") if name == "steps" else FlySettings(name, common)
    plan = replace(FlightPlan.of(settings), area=area)
    return fly_plan(plan, common, Unattended(), Ear(harness.said), WHEN)


def test_a_craft_that_leaves_the_area_is_stopped_and_restored(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(GuardTripped, match="m outside the pond") as caught:
        fly(harness, square(6.0))
    assert caught.value.value < 1.0
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert harness.mode == harness.found
    assert list((harness.directory / "trials").glob("*.csv"))


def test_a_run_predicted_to_leave_the_area_at_cruise_speed_is_refused_before_arming(
    tmp_path: Path,
) -> None:
    harness = SitlHarness(tmp_path / "own")
    with pytest.raises(PreconditionFailed, match=r"preview .*ends early: .* outside the pond.*\. Nothing was armed$"):
        fly(harness, square(6.0), "steps")
    assert harness.found == ""
    assert any("its cruise speed of 1.2 m/s at 80% throttle" in text for text in harness.said)
    untried = SitlHarness(tmp_path / "untried", parameters={"CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 50.0})
    with pytest.raises(GuardTripped, match="m outside the pond"):
        fly(untried, square(6.0), "steps")


def test_a_craft_outside_the_area_is_refused_before_anything_is_armed(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path)
    with pytest.raises(PreconditionFailed, match=r"8\.76400, is 60 m outside the pond\. Nothing was armed$"):
        fly(harness, square(40.0, north=100.0))
    assert harness.found == ""
    near = SitlHarness(tmp_path / "near")
    with pytest.raises(PreconditionFailed, match=r" is 28 cm outside the pond\. Nothing was armed$"):
        fly(near, square(40.0, north=40.3))
    assert near.found == ""


def test_the_vehicles_own_fence_is_read_and_monitored(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, **FENCED)
    harness.server.fence = [(5001, 4.0, *corner) for corner in square(6.0)]
    with pytest.raises(GuardTripped, match="m outside its own fence"):
        fly(harness, None)
    harness.assert_neutral()
    rock = SitlHarness(tmp_path / "rock", **FENCED)
    rock.server.fence = [(5001, 4.0, *corner) for corner in square(400.0)] + [(5004, 5.0, *HOME)]
    with pytest.raises(PreconditionFailed, match=r"is 5\.0 m outside its own fence"):
        fly(rock, None)


@pytest.mark.slow
def test_a_fence_that_the_vehicle_does_not_report_is_mentioned(tmp_path: Path) -> None:
    def silent(t: float, message: Any) -> list[Any]:
        return [] if message.get_type() == "MISSION_COUNT" else [message]

    harness = SitlHarness(tmp_path, meddling=silent, **FENCED)
    fly(harness, square(400.0), "steps")
    announced = " ".join(harness.said)
    assert "FENCE_ENABLE is on, but the vehicle does not report its fence" in announced
    assert "inside the pond: 400 m to its edge" in announced
