"""A journal line by line: the debts after each event, and what is closed when writing fails."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs_autotune.errors import BadFile, PreconditionFailed
from gcs_autotune.link import Journal, JournalState
from gcs_autotune.link.parameters import journal as journal_module
from gcs_autotune.link.parameters.journal import good_length, read_journal
from gcs_autotune.mavlink import VehicleIdentity


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


def state_of(path: Path, *events: dict[str, Any]) -> JournalState:
    path.write_text("".join(json.dumps(event) + "\n" for event in events))
    return read_journal(path)


def event(kind: str, /, **details: Any) -> dict[str, Any]:
    return {"event": kind, **details}


def lent(name: str, value: float) -> dict[str, Any]:
    return event("lent", name=name, value=value)


def writing(name: str, value: float) -> dict[str, Any]:
    return event("writing", name=name, value=value)


OPENED = event("opened", vehicle={"system": 1}, link="memory", mode="HOLD", armed=False, fingerprint={"RC1_TRIM": 1501})


def test_the_initial_state_is_read_from_the_first_line(path: Path) -> None:
    state = state_of(path, OPENED, event("opened", mode="MANUAL", armed=True))
    assert (state.vehicle, state.link, state.mode, state.armed) == ({"system": 1}, "memory", "HOLD", False)
    assert state.fingerprint == {"RC1_TRIM": 1501.0}
    bare = state_of(path, event("opened"))
    assert (bare.vehicle, bare.link, bare.mode, bare.armed, bare.fingerprint) == ({}, "", "", None, {})
    assert bare.opened and not bare.closed


def test_a_debt_is_the_value_lent_before_the_first_write(
    path: Path,
) -> None:
    state = state_of(path, OPENED, lent("P", 0.2), lent("I", 0.1), writing("P", 0.5), lent("P", 0.5), writing("P", 0.6))
    assert state.debts == {"P": 0.2}
    assert state.written == {"P": (0.5, 0.6)}
    assert not state.is_settled
    both = state_of(path, OPENED, lent("P", 0.2), lent("I", 0.1), writing("P", 0.5), writing("I", 0.3))
    assert both.debts == {"P": 0.2, "I": 0.1}


@pytest.mark.parametrize("settled", [event("returned", name="P", value=0.2), event("kept", values={"P": 0.5})])
def test_a_returned_or_kept_parameter_is_no_longer_owed(path: Path, settled: dict[str, Any]) -> None:
    events = [OPENED, lent("P", 0.2), lent("I", 0.1), writing("P", 0.5), writing("I", 0.3), settled]
    state = state_of(path, *events)
    assert (state.debts, state.written) == ({"I": 0.1}, {"I": (0.3,)})
    assert state_of(path, *events, settled).debts == {"I": 0.1}, "recorded twice"
    assert state_of(path, *events, event("closed")).is_settled is False
    done = state_of(path, *events, event("returned", name="I", value=0.1), event("closed"))
    assert done.is_settled and done.closed


def test_a_resumed_journal_is_open_again(path: Path) -> None:
    assert state_of(path, OPENED, event("closed")).is_settled
    again = state_of(path, OPENED, event("closed"), event("resumed"))
    assert not again.closed and not again.is_settled
    assert state_of(path).is_settled and not state_of(path).opened


@pytest.mark.parametrize(
    "bad",
    [
        event("lent", name="P"),
        event("lent", name="P", value="much"),
        event("writing", name="never lent", value=1.0),
        event("returned"),
        event("kept"),
        event("opened", vehicle=3),
        event("opened", fingerprint=[1.0]),
    ],
)
def test_an_invalid_event_raises_bad_file(path: Path, bad: dict[str, Any]) -> None:
    with pytest.raises(BadFile, match="has an invalid event"):
        state_of(path, *([] if bad["event"] == "opened" else [OPENED]), bad)


def test_a_file_of_only_damage_owes_nothing(path: Path) -> None:
    path.write_bytes(b"\0\0\n\0\0\n\0\0\n")
    assert read_journal(path).is_settled
    assert good_length(path.read_bytes()) == 0
    path.unlink()
    with pytest.raises(BadFile, match="cannot be read: No such file"):
        read_journal(path)


def test_complete_lines_are_counted_to_the_byte() -> None:
    line = b'{"event": "x"}\n'
    assert good_length(line + line) == 2 * len(line)
    assert good_length(line + line[:-1]) == 2 * len(line) - 1
    assert good_length(line + b"\n\n" + line) == 2 * len(line) + 2
    for tail in (b"{", b"\0\0\0", b"\n\n", b"7\n", b'{"event": 3}\n'):
        assert good_length(line + tail) == len(line)


def events_of(path: Path) -> list[str]:
    return [json.loads(line)["event"] for line in path.read_text().splitlines()]


def test_an_empty_journal_is_resumed_from_its_first_byte(path: Path) -> None:
    path.write_bytes(b"")
    Journal.resume(path).close()
    assert path.read_text().startswith('{"event": "resumed"')
    path.write_bytes(b'{"event": "opened"}\n{"event": "le')
    Journal.resume(path).close()
    assert events_of(path) == ["opened", "resumed", "closed"]


def test_every_line_has_its_time_and_the_first_contains_the_initial_state(path: Path) -> None:
    times = iter("abc")
    vehicle = VehicleIdentity(1, 1, 3, 11, "ArduRover", "4.6.0", uid="ab")
    journal = Journal(path, vehicle=vehicle, link="memory", mode="HOLD", armed=True, fingerprint={"P": 1.0},
                      stamp=lambda: next(times))  # fmt: skip
    journal.record("lent", name="P", value=0.5)
    journal.close()
    first, second, last = (json.loads(line) for line in path.read_text().splitlines())
    assert first == {
        "event": "opened", "time": "a", "schema": 1, "vehicle": vehicle.to_dict(), "link": "memory", "mode": "HOLD",
        "armed": True, "fingerprint": {"P": 1.0},
    }  # fmt: skip
    assert second == {"event": "lent", "time": "b", "name": "P", "value": 0.5}
    assert last == {"event": "closed", "time": "c"}
    assert journal.path == path


def test_leaving_twice_is_harmless_and_a_journal_left_is_not_written_again(path: Path) -> None:
    journal = Journal(path)
    journal.leave()
    journal.leave()
    with pytest.raises(PreconditionFailed, match="cannot be written"):
        journal.record("lent", name="P", value=0.2)
    with pytest.raises(PreconditionFailed):
        journal.close()
    assert events_of(path) == ["opened"]


def full(*_: object) -> int:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("begin", [Journal, Journal.resume], ids=["new", "resumed"])
@pytest.mark.parametrize("call", ["write", "fsync"])
def test_a_journal_that_cannot_be_begun_is_closed(
    path: Path, monkeypatch: pytest.MonkeyPatch, begin: Callable[[Path], Journal], call: str
) -> None:
    Journal(path).leave()
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(journal_module.os, call, full)
        with pytest.raises(PreconditionFailed, match=r"No space left on device.*so no parameter may be"):
            begin(path)
    assert path.read_bytes() == before, "no partial line is left"
    begin(path).close()


def test_a_journal_whose_tail_cannot_be_cut_off_is_closed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Journal(path).leave()
    path.write_bytes(path.read_bytes() + b"{")
    with monkeypatch.context() as patch:
        patch.setattr(journal_module.os, "ftruncate", full)
        with pytest.raises(PreconditionFailed, match="No space left"):
            Journal.resume(path)
    Journal.resume(path).close()


@pytest.mark.skipif(os.name != "posix", reason="locks of this kind are POSIX's")
@pytest.mark.parametrize(("number", "words"), [(errno.EACCES, "still in progress"), (errno.EAGAIN, "still in progress"),
                                               (errno.EIO, "cannot be written (broken)")])  # fmt: skip
def test_a_lock_held_elsewhere_is_distinguished_from_a_failing_lock(
    path: Path, monkeypatch: pytest.MonkeyPatch, number: int, words: str
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, "broken")

    closed: list[int] = []
    close = os.close
    monkeypatch.setattr(journal_module.os, "close", lambda descriptor: closed.append(descriptor) or close(descriptor))
    monkeypatch.setattr(journal_module.fcntl, "flock", refuse)
    with pytest.raises(PreconditionFailed) as caught:
        Journal(path)
    assert words in str(caught.value)
    assert len(closed) == 1


@pytest.mark.skipif(os.name != "posix", reason="modes of files are POSIX's")
def test_others_may_read_the_journal_and_only_the_owner_writes(path: Path) -> None:
    mask = os.umask(0)
    try:
        Journal(path).leave()
    finally:
        os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


def test_every_line_and_every_repair_is_synced_to_disk(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[bool] = []
    monkeypatch.setattr(journal_module, "_sync", lambda descriptor: synced.append(descriptor >= 0))
    journal = Journal(path)
    journal.record("lent", name="P", value=0.2)
    journal.leave()
    assert synced == [True, True]
    Journal.resume(path).leave()
    assert synced == [True] * 4
