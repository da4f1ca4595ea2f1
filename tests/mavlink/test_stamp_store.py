"""The signing time that outlives a run: half a minute is reserved at a time, and it only grows."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.mavlink import StampStore
from gcs_autotune.mavlink.signing import state_folder

SECOND = 100_000
"""Signing time is counted in units of 10 us."""


def held(folder: Path) -> int:
    return int((folder / "signing-time").read_text())


def test_half_a_minute_beyond_the_stamp_is_on_the_disk_before_it_is_used(tmp_path: Path) -> None:
    store = StampStore(tmp_path / "state")
    assert (store.last, store.trouble) == (0, "")
    store.reach(500 * SECOND)
    assert held(tmp_path / "state") == 530 * SECOND
    store.reach(530 * SECOND - 1)
    assert held(tmp_path / "state") == 530 * SECOND, "it is reserved still"
    store.reach(530 * SECOND)
    assert held(tmp_path / "state") == 560 * SECOND
    assert store.last == 0, "what earlier runs had reached"


def test_the_next_run_and_another_program_begin_beyond_what_was_reserved(tmp_path: Path) -> None:
    first, other = StampStore(tmp_path), StampStore(tmp_path)
    first.reach(500 * SECOND)
    other.reach(400 * SECOND)
    assert held(tmp_path) == 560 * SECOND, "a clock that is behind takes nothing back"
    assert StampStore(tmp_path).last == 560 * SECOND


@pytest.mark.parametrize("spoil", [lambda path: path.write_text("much\n"), lambda path: path.mkdir()])
def test_a_file_that_cannot_be_kept_is_told_of_once_and_stops_nothing(tmp_path: Path, spoil) -> None:
    spoil(tmp_path / "signing-time")
    store = StampStore(tmp_path)
    assert store.last == 0
    assert f"the signing time of earlier runs ({tmp_path / 'signing-time'}) cannot be stored" in store.trouble
    said = store.trouble
    store.reach(5 * SECOND)
    assert store.trouble == said


@pytest.mark.parametrize(("system", "folder"), [("win32", "local"), ("linux", "state"), ("darwin", "state")])
def test_what_outlives_a_run_is_kept_where_each_system_keeps_such_things(
    system: str, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / folder / "gcs-autotune"
