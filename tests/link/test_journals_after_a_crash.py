"""A journal after a power cut, a full disk or a second program, and how it is recovered."""

from __future__ import annotations

import json
import os
import random
from pathlib import Path

import pytest

from gcs_autotune.errors import BadFile, PreconditionFailed
from gcs_autotune.link import Journal
from gcs_autotune.link.parameters import journal as journal_module


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


def written(path: Path) -> bytes:
    """A journal cut off with one parameter owed."""
    journal = Journal(path, mode="HOLD", armed=False, link="memory", fingerprint={"RC1_TRIM": 1501.0})
    journal.record("lent", name="P", value=0.2)
    journal.record("writing", name="P", value=0.5)
    journal.record("written", name="P", value=0.5)
    journal.leave()
    return path.read_bytes()


TAILS = (b"", b"{", b'{"event": "kept", "values": {"P"', b"\0" * 700, b"\xff\xfe\n\x00garbage\n", b"\n\n")


@pytest.mark.parametrize("tail", TAILS)
def test_a_torn_tail_is_ignored_and_removed_when_the_journal_is_resumed(path: Path, tail: bytes) -> None:
    path.write_bytes(written(path) + tail)
    assert Journal.open_debts(path) == {"P": 0.2}
    journal = Journal.resume(path)
    journal.record("returned", name="P", value=0.2)
    journal.close()
    state = Journal.read(path)
    assert state.is_settled and state.mode == "HOLD" and state.fingerprint == {"RC1_TRIM": 1501.0}
    assert all(json.loads(line) for line in path.read_text().splitlines() if line)


@pytest.mark.parametrize("settled", [{"event": "returned", "name": "P"}, {"event": "kept", "values": {"P": 0.5}}])
def test_a_parameter_written_again_after_settling_may_hold_only_the_new_values(
    path: Path, settled: dict[str, object]
) -> None:
    again = {"event": "writing", "name": "P", "value": 0.7}
    lines = [written(path).decode(), *(json.dumps(event) + "\n" for event in (settled, again))]
    path.write_text("".join(lines))
    assert Journal.read(path).written == {"P": (0.7,)}


def test_a_journal_cut_at_any_byte_is_read_and_covers_every_write_sent(path: Path) -> None:
    data = written(path)
    sent = data.index(b'"written"')  # the line before it was on the disk when PARAM_SET left
    last_of_writing = data.rindex(b"}", 0, sent) + 1
    assert 0 < last_of_writing < len(data)
    edges = [i + d for i in range(len(data)) if data[i : i + 1] == b"\n" for d in (-1, 0, 1, 2)]
    for cut in sorted({*range(0, len(data), 37), *edges, len(data)} - {-1}):
        path.write_bytes(data[:cut])
        state = Journal.read(path)
        assert (state.debts == {"P": 0.2}) == (cut >= last_of_writing), cut
        journal = Journal.resume(path)
        journal.close()
        assert Journal.read(path).debts == state.debts


def test_a_complete_last_line_without_its_newline_counts(path: Path) -> None:
    path.write_bytes(written(path)[:-1])
    Journal.resume(path).close()
    assert [json.loads(line)["event"] for line in path.read_text().splitlines()][-3:] == [
        "written",
        "resumed",
        "closed",
    ]


def test_damage_before_the_end_is_refused_with_an_alternative(path: Path) -> None:
    lines = written(path).splitlines(keepends=True)
    path.write_bytes(lines[0] + b"\0\0\0\n" + b"".join(lines[2:]))
    with pytest.raises(BadFile, match=r"line 2.*parameters_before"):
        Journal.read(path)
    with pytest.raises(BadFile):
        Journal.resume(path)


@pytest.mark.parametrize("start", [b"", b'{"event": "open', b"\0\0\0"])
def test_a_journal_whose_first_line_was_never_written_owes_nothing(path: Path, start: bytes) -> None:
    path.write_bytes(start)
    assert Journal.read(path).is_settled


def test_two_programs_cannot_write_one_journal(path: Path) -> None:
    journal = Journal(path)
    with pytest.raises(PreconditionFailed, match="still in progress"):
        Journal.resume(path)
    journal.leave()
    Journal.resume(path).close()


def test_a_line_that_did_not_fit_on_the_disk_is_removed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal, write = Journal(path), os.write
    with monkeypatch.context() as patch:
        patch.setattr(journal_module.os, "write", lambda fd, data: write(fd, data[: len(data) // 2]))
        with pytest.raises(PreconditionFailed, match="disk is full"):
            journal.record("lent", name="P", value=0.2)
    journal.record("lent", name="P", value=0.2)
    journal.close()
    assert [json.loads(line)["event"] for line in path.read_text().splitlines()] == ["opened", "lent", "closed"]


@pytest.mark.parametrize("seed", range(60))
def test_arbitrary_damage_is_read_or_raises_bad_file(path: Path, seed: int) -> None:
    draw, data = random.Random(seed), bytearray(written(path))
    for _ in range(draw.randint(1, 6)):
        data[draw.randrange(len(data))] = draw.randrange(256)
    path.write_bytes(data)
    try:
        debts = Journal.open_debts(path)
    except BadFile:
        return
    assert set(debts) <= {"P"} or all(isinstance(v, float) for v in debts.values())
