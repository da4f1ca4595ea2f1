"""The stored signing time: half a minute is reserved at a time, and it only grows."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.mavlink import StampStore
from gcs_autotune.mavlink.signing import state_folder

SECOND = 100_000
"""Signing time is counted in units of 10 us."""


def stored_time(folder: Path) -> int:
    return int((folder / "signing-time").read_text())


def test_thirty_seconds_beyond_the_stamp_are_reserved_on_disk_before_use(tmp_path: Path) -> None:
    store = StampStore(tmp_path / "state")
    assert (store.last, store.trouble) == (0, "")
    store.reach(500 * SECOND)
    assert stored_time(tmp_path / "state") == 530 * SECOND
    store.reach(530 * SECOND - 1)
    assert stored_time(tmp_path / "state") == 530 * SECOND, "it is still reserved"
    store.reach(530 * SECOND)
    assert stored_time(tmp_path / "state") == 560 * SECOND
    assert store.last == 0, "the time that earlier runs reached"


def test_the_next_run_and_other_programs_start_beyond_the_reserved_time(tmp_path: Path) -> None:
    first, other = StampStore(tmp_path), StampStore(tmp_path)
    first.reach(500 * SECOND)
    other.reach(400 * SECOND)
    assert stored_time(tmp_path) == 560 * SECOND, "a clock that is behind reduces nothing"
    assert StampStore(tmp_path).last == 560 * SECOND


@pytest.mark.parametrize("spoil", [lambda path: path.write_text("much\n"), lambda path: path.mkdir()])
def test_a_file_that_cannot_be_stored_is_reported_once_and_is_not_fatal(tmp_path: Path, spoil) -> None:
    spoil(tmp_path / "signing-time")
    store = StampStore(tmp_path)
    assert store.last == 0
    assert f"the signing time of earlier runs ({tmp_path / 'signing-time'}) cannot be stored" in store.trouble
    trouble = store.trouble
    store.reach(5 * SECOND)
    assert store.trouble == trouble


@pytest.mark.parametrize(("system", "folder"), [("win32", "local"), ("linux", "state"), ("darwin", "state")])
def test_the_state_folder_follows_the_platform_convention(
    system: str, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / folder / "gcs-autotune"
