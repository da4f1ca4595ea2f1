"""`fly` with layered manoeuvres: identify or take a model, fly over our own loops, and leave all as before."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import AutotuneError, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import ModelFile
from gcs_autotune.manoeuvres import read_points
from gcs_autotune.models import SingleDof
from gcs_autotune.plain_json import json_text
from gcs_autotune.workflow import FlightPlan, FlightResult, FlySettings, Unattended, fly_plan, load_flight_plan
from gcs_autotune.workflow import load_models as models_in

from .sitl_harness import SLOW_LOOP, WHEN, Ear, SitlHarness
from .test_fly_area import square

BLUEBOAT = {"yaw": SingleDof("yaw", "1", 4.1, 1.2, 1.9, delay=0.05)}
"""The yaw of `sitl:blueboat`, as `hold heading` identifies it."""


def saved(tmp_path: Path, models: dict[str, SingleDof]) -> tuple[ModelFile, ...]:
    folder = tmp_path / "models"
    folder.mkdir()
    for dof, model in models.items():
        (folder / f"model-{dof}.json").write_text(json_text(model.to_dict()), encoding="utf-8")
    return models_in(folder)


def flown(
    harness: SitlHarness,
    name: str,
    models: tuple[ModelFile, ...] = (),
    points: str = "",
    options: dict[str, float] | None = None,
    **common: Any,
) -> FlightResult:
    settings = FlySettings(
        name,
        harness.common(**common),
        options or {},
        model=models[0] if models else None,
        beside=models[1:],
        points=read_points(points) if points else (),
    )
    return fly_plan(FlightPlan.of(settings), settings.common, Unattended(), Ear(harness.said), WHEN)


def figures(result: FlightResult) -> dict[str, float]:
    return {figure.slug: figure.reading.value for sheet in result.sheets for figure in sheet.figures}


def assert_as_before(harness: SitlHarness) -> None:
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters


@pytest.mark.slow
def test_a_craft_without_a_model_is_identified_and_then_hovers(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2-sway", **SLOW_LOOP)
    result = flown(harness, "hover", options={"duration": 15.0})
    found = figures(result)
    assert found["target-rms"] < 0.1
    assert found["heading-rms"] < math.radians(3.0)
    announced = " ".join(harness.said)
    assert "relay oscillations in yaw and surge and sway to identify the craft, then hover" in announced
    assert {path.stem for path in harness.directory.glob("model*.json")} == {"model", "model-surge", "model-sway"}
    assert "distance to the point, rms" in result.page.read_text(encoding="utf-8")
    assert_as_before(harness)


@pytest.mark.slow
def test_a_plan_chains_layered_manoeuvres_over_one_identification(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    file = tmp_path / "plan.toml"
    file.write_text(
        """
[[run]]
manoeuvre = "goto"
ahead = 25
starboard = 10
[[run]]
manoeuvre = "trajectory"
points = "15,15,0 30,30,10"
[[run]]
manoeuvre = "orientation"
heading-change = 60
""",
        encoding="utf-8",
    )
    common = harness.common()
    plan = load_flight_plan(file, common, None, None)
    result = fly_plan(plan, common, Unattended(), Ear(harness.said), WHEN)
    assert [run.trial and run.trial.ending for run in result.runs] == ["completed"] * 3
    assert sum("first self-oscillation" in text for text in harness.said if text == "first self-oscillation") == 1
    assert_as_before(harness)


def test_a_rudder_boat_cannot_hover_and_the_alternatives_are_listed(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "charlie")
    with pytest.raises(WrongVehicle, match=r"only above 0\.25 m/s\. It can fly: goto, orientation, trajectory$"):
        flown(harness, "hover")
    assert_as_before(harness)


def test_an_rov_without_sway_thrust_cannot_hover(tmp_path: Path) -> None:
    with pytest.raises(WrongVehicle, match=r"drives Y on this FRAME_CONFIG.* It can fly: goto, orientation"):
        flown(SitlHarness(tmp_path, "videoray"), "hover")


@pytest.mark.parametrize(
    ("name", "points", "options", "why"),
    [
        ("trajectory", "5,40,0", {}, r"needs \d+\.\d\d m/s .* The craft makes \d+\.\d\d m/s"),
        ("trajectory", "20,25,0 40,0,0.5", {}, r"corner of .* tighter than the turning circle"),
        ("goto", "", {"ahead": 1.0, "starboard": 2.0}, r"inside the turning circle of .* Use a point at least"),
    ],
)
def test_an_impossible_path_is_refused_before_anything_moves(
    name: str, points: str, options: dict[str, float], why: str, tmp_path: Path
) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    with pytest.raises(PreconditionFailed, match=rf"not flown: .*{why}.*Nothing was armed"):
        flown(harness, name, saved(tmp_path, BLUEBOAT), points, options)
    assert not harness.vehicle.autopilot.armed


def test_a_path_through_the_fence_is_refused_with_the_distance(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters={"FENCE_ENABLE": 1.0, "FENCE_TYPE": 4.0})
    harness.server.fence = [(5001, 4.0, *corner) for corner in square(40.0)]
    with pytest.raises(AutotuneError, match=r"goto: its path goes .* outside its own fence.*Nothing was armed"):
        flown(harness, "goto", saved(tmp_path, BLUEBOAT), options={"ahead": 60.0})
    assert not harness.vehicle.autopilot.armed


def test_only_a_trajectory_takes_points(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    with pytest.raises(UsageError, match="trajectory needs points"):
        flown(harness, "trajectory")
    with pytest.raises(UsageError, match="hover takes no --points"):
        flown(harness, "hover", points="10,5,0")
