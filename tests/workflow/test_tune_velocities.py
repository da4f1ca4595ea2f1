"""``tune speed`` and ``tune yaw``, from the link to proved gains, and ``experiment surge``."""

from __future__ import annotations

import json
import math

import pytest

from gcs_autotune.identify import load_model
from gcs_autotune.identify.thrust import CURVE
from gcs_autotune.report import TuneStory
from gcs_autotune.trial import load_trial
from gcs_autotune.workflow import Unattended, experiment
from sitl.effects import parse_effect

from .conftest import with_pictures
from .sitl_harness import Ear, SitlHarness

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def swift(tmp_path_factory):
    """A boat that steers by two thrusters, its speed loop tuned from a cruise pair that is wrong."""
    harness = SitlHarness(tmp_path_factory.mktemp("swift"), "blueboat", parameters={"CRUISE_SPEED": 2.5})
    with with_pictures():
        return harness, harness.tune(axis="speed")


def test_a_speed_loop_is_tuned_and_proved_and_the_cruise_pair_is_corrected(swift) -> None:
    harness, story = swift
    assert story.ending == "kept"
    assert story.metrics_after.itae < 0.5 * story.metrics_before.itae
    values = harness.vehicle.parameters.values
    assert values["CRUISE_THROTTLE"] == 40
    assert values["CRUISE_SPEED"] == pytest.approx(2.0 * 55.2 * 0.4 / 29.35, rel=0.03)
    for name, value in story.proposal.new.items():
        assert values[name] == pytest.approx(value, rel=1e-6)
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


def test_the_surge_of_the_simulated_boat_is_identified_with_linear_thrust(swift) -> None:
    _, story = swift
    full, std, curve = 2.0 * 55.2, story.fit.parameters["alpha_u"].std, story.fit.extra[CURVE]
    assert std < 0.02 * story.fit.model.alpha
    assert story.fit.model.alpha == pytest.approx(41.77 / full, abs=2.5 * std)
    assert story.fit.model.steady_velocity(0.5) == pytest.approx(0.5 * full / 29.35, rel=0.03)
    assert curve["std"] < 0.04
    assert curve["square"] == pytest.approx(0.0, abs=2.5 * curve["std"])


def test_one_throttle_run_suffices_in_still_water_and_two_are_flown_in_a_current(swift, tmp_path) -> None:
    _, story = swift
    assert [run.name for run in story.relays] == ["throttle-1"]
    assert {trace.run for trace in story.fit.traces} == {"throttle-1", "step-before"}
    harness = SitlHarness(tmp_path, "blueboat", effects=[parse_effect("steady-current@over ground.V_x=0.2,V_y=0.1")])
    story = harness.tune(axis="speed")
    assert [run.name for run in story.relays] == ["throttle-1", "throttle-2"]
    assert story.ending == "kept"
    assert "set-along-the-track" in {doubt.slug for doubt in story.fit.doubts}
    assert harness.vehicle.parameters.values["CRUISE_SPEED"] == pytest.approx(2.0 * 55.2 * 0.4 / 29.35, rel=0.03)


def test_the_same_speed_step_is_flown_before_and_after_and_plotted_as_speed(swift) -> None:
    harness, story = swift
    assert story.step_before.meta["signal"] == story.step_after.meta["signal"] == "u"
    assert story.step_before.meta["size"] == story.step_after.meta["size"]
    page = (harness.directory / "report.html").read_text(encoding="utf-8")
    assert "Throttle steps" in page
    assert "speed measured at this throttle" in page
    json.loads((harness.directory / "gains.json").read_text(encoding="utf-8"))
    recorded = load_trial(next((harness.directory / "trials").glob("*-throttle-1.csv")))
    assert recorded.meta["dof"] == "surge"


def test_a_turn_rate_loop_is_tuned_without_its_angle_gain(tmp_path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    story = harness.tune(axis="yaw")
    assert story.ending == "kept"
    assert story.step_after.meta["signal"] == "r"
    assert story.metrics_after.itae < 0.5 * story.metrics_before.itae
    changed = {n for n, v in harness.parameters.items() if dict(harness.vehicle.parameters.values)[n] != v}
    assert changed == set(story.proposal.new)
    assert "ATC_STR_ANG_P" not in changed


def test_a_third_oscillation_distinguishes_a_dead_zone_from_a_curve_in_a_turn_rate_tune(tmp_path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", effects=[parse_effect("dead-zone@N.width=0.12")])
    story = harness.tune(axis="yaw")
    assert [trial.name for trial in story.relays] == ["relay-1", "relay-2", "relay-3"]
    assert any(
        "the three oscillations are explained best by an actuator that does nothing below 12" in announced
        for announced in harness.said
    )
    assert story.ending == "kept"
    assert story.metrics_after.itae < 0.1 * story.metrics_before.itae


def test_the_residual_of_nonlinear_thrust_is_not_taken_for_turn_rate_noise(tmp_path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", effects=[parse_effect("quadratic-actuator@N.share=1")])
    story = harness.tune(axis="yaw")
    assert story.ending == "kept"
    assert story.metrics_after.itae < 0.1 * story.metrics_before.itae
    _assert_all_is_told_of_the_model_with_the_curve(harness, story)


def _assert_all_is_told_of_the_model_with_the_curve(harness: SitlHarness, story: TuneStory) -> None:
    """Page, fit.json, model.json and doubts are of the model that the gains came from: one model, one file."""
    assert ("quadratic-actuator", "N") in [(e.slug, e.place) for e in story.fit.effects]
    assert story.fit.fit_percent > 95.0
    assert not {"run-apart", "runs-disagree"} & {d.slug for d in story.fit.doubts}
    assert [p.name for p in harness.directory.glob("*model*.json")] == ["model.json"]
    file = load_model(harness.directory / "model.json")
    assert file.model.effects == story.fit.effects
    assert "quadratic-actuator@N.share" in file.names
    assert load_model(harness.directory / "fit.json").model == file.model
    assert "quadratic fraction of the thrust" in (harness.directory / "report.html").read_text(encoding="utf-8")


def test_an_rov_turns_at_the_rate_of_its_stick_before_and_after(tmp_path) -> None:
    """Of 25 deg/s: the present gains are too weak to turn a Falcon at 30 deg/s, half the step without asking."""
    harness = SitlHarness(tmp_path, "falcon")
    story = harness.tune(axis="yaw", dry_run=True, step=math.radians(25.0))
    assert story.ending in ("dry-run", "unchanged")
    flown = story.step_before
    end = [m.t for m in flown.marks if m.kind == "target"][-1]
    reached = flown["r"].between(end - 1.5, end).values.mean()
    assert reached == pytest.approx(flown.meta["size"] / 2.0, rel=0.15)
    harness.assert_as_found()


def test_experiment_surge_on_a_boat_explains_the_motion_and_writes_a_model_file(tmp_path) -> None:
    harness = SitlHarness(tmp_path)
    fit = experiment(harness.settings("surge"), Unattended(), Ear(harness.said))
    assert fit.fit_percent > 85.0
    assert fit.model.alpha == pytest.approx(300.0 / 75.0, rel=0.03)
    assert fit.extra[CURVE]["square"] == pytest.approx(1.0, abs=0.06)
    model = json.loads((harness.directory / "model.json").read_text(encoding="utf-8"))
    assert model["effects"][-1]["slug"] == "quadratic-actuator"
    assert dict(harness.vehicle.parameters.values) == harness.parameters
