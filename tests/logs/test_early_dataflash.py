"""Logs on board of before 2015: stamps in milliseconds, none on PARM and MSG, outputs under other names."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.logs import cut_runs, load_runs, record, survey

CODES = {
    "I": "I",
    "h": "h",
    "H": "H",
    "f": "f",
    "c": "h",
    "C": "H",
    "e": "i",
    "L": "i",
    "N": "16s",
    "Z": "64s",
    "M": "B",
    "B": "B",
}
SCALE = {"c": 100.0, "C": 100.0, "e": 100.0, "L": 1e7}
GPS = ("GPS", "BIHBcLLeeEefI".replace("E", "e"), "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T")
FORMATS = (
    ("PARM", "Nf", "Name,Value"),
    ("MSG", "Z", "Message"),
    ("MODE", "IMB", "TimeMS,Mode,ModeNum"),
    ("ATT", "IccC", "TimeMS,Roll,Pitch,Yaw"),
    ("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    ("RCOU", "Ihhhhhhhh", "TimeMS,Chan1,Chan2,Chan3,Chan4,Chan5,Chan6,Chan7,Chan8"),
    GPS,
)
PARAMETERS = {
    "RC1_MIN": 1000.0, "RC1_TRIM": 1500.0, "RC1_MAX": 2000.0, "RC1_REV": 1.0,
    "RC3_MIN": 1100.0, "RC3_TRIM": 1500.0, "RC3_MAX": 1900.0, "RC3_REV": 1.0, "SKID_STEER_OUT": 0.0,
}  # fmt: skip
Row = tuple[str, tuple[float | str, ...]]


def sailed(said: str = "ArduRover v2.46 (00000000)", seconds: float = 40.0) -> list[Row]:
    """A boat that swings: first order in yaw, 1.2 s, half a rad/s at full rudder, every 0.1 s from 8.8 s on."""
    rows: list[Row] = [("MSG", (said,)), *(("PARM", item) for item in PARAMETERS.items()), ("MODE", (8800, 0, 0))]
    psi = r = 0.0
    for k in range(round(10 * seconds)):
        t = 8800 + 100 * k
        share = 0.4 if (k // 30) % 2 else -0.4
        rows.append(("RCOU", (t, 1500 + 500 * share, 1500, 1700, 1500, 0, 0, 0, 0)))
        rows.append(("ATT", (t, 0.0, 0.0, math.degrees(psi) % 360.0)))
        rows.append(("IMU", (t, 0.0, 0.0, r, 0.0, 0.0, -9.8)))
        if k % 2 == 0:
            fix = (3, 130040903 + t, 1769, 10, 1.5, 44.0 + 1e-6 * k, 9.0, 0.0, 0.0, 1.5, 90.0, 0.0, t)
            rows.append(("GPS", fix))
        for _ in range(10):
            r += 0.01 * (0.5 * share - r) / 1.2
            psi += 0.01 * r
    return rows


def as_text(rows: Sequence[Row], above: str = "") -> str:
    heads = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    heads += [f"FMT, {130 + i}, 9, {name}, {letters}, {columns}" for i, (name, letters, columns) in enumerate(FORMATS)]
    return above + "\n".join([*heads, *(", ".join([kind, *map(str, cells)]) for kind, cells in rows)]) + "\n"


def as_binary(rows: Sequence[Row]) -> bytes:
    pieces = []
    numbers = {name: 130 + i for i, (name, _, _) in enumerate(FORMATS)}
    layouts = {name: "<" + "".join(CODES[c] for c in letters) for name, letters, _ in FORMATS}
    for name, letters, columns in FORMATS:
        length = 3 + struct.calcsize(layouts[name])
        body = (numbers[name], length, name.encode(), letters.encode(), columns.encode())
        pieces.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *body))
    for kind, cells in rows:
        letters = {n: le for n, le, _ in FORMATS}[kind]
        packed = [
            c.encode() if isinstance(c, str) else float(c) if code == "f" else round(c * SCALE.get(code, 1.0))
            for c, code in zip(cells, letters, strict=True)
        ]
        pieces.append(b"\xa3\x95" + bytes([numbers[kind]]) + struct.pack(layouts[kind], *packed))
    return b"".join(pieces)


@pytest.mark.parametrize("form", ["text", "binary"])
@pytest.mark.parametrize("said", ["ArduRover v2.46 (00000000)", "APM:Rover v3.1"])
def test_milliseconds_are_read_and_the_outputs_mapped_by_the_rc_parameters(
    tmp_path: Path, form: str, said: str
) -> None:
    path = tmp_path / ("old.log" if form == "text" else "old.bin")
    path.write_bytes(as_text(sailed(said)).encode() if form == "text" else as_binary(sailed(said)))
    log = record(path)
    assert log is not None
    (store,) = log.stores
    assert store.clock == "vehicle (TimeMS)"
    assert store.vehicle == said
    assert store.parameters == pytest.approx(PARAMETERS)
    assert store.span == pytest.approx((8.8, 48.7))
    (run,) = load_runs(path)
    assert np.ptp(run["N"].values) == pytest.approx(0.8)
    assert set(np.round(run["X"].values, 6)) == {0.5}
    assert run["psi"].t[:3] == pytest.approx([8.8, 8.9, 9.0])
    assert run["U"].t[:2] == pytest.approx([8.8, 9.0]), "GPS by its boot clock T, not by the time of the GPS week"
    assert log.meta["damaged_stamps"] == 0


def test_lines_above_the_log_name_the_firmware_and_are_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "terminal.log"
    rows = [row for row in sailed() if row[0] != "MSG"]
    path.write_text(as_text(rows, "ArduRover V2.45 (a1b2)\nFree RAM: 2341\nAPM 2\n\n"), encoding="utf-8")
    log = record(path)
    assert log is not None
    assert log.stores[0].vehicle == "ArduRover V2.45 (a1b2)"
    assert log.meta["damaged"] == 0
    assert len(load_runs(path)) == 1


def test_a_log_without_any_stamp_is_named_as_one(tmp_path: Path) -> None:
    path = tmp_path / "first.log"
    text = as_text([("MSG", ("ArduRover v2.40",)), *(("ATT", (k, 0.0, 0.0, 10.0)) for k in range(50))])
    path.write_text(text.replace("IccC, TimeMS,Roll", "IccC, Nr,Roll"), encoding="utf-8")
    with pytest.raises(BadFile, match=r"first\.log is a log of ArduRover v2\.40 whose messages carry no time stamp"):
        record(path)


def test_a_log_of_px4s_old_logger_is_named_as_one(tmp_path: Path) -> None:
    path = tmp_path / "sess001.bin"
    heads = "FMT, 129, 11, TIME, Q, StartTime\nFMT, 130, 9, ATT, fff, Roll,Pitch,Yaw\n"
    path.write_text(heads + "TIME, 123456\nATT, 0.1, 0.1, 0.3\n" * 40, encoding="utf-8")
    with pytest.raises(BadFile, match=r"sess001\.bin is a log of PX4's old logger \(sdlog2\)"):
        record(path)


def test_a_log_of_a_copter_says_so(tmp_path: Path) -> None:
    path = tmp_path / "copter.log"
    path.write_text(as_text(sailed("APM:Copter V3.2.1 (36b405fb)")), encoding="utf-8")
    with pytest.raises(NotInformative, match=r"copter\.log .*is of APM:Copter V3\.2\.1.*neither ArduRover nor ArduSub"):
        load_runs(path)


def test_a_log_without_parameters_names_the_option_and_no_link(tmp_path: Path) -> None:
    path = tmp_path / "bare.log"
    path.write_text(as_text([row for row in sailed() if row[0] != "PARM"]), encoding="utf-8")
    with pytest.raises(NotInformative, match=r"bare\.log .*no parameters \(0\).*--parameters FILE") as refused:
        load_runs(path)
    log = record(path)
    assert log is not None
    shown = str(survey(log, cut_runs(log)))
    for text in (str(refused.value), shown):
        assert not any(word in text for word in ("thin", "link", "answer", "set SERVOn_FUNCTION"))
    (run,) = load_runs(path, parameters=PARAMETERS)
    assert np.ptp(run["N"].values) == pytest.approx(0.8)
