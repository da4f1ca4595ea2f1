"""``restore`` after a crash: the vehicle itself is checked, and is in its original state."""

from __future__ import annotations

import json
import math
import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.faults import Case, Fault, Killed, VehicleAsFound, run_case
from benchmarks.faults.case import FLEET
from benchmarks.faults.vehicle import Condition
from gcs_autotune.errors import LinkLost, NotAsFound, PreconditionFailed, UsageError, WrongVehicle
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Commands, Journal, JournalState, Parameters, ParameterTransaction, Session
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import Unattended, is_settled, link_of, restore_run, settled_words
from gcs_autotune.workflow import restore as restore_module
from gcs_autotune.workflow.restore import _Restoring

pytestmark = pytest.mark.usefixtures("plainly")

NEW = {"ATC_STR_RAT_P": 0.5, "ATC_STR_RAT_I": 0.4, "ATC_STR_RAT_FF": 1.5}
VIDEORAY = next(subject for subject in FLEET if subject.vehicle == "videoray")


def moored(**options: Any) -> VehicleAsFound:
    vehicle = VehicleAsFound("charlie", seed=1, parameters={"SIM_RC_FAIL": 0.0, **options})
    vehicle.wait(4.0)
    vehicle.server.vehicle.autopilot.set_mode(4)
    vehicle.wait(0.1)
    return vehicle


def borrow(vehicle: VehicleAsFound, path: Path, faults: tuple[Fault, ...] = (), **found: Any) -> None:
    """What a tune does to a vehicle, in short: journal, arm, another mode, new gains; and no clean-up."""
    with Session(vehicle.connection(faults).open()) as session:
        session.discover(system_id=1)
        commands = Commands(session, FIRMWARE["ardurover"])
        known = {"vehicle": session.vehicle, "mode": "HOLD", "armed": False, "link": "memory", **found}
        journal = Journal(path, **known)
        try:
            journal.record("ordering", armed=True)
            commands.arm()
            journal.record("ordering", mode="GUIDED", boot=vehicle.server.now)
            commands.set_mode("GUIDED")
            journal.record("ordered", mode="GUIDED")
            ParameterTransaction(Parameters(session), journal).set(NEW)
        finally:
            journal.leave()


def restore(vehicle: VehicleAsFound, path: Path, *faults: Fault, answer: bool = True, **acts: Any) -> Any:
    return restore_run(vehicle.connection(faults, **acts), path, Unattended(answer), SilentObserver())


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


def test_restore_disarms_restores_verifies_and_settles(path: Path) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    assert vehicle.condition().differs_from(found, {})
    changes = restore(vehicle, path)
    assert changes == {n: (pytest.approx(v), pytest.approx(found.parameters[n])) for n, v in NEW.items()}
    assert vehicle.condition().differs_from(found, {}) == []
    assert Journal.read(path).is_settled
    assert restore(vehicle, path) == {}


@pytest.mark.slow
def test_a_kill_at_any_moment_of_borrowing_and_restoring_is_recovered(path: Path) -> None:
    """The moments are counted in messages of ours, so that none between two of them is left out."""
    whole = moored()
    connection = whole.connection()
    restore_link = whole.connection()
    with Session(connection.open()):
        pass
    borrow(whole, path)
    restore_run(restore_link, path, Unattended(), SilentObserver())
    counts = dict(restore_link.opened[0].sent)
    moments = [("PARAM_SET", n, after) for n in (1, 2, 3) for after in (0.0, 0.021, 0.05)]
    moments += [("COMMAND_LONG", n, after) for n in (2, 3) for after in (0.0, 0.05)]
    for k, (name, count, after) in enumerate(moments):
        path.unlink()
        vehicle = moored()
        found = vehicle.condition()
        with pytest.raises(Killed):
            borrow(vehicle, path, (Fault("killed", after, sent=name, count=count),))
        again = list(counts)[k % len(counts)]
        at = 1 + k % counts[again]
        try:
            restore(vehicle, path, Fault("killed", 0.0, sent=again, count=at))
        except Killed:
            assert not Journal.read(path).is_settled
        restore(vehicle, path)
        assert vehicle.condition().differs_from(found, {}) == [], (name, count, after, again, at)
        assert Journal.read(path).is_settled


def test_another_vehicle_with_the_same_system_id_is_refused_by_its_board(path: Path) -> None:
    vehicle = moored()
    borrow(vehicle, path)
    journal = path.read_text().replace('"uid": "', '"uid": "f00')
    path.write_text(journal)
    before = vehicle.condition()
    with pytest.raises(WrongVehicle, match="its board is f00"):
        restore(vehicle, path)
    assert vehicle.condition().parameters == before.parameters
    assert not Journal.read(path).is_settled


def test_without_a_unique_id_calibration_and_setup_distinguish_two_vehicles(path: Path) -> None:
    vehicle = moored()
    borrow(
        vehicle, path, fingerprint={"CRUISE_SPEED": vehicle.condition().parameters["CRUISE_SPEED"], "RC1_TRIM": 1500.0}
    )
    events = [json.loads(line) for line in path.read_text().splitlines()]
    events[0]["vehicle"]["uid"] = ""
    path.write_text("".join(json.dumps(e) + "\n" for e in events))
    other = moored(RC1_TRIM=1512.0)
    with pytest.raises(WrongVehicle, match="RC1_TRIM 1500 there, 1512 here"):
        restore(other, path)
    assert other.writes == []
    restore(vehicle, path)
    assert Journal.read(path).is_settled


@pytest.mark.parametrize(
    ("hours", "boot", "restarted"), [(1.0, 3700.0, False), (1.0, 1000.0, True), (0.0, 90.0, True), (0.0, 101.0, False)]
)
def test_a_restart_is_detected_by_two_clocks(hours: float, boot: float, restarted: bool) -> None:
    restoring = object.__new__(_Restoring)
    restoring._session = SimpleNamespace(transport=SimpleNamespace(is_simulated=False))  # type: ignore[assignment]
    restoring._boot = None
    stamp = (datetime.now(UTC) - timedelta(hours=hours)).isoformat()
    restoring._state = JournalState(boot=100.0, stamp=stamp)
    restoring._time_since_boot = lambda: boot  # type: ignore[method-assign]
    assert restoring._has_restarted() == restarted


# --- what another operator did since -----------------------------------------------------------


class Person(Unattended):
    """An operator who *overrules* what others did, or not, and agrees to the rest."""

    answered_beforehand = False

    def __init__(self, *, overrules: bool) -> None:
        super().__init__()
        self.overrules, self.asked = overrules, list[str]()

    def ask(self, question: str, while_waiting: Any) -> bool:
        self.asked.append(question)
        return self.overrules if "Another operator" in question else True


def without_receiver(vehicle: VehicleAsFound) -> Condition:
    """Switch the transmitter off, so that only our overrides kept the radio failsafe away."""
    vehicle.server.vehicle.parameters.preset("SIM_RC_FAIL", 1.0)
    return vehicle.condition()


def test_a_value_written_by_another_station_stays_and_ours_are_restored(path: Path) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    vehicle.server.vehicle.parameters.preset("ATC_STR_RAT_P", 0.77)
    with pytest.raises(NotAsFound, match=r"ATC_STR_RAT_P: its value 0.77.*without --yes") as caught:
        restore(vehicle, path)
    assert set(caught.value.differences) == {"ATC_STR_RAT_P"}
    assert vehicle.condition().differs_from(found, {}) == ["ATC_STR_RAT_P 0.77, found 0.2"]
    assert set(Journal.open_debts(path)) == {"ATC_STR_RAT_P"}


@pytest.mark.parametrize("mode", [4, 0, 3])
def test_a_mode_that_neither_we_nor_a_failsafe_set_stays(path: Path, mode: int) -> None:
    """With an RC receiver no failsafe ends in HOLD (4), and none ever in MANUAL (0) or STEERING (3)."""
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path, mode="ACRO")
    vehicle.server.vehicle.autopilot.set_mode(mode)
    with pytest.raises(NotAsFound, match=r"mode: its mode is .*without --yes") as caught:
        restore(vehicle, path)
    now = vehicle.condition()
    assert now.mode == mode
    assert now.parameters == found.parameters
    assert ("armed state" in caught.value.differences, now.armed) == ((False, False) if mode == 4 else (True, True))
    assert not Journal.read(path).is_settled


@pytest.mark.parametrize("overrules", [True, False])
def test_the_operator_decides_about_another_operators_changes_and_the_journal_is_settled(
    path: Path, overrules: bool
) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    vehicle.server.vehicle.autopilot.set_mode(3)
    vehicle.server.vehicle.parameters.preset("ATC_STR_RAT_P", 0.77)
    person = Person(overrules=overrules)
    restore_run(vehicle.connection(), path, person, SilentObserver())
    now = vehicle.condition()
    assert len([q for q in person.asked if "Another operator" in q]) == 3, "mode, armed state, a gain"
    assert (now.mode, now.armed) == ((4, False) if overrules else (3, True))
    assert now.parameters["ATC_STR_RAT_P"] == pytest.approx(0.2 if overrules else 0.77)
    assert {**now.parameters, "ATC_STR_RAT_P": 0.0} == {**found.parameters, "ATC_STR_RAT_P": 0.0}
    assert Journal.read(path).is_settled


def test_a_vehicle_in_hold_by_its_radio_failsafe_after_a_kill_is_restored(path: Path) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path, mode="ACRO")
    without_receiver(vehicle)
    vehicle.wait(6.0)
    assert (vehicle.condition().mode, vehicle.condition().armed) == (4, True)
    restore(vehicle, path)
    now = vehicle.condition()
    assert not now.armed
    assert {n: now.parameters[n] for n in NEW} == {n: found.parameters[n] for n in NEW}
    assert Journal.read(path).is_settled


def test_a_mode_ordered_by_another_station_during_the_run_stays(path: Path) -> None:
    vehicle = moored()
    borrow(vehicle, path, mode="ACRO")
    without_receiver(vehicle)
    vehicle.wait(6.0)
    journal = Journal.resume(path)
    journal.record("yielded", mode="HOLD")
    journal.leave()
    with pytest.raises(NotAsFound, match="mode: its mode is HOLD"):
        restore(vehicle, path)
    assert vehicle.condition().mode == 4


def test_the_mode_after_a_restart_is_not_an_order(path: Path) -> None:
    vehicle = moored()
    vehicle.wait(30.0)
    borrow(vehicle, path)
    vehicle.server.reboot_soon()
    vehicle.wait(5.0)
    assert (vehicle.condition().mode, vehicle.condition().armed) == (0, False)
    restore(vehicle, path)
    assert vehicle.condition().mode == 4
    assert Journal.read(path).is_settled


def test_a_run_in_progress_is_not_restored(path: Path) -> None:
    vehicle = moored()
    journal = Journal(path, mode="HOLD", armed=False)
    with pytest.raises(PreconditionFailed, match="still in progress"):
        restore(vehicle, path)
    journal.leave()
    assert vehicle.server.now == pytest.approx(4.1)


def test_a_radio_loss_while_restoring_is_waited_out(path: Path) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    restore(vehicle, path, Fault("silence", 0.05, 20.0, sent="PARAM_SET"))
    assert vehicle.condition().differs_from(found, {}) == []


def test_a_vehicle_that_restarts_after_its_mode_was_restored_is_restored_again(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    looked = []
    plain = _Restoring._check_neutral

    def look(self: _Restoring) -> None:
        plain(self)
        looked.append(vehicle.condition().mode)
        if len(looked) == 1:
            vehicle.server.reboot_soon()

    monkeypatch.setattr(_Restoring, "_check_neutral", look)
    restore(vehicle, path)
    assert looked == [found.mode, found.mode]
    assert vehicle.condition().differs_from(found, {}) == []
    assert Journal.read(path).is_settled


def test_a_value_that_cannot_be_restored_is_reported_and_the_others_are_restored(path: Path) -> None:
    vehicle = moored()
    found = vehicle.condition()
    borrow(vehicle, path)
    vehicle.deaf_to.add("ATC_STR_RAT_I")
    with pytest.raises(NotAsFound, match=r"ATC_STR_RAT_I.*again") as caught:
        restore(vehicle, path)
    assert set(caught.value.differences) == {"ATC_STR_RAT_I"}
    assert [d.split()[0] for d in vehicle.condition().differs_from(found, {})] == ["ATC_STR_RAT_I"]
    assert set(Journal.open_debts(path)) == {"ATC_STR_RAT_I"}
    vehicle.deaf_to.clear()
    restore(vehicle, path)
    assert vehicle.condition().differs_from(found, {}) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        Fault("unplugged", 0.05, sent="PARAM_SET", count=2),
        Fault("silence", 1.0, sent="PARAM_SET", count=4),
        Fault("silence", 1.0, 12.0, sent="PARAM_SET", count=4),
        Fault("reboot", 3.0, size=4.0, sent="PARAM_SET", count=4),
        Fault("disk-full", 0.0, sent="PARAM_SET", count=4),
        Fault("forged-own", 0.0, size=0.5, way="down"),
        Fault("stuck", 2.0, size=1.0, sent="PARAM_SET", count=4),
    ],
    ids=lambda fault: f"{fault.kind}-{fault.duration:g}",
)
def test_a_fault_during_a_tune_leaves_a_permitted_state_or_is_reported(fault: Fault) -> None:
    outcome = run_case(Case.of(VIDEORAY, fault))
    assert outcome.failures == []
    assert outcome.writes > 0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc for open files")
def test_the_journal_is_closed_after_every_ending(tmp_path: Path) -> None:
    run_case(Case.of(VIDEORAY, Fault("unplugged", 5.0)), tmp_path)
    open_files = [str(entry.readlink()) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()]
    assert str(tmp_path / "run" / "journal.jsonl") not in open_files


@pytest.mark.parametrize(
    ("outputs", "words"),
    [
        ({"N": 0.03, "X": -0.03}, ""),
        ({"N": 0.031, "X": 0.0}, "N +0.03 of full output"),
        ({"N": 0.0, "X": -0.5}, "X -0.50 of full output"),
        ({"N": math.nan}, "N +nan of full output"),
        ({}, "outputs are not reported"),
    ],
)
def test_outputs_not_neutral_or_not_received_are_reported(
    monkeypatch: pytest.MonkeyPatch, outputs: dict[str, float], words: str
) -> None:
    monkeypatch.setattr(restore_module, "read_servo_map", lambda *args: None)
    monkeypatch.setattr(restore_module, "read_outputs", lambda *args: outputs)
    restoring = object.__new__(_Restoring)
    restoring._session = restoring._parameters = None  # type: ignore[assignment]
    restoring._firmware = FIRMWARE["ardurover"]
    if not words:
        restoring._check_neutral()
        return
    with pytest.raises(NotAsFound) as caught:
        restoring._check_neutral()
    assert words in str(caught.value)
    assert "Take over by hand" in str(caught.value)


@pytest.mark.parametrize(
    ("lost", "returns", "done"), [(0, True, True), (1, True, True), (2, True, False), (1, False, False)]
)
def test_an_action_is_retried_once_when_the_vehicle_returns(lost: int, returns: bool, done: bool) -> None:
    restoring = object.__new__(_Restoring)
    restoring._session = SimpleNamespace(outlast=lambda patience: returns)  # type: ignore[assignment]
    restoring._differences = {}
    tried: list[int] = []

    def act() -> None:
        tried.append(1)
        if len(tried) <= lost:
            raise LinkLost("silent")

    restoring._try("mode", act)
    assert restoring._differences == ({} if done else {"mode": "silent"})
    assert len(tried) == (min(lost, 1) + 1 if returns else 1)


def journal_in(folder: Path, *, link: str = "udp:1.2.3.4:5", settled: bool = False) -> Path:
    folder.mkdir(parents=True)
    rows = [{"event": "opened", "vehicle": {"system": 1, "autopilot": 3, "vehicle_type": 11}, "link": link}]
    rows += [{"event": "closed"}] if settled else []
    path = folder / "journal.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def test_the_link_of_a_run_is_read_from_its_journal_by_folder_or_file(tmp_path: Path) -> None:
    path = journal_in(tmp_path / "run")
    beside = tmp_path / "run" / "parameters_before.param"
    for named in (tmp_path / "run", path, beside):
        assert link_of(named) == "udp:1.2.3.4:5"
    (tmp_path / "else").mkdir()
    silent = journal_in(tmp_path / "silent", link="")
    for nowhere in (tmp_path / "else", tmp_path / "else" / "a.param", silent):
        with pytest.raises(UsageError, match="no run records how the vehicle was connected"):
            link_of(nowhere)


def test_without_a_name_the_newest_unsettled_run_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert is_settled(None), "there is none"
    for age, (name, settled) in enumerate((("new", True), ("open", False), ("old", False))):
        path = journal_in(tmp_path / "runs" / name, link=name, settled=settled)
        os.utime(path, (1e9 - age, 1e9 - age))
    assert link_of(None) == "open"
    assert not is_settled(None)
    assert is_settled(tmp_path / "runs" / "new")
    assert settled_words(tmp_path / "runs" / "new").endswith("/runs/new has already restored everything.")
    assert not is_settled(tmp_path / "runs" / "old" / "journal.jsonl")
    with pytest.raises(UsageError, match="does not exist"):
        is_settled(tmp_path / "runs" / "none")


def test_a_script_that_the_run_left_on_the_card_is_removed(tmp_path):
    vehicle, path, script = moored(), tmp_path / "journal.jsonl", "APM/scripts/left.lua"
    borrow(vehicle, path)
    vehicle.server.vehicle.card[script] = b"return"
    journal = Journal.resume(path)
    journal.record("script_writing", path=script)
    journal.leave()
    restore(vehicle, path)
    assert vehicle.server.vehicle.card == {}
    assert is_settled(path)
