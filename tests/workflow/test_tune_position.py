"""`tune position`: refused without a position, proved by a step and a push, kept only if better."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import GuardTripped, NotAchieved, PreconditionFailed, WrongVehicle
from gcs_autotune.identify import load_model
from gcs_autotune.link import Journal
from gcs_autotune.workflow import Unattended, tune_position
from sitl.effects import parse_effect

from .sitl_harness import SLOW_LOOP, WHEN, Ear, SitlHarness

GAINS = {"PSC_POSXY_P", "PSC_VELXY_P", "PSC_VELXY_I"}
LOOP = SLOW_LOOP["parameters"]


def rov(tmp_path: Path, meddling: Any = None, name: str = "bluerov2-sway", **options: Any) -> SitlHarness:
    parameters = {**LOOP, **options.pop("parameters", {})}
    return SitlHarness(tmp_path, name, meddling, parameters=parameters, **options)


def position(harness: SitlHarness, **changes: Any) -> Any:
    return tune_position(harness.settings("depth", **changes), Unattended(), Ear(harness.said), WHEN)


def changed(harness: SitlHarness) -> set[str]:
    return {n for n, v in harness.vehicle.parameters.values.items() if v != harness.parameters[n]}


@pytest.mark.slow
def test_better_gains_are_kept_after_a_step_and_a_push(tmp_path: Path) -> None:
    harness = rov(tmp_path)
    story = position(harness)
    assert story.ending == "kept"
    assert story.position_after.itae < 0.85 * story.position_before.itae
    assert story.position_after.push < 0.85 * story.position_before.push
    assert changed(harness) <= GAINS
    assert not harness.vehicle.autopilot.armed
    assert Journal.read(harness.directory / "journal.jsonl").is_settled
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert summary["position"]["after"]["push"] == pytest.approx(story.position_after.push)
    page = (harness.directory / "report.html").read_text()
    assert all(title in page for title in ("Position before and after", "Model of surge", "Model of sway"))
    sway = load_model(harness.directory / "model-sway.json").axis
    assert sway is not None and sway.axis.name == "sway"
    announced = " ".join(harness.said)
    assert announced.index("need about") < announced.index("State before the run")


@pytest.mark.slow
def test_a_dry_run_writes_nothing_and_flies_once(tmp_path: Path) -> None:
    harness = rov(tmp_path)
    story = position(harness, dry_run=True)
    assert (story.ending, story.position_after) == ("dry-run", None)
    assert {c.parameter for c in story.changes} <= GAINS
    harness.assert_as_found()


@pytest.mark.slow
def test_the_newer_parameter_names_are_written(tmp_path: Path) -> None:
    harness = rov(tmp_path, names="4.7")
    story = position(harness)
    assert story.ending == "kept"
    assert changed(harness) <= GAINS
    assert {c.parameter for c in story.changes} <= {"PSC_NE_POS_P", "PSC_NE_VEL_P", "PSC_NE_VEL_I"}


@pytest.mark.slow
def test_a_delay_lowers_the_gains_to_the_margins(tmp_path: Path) -> None:
    late = [parse_effect(f"input-delay@{axis}.delay=0.4") for axis in "XY"]
    harness = rov(tmp_path, effects=late)
    story = position(harness, dry_run=True)
    new = {c.parameter: c.new for c in story.changes}
    assert new["PSC_VELXY_P"] < 5.0
    assert "predicted margins" in " ".join(harness.said)


@pytest.mark.slow
def test_gains_that_are_not_better_are_restored(tmp_path: Path) -> None:
    harness = rov(tmp_path, parameters={"PSC_POSXY_P": 2.0, "PSC_VELXY_I": 0.9})
    story = position(harness)
    assert story.ending in ("restored", "unchanged")
    harness.assert_as_found()


@pytest.mark.parametrize(("name", "why"), [("videoray", "sideways"), ("charlie", "rudder.*LOIT_RADIUS")])
def test_a_craft_that_cannot_stay_in_one_place_is_refused(name: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(WrongVehicle, match=why):
        position(SitlHarness(tmp_path, name))


def test_an_rov_that_does_not_move_sideways_ends_at_the_sign_check(tmp_path: Path) -> None:
    harness = rov(tmp_path, name="bluerov2")
    with pytest.raises(PreconditionFailed, match=r"sign check: .*Y output.*dead or too weak"):
        position(harness)
    assert [path.stem for path in (harness.directory / "trials").glob("*.csv")] == ["01-sign-check"]
    harness.assert_as_found()


@pytest.mark.slow
def test_in_a_current_a_boat_holds_closer_with_a_smaller_radius(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    harness.vehicle.plant.water.V_x, harness.vehicle.plant.water.V_y = 0.2, 0.2
    story = position(harness)
    assert story.ending == "kept"
    assert story.position_after.hold < 0.6 * story.position_before.hold
    assert math.isnan(story.position_after.push), "nothing pushes a boat"
    assert not any("push" in reason for reason in story.verdict_reasons)
    assert changed(harness) == {"LOIT_RADIUS"}
    assert not harness.vehicle.autopilot.armed


def test_a_boat_with_a_small_radius_is_left_unchanged(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters={"LOIT_RADIUS": 0.3})
    assert position(harness).ending == "unchanged"
    harness.assert_as_found()


def test_a_missing_position_is_refused_before_anything_moves(tmp_path: Path) -> None:
    harness = rov(tmp_path)
    harness.vehicle.autopilot.ready_ms = 10**9
    with pytest.raises(PreconditionFailed, match="no position estimate"):
        position(harness)
    assert not harness.found
    harness.assert_untouched()


def test_an_rov_without_a_gps_is_refused_for_its_position(tmp_path: Path) -> None:
    harness = rov(tmp_path, parameters={"GPS1_TYPE": 0.0})
    with pytest.raises(PreconditionFailed, match=r"no position estimate.*Check the DVL or other position source"):
        position(harness)
    harness.assert_untouched()


def test_a_current_stronger_than_the_craft_is_refused_with_its_speed(tmp_path: Path) -> None:
    harness = rov(tmp_path, parameters={"WPNAV_SPEED": 30.0})
    harness.vehicle.plant.water.V_x = 0.5
    with pytest.raises(PreconditionFailed, match=r"reports a drift of 0\.[45]\d m/s.*0\.30 m/s"):
        position(harness)
    harness.assert_untouched()


def test_a_firmware_without_the_gains_is_refused(tmp_path: Path) -> None:
    def without(_: float, message: Any) -> Iterable[Any]:
        hidden = message.get_type() == "PARAM_VALUE" and message.param_id.startswith("PSC_VEL")
        return () if hidden else (message,)

    with pytest.raises(WrongVehicle, match="no parameter PSC_VELXY_P, PSC_VELXY_I"):
        position(rov(tmp_path, without))


class Jumping:
    """Moves the reported position by *metres* once the vehicle has been in GUIDED for 15 s."""

    def __init__(self, metres: float) -> None:
        self.harness: SitlHarness
        self._metres, self._since = metres, math.inf

    def __call__(self, t: float, message: Any) -> Iterable[Any]:
        if self.harness.vehicle.autopilot.mode.number == 4:
            self._since = min(self._since, t)
        if message.get_type() == "LOCAL_POSITION_NED" and t > self._since + 15.0:
            message.x += self._metres
        return (message,)


def test_a_position_jump_ends_the_run_with_its_size(tmp_path: Path) -> None:
    jump = Jumping(1.7)
    harness = jump.harness = rov(tmp_path, jump)
    with pytest.raises(NotAchieved, match=r"jumped by 1\.[678] m"):
        position(harness)
    harness.assert_as_found()


def test_an_operators_mode_stays_in_force(tmp_path: Path) -> None:
    class Ordering:
        def __init__(self) -> None:
            self.harness: SitlHarness
            self._since = math.inf

        def __call__(self, t: float, message: Any) -> Iterable[Any]:
            if self.harness.vehicle.autopilot.mode.number == 16:
                self._since = min(self._since, t)
            if t > self._since + 20.0:
                self._since = math.inf
                order = (mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, 2, 0.0, 0.0, 0.0, 0.0, 0.0)
                stranger = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
                self.harness.server.receive(mavlink.MAVLink_command_long_message(1, 1, *order).pack(stranger))
            return (message,)

    order = Ordering()
    harness = order.harness = rov(tmp_path, order)
    with pytest.raises(GuardTripped):
        position(harness)
    assert harness.mode == "ALT_HOLD"
    assert dict(harness.vehicle.parameters.values) == harness.parameters
