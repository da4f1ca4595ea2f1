"""The reader of onboard logs: compared with another reader, and on damaged files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from log_writing import swing
from onboard_log_writer import Board
from pymavlink import DFReader

from gcs_autotune.logs import load_runs, record
from gcs_autotune.logs.dataflash_format import BinaryLog

REAL = Path(__file__).parents[2] / "../shared/data/ardusub_logs/small.BIN"


def boat(start: float = 100.0, seconds: float = 20.0, course: float | None = None) -> Board:
    """A turning boat; with a *course* [deg] relative to the bow a GPS reports its speed of 1.5 m/s after 1 s."""
    board = Board()
    board.boat(t=start)
    motion = swing(seconds)
    for t, psi, r, N in zip(motion["t"] + start, motion["psi"], motion["r"], motion["N"], strict=True):
        board.row("ATT", t, 0.5, 1.5, math.degrees(psi))
        board.row("IMU", t, 0, 0.0, 0.0, float(r))
        board.row("IMU", t, 1, 9.0, 9.0, 9.0)
        board.row("RCOU", t, 1500 + round(400 * N), 0, 1600)
        board.row("SIM", t, 77.0)
        if course is not None:
            status, along = (3 if t >= start + 1.0 else 1), math.degrees(psi) + course
            board.row("GPS", t, 0, status, 45.0 + 1e-6 * (t - start), 14.0, 1.5, along % 360.0)
    return board


def test_a_binary_log_becomes_a_run_with_its_first_imu_and_no_simulator_truth(tmp_path: Path) -> None:
    (run,) = load_runs(boat().write(tmp_path / "00000007.BIN"))
    assert run.name == "00000007#1 MANUAL 0-20 s"
    assert (run.meta["format"], run.meta["clock"]) == ("onboard log (binary)", "vehicle (TimeUS)")
    assert run.meta["sources"]["r"] == "imu"
    assert np.allclose(run["r"].values, swing(20.0)["r"], atol=1e-6)
    assert set(run["N"].values) == {-0.4, 0.4}
    assert not run.meta["notes"]


def test_without_an_estimator_surge_and_sway_come_from_the_gps_course(tmp_path: Path) -> None:
    (run,) = load_runs(boat(course=30.0).write(tmp_path / "00000007.BIN"))
    assert run.meta["sources"]["u"] == "gps"
    known = np.isfinite(run["u"].values)
    assert run["u"].t[known][0] == pytest.approx(run["psi"].t[0] + 1.0, abs=0.06)
    assert np.allclose(run["u"].values[known], 1.5 * math.cos(math.radians(30.0)), atol=0.01)
    assert np.allclose(run["v"].values[known], 1.5 * math.sin(math.radians(30.0)), atol=0.01)


@pytest.mark.skipif(not REAL.exists(), reason="the shared data folder is not beside this checkout")
def test_a_real_log_reads_as_pymavlink_reads_it() -> None:
    theirs: dict[str, list[tuple[int, float]]] = {}
    log = DFReader.DFReader_binary(str(REAL))
    while (m := log.recv_msg()) is not None:
        for kind, name in (("ATT", "Yaw"), ("RCOU", "C5"), ("CTUN", "Alt"), ("XKF1", "PD"), ("BARO", "Press")):
            if m.get_type() == kind:
                theirs.setdefault(kind, []).append((m.TimeUS, getattr(m, name)))
    log.filehandle.close()
    ours = BinaryLog(REAL.open("rb"))
    names = {"ATT": "Yaw", "RCOU": "C5", "CTUN": "Alt", "XKF1": "PD", "BARO": "Press"}
    found = {
        b.kind: list(zip(b.column("TimeUS"), b.column(names[b.kind]), strict=True))
        for blocks in ours
        for b in blocks
        if b.kind in names
    }
    assert ours.damaged == 0
    assert {k: len(v) for k, v in found.items()} == {k: len(v) for k, v in theirs.items()}
    for kind, rows in theirs.items():
        assert np.allclose(found[kind], rows, rtol=1e-12), kind
    assert record(REAL).meta["damaged_stamps"] == 0


def test_bytes_between_messages_are_skipped_and_counted(tmp_path: Path) -> None:
    board = boat()
    whole = len(board.pieces)
    board.pieces[60:60] = [b"\xa3\x95\xff nothing of a message \xa3\x95"]
    board.pieces[90] = board.pieces[90][:-4]
    log = record(board.write(tmp_path / "a.bin"))
    assert log.meta["damaged"] == 2
    assert log.meta["messages"] == whole - 1
    assert log.notes[0][0] == "damaged-log"


def test_a_damaged_stamp_is_left_out_and_a_sparse_log_is_not_damaged(tmp_path: Path) -> None:
    board = boat()
    spoilt = bytearray(board.pieces[200])
    spoilt[9] ^= 0x40
    board.pieces[200] = bytes(spoilt)
    for t in (300.0, 410.0, 520.0):
        board.row("MSG", t, 0, 0, "still here")
    log = record(board.write(tmp_path / "a.bin"))
    assert log.meta["damaged_stamps"] == 1
    assert [t for t, text in log.stores[0].texts if text == "still here"] == [300.0, 410.0, 520.0]
    assert log.stores[0].span == pytest.approx((100.0, 119.95))


def test_impossible_values_are_left_out_and_counted(tmp_path: Path) -> None:
    board = boat()
    board.row("IMU", 120.0, 0, 0.0, 0.0, 1e30)
    board.row("IMU", 120.1, 0, 0.0, 0.0, math.nan)
    (run,) = load_runs(board.write(tmp_path / "a.bin"))
    assert run.meta["absurd_samples"] == 1
    assert float(np.max(np.abs(run["r"].values))) < 5.0


def test_two_boots_in_one_file_are_two_runs(tmp_path: Path) -> None:
    board = boat(400.0)
    board.pieces += boat(30.0).pieces
    first, second = load_runs(board.write(tmp_path / "two.bin"))
    assert (first["psi"].t[0], second["psi"].t[0]) == pytest.approx((400.0, 30.0))


def test_a_message_without_stamps_gets_the_time_of_the_preceding_one(tmp_path: Path) -> None:
    """ArduSub 4.7 writes 0 into the TimeUS of RATE; another source of the rate is preferred."""
    board = Board()
    board.boat()
    for i in range(100):
        board.row("ATT", 100.0 + 0.1 * i, 0.0, 0.0, float(i))
        board.row("RATE", 0.0, 0.0, 0.0, 10.0 + i % 7)
        board.row("RCOU", 100.0 + 0.1 * i, 1500 + 10 * (i % 5), 0, 1600)
    (run,) = load_runs(board.write(tmp_path / "a.bin"))
    assert run.meta["sources"]["r"] == "rate"
    assert run.meta["dated_by_arrival"] == ["rate"]
    assert run.meta["damaged_stamps"] == 0
    assert np.allclose(run["r"].t, run["psi"].t)
    for i in range(100):
        board.row("IMU", 110.0 + 0.1 * i, 0, 0.0, 0.0, 0.1 * (i % 3))
    (run,) = load_runs(board.write(tmp_path / "a.bin"))
    assert run.meta["sources"]["r"] == "imu"


def test_a_run_records_the_gyro_filter_of_its_rates(tmp_path: Path) -> None:
    board = boat()
    board.row("PARM", 120.0, "INS_GYRO_FILTER", 4.0, 4.0)
    (run,) = load_runs(board.write(tmp_path / "a.bin"))
    reported = run.meta["filters"]["r"]
    assert (reported["parameter"], reported["cutoff_hz"], reported["order"]) == ("INS_GYRO_FILTER", 4.0, 2)
    assert reported["delay_s"] == pytest.approx(0.0563, abs=1e-4)
    assert "psi" not in run.meta["filters"]
