"""`hold`: identify, design a controller of our own, fly with it in manual mode, and leave all as before."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import NoGainsMeetSpec, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.report import HeldDistance, HeldLine, HeldLoop, HeldPosition, hold_document, to_html
from gcs_autotune.workflow import HoldSettings, Unattended, hold

from .sitl_harness import WHEN, Ear, SitlHarness


def held(harness: SitlHarness, axis: str, *, seconds: float = 0.0, **changes: Any) -> HeldLoop:
    settings = HoldSettings(axis, harness.settings(axis, **changes), seconds)
    found = hold(settings, Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldLoop)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "axis"),
    [
        ("charlie", "heading"),
        ("blueboat", "heading"),
        ("videoray", "heading"),
        ("videoray", "depth"),
        ("bluerov2", "heading"),
        ("bluerov2", "depth"),
    ],
)
def test_every_vehicle_follows_the_model_function_that_it_was_given(vehicle: str, axis: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, vehicle)
    found = held(harness, axis)
    assert found.follows
    assert found.design.margins.vector >= 0.5
    assert found.design.bound[0] < found.design.bound[1]
    assert found.trial.meta["controller"]["structure"] == "I-PD"
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    page = (harness.directory / "report.html").read_text()
    assert "its step follows the model function" in page
    said = " ".join(harness.said)
    assert said.index("with our own controller") < said.index("State before the run: mode")
    assert "write no parameter" in said


@pytest.mark.slow
def test_a_required_frequency_is_what_the_loop_gets_and_it_holds_for_the_time_required(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    found = held(harness, "heading", seconds=15.0, omega_0=0.8)
    assert found.design.wanted.omega_0 == pytest.approx(0.8)
    assert "own-hold: completed, held for 15 s" in " ".join(harness.said)
    assert found.metrics.rise > 2.0


@pytest.mark.slow
def test_a_loop_that_is_too_fast_is_refused_with_the_fastest_and_leaves_the_vehicle_neutral(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    with pytest.raises(NoGainsMeetSpec, match=r"too fast: .* The fastest that is possible is"):
        held(harness, "heading", omega_0=20.0)
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


def test_what_cannot_be_held_is_refused_with_what_can(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="heading, depth, line"):
        held(SitlHarness(tmp_path, "blueboat"), "speed")


def line(harness: SitlHarness, **changes: Any) -> HeldLine:
    tune = harness.settings("heading", envelope=Envelope(distance=300.0))
    found = hold(HoldSettings("line", tune, **changes), Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldLine)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("guidance", ["indirect", "direct", "integral", "adaptive"])
def test_a_boat_approaches_a_line_and_stays_on_it_by_every_law(guidance: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    found = line(harness, guidance=guidance, offset=-6.0)
    assert found.follows
    assert found.figures.rms < 0.3
    assert found.figures.overshoot < 1.5
    assert math.degrees(found.figures.approach) < 75.0
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert "The craft follows the line" in (harness.directory / "report.html").read_text()


@pytest.mark.slow
def test_a_rudder_boat_far_from_the_line_keeps_its_approach_angle(tmp_path: Path) -> None:
    found = line(
        SitlHarness(tmp_path, "charlie"), guidance="direct", offset=20.0, length=130.0, approach=math.radians(30.0)
    )
    assert found.follows
    assert math.degrees(found.figures.approach) < 35.0


def test_an_rov_is_not_sent_along_a_line(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "videoray")
    with pytest.raises(WrongVehicle, match="steered at rest"):
        line(harness)
    assert not harness.vehicle.autopilot.armed


@pytest.mark.slow
def test_the_report_states_gains_margins_and_what_limits_the_loop(tmp_path: Path) -> None:
    found = held(SitlHarness(tmp_path, "videoray"), "depth")
    page = to_html(hold_document(found, "Hold: depth", WHEN))
    for words in ("K_P", "phase margin", "What keeps the loop from being faster"):
        assert words in page
    assert not any(isinstance(value, float) and math.isnan(value) for value in found.to_dict().values())


@pytest.mark.slow
def test_an_rov_before_a_wall_is_tuned_end_to_end_and_keeps_its_distance(tmp_path: Path) -> None:
    """Algorithm 8.5 on the VideoRay with two laser distances."""
    harness = SitlHarness(tmp_path, "videoray-lasers")
    settings = HoldSettings("distance", harness.settings("heading"))
    found = hold(settings, Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldDistance)
    assert found.follows
    assert abs(found.figures.mean) < 0.01
    assert found.figures.overshoot < 0.03
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters


@pytest.mark.parametrize(("vehicle", "why"), [("videoray-wall", "reports one"), ("videoray", "no distance")])
def test_without_two_rangefinders_no_distance_is_kept(vehicle: str, why: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, vehicle)
    with pytest.raises(PreconditionFailed, match=why):
        hold(HoldSettings("distance", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)
    assert not harness.vehicle.autopilot.armed


@pytest.mark.slow
@pytest.mark.parametrize("law", ["sliding", "pid"])
def test_a_vectored_rov_holds_its_position_and_steps_away_from_it(law: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2-sway")
    settings = HoldSettings("position", harness.settings("heading"), law=law)
    found = hold(settings, Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldPosition)
    assert found.follows
    assert math.degrees(found.figures.heading) < 8.0
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters


def test_a_craft_that_cannot_push_sideways_does_not_hold_a_position(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "videoray")
    with pytest.raises(WrongVehicle, match="push sideways"):
        hold(HoldSettings("position", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)
