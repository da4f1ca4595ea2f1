"""The vehicle's mission: downloaded, replaced for a while, and restored."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import NotAsFound, PreconditionFailed
from gcs_autotune.link import (
    Journal,
    MemoryLink,
    MissionItem,
    MissionLoan,
    Session,
    StoredMission,
    read_mission,
    same_mission,
    waypoint,
    write_mission,
)
from sitl import open_vehicle
from sitl.autopilot.mission import Command
from sitl.autopilot.mission import MissionItem as Stored

HOME = waypoint(45.0, 15.0)
THEIRS = (
    Stored(Command.WAYPOINT, 3),
    Stored(Command.WAYPOINT, 3, (2.0, 0.0, 0.0, 0.0), 450001000, 150002000, 1.5),
    Stored(Command.CHANGE_SPEED, 0, (1.0, 0.75, -1.0, 0.0)),
    Stored(Command.LOITER_TIME, 3, (7.0, 0.0, 0.0, 0.0), 450003000, 150004000),
)
OURS = StoredMission((HOME, waypoint(45.001, 15.0), waypoint(45.001, 15.001)), 1)


class Boat:
    """A simulated boat with a session on it; *lossy* drops a quarter of what the vehicle sends."""

    def __init__(self, *, lossy: bool = False) -> None:
        self.server = open_vehicle("blueboat", seed=1)
        self.lossy = lossy
        self._chance = random.Random(3)
        self.mission = self.server.vehicle.autopilot.mission
        self.mission.store(THEIRS)
        self.session = Session(MemoryLink(self))
        self.session.discover()

    def receive(self, data: bytes) -> None:
        self.server.receive(data)

    def advance_to(self, t: float) -> bytes:
        data = self.server.advance_to(t)
        return b"" if self.lossy and self._chance.random() < 0.25 else data

    @property
    def flown(self) -> list[Any]:
        return [(i.command, i.parameters, i.latitude, i.longitude) for i in self.mission.items[1:]]


def theirs() -> list[Any]:
    return [(i.command, i.parameters, i.latitude, i.longitude) for i in THEIRS[1:]]


def test_a_mission_is_read_as_stored() -> None:
    found = read_mission(Boat().session)
    assert [item.command for item in found.items[1:]] == [16, 178, 19]
    assert (found.items[1].x, found.items[1].y, found.items[1].z) == (450001000, 150002000, 1.5)
    assert found.items[2].param2 == pytest.approx(0.75)


@pytest.mark.parametrize("lossy", [False, True])
def test_a_written_mission_is_read_back(lossy: bool) -> None:
    boat = Boat(lossy=lossy)
    write_mission(boat.session, OURS)
    assert same_mission(read_mission(boat.session).items, OURS.items)
    assert boat.mission.current == 1


def test_an_empty_mission_clears_the_vehicles_mission() -> None:
    boat = Boat()
    write_mission(boat.session, StoredMission())
    assert len(boat.mission.items) <= 1


def test_a_rejected_item_is_reported_and_the_mission_stays() -> None:
    boat = Boat()
    bad = StoredMission((HOME, MissionItem(frame=6, command=31000)))
    with pytest.raises(PreconditionFailed, match="rejects the mission"):
        write_mission(boat.session, bad)
    assert boat.flown == theirs()


def test_a_loan_restores_the_mission_and_its_current_item(tmp_path: Path) -> None:
    boat = Boat()
    boat.server.vehicle.autopilot.set_mission_item(3)
    journal = Journal(tmp_path / "journal.jsonl")
    with MissionLoan(boat.session, journal) as loan:
        loan.set(OURS)
        assert len(boat.flown) == 2
        owed = Journal.read(journal.path).mission
        assert owed is not None
        assert [item["command"] for item in owed["items"]] == [16, 16, 178, 19]
    assert boat.flown == theirs()
    assert boat.mission.current == 3
    assert Journal.read(journal.path).mission is None


def test_a_loan_restores_the_mission_after_an_error(tmp_path: Path) -> None:
    boat = Boat()
    with pytest.raises(ValueError, match="mine"), MissionLoan(boat.session, Journal(tmp_path / "j")) as loan:
        loan.set(OURS)
        raise ValueError("mine")
    assert boat.flown == theirs()


def test_a_mission_written_by_another_station_stays(tmp_path: Path) -> None:
    boat = Boat()
    with MissionLoan(boat.session, Journal(tmp_path / "j")) as loan:
        loan.set(OURS)
        boat.mission.store([THEIRS[0], Stored(Command.WAYPOINT, 3, latitude=460000000, longitude=160000000)])
    assert [item[2] for item in boat.flown] == [460000000]
    assert "another station" in " ".join(boat.session.notes)


def test_a_mission_started_by_an_operator_is_left_and_stays_in_the_journal(tmp_path: Path) -> None:
    boat = Boat()
    loan = MissionLoan(boat.session, Journal(tmp_path / "j"), lambda: "the vehicle is in AUTO")
    loan.set(OURS)
    with pytest.raises(NotAsFound, match=r"in AUTO.*gcs-autotune restore"):
        loan.give_back()
    assert not Journal.read(tmp_path / "j").is_settled
    assert len(boat.flown) == 2


def test_the_remains_of_an_interrupted_upload_are_replaced_by_the_previous_mission(tmp_path: Path) -> None:
    """ArduPilot overwrites item by item: the first is ours, the rest is theirs."""
    boat = Boat()
    with MissionLoan(boat.session, Journal(tmp_path / "j")) as loan:
        loan.set(OURS)
        boat.mission.store([boat.mission.items[0], boat.mission.items[1], *THEIRS[2:]])
    assert boat.flown == theirs()
