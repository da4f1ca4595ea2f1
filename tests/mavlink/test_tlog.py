from __future__ import annotations

import io
from pathlib import Path
from types import SimpleNamespace

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import BadFile
from gcs_autotune.mavlink import TlogReader, TlogWriter, read_tlog, tlog

LOGS = Path(__file__).parents[2] / "../shared/data/ardusub_logs"


def written(path: Path, count: int = 5) -> bytes:
    mav = mavlink.MAVLink(None, 1, 1)
    time = iter(range(count))
    log = TlogWriter(path, lambda: 1000.0 + 0.25 * next(time))
    for i in range(count):
        log.write(mavlink.MAVLink_attitude_message(i, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6).pack(mav))
    log.close()
    return path.read_bytes()


def test_a_written_log_is_read_back(tmp_path: Path) -> None:
    written(tmp_path / "a.tlog")
    log = read_tlog(tmp_path / "a.tlog")
    assert [(r.time, r.frame.message.time_boot_ms) for r in log] == [(1000.0 + 0.25 * i, i) for i in range(5)]
    assert (log.frames, log.damaged, log.truncated) == (5, 0, False)


def test_other_ground_stations_can_read_it(tmp_path: Path) -> None:
    written(tmp_path / "a.tlog")
    log = mavutil.mavlink_connection(str(tmp_path / "a.tlog"))
    assert [log.recv_msg().time_boot_ms for _ in range(5)] == list(range(5))
    log.close()


def test_a_truncated_log_returns_its_complete_frames(tmp_path: Path) -> None:
    data = written(tmp_path / "a.tlog")
    whole = len(data) // 5
    assert whole > 20
    for cut in range(1, whole):
        (tmp_path / "b.tlog").write_bytes(data[:-cut])
        log = read_tlog(tmp_path / "b.tlog")
        assert len(list(log)) == 4
        assert log.truncated


def test_damaged_bytes_are_skipped_and_counted(tmp_path: Path) -> None:
    data = bytearray(written(tmp_path / "a.tlog"))
    whole = len(data) // 5
    data[whole + 20] ^= 0xFF
    data[3 * whole : 3 * whole] = b"garbage"
    (tmp_path / "b.tlog").write_bytes(data)
    log = read_tlog(tmp_path / "b.tlog")
    assert [r.frame.message.time_boot_ms for r in log] == [0, 2, 3, 4]
    assert log.damaged == 2
    assert log.damaged_bytes == whole + len(b"garbage")


def test_one_extra_byte_loses_no_frame(tmp_path: Path) -> None:
    data = bytearray(written(tmp_path / "a.tlog"))
    data[2 * len(data) // 5 : 2 * len(data) // 5] = b"x"
    (tmp_path / "b.tlog").write_bytes(data)
    log = read_tlog(tmp_path / "b.tlog")
    assert [r.frame.message.time_boot_ms for r in log] == [0, 1, 2, 3, 4]
    assert (log.damaged, log.damaged_bytes) == (1, 1)


def test_missing_and_empty_logs_raise_bad_file(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="cannot be read"):
        read_tlog(tmp_path / "none.tlog")
    (tmp_path / "empty.tlog").write_bytes(b"")
    with pytest.raises(BadFile, match="empty"):
        read_tlog(tmp_path / "empty.tlog")


def test_a_log_that_cannot_be_created_raises_bad_file(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="cannot be written"):
        TlogWriter(tmp_path / "no" / "a.tlog", lambda: 0.0)


def test_flushed_data_is_in_the_file_before_it_is_closed(tmp_path: Path) -> None:
    log = TlogWriter(tmp_path / "a.tlog", lambda: 1.0)
    log.write(b"frame")
    log.flush()
    assert (tmp_path / "a.tlog").read_bytes().endswith(b"frame")
    log.close()


@pytest.mark.parametrize("act", ["write", "flush", "close"])
def test_a_full_disk_is_reported_with_the_log_name_on_write_flush_and_close(tmp_path: Path, act: str) -> None:
    log = TlogWriter(tmp_path / "a.tlog", lambda: 1.0)
    log._stream.close()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    log._stream = SimpleNamespace(write=fail, flush=fail, close=fail)  # type: ignore[assignment]
    with pytest.raises(BadFile, match=r"a\.tlog cannot be written: No space left on device\. Check the disk"):
        getattr(log, act)(*([b"frame"] if act == "write" else []))


@pytest.mark.slow
@pytest.mark.skipif(not LOGS.is_dir(), reason="the shared data folder is not beside this checkout")
@pytest.mark.parametrize(
    ("name", "frames", "damaged"), [("2023-04-18_11-03-34.tlog", 50136, 1961), ("small.tlog", 35912, 4)]
)
def test_logs_of_a_real_rov_are_read_with_their_damage_counted(name: str, frames: int, damaged: int) -> None:
    """The frame counts are pymavlink's own for the same files."""
    log = read_tlog(LOGS / name)
    assert sum(r.frame.name == "ATTITUDE" for r in log) > 5000
    assert (log.frames, log.damaged) == (frames, damaged)


def unknown_frame(payload: bytes = b"abcdef") -> bytes:
    """A frame of MAVLink 2 of a message that no dialect here knows; its checksum cannot be verified."""
    return bytes([0xFD, len(payload), 0, 0, 0, 1, 1]) + (9_999_999).to_bytes(3, "little") + payload + b"\x00\x00"


def test_a_frame_of_unknown_type_is_accepted_only_at_the_end_or_before_a_valid_frame(tmp_path: Path) -> None:
    data = written(tmp_path / "a.tlog", 2)
    half = len(data) // 2
    stamp = data[:8]
    strange = stamp + unknown_frame()
    path = tmp_path / "b.tlog"

    def read(content: bytes) -> tuple[list[str], int]:
        path.write_bytes(content)
        log = read_tlog(path)
        return [r.frame.name[:7] for r in log], log.damaged

    assert read(data + strange) == (["ATTITUD", "ATTITUD", "UNKNOWN"], 0)
    assert read(data[:half] + strange + data[half:]) == (["ATTITUD", "UNKNOWN", "ATTITUD"], 0)
    assert read(data[:half] + strange + b"?" * 9 + data[half:]) == (["ATTITUD", "ATTITUD"], 1)
    for tail in (1, 7, 8):  # a stamp without its frame is ignored
        names, _ = read(data + strange + b"?" * tail)
        assert names == ["ATTITUD", "ATTITUD"]


def test_damage_at_the_start_counts_as_one_stretch(tmp_path: Path) -> None:
    data = written(tmp_path / "a.tlog")
    (tmp_path / "b.tlog").write_bytes(b"not a log at all" + data)
    log = read_tlog(tmp_path / "b.tlog")
    assert len(list(log)) == 5
    assert (log.damaged, log.damaged_bytes) == (1, 16)


def test_a_long_log_is_read_in_few_chunks_and_never_held_whole_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tlog, "_CHUNK", 4096)
    data = written(tmp_path / "a.tlog", 900)
    sizes: list[int] = []

    class Counting(io.BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            sizes.append(len(log._buffer))
            return super().read(size)

    log = TlogReader(Counting(data))
    assert sum(1 for _ in log) == 900
    assert len(sizes) <= len(data) // 4096 + 3
    assert max(sizes) < 1024 < len(data)
