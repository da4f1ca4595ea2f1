"""Files of other tools: recognised by their content, read if a library supports them, else named with a conversion."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import shutil
import sqlite3
import sys
import tarfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from foreign_writing import PSI, N, R, T, bag2, mat, ulog
from log_writing import BOAT, Tlog, beats, parameters, sail, swing
from onboard_log_writer import Board

from gcs_autotune.errors import BadFile
from gcs_autotune.logs import FORMATS, load_runs, record


def test_a_ulog_gives_its_armed_segment_with_set_points_as_inputs(tmp_path: Path) -> None:
    path = tmp_path / "boat.ulg"
    path.write_bytes(ulog())
    log = record(path)
    assert log is not None
    assert log.form == "PX4 ULog"
    assert log.stores[0].parameters == {"GND_SPEED_P": 0.25}
    (run,) = load_runs(path)
    assert run["psi"].values == pytest.approx(PSI, abs=1e-6)
    assert run["r"].values == pytest.approx(R, abs=1e-6)
    assert run["N"].values == pytest.approx(N, abs=1e-6)
    assert set(run["X"].values) == {0.5}
    assert run["psi"].t == pytest.approx(10.0 + T)
    (note,) = [n for n in run.meta["notes"] if n[0] == "input-is-command"]
    assert "the inputs are the controllers' set-points" in note[1]
    assert "PX4" in note[1]


@pytest.mark.parametrize("nested", [False, True])
def test_a_matlab_file_gives_the_vectors_with_its_times(tmp_path: Path, nested: bool) -> None:
    path = tmp_path / "log.mat"
    columns = {"t": T, "psi": PSI, "r": R, "N": N}
    path.write_bytes(
        mat(run1={"data": columns, "rate": 20.0}, who="me") if nested else mat(**columns, extra=np.ones(7))
    )
    (run,) = load_runs(path)
    assert run["psi"].values == pytest.approx(PSI)
    assert (run["psi"].unit, run["N"].unit) == ("rad", "1")
    slugs = [n[0] for n in run.meta["notes"]]
    assert slugs == ["assumed-units"] if nested else ["assumed-units", "left-out-vectors"]


def test_the_columns_of_a_matlab_file_are_named_by_the_user(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(mat(zeit=1000.0 * T, kurs=np.degrees(PSI), ruder=N))
    with pytest.raises(BadFile, match=r"log\.mat .*without a time vector.*zeit, kurs, ruder.*--columns OLD=t\[s\]"):
        load_runs(path)
    (run,) = load_runs(path, columns={"zeit": "t[ms]", "kurs": "psi[deg]", "ruder": "N"})
    assert run["psi"].t == pytest.approx(T)
    assert run["psi"].values == pytest.approx(PSI)


def test_a_ros_bag_is_converted_from_enu_to_ned(tmp_path: Path) -> None:
    folder = bag2(tmp_path)
    (run,) = load_runs(folder)
    assert np.unwrap(run["psi"].values) == pytest.approx(PSI, abs=1e-9)
    assert run["r"].values == pytest.approx(R)
    assert (run["x"].values[0], run["y"].values[0], run["z"].values[0]) == (2.0, 3.0, -1.0)
    assert (run["u"].values[0], run["v"].values[0]) == (1.5, -0.2)
    assert run["N"].values == pytest.approx(N)
    assert (run["N"].unit, run["X"].values[0]) == ("N m", 20.0)
    assert run["psi"].t == pytest.approx(1714644000.0 + T, abs=1e-6)
    assert "ros-axes" in [n[0] for n in run.meta["notes"]]
    (file,) = folder.glob("*.db3")
    (alone,) = load_runs(file)
    assert alone["N"].values == pytest.approx(N)


def test_motor_pulses_in_a_ros_bag_are_columns(tmp_path: Path) -> None:
    (run,) = load_runs(bag2(tmp_path))
    assert run["motors_1"].values == pytest.approx(1500.0 + np.round(100.0 * N))
    assert run["motors_2"].values == pytest.approx(1500.0)


@pytest.mark.parametrize(
    ("library", "content", "words"),
    [
        ("pyulog", ulog(), "is a PX4 ULog, and pyulog is not installed.*'gcs-autotune.formats.'.*ulog2csv"),
        ("rosbags", b"#ROSBAG V2.0\n" + bytes(100), "is a ROS bag, and rosbags is not installed.*formats"),
    ],
)
def test_a_missing_library_is_reported_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, content: bytes, words: str
) -> None:
    for name in [n for n in sys.modules if n.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / "mine.log"
    path.write_bytes(content)
    with pytest.raises(BadFile, match=words):
        load_runs(path)


def zipped(*names: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, "x")
    return stream.getvalue()


def tarred() -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("a.BIN"), io.BytesIO())
    return stream.getvalue()


def database(folder: Path) -> bytes:
    with sqlite3.connect(folder / "x.db") as connection:
        connection.execute("create table runs (a)")
    connection.close()
    return (folder / "x.db").read_bytes()


def frames(folder: Path, stamped: bool = False) -> bytes:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 8.0, armed=True)
    sail(log, swing(8.0))
    data, raw, at = log.write(folder / "x.tlog").read_bytes(), b"", 0
    while at < len(data):
        length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
        raw += data[at + 8 : at + 8 + length]
        at += 8 + length
    return data if stamped else raw


FOREIGN: Sequence[tuple[bytes, str]] = (
    (zipped("00000049.BIN"), r"is a zip archive: unpack it: unzip mine.* \(it contains 00000049\.BIN\)"),
    (zipped("[Content_Types].xml", "xl/workbook.xml"), "is an Excel workbook: export it .*CSV"),
    (zipped("[Content_Types].xml", "word/document.xml"), "is a document of Word or PowerPoint: give the data"),
    (zipped("mimetype", "content.xml"), "is a spreadsheet of LibreOffice: export it"),
    (zipped("t.npy", "psi.npy"), "is NumPy's .npz.*savetxt"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "is an old Excel workbook"),
    (gzip.compress(b"t,psi"), "is compressed by gzip: unpack it: gunzip -k mine.csv"),
    (bz2.compress(b"t,psi"), "is compressed by bzip2"),
    (lzma.compress(b"t,psi"), "is compressed by xz"),
    (tarred(), "is a tar archive"),
    (b"\x89HDF\r\n\x1a\n" + bytes(500), "is a MATLAB file of version 7.3, or another HDF5 file.*-v7"),
    (b"PAR1" + bytes(80), "is Parquet"),
    (b'{"t": [0, 1]}', "is JSON: use CSV"),
    (b"<?xml version='1.0'?><gpx></gpx>", "is a track in XML"),
    (b"<!DOCTYPE html><html></html>", "is a web page"),
    (b"$GPRMC,081836,A,3751.65,S\r\n$GPGGA,1\r\n", "is NMEA sentences"),
    (b"QGC WPL 110\n0\t1\t0\t16\n", "is a list of waypoints"),
    (b"SERVO1_FUNCTION,26\nSERVO1_MIN,1100\nSERVO1_MAX,1900\n", "is a list of parameters: use it with --parameters"),
    (b"ATT: 12, 15, 20000\nGPS: 130040903, 1, 8\n", "is an ArduPilot log without FMT lines"),
    (b"%PDF-1.7\n", "is a PDF"),
    (b"\x89PNG\r\n\x1a\n", "is an image"),
)


@pytest.mark.parametrize("case", range(len(FOREIGN)))
@pytest.mark.parametrize("name", ["mine.csv", "mine.tlog", "mine.bin", "mine"])
def test_a_file_of_unknown_format_is_rejected_under_any_name(tmp_path: Path, name: str, case: int) -> None:
    content, words = FOREIGN[case]
    path = tmp_path / name
    path.write_bytes(content)
    for read in (load_runs, record):
        with pytest.raises(BadFile, match=words.replace("mine.csv", name)) as refused:
            read(path)
        assert str(path) in str(refused.value)
        assert "\n" not in str(refused.value)


def test_mavlink_without_stamps_and_a_database_are_recognised(tmp_path: Path) -> None:
    for content, words in (
        (frames(tmp_path), "MAVProxy's .raw.: use the telemetry log"),
        (database(tmp_path), "SQLite"),
    ):
        path = tmp_path / "mine.tlog"
        path.write_bytes(content)
        with pytest.raises(BadFile, match=words):
            load_runs(path)


@pytest.mark.parametrize("name", ["mine.csv", "mine.txt", "mine.log", "mine.bin"])
def test_a_log_and_a_table_are_read_under_any_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(frames(tmp_path, stamped=True))
    log = record(path)
    assert log is not None and log.form == "telemetry log"
    board = Board()
    board.boat()
    board.row("ATT", 100.0, 0.5, 1.5, 10.0)
    log = record(board.write(path))
    assert log is not None and log.form == "onboard log (binary)"
    path.write_text("t[s],psi[deg],N\n0,1,1\n1,2,1\n", encoding="utf-8")
    assert load_runs(path)[0]["psi"].t.tolist() == [0.0, 1.0]


def test_the_contents_of_a_folder_without_runs_are_listed(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"is a folder without a recorded run.*\. It is empty"):
        load_runs(tmp_path)
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(BadFile, match=r"\*\.ulg.*\. It contains notes\.txt"):
        load_runs(tmp_path)
    for run in ("00-announcement", "01-heading", "02-depth"):
        (tmp_path / run / "trials").mkdir(parents=True)
    for run in ("01-heading", "02-depth"):
        (tmp_path / run / "trials" / "01.csv").touch()
    with pytest.raises(BadFile, match=r"It contains these runs: [^ ]*01-heading, [^ ]*02-depth$"):
        load_runs(tmp_path)


def test_an_empty_file_of_any_kind_is_reported_as_empty(tmp_path: Path) -> None:
    for name in ("a.csv", "a.tlog", "a.bin", "a.ulg", "a.mat"):
        (tmp_path / name).touch()
        with pytest.raises(BadFile, match=rf"{name} is empty"):
            load_runs(tmp_path / name)


def test_every_file_format_is_read_or_has_conversion_advice() -> None:
    wrong = [form.name for form in FORMATS if (form.record is None and form.runs is None) is not bool(form.advice)]
    assert wrong == []


def test_a_ros_bag_with_a_missing_part_is_rejected_in_one_line(tmp_path: Path) -> None:
    folder = bag2(tmp_path)
    for file in folder.glob("*.db3"):
        file.unlink()
    with pytest.raises(BadFile, match="is a ROS bag that cannot be read"):
        load_runs(folder)
    shutil.rmtree(folder)
