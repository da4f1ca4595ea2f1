"""A run in one file: what others receive, and what they do not."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile
from gcs_autotune.mavlink import Packer, mavlink, read_tlog
from gcs_autotune.workflow import share_run

NORTH, EAST = 444249998, 87640004
"""Place of the run [1e-7 deg]."""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    packer = Packer(1, 1)
    messages = [
        mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        *(
            mavlink.MAVLink_global_position_int_message(k, NORTH + 900 * k, EAST + 900 * k, 0, 0, 0, 0, 0, 0)
            for k in range(3)
        ),
        mavlink.MAVLink_sim_state_message(*[0.0] * 13, NORTH * 1e-7, EAST * 1e-7, *[0.0] * 6, NORTH, EAST),
        mavlink.MAVLink_statustext_message(6, b"home 44.4249998 8.7640004"),
        mavlink.MAVLink_param_value_message(b"SIM_OPOS_LAT", NORTH * 1e-7, 9, 1, 0),
        mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 0),
    ]
    folder = tmp_path / "20261126-heading"
    folder.mkdir()
    log = b"".join(struct.pack(">Q", 1000 * k) + packer.pack(m) for k, m in enumerate(messages))
    (folder / "telemetry.tlog").write_bytes(log)
    (folder / "summary.json").write_text("{}")
    (folder / "area.json").write_text('{"lat": 44.4251, "lon": 8.76403}')
    (folder / "signing.key").write_text("secret")
    return folder


def unpacked(path: Path, into: Path) -> Path:
    with zipfile.ZipFile(path) as packed:
        packed.extractall(into)
    return into / "20261126-heading"


def test_a_shared_run_contains_its_files_and_no_signing_key(run: Path, tmp_path: Path) -> None:
    shared = share_run(run, tmp_path / "out.zip")
    folder = unpacked(shared.path, tmp_path / "there")
    assert shared.files == ("area.json", "summary.json", "telemetry.tlog")
    assert [name for name, _ in shared.left_out] == ["signing.key"]
    assert "signing.key" in (folder / "README.txt").read_text()
    names = [record.frame.name for record in read_tlog(folder / "telemetry.tlog")]
    assert len(names) == 7
    assert "SETUP_SIGNING" not in names


def test_with_hidden_positions_distances_stay_and_the_place_is_removed(run: Path, tmp_path: Path) -> None:
    shared = share_run(run, tmp_path / "out.zip", hide_position=True)
    folder = unpacked(shared.path, tmp_path / "there")
    assert dict(shared.left_out)["area.json"] == "contains the place of the run"
    frames = [record.frame for record in read_tlog(folder / "telemetry.tlog")]
    assert [f.name for f in frames] == ["GPS_RAW_INT", *["GLOBAL_POSITION_INT"] * 3, "SIM_STATE"]
    moved = [(f.message.lat, f.message.lon) for f in frames[1:4]]
    assert moved[0] == (0, 0)
    assert moved[2] == (1800, round(1800 * 0.71420))  # cos 44.425 degrees
    simulated = frames[4].message
    assert (simulated.lat, simulated.lat_int, simulated.lon_int) == (pytest.approx(0.0, abs=1e-5), 0, 0)


def test_a_folder_that_is_not_a_run_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(BadFile, match="not a run directory"):
        share_run(tmp_path, tmp_path / "out.zip")
    assert not (tmp_path / "out.zip").exists()


def test_the_command_names_the_file_after_the_run_and_keeps_an_earlier_one(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["share", str(run)]) == main(["share", str(run), "--hide-position"]) == 0
    assert (tmp_path / "20261126-heading.zip").exists()
    assert (tmp_path / "20261126-heading-2.zip").exists()
    reported = capsys.readouterr()
    assert "no signing key, with positions" in reported.out
    assert "left out: signing.key" in reported.err
