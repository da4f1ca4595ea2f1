"""`tune line`: refused untuned, proved by a mission that is restored, kept only if better."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import AutotuneError, GuardTripped, PreconditionFailed, WrongVehicle
from gcs_autotune.link import Journal
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import LineSettings, Unattended, restore_run, tune_line
from sitl.autopilot.mission import Command, MissionItem

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


def tuned(tmp_path: Path, meddling: Any = None, **parameters: float) -> SitlHarness:
    """Return a tuned blueboat with a mission of its owner, whose second command is the current one."""
    harness = SitlHarness(tmp_path, "blueboat", meddling, parameters={**BLUEBOAT, **parameters})
    harness.vehicle.autopilot.mission.store(THEIRS)
    harness.vehicle.autopilot.set_mission_item(2)
    return harness


def line(harness: SitlHarness, operator: Any = None, leg: float | None = 30.0, **changes: Any) -> Any:
    settings = LineSettings(harness.settings(**changes), leg)
    return tune_line(settings, operator or Unattended(), Ear(harness.said), WHEN)


def flown(harness: SitlHarness) -> list[tuple[int, int, int]]:
    return [(i.command, i.latitude, i.longitude) for i in harness.vehicle.autopilot.mission.items[1:]]


def theirs() -> list[tuple[int, int, int]]:
    return [(i.command, i.latitude, i.longitude) for i in THEIRS[1:]]


def test_better_parameters_are_kept_and_the_mission_is_restored(tmp_path: Path) -> None:
    harness = tuned(tmp_path)
    story = line(harness)
    assert story.ending == "kept"
    assert story.track_after.rms < 0.8 * story.track_before.rms
    assert flown(harness) == theirs()
    assert harness.vehicle.autopilot.mission.current == 2
    changed = {n for n, v in harness.vehicle.parameters.values.items() if v != harness.parameters[n]}
    assert changed == {"WP_ACCEL", "WP_RADIUS", "WP_PIVOT_ANGLE", "PSC_POS_P", "PSC_VEL_P"}
    assert not harness.vehicle.autopilot.armed
    assert Journal.read(harness.directory / "journal.jsonl").is_settled
    summary = json.loads((harness.directory / "summary.json").read_text())
    assert summary["track"]["after"]["rms"] == pytest.approx(story.track_after.rms)
    page = (harness.directory / "report.html").read_text()
    assert "Distance from the route (measured)" in page
    said = " ".join(harness.said)
    assert "will need" in said
    assert said.index("replaces the vehicle's own one") < said.index("State before the run")


def test_a_dry_run_flies_once_and_writes_nothing(tmp_path: Path) -> None:
    harness = tuned(tmp_path)
    story = line(harness, dry_run=True)
    assert (story.ending, story.track_after) == ("dry-run", None)
    assert {c.parameter for c in story.changes} >= {"WP_ACCEL", "PSC_POS_P"}
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


def test_too_little_space_is_refused_with_what_is_enough(tmp_path: Path) -> None:
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
def test_an_operators_mode_stands_and_the_mission_is_restored(number: int, name: str, tmp_path: Path) -> None:
    order = Ordering(number, 20.0)
    harness = order.harness = tuned(tmp_path, order)
    with pytest.raises(GuardTripped):
        line(harness)
    assert f"left in mode {name}" in " ".join(harness.said)
    assert flown(harness) == theirs()
    assert dict(harness.vehicle.parameters.values) == harness.parameters


def test_a_run_that_was_cut_off_is_restored_with_its_mission(tmp_path: Path) -> None:
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
