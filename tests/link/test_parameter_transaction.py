"""Journal and transaction: the vehicle is restored in every case, or the journal lists what is not."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import (
    BadFile,
    LinkLost,
    NoReply,
    NotAsFound,
    OperatorStopped,
    ParameterMissing,
    ParameterNotAccepted,
    PreconditionFailed,
)
from gcs_autotune.link import Journal, MemoryLink, Parameters, ParameterTransaction, Session
from gcs_autotune.link.parameters import journal as journal_module

P, INT, FF = "ATC_STR_RAT_P", "ATC_STR_RAT_I", "ATC_STR_RAT_FF"
OLD = {P: 0.2, INT: 0.1, FF: 0.75}
NEW = {P: 0.5, INT: 0.4, FF: 1.5}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


@pytest.fixture
def transaction(parameters: Parameters, path: Path) -> ParameterTransaction:
    session = parameters.session
    journal = Journal(
        path, vehicle=session.vehicle, link="memory", mode="HOLD", armed=False, stamp=lambda: "2026-01-01T00:00:00"
    )
    return ParameterTransaction(parameters, journal)


def held(boat: ScriptedVehicle) -> dict[str, float]:
    return {name: boat.parameters[name] for name in OLD}


def test_lending_reads_and_journals_the_initial_values(transaction: ParameterTransaction, path: Path) -> None:
    assert transaction.lend(OLD) == pytest.approx(OLD)
    events = [json.loads(line) for line in path.read_text().splitlines()]
    assert [e["event"] for e in events] == ["opened", "lent", "lent", "lent"]
    assert Journal.open_debts(path) == {}


def test_a_value_set_is_in_the_vehicle_and_owed_in_the_journal(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    transaction.set(NEW)
    assert held(boat) == pytest.approx(NEW)
    assert Journal.open_debts(path) == pytest.approx(OLD)


def test_restoring_writes_in_reverse_order_and_settles_the_debt(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    transaction.set(NEW)
    transaction.give_back()
    assert held(boat) == pytest.approx(OLD)
    assert Journal.open_debts(path) == {}
    assert [m.param_id for m in boat.heard if m.get_type() == "PARAM_SET"] == [P, INT, FF, FF, INT, P]


def test_keeping_leaves_the_new_values_and_owes_nothing(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    transaction.set(NEW)
    assert transaction.keep() == pytest.approx(NEW)
    transaction.give_back()
    assert held(boat) == pytest.approx(NEW)
    assert Journal.open_debts(path) == {}


def test_a_write_after_keeping_owes_the_kept_values(transaction: ParameterTransaction, path: Path) -> None:
    transaction.set(NEW)
    transaction.keep()
    transaction.set({P: 0.9})
    assert Journal.open_debts(path) == {P: pytest.approx(0.5)}


def test_leaving_the_context_restores_also_after_an_error(
    transaction: ParameterTransaction, boat: ScriptedVehicle
) -> None:
    with pytest.raises(LinkLost), transaction:
        transaction.set(NEW)
        raise LinkLost("the worst moment")
    assert held(boat) == pytest.approx(OLD)


def test_one_refused_value_restores_all_values(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    boat.read_only.add(FF)
    with pytest.raises(ParameterNotAccepted, match=FF):
        transaction.set(NEW)
    assert held(boat) == pytest.approx(OLD)
    assert Journal.open_debts(path) == {}


def test_a_missing_name_writes_nothing(transaction: ParameterTransaction, boat: ScriptedVehicle) -> None:
    with pytest.raises(ParameterMissing):
        transaction.set({**NEW, "NO_SUCH_THING": 1.0})
    assert boat.count("PARAM_SET") == 0


def test_values_that_could_not_be_restored_are_reported_and_stay_owed(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    transaction.set(NEW)
    boat.read_only.add(INT)
    with pytest.raises(NotAsFound, match=INT) as caught:
        transaction.give_back()
    assert set(caught.value.differences) == {INT}
    assert held(boat) == pytest.approx({**OLD, INT: NEW[INT]})
    assert Journal.open_debts(path) == {INT: pytest.approx(OLD[INT])}
    boat.read_only.clear()
    transaction.give_back()
    assert held(boat) == pytest.approx(OLD)
    assert Journal.open_debts(path) == {}


def test_a_link_lost_while_setting_is_reported_with_the_owed_values(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle
) -> None:
    def die_at_the_second(m: Any) -> None:
        boat._on_param_set(m)
        boat.alive = m.param_id == P

    boat.on["PARAM_SET"] = die_at_the_second
    with pytest.raises(NotAsFound) as caught:
        transaction.set(NEW)
    assert {P, INT} <= set(caught.value.differences)
    assert set(Journal.open_debts(path)) == set(caught.value.differences)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 60))
def test_the_operator_can_stop_at_any_pump_and_all_values_are_restored(tmp_path: Path, pumps: int) -> None:
    boat, left = ScriptedVehicle(), [10**9]

    def stop() -> bool:
        left[0] -= 1
        return left[0] < 0

    session = Session(MemoryLink(boat), interrupt=stop)
    session.discover()
    path = tmp_path / f"{pumps}.jsonl"
    left[0] = pumps
    journal = Journal(path)
    try:
        with ParameterTransaction(Parameters(session), journal) as transaction:
            transaction.set(NEW)
            session.pause(2.0)
            raise OperatorStopped("at the end")
    except OperatorStopped:
        pass
    journal.close()
    path.unlink()
    assert held(boat) == pytest.approx(OLD)


class PowerCut(BaseException):
    """No code of this program runs after it."""


@pytest.mark.parametrize("last", range(1, 8))
def test_after_a_power_cut_at_any_event_the_journal_covers_every_change(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle, last: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsync, events = os.fsync, [0]

    def cut(descriptor: int) -> None:
        fsync(descriptor)
        events[0] += 1
        if events[0] >= last:
            raise PowerCut

    monkeypatch.setattr(journal_module.os, "fsync", cut)
    with pytest.raises(PowerCut):
        transaction.set(NEW)
    changed = {n for n in OLD if boat.parameters[n] != pytest.approx(OLD[n])}
    debts = Journal.open_debts(path)
    assert changed <= set(debts)
    assert all(debts[n] == pytest.approx(OLD[n]) for n in changed)


# --- the journal itself --------------------------------------------------------------------------------


def test_the_journal_contains_the_initial_state(transaction: ParameterTransaction, path: Path) -> None:
    state = Journal.read(path)
    assert (state.mode, state.armed, state.link, state.closed) == ("HOLD", False, "memory", False)
    assert state.vehicle["vehicle_type"] == 11


def test_a_truncated_last_line_is_ignored_but_a_damaged_line_before_is_not(
    transaction: ParameterTransaction, path: Path
) -> None:
    transaction.set(NEW)
    text = path.read_text()
    path.write_text(text[:-10])
    assert Journal.open_debts(path) == pytest.approx(OLD)
    lines = text.splitlines()
    lines[2] = lines[2][:-5]
    path.write_text("\n".join(lines))
    with pytest.raises(BadFile, match="line 3"):
        Journal.open_debts(path)


def test_an_invalid_journal_raises_bad_file(path: Path) -> None:
    path.write_text('{"event": "writing", "name": "A", "value": 1}\n')
    with pytest.raises(BadFile, match="invalid event"):
        Journal.read(path)
    with pytest.raises(BadFile, match="cannot be read"):
        Journal.read(path.with_name("none"))


def test_without_a_journal_no_parameter_is_changed(tmp_path: Path) -> None:
    with pytest.raises(PreconditionFailed, match="no parameter may be changed"):
        Journal(tmp_path / "no" / "journal.jsonl")


def full_disk() -> Callable[..., int]:
    def write(*_: object) -> int:
        raise OSError(28, "No space left on device")

    return write


def test_a_full_disk_prevents_every_write(
    transaction: ParameterTransaction, boat: ScriptedVehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module.os, "write", full_disk())
    with pytest.raises(PreconditionFailed, match="No space left"):
        transaction.set(NEW)
    assert boat.count("PARAM_SET") == 0


def test_a_disk_that_fills_up_does_not_prevent_restoring(
    transaction: ParameterTransaction, boat: ScriptedVehicle, parameters: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    transaction.set(NEW)
    monkeypatch.setattr(journal_module.os, "write", full_disk())
    transaction.give_back()
    assert held(boat) == pytest.approx(OLD)
    assert len(parameters.session.notes) == 3


class Counted:
    """Parameters behind a link: counts writes and looks; ``lost`` names are answered with silence."""

    def __init__(self) -> None:
        self.session = SimpleNamespace(operator=SimpleNamespace(shielded=nullcontext), outlast=self.outlast, notes=[])
        self.held = dict(OLD)
        self.writes: list[str] = []
        self.looks = self.waited = 0
        self.lost: set[str] = set()
        self.fails: dict[str, list[Exception]] = {}
        self.undone: list[dict[str, float]] = []
        self.asked: list[list[str]] = []
        self.watched: list[str] = []
        self.intrusions: list[tuple[str, float, float]] = []

    def outlast(self, patience: float) -> bool:
        assert patience == 30.0, "a boat behind a pier comes out again"
        self.waited += 1
        return False

    def read_confirmed(self, names: Iterable[str]) -> dict[str, float]:
        self.looks += 1
        self.asked.append(list(names))
        if self.undone:
            self.held.update(self.undone.pop(0))
        return {n: self.held[n] for n in self.asked[-1]}

    def write(self, name: str, value: float) -> None:
        self.writes.append(name)
        if name in self.lost:
            raise LinkLost("silence")
        if self.fails.get(name):
            raise self.fails[name].pop(0)
        self.held[name] = value

    def watch(self, values: Mapping[str, float]) -> None:
        self.watched += values

    def unwatch(self, names: Iterable[str]) -> None:
        self.watched = [name for name in self.watched if name not in set(names)]


def counted(path: Path) -> tuple[ParameterTransaction, Counted]:
    parameters = Counted()
    transaction = ParameterTransaction(cast(Parameters, parameters), Journal(path, stamp=lambda: "now"))
    transaction.set(NEW)
    parameters.writes.clear()
    parameters.asked.clear()
    parameters.looks = 0
    return transaction, parameters


def test_lent_parameters_are_watched_until_they_are_restored(path: Path) -> None:
    transaction, parameters = counted(path)
    assert parameters.watched == [P, INT, FF]
    transaction.set({P: 0.6})
    assert parameters.watched == [P, INT, FF], "what was lent is not read again"
    transaction.give_back()
    assert parameters.watched == []


def test_a_value_written_twice_is_restored_once_in_the_order_of_the_last_writes(path: Path) -> None:
    transaction, parameters = counted(path)
    transaction.set({P: 0.6})
    assert transaction.written == [INT, FF, P]
    parameters.writes.clear()
    transaction.give_back()
    assert parameters.writes == [P, FF, INT]
    assert parameters.held == OLD


def test_an_unanswered_write_is_repeated_and_the_others_are_only_checked(path: Path) -> None:
    transaction, parameters = counted(path)
    parameters.fails = {INT: [NoReply("no answer")]}
    transaction.give_back()
    assert parameters.writes == [FF, INT, P, INT]
    assert parameters.asked == [[P, FF], [P, INT, FF]]
    assert parameters.held == OLD


def test_a_restored_value_undone_by_a_late_write_is_restored_again_a_few_times(path: Path) -> None:
    transaction, parameters = counted(path)
    parameters.undone = [{INT: 0.4}]
    transaction.give_back()
    assert parameters.writes == [FF, INT, P, INT]
    assert parameters.held == OLD
    transaction, parameters = counted(path.with_name("again.jsonl"))
    parameters.undone = [{INT: 0.4}] * 9
    with pytest.raises(NotAsFound, match="could not restore ATC_STR_RAT_I") as caught:
        transaction.give_back()
    assert parameters.writes == [FF, INT, P, INT, INT]
    assert "it changed to 0.4 again after it was restored" in caught.value.differences[INT]


def test_values_that_cannot_be_checked_stay_owed_though_written(path: Path) -> None:
    transaction, parameters = counted(path)
    parameters.read_confirmed = lambda names: (_ for _ in ()).throw(LinkLost("silence"))  # type: ignore[method-assign]
    with pytest.raises(NotAsFound) as caught:
        transaction.give_back()
    assert set(caught.value.differences) == {P, INT, FF}
    assert transaction.written == [P, INT, FF]
    assert Journal.open_debts(path) == OLD


def test_leaving_without_a_write_neither_writes_nor_checks(path: Path) -> None:
    transaction, parameters = counted(path)
    transaction.give_back()
    parameters.writes.clear()
    parameters.looks = 0
    with transaction:
        pass
    assert (parameters.writes, parameters.looks) == ([], 0)


def test_a_refused_value_is_written_only_once(path: Path) -> None:
    transaction, parameters = counted(path)
    parameters.fails = {INT: [ParameterNotAccepted("refused", name=INT, wanted=0.1, found=0.4)] * 9}
    with pytest.raises(NotAsFound):
        transaction.give_back()
    assert parameters.writes == [FF, INT, P]
    assert parameters.asked == [[P, FF]]


def test_restoring_writes_each_value_once_in_reverse_order_and_checks_once(path: Path) -> None:
    transaction, parameters = counted(path)
    transaction.give_back()
    assert parameters.writes == [FF, INT, P]
    assert (parameters.looks, parameters.waited) == (1, 0)
    assert (transaction.written, transaction.old) == ([], {})


def test_a_silent_link_is_awaited_before_it_is_written_again(path: Path) -> None:
    transaction, parameters = counted(path)
    parameters.lost = {INT}
    with pytest.raises(NotAsFound, match="could not restore") as caught:
        transaction.give_back()
    assert parameters.writes == [FF, INT, P]
    assert (parameters.looks, parameters.waited) == (0, 1)
    assert set(caught.value.differences) == {INT}
    assert transaction.written == [INT] and Journal.open_debts(path) == {INT: OLD[INT]}


def test_a_journal_line_that_is_json_but_not_an_event_is_damage(path: Path) -> None:
    Journal(path, stamp=lambda: "now").leave()
    good = path.read_text()
    for line in ("[1, 2]", "7", '"opened"', "null", "{}", '{"event": 3}', '{"name": "P"}'):
        path.write_text(good + line + "\n" + good)
        with pytest.raises(BadFile, match="line 2, is damaged"):
            Journal.read(path)
        path.write_text(good + line + "\n")
        assert Journal.read(path).opened, "at its end it is what a power cut left"


def test_an_error_on_leaving_is_reported_with_the_values_not_restored(
    transaction: ParameterTransaction, boat: ScriptedVehicle
) -> None:
    with pytest.raises(NotAsFound, match="the worst moment; and could not restore " + INT) as caught, transaction:
        transaction.set(NEW)
        boat.read_only.add(INT)
        raise ParameterNotAccepted("the worst moment", name=P, wanted=0.0, found=1.0)
    assert isinstance(caught.value.__cause__, ParameterNotAccepted)


def test_leaving_without_an_error_reports_only_the_values_not_restored(
    transaction: ParameterTransaction, boat: ScriptedVehicle
) -> None:
    with pytest.raises(NotAsFound, match="^could not restore " + INT) as caught, transaction:
        transaction.set(NEW)
        boat.read_only.add(INT)
    assert caught.value.__cause__ is None


def test_leaving_without_a_write_stops_watching(transaction: ParameterTransaction, boat: ScriptedVehicle) -> None:
    with transaction:
        transaction.lend(OLD)
    assert transaction.old == {}
    assert boat.count("PARAM_SET") == 0
    boat.parameters[P] = 0.9
    boat.send_parameter(P)
    transaction._session.pause(2.0)
    assert transaction._parameters.intrusions == []


def test_a_link_lost_while_restoring_is_awaited_and_all_values_are_restored(
    transaction: ParameterTransaction, boat: ScriptedVehicle
) -> None:
    transaction.set(NEW)
    written: list[str] = []
    known = transaction._parameters.write

    def write(name: str, value: float) -> None:
        written.append(name)
        if len(written) == 2:
            raise LinkLost("behind a pier")
        known(name, value)

    transaction._parameters.write = write  # type: ignore[method-assign]
    transaction.give_back()
    assert held(boat) == pytest.approx(OLD)
    assert written == [FF, INT, P, FF, INT, P]


@pytest.mark.parametrize("name", [P, INT, FF])
def test_no_value_is_kept_when_one_differs_from_the_tested_value(
    transaction: ParameterTransaction, path: Path, boat: ScriptedVehicle, name: str
) -> None:
    transaction.set(NEW)
    boat.parameters[name] = 0.33
    with pytest.raises(ParameterNotAccepted, match=f"{name} is 0.33, but was tested with {NEW[name]:g}") as caught:
        transaction.keep()
    assert (caught.value.wanted, caught.value.found) == (pytest.approx(NEW[name]), pytest.approx(0.33))
    assert Journal.open_debts(path) == pytest.approx(OLD)
    transaction.give_back()
    assert held(boat) == pytest.approx({**OLD, name: 0.33}), "what another station wrote stands"
    assert f"{name} stays at 0.33, written by another station" in transaction._session.notes[-1]
    assert Journal.open_debts(path) == {}


def test_a_gain_changed_elsewhere_without_notice_is_not_overwritten(
    transaction: ParameterTransaction, boat: ScriptedVehicle
) -> None:
    transaction._parameters.watch(OLD)
    boat.parameters[P] = 0.33
    with pytest.raises(PreconditionFailed, match=f"another ground station wrote {P} = 0.33"):
        transaction.set(NEW)
    assert boat.count("PARAM_SET") == 0


def test_the_journal_uses_the_stronger_sync_where_the_system_has_one(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """macOS keeps synced data in the drive's cache until F_FULLFSYNC."""
    requested: list[int] = []
    system = SimpleNamespace(**{n: getattr(journal_module.fcntl, n) for n in ("flock", "LOCK_EX", "LOCK_NB")})
    system.F_FULLFSYNC, system.fcntl = 51, lambda descriptor, command: requested.append(command)
    monkeypatch.setattr(journal_module, "fcntl", system)
    journal = Journal(path)
    journal.record("writing", name="A", value=1.0)
    journal.close()
    assert requested and set(requested) == {51}


@pytest.mark.skipif(os.name != "posix", reason="a folder can be synced on POSIX systems only")
def test_the_folders_of_a_new_journal_are_synced_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsync, synced = os.fsync, set()

    def noting(descriptor: int) -> None:
        synced.add(os.fstat(descriptor).st_ino)
        fsync(descriptor)

    monkeypatch.setattr(journal_module.os, "fsync", noting)
    folder = tmp_path / "run"
    folder.mkdir()
    Journal(folder / "journal.jsonl").close()
    assert {folder.stat().st_ino, tmp_path.stat().st_ino} <= synced
