"""Files on the vehicle's card: written, verified, read and removed by MAVLink FTP, and a script lent to it."""

from __future__ import annotations

import json

import pytest

import sitl
from gcs_autotune.errors import BadFile, CommandDenied, NoReply, NotAsFound, PreconditionFailed
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Commands, Journal, MemoryLink, ScriptLoan, Session, script_folder
from gcs_autotune.link.file_transfer import (
    has_remote_folder,
    read_remote_file,
    remove_remote_file,
    write_remote_file,
)
from gcs_autotune.mavlink import mavlink

PATH = "APM/scripts/x.lua"
TEXT = bytes(range(256)) * 12 + b"end"


def session_of(peer, **link) -> Session:
    session = Session(MemoryLink(peer, **link))
    session.discover()
    return session


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 0), (0.1, 1), (0.1, 2), (0.1, 3)])
def test_a_file_is_written_read_and_removed_on_a_lossy_link(loss, seed):
    peer = sitl.open_vehicle("charlie")
    session = session_of(peer, loss=loss, seed=seed)
    write_remote_file(session, PATH, TEXT)
    assert peer.vehicle.card == {PATH: TEXT}
    assert read_remote_file(session, PATH) == TEXT
    remove_remote_file(session, PATH)
    assert peer.vehicle.card == {}
    remove_remote_file(session, PATH)


def test_an_existing_file_is_replaced():
    peer = sitl.open_vehicle("charlie")
    session = session_of(peer)
    write_remote_file(session, PATH, TEXT)
    write_remote_file(session, PATH, b"short")
    assert peer.vehicle.card == {PATH: b"short"}


def test_a_card_that_stores_wrong_data_is_detected(monkeypatch):
    peer = sitl.open_vehicle("charlie")
    session = session_of(peer)
    write = peer.files._write
    monkeypatch.setattr(peer.files, "_write", lambda offset, data, reply: write(offset, data[:-1] + b"?", reply))
    with pytest.raises(BadFile, match=r"not stored correctly.*Check its SD card"):
        write_remote_file(session, PATH, TEXT)


def test_a_missing_folder_is_reported():
    session = session_of(sitl.open_vehicle("charlie"))
    assert has_remote_folder(session, "APM/scripts")
    assert not has_remote_folder(session, "APM/elsewhere")
    with pytest.raises(BadFile, match="cannot create the file"):
        write_remote_file(session, "APM/elsewhere/x.lua", TEXT)


def test_a_vehicle_without_ftp_raises_no_reply(boat):
    session = session_of(boat)
    with pytest.raises(NoReply, match="MAVLink FTP"):
        script_folder(session)


def test_a_missing_scripts_folder_is_reported_with_its_cure():
    peer = sitl.open_vehicle("charlie")
    peer.vehicle.folders = ("APM",)
    with pytest.raises(PreconditionFailed, match="SCR_ENABLE 1 and an SD card"):
        script_folder(session_of(peer))


class Loaded:
    """Counts the requests to load the scripts."""

    def __init__(self) -> None:
        self.restarts = 0

    def restart(self) -> None:
        self.restarts += 1

    def tick(self) -> None:
        pass


def test_a_lent_script_is_removed_afterwards(tmp_path):
    peer = sitl.open_vehicle("charlie")
    peer.vehicle.autopilot.scripts = loaded = Loaded()
    session = session_of(peer)
    journal = Journal(tmp_path / "journal.jsonl", vehicle=session.vehicle)
    loan = ScriptLoan(session, Commands(session, FIRMWARE["ardurover"]), journal, PATH)
    loan.load("return 1")
    assert peer.vehicle.card == {PATH: b"return 1"}
    assert Journal.read(journal.path).scripts == (PATH,)
    loan.give_back()
    assert peer.vehicle.card == {}
    assert loaded.restarts == 2
    journal.close()
    assert Journal.read(journal.path).is_settled


def test_a_script_that_cannot_be_removed_stays_in_the_journal(tmp_path, monkeypatch):
    peer = sitl.open_vehicle("charlie")
    session = session_of(peer)
    journal = Journal(tmp_path / "journal.jsonl", vehicle=session.vehicle)
    loan = ScriptLoan(session, Commands(session, FIRMWARE["ardurover"]), journal, PATH)
    loan.load("return 1")
    monkeypatch.setattr(peer.files, "handle", lambda message: None)
    with pytest.raises(NotAsFound, match="gcs-autotune restore"):
        loan.give_back()
    journal.close()
    state = Journal.read(journal.path)
    assert state.scripts == (PATH,)
    assert not state.is_settled


def test_an_autopilot_without_scripting_is_reported_with_its_cure(tmp_path):
    peer = sitl.open_vehicle("charlie")
    session = session_of(peer)
    session_commands = Commands(session, FIRMWARE["ardurover"])

    def refuse(command, *values):
        raise CommandDenied("no", command=command, result=mavlink.MAV_RESULT_UNSUPPORTED)

    session_commands.command_int = refuse
    journal = Journal(tmp_path / "journal.jsonl", vehicle=session.vehicle)
    loan = ScriptLoan(session, session_commands, journal, PATH)
    with pytest.raises(PreconditionFailed, match="set SCR_ENABLE to 1 and restart it"):
        loan.load("return 1")
    loan.give_back()
    assert peer.vehicle.card == {}


@pytest.mark.parametrize("path", ["../x; rm", "", "x" * 200])
def test_a_journal_with_an_invalid_path_is_rejected(tmp_path, path):
    file = tmp_path / "journal.jsonl"
    lines = [{"event": "opened"}, {"event": "script_writing", "path": path}]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(BadFile, match="script_writing"):
        Journal.read(file)
