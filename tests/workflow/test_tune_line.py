"""`tune line`: refused untuned, proved by a mission that is restored, kept only if better."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import AutotuneError, GuardTripped, NotAchieved, PreconditionFailed, WrongVehicle
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import Area, Envelope, Zone
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Unattended, restore_run, tune_line
from sitl.autopilot.mission import Command, MissionItem
from sitl.effects import parse_effect
from sitl.place import HOME

from .sitl_harness import WHEN, Ear, Later, Moored, SitlHarness

BLUEBOAT = {
    "ATC_SPEED_P": 1.852,
    "ATC_SPEED_I": 2.0,
    "ATC_STR_RAT_FF": 1.371,
    "ATC_STR_RAT_P": 1.987,
    "ATC_STR_RAT_I": 0.6676,
    "ATC_STR_ANG_P": 2.726,
}
"""Gains of `tune speed` and `tune heading`."""
THEIRS = [
    MissionItem(Command.WAYPOINT, 0),
    MissionItem(Command.WAYPOINT, 3, (0.0, 0.0, 0.0, 0.0), 451000000, 151000000),
    MissionItem(Command.LOITER_TIME, 3, (9.0, 0.0, 0.0, 0.0), 451001000, 151001000),
]


def tuned(tmp_path: Path, meddling: Any = None, effects: Any = (), **parameters: float) -> SitlHarness:
    """Return a tuned blueboat with a mission of its owner, whose second command is the current one."""
    harness = SitlHarness(tmp_path, "blueboat", meddling, parameters={**BLUEBOAT, **parameters}, effects=effects)
    harness.vehicle.autopilot.mission.store(THEIRS)
    harness.vehicle.autopilot.set_mission_item(2)
    return harness


def line(
    harness: SitlHarness, operator: Any = None, leg: float | None = 30.0, *, untuned: bool = False, **changes: Any
) -> Any:
    settings = harness.settings(leg_length=leg, untuned=untuned, **changes)
    return tune_line(settings, operator or Unattended(), Ear(harness.said), WHEN)


def flown(harness: SitlHarness) -> list[tuple[int, int, int]]:
    return [(i.command, i.latitude, i.longitude) for i in harness.vehicle.autopilot.mission.items[1:]]


def theirs() -> list[tuple[int, int, int]]:
    return [(i.command, i.latitude, i.longitude) for i in THEIRS[1:]]


@pytest.mark.slow
def test_better_parameters_are_kept_and_the_mission_is_restored(tmp_path: Path) -> None:
    harness = tuned(tmp_path)
    story = line(harness)
    assert story.ending == "kept"
    assert story.track_after.rms < 0.8 * story.track_before.rms
    assert flown(harness) == theirs()
    assert harness.vehicle.autopilot.mission.current == 2
    changed = {n for n, v in harness.vehicle.parameters.values.items() if v != harness.parameters[n]}
    assert changed == {"WP_ACCEL", "WP_RADIUS", "WP_PIVOT_ANGLE", "PSC_VEL_P"}
    assert not harness.vehicle.autopilot.armed
    assert Journal.read(harness.directory / "journal.jsonl").is_settled
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert summary["track"]["after"]["rms"] == pytest.approx(story.track_after.rms)
    page = (harness.directory / "report.html").read_text()
    assert "Distance from the route (measured)" in page
    announced = " ".join(harness.said)
    assert "will need" in announced
    assert announced.index("replaces the vehicle's own one") < announced.index("State before the run")


@pytest.mark.slow
def test_a_dry_run_flies_once_and_writes_nothing(tmp_path: Path) -> None:
    harness = tuned(tmp_path)
    story = line(harness, dry_run=True)
    assert (story.ending, story.track_after) == ("dry-run", None)
    assert {c.parameter for c in story.changes} >= {"WP_ACCEL", "PSC_VEL_P"}
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    assert flown(harness) == theirs()


@pytest.mark.parametrize(
    ("own", "command"), [({"ATC_STR_RAT_FF": 0.2, "ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": 0.2}, "tune heading"),
                         ({"ATC_SPEED_P": 0.2, "ATC_SPEED_I": 0.2}, "tune speed")],
)  # fmt: skip
def test_a_boat_that_is_not_tuned_is_refused_with_the_command(
    own: dict[str, float], command: str, tmp_path: Path
) -> None:
    harness = tuned(tmp_path, **own)
    with pytest.raises(PreconditionFailed, match=f"not tuned.*`gcs-autotune {command}`"):
        line(harness)
    assert not harness.found
    assert flown(harness) == theirs()


def test_an_rov_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WrongVehicle, match="for ArduRover boats"):
        line(SitlHarness(tmp_path, "bluerov2"))


def test_insufficient_space_is_refused_with_the_required_distance(tmp_path: Path) -> None:
    with pytest.raises(PreconditionFailed, match=r"--max-distance is 60 m. Use .*--max-distance \d+"):
        line(tuned(tmp_path), envelope=Envelope(distance=60.0))


class Ordering:
    """Orders a mode *seconds* after the boat went to AUTO."""

    def __init__(self, mode: int, seconds: float) -> None:
        self.harness: SitlHarness
        self._mode, self._seconds, self._since = mode, seconds, -1.0

    def __call__(self, t: float, message: Any) -> Iterable[Any]:
        autopilot = self.harness.vehicle.autopilot
        if autopilot.mode.number == 10 and self._since < 0.0:
            self._since = t
        if self._since >= 0.0 and t > self._since + self._seconds:
            self._seconds = 1e9
            order = (mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, self._mode, 0.0, 0.0, 0.0, 0.0, 0.0)
            stranger = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
            self.harness.server.receive(mavlink.MAVLink_command_long_message(1, 1, *order).pack(stranger))
        return (message,)


@pytest.mark.parametrize(("number", "name"), [(4, "HOLD"), (5, "LOITER")])
def test_an_operators_mode_stays_in_force_and_the_mission_is_restored(number: int, name: str, tmp_path: Path) -> None:
    order = Ordering(number, 20.0)
    harness = order.harness = tuned(tmp_path, order)
    with pytest.raises(GuardTripped):
        line(harness)
    assert f"left in mode {name}" in " ".join(harness.said)
    assert flown(harness) == theirs()
    assert dict(harness.vehicle.parameters.values) == harness.parameters


def test_an_interrupted_run_is_restored_with_its_mission(tmp_path: Path) -> None:
    class Cut(Ordering):
        def __call__(self, t: float, message: Any) -> Iterable[Any]:
            list(super().__call__(t, message))
            return () if self._seconds > 1e8 else (message,)

    cut = Cut(10, 20.0)
    harness = cut.harness = tuned(tmp_path, cut)
    with pytest.raises(AutotuneError):
        line(harness, patience=0.0)
    assert flown(harness) != theirs()
    journal = harness.directory / "journal.jsonl"
    assert not Journal.read(journal).is_settled
    restore_run(Moored(peer=Later(harness.server)), journal, Unattended(), SilentObserver())
    assert flown(harness) == theirs()
    assert Journal.read(journal).is_settled


@pytest.mark.slow
def test_an_untuned_boat_is_flown_on_request_and_the_report_states_it(tmp_path: Path) -> None:
    harness = tuned(tmp_path, ATC_SPEED_P=0.2, ATC_SPEED_I=0.2)
    assert line(harness, untuned=True, dry_run=True).ending == "dry-run"
    assert "speed not tuned" in " ".join(harness.said)


def assert_as_before(harness: SitlHarness) -> None:
    harness.assert_untouched()
    assert flown(harness) == theirs()
    assert harness.vehicle.autopilot.mission.current == 2


def test_a_current_nearly_as_fast_as_the_mission_is_refused_with_the_accepted_speed(tmp_path: Path) -> None:
    harness = tuned(tmp_path, effects=[parse_effect("steady-current.V_x=1.3")])
    with pytest.raises(PreconditionFailed, match=r"drifts at 1\.3 m/s .* up to 1\.2 m/s is accepted"):
        line(harness)
    assert_as_before(harness)


@pytest.mark.slow
def test_a_current_too_strong_for_the_boat_ends_the_flight_with_its_speed(tmp_path: Path) -> None:
    north = [parse_effect("steady-current.V_x=-2.6")]
    harness = tuned(tmp_path, effects=north, WP_SPEED=3.5)
    with pytest.raises(NotAchieved, match=r"made 0\.\d\d m/s towards it with \d\d % of full output. The current"):
        line(harness)
    assert_as_before(harness)


def test_legs_too_short_for_the_corners_are_refused_with_a_sufficient_length(tmp_path: Path) -> None:
    harness = tuned(tmp_path, WP_SPEED=3.0, WP_PIVOT_ANGLE=0.0)
    story = line(harness, leg=10.0)
    assert story.ending == "unchanged"
    assert "the legs are 10 m. Use --leg-length" in story.reason
    assert_as_before(harness)


def area_around(*corners: tuple[float, float]) -> Envelope:
    """Return an envelope with a polygon, its corners north and east of the vehicle [m]."""
    degrees = tuple(
        (HOME[0] + n / 111320.0, HOME[1] + e / 111320.0 / math.cos(math.radians(HOME[0]))) for n, e in corners
    )
    return Envelope(area=Area((Zone(degrees),), "--area"))


@pytest.mark.parametrize(
    ("south", "north", "east", "leg", "fits"),
    [
        (-150.0, 150.0, 25.0, 30.0, r"leaves --area by \d+ m. It fits with the bow at \d+ deg"),
        (-50.0, 50.0, 50.0, 60.0, r"It fits with --leg-length \d+ and the bow at \d+ deg"),
        (-9.0, 9.0, 9.0, 30.0, "No course fits here"),
    ],
)
def test_a_course_through_the_fence_is_refused_with_a_heading_or_leg_that_fits(
    south: float, north: float, east: float, leg: float, fits: str, tmp_path: Path
) -> None:
    harness = tuned(tmp_path)
    area = area_around((south, -north), (north, -north), (north, east), (south, east))
    with pytest.raises(PreconditionFailed, match=fits):
        line(harness, leg=leg, envelope=area)
    assert_as_before(harness)


def test_a_mission_that_could_not_be_restored_is_not_replaced(tmp_path: Path) -> None:
    harness = tuned(tmp_path)
    odd = [*THEIRS, MissionItem(Command.WAYPOINT, 77, (0.0, 0.0, 0.0, 0.0), 451002000, 151002000)]
    harness.vehicle.autopilot.mission.store(odd)
    harness.vehicle.autopilot.set_mission_item(2)
    with pytest.raises(PreconditionFailed, match=r"own mission \(3 items\) could not be restored .*UNSUPPORTED_FRAME"):
        line(harness)
    harness.assert_untouched()
    assert flown(harness) == [(i.command, i.latitude, i.longitude) for i in odd[1:]]


def test_a_position_jump_ends_the_flight_and_the_mission_is_restored(tmp_path: Path) -> None:
    class Jump(Ordering):
        def __call__(self, t: float, message: Any) -> Iterable[Any]:
            if self.harness.vehicle.autopilot.mode.number == 10 and self._since < 0.0:
                self._since = t
            if 0.0 <= self._since < t - self._seconds and message.get_type() == "LOCAL_POSITION_NED":
                message.x += 12.0
            return (message,)

    jump = Jump(10, 20.0)
    harness = jump.harness = tuned(tmp_path, jump)
    with pytest.raises(NotAchieved, match=r"position jumped by 1[12]\.\d m"):
        line(harness)
    assert_as_before(harness)
