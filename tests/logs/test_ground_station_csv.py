"""CSV files of ground stations: the same runs as the original telemetry log, or the reason there are none."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_writing import BOAT, Tlog, beats, parameters, sail, swing
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.logs import cut_runs, load_runs, record
from gcs_autotune.mavlink import read_tlog
from gcs_autotune.trial import Trial

QGC = (
    "Timestamp,roll,pitch,heading,rollRate,pitchRate,yawRate,groundSpeed,climbRate,altitudeRelative,throttlePct,"
    "battery0.voltage,gps.lat,gps.lon,localPosition.x,localPosition.y,localPosition.z,localPosition.vx,localPosition.vy"
)
"""Columns of QGroundControl 4.x, in its order, some left out."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 20.0, armed=True)
    sail(log, swing(20.0))
    log.heard(3.0, mavlink.MAVLink_statustext_message(6, b"EKF3 IMU0, is using GPS"))
    log.heard(4.0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), 255, 190)
    return log.write(tmp_path_factory.mktemp("flown") / "dive.tlog")


def planner(flown: Path, stamp: str, head: Callable[[Any], str], number: Callable[[object], str]) -> str:
    """Return the Mission Planner CSV of a log; its format follows its public sources and users' posts."""
    lines = []
    for r in read_tlog(flown):
        m = r.frame.message
        when = datetime.fromtimestamp(r.time, UTC).strftime(stamp)
        pairs = [f"{n},{number(getattr(m, n))}" for n in m.get_fieldnames()]
        lines.append(
            f"{when},{head(r.frame)},mavlink_{r.frame.name.lower()}_t,{','.join(pairs)},,Len,{len(r.frame.raw)}"
        )
    return "\r\n".join(lines) + "\r\n"


def new_head(f: Any) -> str:
    return f"FD,{f.raw[1]:2X}, 0, 0,{f.raw[4]:2X},{f.system:2X},{f.component:2X},{f.message.get_msgId():6X}"


def old_head(f: Any) -> str:
    return f"FE,{f.raw[1]:2X},{f.raw[4]:2X},{f.system:2X},{f.component:2X},{f.message.get_msgId():2X}"


def agree(ours: Trial, theirs: Trial) -> None:
    assert set(ours.channels) == set(theirs.channels)
    for name, channel in theirs.channels.items():
        assert np.allclose(ours[name].t, channel.t, atol=1e-6), name
        assert np.allclose(ours[name].values, channel.values, atol=1e-6), name


@pytest.mark.parametrize(
    ("stamp", "head", "comma"),
    [("%Y-%m-%dT%H:%M:%S.%f", new_head, False), ("%m/%d/%Y %I:%M:%S %p", old_head, False),
     ("%Y-%m-%dT%H:%M:%S.%f", new_head, True)],
    ids=["MAVLink 2", "MAVLink 1", "decimal comma"],
)  # fmt: skip
def test_a_mission_planner_csv_gives_the_runs_of_its_tlog(
    tmp_path: Path, flown: Path, stamp: str, head: Callable[[Any], str], comma: bool
) -> None:
    def number(value: object) -> str:
        return str(value).replace(".", ",") if comma and isinstance(value, float) else str(value)

    (tmp_path / "dive.csv").write_text(planner(flown, stamp, head, number), newline="")
    log = record(tmp_path / "dive.csv")
    assert log is not None
    assert (log.form, log.meta["damaged"]) == ("Mission Planner CSV", 0)
    (run,) = cut_runs(log).runs
    agree(run, load_runs(flown)[0])
    assert any("EKF3 IMU0, is using GPS" in str(m.detail.get("text")) for m in run.marks)


def test_a_mavlogdump_csv_gives_the_runs_of_its_tlog(tmp_path: Path, flown: Path) -> None:
    kinds = ("ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT", "PARAM_VALUE")
    fields = [(k, n) for k in kinds for n in getattr(mavlink, f"MAVLink_{k.lower()}_message").fieldnames]
    lines = [",".join(["timestamp", *(f"{k}.{n}" for k, n in fields)])]
    for r in read_tlog(flown):
        if r.frame.name in kinds:
            cells = [str(getattr(r.frame.message, n)) if k == r.frame.name else "" for k, n in fields]
            lines.append(",".join([f"{r.time:.8f}", *cells]))
    (tmp_path / "dive.csv").write_text("\n".join([*lines, "1600000020.5,half a li"]) + "\n")
    (run,) = load_runs(tmp_path / "dive.csv")
    assert (run.meta["format"], run.meta["damaged"]) == ("mavlogdump CSV", 1)
    agree(run, load_runs(flown)[0])


def test_a_mostly_damaged_csv_is_rejected_with_advice(tmp_path: Path, flown: Path) -> None:
    text = planner(flown, "%Y-%m-%dT%H:%M:%S.%f", new_head, str)
    spoilt = "\n".join(line[: len(line) // 3] if i % 3 else line for i, line in enumerate(text.splitlines()))
    (tmp_path / "dive.csv").write_text(spoilt)
    with pytest.raises(BadFile, match=r"cannot be read as Mission Planner CSV.*\.tlog"):
        record(tmp_path / "dive.csv")


def qgc(path: Path, width: int = 0) -> Path:
    lines = [QGC]
    for i in range(60):
        row = f"2026-05-01 12:00:{i:02d}.250,0.5,-1.0,{3 * i % 360},--.--,--.--,2.0,1.5,0.0,-0.25,20,12.6"
        cells = f"{row},45.0,15.0,{1.5 * i},2.0,0.3,1.5,0.0".split(",")
        lines.append(",".join([*cells[:12], *(["7"] * width), *cells[12:]]))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_qgroundcontrol_csv_is_reported_to_lack_actuator_outputs(tmp_path: Path) -> None:
    log = record(qgc(tmp_path / "2026-05-01 12-00-00 vehicle1.csv"))
    assert log is not None
    (left,) = cut_runs(log).left_out
    assert left.run["psi"].values[1] == pytest.approx(math.radians(3.0))
    assert (left.run["x"].values[2], left.run["z"].values[0]) == (3.0, 0.25)
    assert left.run["U"].unit == "m/s"
    with pytest.raises(NotInformative, match=r"no actuator outputs"):
        load_runs(tmp_path / "2026-05-01 12-00-00 vehicle1.csv")


def test_shifted_columns_of_qgroundcontrol_are_detected(tmp_path: Path) -> None:
    log = record(qgc(tmp_path / "q.csv", width=3))
    assert log is not None
    assert log.meta["shifted_rows"] == 60
    (left,) = cut_runs(log).left_out
    assert "psi" in left.run
    assert "x" not in left.run
