"""`hold`: identify, design a controller of our own, fly a step with it in manual mode, and leave all as before."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import NoGainsMeetSpec, UsageError
from gcs_autotune.report import HeldLoop, hold_document, to_html
from gcs_autotune.workflow import HoldSettings, Unattended, hold

from .sitl_harness import WHEN, Ear, SitlHarness


def held(harness: SitlHarness, axis: str, *, seconds: float = 0.0, **changes: Any) -> HeldLoop:
    return hold(HoldSettings(harness.settings(axis, **changes), seconds), Unattended(), Ear(harness.said), WHEN)


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


def test_a_speed_has_no_loop_of_our_own(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="Use heading or depth"):
        held(SitlHarness(tmp_path, "blueboat"), "speed")


@pytest.mark.slow
def test_the_report_states_gains_margins_and_what_limits_the_loop(tmp_path: Path) -> None:
    found = held(SitlHarness(tmp_path, "videoray"), "depth")
    page = to_html(hold_document(found, "Hold: depth", WHEN))
    for words in ("K_P", "phase margin", "What keeps the loop from being faster"):
        assert words in page
    assert not any(isinstance(value, float) and math.isnan(value) for value in found.to_dict().values())
