"""Default sizes are reduced until they stay inside the limits; user-supplied sizes are previewed unchanged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope
from gcs_autotune.workflow import FlySettings
from gcs_autotune.workflow.nominal_plant import AssumedCraft, nominal_plant

from .sitl_harness import SLOW_LOOP, SitlHarness
from .test_fly import flown

BY_THE_CLOCK = sorted(kind.name for kind in MANOEUVRES.values() if kind.shrinks and kind.for_force and kind.identifies)


def heaved(tmp_path: Path, name: str, vehicle: str = "bluerov2", **more: Any) -> tuple[SitlHarness, Any]:
    harness = SitlHarness(tmp_path, vehicle, **SLOW_LOOP)
    options = more.pop("options", {})
    return harness, flown(harness, options, name, force="Z", **more)


@pytest.mark.slow
def test_heave_of_default_size_is_reduced_to_stay_within_the_depth_limit(tmp_path: Path) -> None:
    harness, result = heaved(tmp_path, "free-decay")
    announced = [text for text in harness.said if "is reduced to" in text]
    assert len(announced) == 1
    assert announced[0].startswith("free-decay is reduced to --duration 13, --push 2.1, --steering 0.36. ")
    assert "usual size safety limit 'depth " in announced[0]
    assert result.trial.duration == pytest.approx(13.0, abs=0.5)
    assert np.ptp(result.trial["z"].values) < Envelope().depth_excursion
    assert result.fit.dof == "heave"
    assert any("an assumed 1.5 m/s up or down" in text for text in harness.said)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["bluerov2", "falcon", "videoray"])
@pytest.mark.parametrize("name", BY_THE_CLOCK)
def test_every_timed_manoeuvre_in_heave_completes_at_default_size_on_every_rov(
    name: str, vehicle: str, tmp_path: Path
) -> None:
    harness, result = heaved(tmp_path, name, vehicle)
    assert result.trial.ending == "completed"
    assert result.fit.dof == "heave"
    assert result.remarks == []
    harness.assert_neutral()


def test_user_supplied_sizes_stay_and_the_preview_shows_where_the_run_would_end(tmp_path: Path) -> None:
    given = {"duration": 60.0, "steering": 0.67}
    harness, result = heaved(tmp_path, "doublets", options=given, only_preview=True)
    assert not any("is reduced to" in text for text in harness.said)
    assert any(
        "with assumed parameters the run ends early: safety limit 'depth excursion'" in text for text in harness.said
    )
    assert result.preview.seconds == pytest.approx(60.0, abs=0.2)
    assert result.preview.deep > 5.0
    assert any("would need " in text and "doublets 1 min" in text for text in harness.said)


def test_only_options_not_supplied_by_the_user_are_reduced(tmp_path: Path) -> None:
    common = SitlHarness(tmp_path).common()
    usual = FlySettings("doublets", common, {"steering": 0.5}, force="Z")
    sizes = [one.options for one in usual.smaller()]
    assert {o["steering"] for o in sizes} == {0.5}
    durations = [o["duration"] for o in sizes]
    assert durations == sorted(durations, reverse=True)
    assert durations[0] == pytest.approx(48.0)
    assert 5.0 < durations[-1] < 8.0
    settled = FlySettings("doublets", common, {"steering": 0.5, "duration": 20.0}, force="Z")
    assert list(settled.smaller()) == []
    assert list(FlySettings("zig-zag", common, {"steering": 0.5}).smaller()) == []


def test_an_rov_is_previewed_ahead_and_astern_as_flown(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2", **SLOW_LOOP)
    result = flown(harness, {}, "steps", force="X", only_preview=True)
    X = result.preview.trial["X"].values
    assert (X.min(), X.max()) == (-0.67, 0.67)


def test_the_assumed_turn_rate_of_an_unknown_rov_lies_between_known_ones(tmp_path: Path) -> None:
    settings = FlySettings("zig-zag", SitlHarness(tmp_path).common())
    paper = nominal_plant(settings, FIRMWARE["ardusub"], {}, 0.0, 0.0)
    falcon, bluerov2 = 1.28, 3.91  # Miskovic2010, table 7.1; Benzon2022, table A1
    assert falcon < paper.yaw.steady_velocity(1.0) < bluerov2
    assert 0.1 < paper.yaw.alpha / (paper.yaw.beta + 2.0 * paper.yaw.beta_quadratic * 1.9) < 0.6
    assert "an assumed turn rate of 109 deg/s" in paper.source


def test_an_unknown_heaving_craft_is_assumed_fast_and_buoyant_or_heavy(tmp_path: Path) -> None:
    settings = FlySettings("doublets", SitlHarness(tmp_path).common(), force="Z")
    like = (AssumedCraft(sinks=sinks) for sinks in (True, False))
    heavy, light = (nominal_plant(settings, FIRMWARE["ardusub"], {}, 0.0, 0.0, one).others["Z"] for one in like)
    assert heavy.delta == -light.delta > 0.0
    assert heavy.steady_velocity(1.0 - heavy.delta) == pytest.approx(1.5)
    assert heavy.steady_velocity(0.0) > 0.05
    ahead = FlySettings("steps", SitlHarness(tmp_path).common(), force="X")
    boat = nominal_plant(ahead, FIRMWARE["ardurover"], {}, 0.4, 1.5)
    assert boat.source == "its cruise speed of 1.5 m/s at 40% throttle"
    assert boat.others["X"].steady_velocity(0.4) == pytest.approx(1.5)
