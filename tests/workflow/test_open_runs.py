"""A vehicle on which another run of this machine is open is not flown, and `doctor` looks for such runs first."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.link import Journal
from gcs_autotune.link.vehicle.other_stations import OtherStations
from gcs_autotune.mavlink import VehicleIdentity, our_heartbeat
from gcs_autotune.workflow import examine
from gcs_autotune.workflow.open_runs import forget_run, note_run, open_runs, refuse_open_runs

from .sitl_harness import SitlHarness

GAIN = "ATC_STR_RAT_P"


def cut_off(folder: Path, uid: str = "00000000a1b2c3d4") -> Journal:
    """A run with a trial gain aboard, whose journal is still held open."""
    folder.mkdir(parents=True)
    identity = VehicleIdentity(1, 1, 3, 11, "4.7.0-dev", uid=uid)
    journal = Journal(folder / "journal.jsonl", vehicle=identity, link="udpin:0.0.0.0:14550", mode="HOLD", armed=False)
    journal.record("lent", name=GAIN, value=0.2)
    journal.record("writing", name=GAIN, value=0.9)
    note_run(journal.path)
    return journal


def test_an_open_run_is_found_anywhere_and_forgotten_when_settled(tmp_path: Path) -> None:
    journal = cut_off(tmp_path / "elsewhere")
    (found,) = open_runs()
    assert found.path == tmp_path / "elsewhere" and found.is_going_on
    assert f"{GAIN} (was 0.2) may have trial values" in str(found)
    journal.leave()
    (found,) = open_runs()
    assert not found.is_going_on and "was interrupted" in str(found)
    journal = Journal.resume(tmp_path / "elsewhere" / "journal.jsonl")
    journal.record("returned", name=GAIN, value=0.2)
    journal.close()
    assert open_runs() == []
    forget_run(journal.path)


def test_doctor_checks_for_open_runs_first(tmp_path: Path) -> None:
    cut_off(tmp_path / "one").leave()
    first = next(iter(examine(tmp_path, None)))
    assert (first.what, first.state) == ("run", "wrong")
    assert first.cure == f"gcs-autotune restore {tmp_path / 'one'}"


class Real(SitlHarness):
    """A vehicle that counts as a real one: other stations may use it."""

    def settings(self, axis: str = "heading", *, simulated: bool = False, **changes: Any) -> Any:
        return super().settings(axis, simulated=simulated, **changes)


@pytest.mark.parametrize("going_on", [True, False])
def test_a_vehicle_with_an_open_run_is_refused_before_it_is_armed(tmp_path: Path, going_on: bool) -> None:
    harness = Real(tmp_path)
    uid = uid_of(harness, tmp_path)
    journal = cut_off(tmp_path / "first", uid)
    if not going_on:
        journal.leave()
    cure = "Wait until it ends, or stop it" if going_on else f"Run `gcs-autotune restore {tmp_path / 'first'}` first"
    with pytest.raises(PreconditionFailed, match=cure):
        harness.tune()
    assert not harness.vehicle.autopilot.armed
    assert not (harness.directory / "journal.jsonl").exists()


def uid_of(harness: SitlHarness, tmp_path: Path) -> str:
    """Return the board's id that this vehicle reports."""
    from gcs_autotune.link import MemoryLink, Session

    from .sitl_harness import Later

    with Session(MemoryLink(Later(harness.server))) as session:
        return str(session.discover().uid)


def test_a_simulated_vehicle_that_ended_leaves_no_open_run(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    identity = VehicleIdentity(1, 1, 3, 11, "4.7.0-dev", uid="00000000a1b2c3d4")
    journal = Journal(folder / "journal.jsonl", vehicle=identity, link="sitl:charlie", mode="HOLD", armed=False)
    note_run(journal.path)
    journal.leave()
    assert open_runs() == []


def heard_from(at_work: bool, component: int = 30) -> SimpleNamespace:
    """A craft on whose link a station of our system announces a run in progress, or none; our beacon is 25."""
    session: Any = SimpleNamespace(
        vehicle=VehicleIdentity(1, 1, 3, 11),
        clock=ManualClock(),
        transport=SimpleNamespace(is_simulated=False),
        listen=lambda name, listener: None,
        routing=SimpleNamespace(overhear=lambda hear: None),
        port=SimpleNamespace(system=255),
        beacon=25,
    )
    stations = OtherStations(session)
    message = our_heartbeat(at_work=at_work)
    frame: Any = SimpleNamespace(name="HEARTBEAT", message=message, system=255, component=component)
    stations._on_other_station(frame)
    return SimpleNamespace(session=session, other_stations=stations, parameters=None)


def test_a_vehicle_with_a_run_on_another_computer_is_refused() -> None:
    with pytest.raises(
        PreconditionFailed,
        match=r"another computer .*system 255, component 30\). Wait until that run "
        r"ends",
    ):
        refuse_open_runs(heard_from(at_work=True))  # type: ignore[arg-type]
    refuse_open_runs(heard_from(at_work=False))  # type: ignore[arg-type]
    refuse_open_runs(heard_from(at_work=True, component=25))  # type: ignore[arg-type]  # our own, sent back by a router
    late = heard_from(at_work=True)
    late.session.clock.advance(60.0)
    assert late.other_stations.at_work == "", "it has fallen silent since"
