"""`hold`: identify, design a controller of our own, fly with it in manual mode, and leave all as before."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import AutotuneError, NoGainsMeetSpec, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.identify import ModelFile
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.models import SingleDof
from gcs_autotune.plain_json import json_text
from gcs_autotune.report import HeldDistance, HeldLine, HeldLoop, HeldPosition, hold_document, to_html
from gcs_autotune.workflow import HoldSettings, Unattended, hold, load_models
from gcs_autotune.workflow.own_loops import supplied, supplied_motion
from sitl.effects import parse_effect

from .sitl_harness import SLOW_LOOP, WHEN, Ear, SitlHarness
from .test_fly_area import square


def held(
    harness: SitlHarness, axis: str, *, seconds: float = 0.0, models: tuple[ModelFile, ...] = (), **changes: Any
) -> HeldLoop:
    settings = HoldSettings(axis, harness.settings(axis, **changes), models, seconds)
    found = hold(settings, Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldLoop)
    return found


class Flights(dict[tuple[str, str], tuple[SitlHarness, HeldLoop]]):
    """Vehicle and axis -> the vehicle and its flight, each flown when first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __missing__(self, case: tuple[str, str]) -> tuple[SitlHarness, HeldLoop]:
        vehicle, axis = case
        loop = SLOW_LOOP if vehicle in ("videoray", "bluerov2") else {}
        harness = SitlHarness(self._folder / "-".join(case), vehicle, **loop)
        self[case] = harness, held(harness, axis)
        return self[case]

    def models(self, vehicle: str, axis: str) -> tuple[ModelFile, ...]:
        """Return the models identified in a flight."""
        harness, _ = self[vehicle, axis]
        return load_models(harness.directory)


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Flights:
    return Flights(tmp_path_factory.mktemp("held"))


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
def test_every_vehicle_follows_its_reference_model(vehicle: str, axis: str, flights: Flights) -> None:
    harness, found = flights[vehicle, axis]
    assert found.follows
    assert found.design.margins.vector >= 0.5
    assert found.design.bound[0] < found.design.bound[1]
    assert found.trial.meta["controller"]["structure"] == "I-PD"
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    page = (harness.directory / "report.html").read_text()
    assert "follows the model function" in page
    announced = " ".join(harness.said)
    assert announced.index("with our own controller") < announced.index("State before the run: mode")
    assert "write no parameter" in announced


def test_a_supplied_model_replaces_the_experiments(tmp_path: Path) -> None:
    file = tmp_path / "craft.json"
    file.write_text(json_text(SingleDof("yaw", "1", 0.5, 1.0).to_dict()), encoding="utf-8")
    harness = SitlHarness(tmp_path, "blueboat")
    found = held(harness, "heading", omega_0=0.5, models=load_models(file))
    assert found.design.model.alpha == 0.5
    assert not list((harness.directory / "trials").glob("*relay*"))


@pytest.mark.slow
def test_a_model_from_a_file_replaces_the_relays(flights: Flights, tmp_path: Path) -> None:
    again = SitlHarness(tmp_path, "blueboat")
    found = held(again, "heading", models=flights.models("blueboat", "heading"))
    assert found.follows
    assert "relay-1" not in " ".join(again.said)


@pytest.mark.slow
def test_a_required_bandwidth_is_used_and_held_for_the_required_time(flights: Flights, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    found = held(harness, "heading", seconds=15.0, omega_0=0.8, models=flights.models("blueboat", "heading"))
    assert found.design.wanted.omega_0 == pytest.approx(0.8)
    assert "own-hold: completed, held for 15 s" in " ".join(harness.said)
    assert found.metrics.rise > 2.0


@pytest.mark.slow
def test_a_loop_that_is_too_fast_is_refused_with_the_fastest_possible(flights: Flights, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    with pytest.raises(NoGainsMeetSpec, match=r"too fast: .* The fastest that is possible is"):
        held(harness, "heading", omega_0=20.0, models=flights.models("blueboat", "heading"))
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


def test_an_axis_that_cannot_be_held_is_refused_with_those_that_can(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="heading, depth, line"):
        held(SitlHarness(tmp_path, "blueboat"), "speed")


def line(harness: SitlHarness, **changes: Any) -> HeldLine:
    tune = harness.settings("heading", envelope=Envelope(distance=300.0))
    found = hold(HoldSettings("line", tune, **changes), Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldLine)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("guidance", ["indirect", "direct", "integral", "adaptive"])
def test_a_boat_follows_a_line_with_every_guidance_law(guidance: str, flights: Flights, tmp_path: Path) -> None:
    """The first law on a boat that is identified for it, the others with the model of another flight."""
    harness = SitlHarness(tmp_path, "blueboat")
    models = () if guidance == "indirect" else flights.models("blueboat", "heading")
    found = line(harness, guidance=guidance, offset=-6.0, models=models)
    assert found.follows
    assert found.figures.rms < 0.3
    assert found.figures.overshoot < 1.5
    assert math.degrees(found.figures.approach) < 75.0
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert "The craft follows the line" in (harness.directory / "report.html").read_text()


@pytest.mark.slow
def test_a_rudder_boat_far_from_the_line_keeps_its_approach_angle(flights: Flights, tmp_path: Path) -> None:
    found = line(
        SitlHarness(tmp_path, "charlie"),
        guidance="direct",
        offset=20.0,
        length=130.0,
        approach=math.radians(30.0),
        models=flights.models("charlie", "heading"),
    )
    assert found.follows
    assert math.degrees(found.figures.approach) < 35.0


def test_an_rov_cannot_follow_a_line(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "videoray")
    with pytest.raises(WrongVehicle, match="steered at rest"):
        line(harness)
    assert not harness.vehicle.autopilot.armed


@pytest.mark.slow
def test_the_report_contains_gains_margins_and_the_limit_of_the_loop(flights: Flights) -> None:
    _, found = flights["videoray", "depth"]
    page = to_html(hold_document(found, "Hold: depth", WHEN))
    for words in ("K_P", "phase margin", "No faster loop was chosen: "):
        assert words in page
    assert not any(isinstance(value, float) and math.isnan(value) for value in found.to_dict().values())


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["videoray-lasers", "videoray-beams"])
def test_an_rov_before_a_wall_is_tuned_end_to_end_and_keeps_its_distance(vehicle: str, tmp_path: Path) -> None:
    """Algorithm 8.5 on the VideoRay with two laser distances, or two beams that look aside."""
    harness = SitlHarness(tmp_path, vehicle, **SLOW_LOOP)
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
def test_without_two_rangefinders_distance_hold_is_refused(vehicle: str, why: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, vehicle)
    with pytest.raises(PreconditionFailed, match=why):
        hold(HoldSettings("distance", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)
    assert not harness.vehicle.autopilot.armed


def position(harness: SitlHarness, **changes: Any) -> HeldPosition:
    settings = HoldSettings("position", harness.settings("heading"), **changes)
    found = hold(settings, Unattended(), Ear(harness.said), WHEN)
    assert isinstance(found, HeldPosition)
    return found


def assert_held(harness: SitlHarness, found: HeldPosition) -> None:
    assert found.follows
    assert math.degrees(found.figures.heading) < 3.0
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters


@pytest.fixture(scope="module")
def vectored(tmp_path_factory: pytest.TempPathFactory) -> tuple[SitlHarness, HeldPosition]:
    """A vectored ROV that has held its position, flown once."""
    harness = SitlHarness(tmp_path_factory.mktemp("vectored"), "bluerov2-sway", **SLOW_LOOP)
    return harness, position(harness, law="sliding")


@pytest.mark.slow
def test_a_vectored_rov_holds_its_position_and_steps_away_from_it(vectored: tuple[SitlHarness, HeldPosition]) -> None:
    assert_held(*vectored)


@pytest.mark.slow
def test_models_of_a_run_replace_every_relay_and_the_pid_law_holds_position_too(
    vectored: tuple[SitlHarness, HeldPosition], tmp_path: Path
) -> None:
    models = load_models(vectored[0].directory)
    assert {file.model.base.form.dofs[0] for file in models} == {"yaw", "surge", "sway"}
    again = SitlHarness(tmp_path, "bluerov2-sway", **SLOW_LOOP)
    assert_held(again, position(again, law="pid", models=models))
    assert "relay" not in " ".join(again.said).replace("relay-", "")
    loop = supplied_motion(supplied(models, "sideways", None)).loop(0.3)
    assert loop.output(0.01) > 0.1


def test_a_craft_without_sway_thrust_cannot_hold_position(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "videoray")
    with pytest.raises(WrongVehicle, match="push sideways"):
        hold(HoldSettings("position", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)


@pytest.mark.slow
@pytest.mark.parametrize(("signal", "force", "known"), [("u", "X", {"yaw"}), ("v", "Y", {"yaw", "surge"})])
def test_every_thruster_is_checked_before_the_relay_that_drives_it(
    signal: str, force: str, known: set[str], vectored: tuple[SitlHarness, HeldPosition], tmp_path: Path
) -> None:
    """The motions before it are *known* from a run, so that its relay would be the first."""
    models = tuple(f for f in load_models(vectored[0].directory) if f.model.base.form.dofs[0] in known)
    harness = SitlHarness(tmp_path, "bluerov2-sway", effects=[parse_effect(f"sign-error@{signal}")], **SLOW_LOOP)
    with pytest.raises(PreconditionFailed, match=rf"sign check: .* of full {force} output"):
        position(harness, models=models)
    flown = " ".join(path.stem for path in (harness.directory / "trials").glob("*.csv"))
    assert f"relay-{'surge' if force == 'X' else 'sway'}" not in flown
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


@pytest.mark.slow
def test_a_reversed_thruster_ends_the_wall_relay(tmp_path: Path) -> None:
    astern = {f"MOT_{n}_DIRECTION": -1.0 for n in (1, 2)}
    harness = SitlHarness(tmp_path, "videoray-lasers", parameters=astern)
    with pytest.raises(AutotuneError, match=r"first surge self-oscillation|sign check"):
        hold(HoldSettings("distance", harness.settings("heading")), Unattended(), Ear(harness.said), WHEN)
    harness.assert_neutral()


def test_a_line_through_the_fence_is_refused_with_the_distance(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters={"FENCE_ENABLE": 1.0, "FENCE_TYPE": 4.0})
    harness.server.fence = [(5001, 4.0, *corner) for corner in square(40.0)]
    with pytest.raises(PreconditionFailed, match=r"the line goes .* outside its own fence"):
        line(harness, length=80.0)
    assert not harness.vehicle.autopilot.armed
