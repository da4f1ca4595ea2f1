"""Logs on board: units converted, the first instance of each filter, runs by arming and mode."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from log_writing import ALPHA, BETA, BOAT, BOOT, swing

from gcs_autotune.errors import BadFile, NotInformative
from gcs_autotune.identify import fit_axis
from gcs_autotune.logs import load_runs
from gcs_autotune.logs.dataflash import _event
from gcs_autotune.logs.sample_store import SampleStore

REAL = Path(__file__).parents[2] / "../shared/data/ardusub_logs/small.BIN"

FORMATS = (
    ("PARM", "QNf", "TimeUS,Name,Value"),
    ("MSG", "QZ", "TimeUS,Message"),
    ("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    ("ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
    ("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw"),
    ("RATE", "Qfff", "TimeUS,R,P,Y"),
    ("RCOU", "QHHH", "TimeUS,C1,C2,C3"),
    ("XKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD"),
)


def text_log(path: Path, *, arm: tuple[tuple[float, int], ...] = (), noise: float = 0.003) -> Path:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {130 + i}, 40, {name}, {form}, {columns}" for i, (name, form, columns) in enumerate(FORMATS)]
    us = round(BOOT * 1e6)
    lines += [f"PARM, {us}, {name}, {value}" for name, value in BOAT.items()]
    lines += [f"MSG, {us}, ArduRover V4.5.1 (abcdef)", f"MODE, {us}, Manual, 0, 1"]
    events = list(arm)
    motion = swing(40.0)
    north, east, before = 0.0, 0.0, 0.0
    for t, psi, r, N in zip(motion["t"], motion["psi"], motion["r"], motion["N"], strict=True):
        us = round((BOOT + t) * 1e6)
        while events and events[0][0] <= t:
            lines.append(f"ARM, {us}, {events.pop(0)[1]}, 0, 0, 0")
        deg = math.degrees(psi) % 360.0
        lines.append(f"ATT, {us}, 0.5, 1.5, {deg:.4f}")
        lines.append(f"RATE, {us}, 0.0, 0.0, {math.degrees(r):.4f}")
        lines.append(f"RCOU, {us}, {1500 + round(400 * N)}, 0, 1600")
        north, east, before = north + math.cos(psi) * (t - before), east + math.sin(psi) * (t - before), t
        lines.append(f"XKF1, {us}, 0, {math.cos(psi):.5f}, {math.sin(psi):.5f}, 0.1, {north:.3f}, {east:.3f}, 2.5")
        lines.append(f"XKF1, {us}, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_degrees_and_pulses_become_radians_and_fractions(tmp_path: Path) -> None:
    (run,) = load_runs(text_log(tmp_path / "00000001.log"))
    assert run.name == "00000001#1 MANUAL 0-40 s"
    assert run.meta["vehicle"].startswith("ArduRover V4.5.1")
    motion = swing(40.0)
    assert np.allclose(np.angle(np.exp(1j * (run["psi"].values - motion["psi"][: len(run["psi"])]))), 0.0, atol=1e-4)
    assert np.allclose(run["r"].values, motion["r"][: len(run["r"])], atol=1e-5)
    assert set(run["N"].values) == {-0.4, 0.4}
    assert np.allclose(run["u"].values, 1.0, atol=1e-3)
    assert np.allclose(run["phi"].values, math.radians(0.5))
    assert np.all(run["x"].values < 41.0)


def test_a_log_on_board_is_identified(tmp_path: Path) -> None:
    found = fit_axis(load_runs(text_log(tmp_path / "a.log")), dof="yaw", structure="linear")
    for name, truth in (("alpha_r", ALPHA), ("beta_r", BETA)):
        assert found.parameters[name].value == pytest.approx(truth, abs=4.0 * found.parameters[name].std)


def test_arming_splits_a_log_that_began_before_it(tmp_path: Path) -> None:
    runs = load_runs(text_log(tmp_path / "a.log", arm=((12.0, 0), (20.0, 1))))
    assert [r.name for r in runs] == ["a#1 MANUAL 0-12 s", "a#2 MANUAL 20-40 s"]


@pytest.mark.parametrize(
    "text", [b"", b"\xa3\x95", b"\xa3\x95\x80\x59" * 40, b"hello", b"FMT, 128\n", bytes(range(256))]
)
@pytest.mark.parametrize("suffix", [".bin", ".BIN", ".log"])
def test_a_file_that_is_not_a_log_is_an_error(tmp_path: Path, text: bytes, suffix: str) -> None:
    (tmp_path / f"x{suffix}").write_bytes(text)
    with pytest.raises((BadFile, NotInformative)):
        load_runs(tmp_path / f"x{suffix}")


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason="the shared data folder is not beside this checkout")
def test_a_real_log_is_read_intact_truncated_and_damaged(tmp_path: Path) -> None:
    (run,) = load_runs(REAL)
    assert run.name == "small#1 MANUAL 0-9 s"
    assert run.meta["vehicle"].startswith("ArduSub V4.1.0")
    assert math.degrees(float(run["psi"].values[0])) == pytest.approx(213.93, abs=0.01)
    assert float(run["N"].values[0]) == 0.0
    with pytest.raises(NotInformative):
        fit_axis(run, dof="yaw")
    data = bytearray(REAL.read_bytes())
    rng = np.random.default_rng(2)
    for cut in (100, 5000, 60_000, len(data) - 7):
        (tmp_path / "cut.BIN").write_bytes(data[:cut])
        try:
            load_runs(tmp_path / "cut.BIN")
        except (BadFile, NotInformative) as error:
            assert len(str(error)) > 40
    for i in rng.integers(20_000, len(data), 200):
        data[int(i)] ^= 0xFF
    (tmp_path / "spoilt.BIN").write_bytes(data)
    (spoilt,) = load_runs(tmp_path / "spoilt.BIN")
    assert 0.5 * len(run["psi"]) < len(spoilt["psi"]) <= len(run["psi"])


@pytest.mark.parametrize(
    ("kind", "m", "name"),
    [
        ("VER", {"FWS": "ArduSub V4.6.0"}, "ArduSub"),
        ("MSG", {"Message": "ArduRover V4.5.1"}, "ArduRover"),
        ("MSG", {"Message": "Rover V4.5.1"}, "ArduRover"),
        ("MSG", {"Message": "EKF3 active"}, None),
    ],
)
def test_the_firmware_is_identified_from_its_messages(kind: str, m: dict[str, str], name: str | None) -> None:
    store = SampleStore("a log", "its own")
    _event(store, kind, 3.0, m)
    assert (store.firmware.name if store.firmware else None) == name
    assert store.texts == ([(3.0, m["Message"])] if kind == "MSG" else [])
    if name is not None:
        assert store.vehicle == next(iter(m.values()))
        _event(store, "VER", 4.0, {"FWS": "ArduPlane V9"})
        _event(store, "VER", 4.0, {"FWS": "ArduSub V9"})
        assert store.vehicle == next(iter(m.values())), "the first counts"


def test_modes_and_arming_are_recorded_with_their_times() -> None:
    store = SampleStore("a log", "its own")
    for t, kind, m in (
        (1.0, "MODE", {"ModeNum": 15}),
        (2.0, "MODE", {"Mode": "4.0"}),
        (3.0, "MODE", {"Mode": "GUIDED"}),
        (4.0, "ARM", {"ArmState": 1}),
        (5.0, "ARM", {"ArmState": 0}),
        (6.0, "EV", {"Id": 10}),
        (7.0, "EV", {"Id": 11}),
        (8.0, "EV", {"Id": 25}),
    ):
        _event(store, kind, t, m)
    assert store.modes == [(1.0, 15), (2.0, 4)]
    assert store.arming == [(4.0, True), (5.0, False), (6.0, True), (7.0, False)]


def test_unknown_or_incomplete_message_kinds_do_not_affect_others(tmp_path: Path) -> None:
    lines = text_log(tmp_path / "a.log").read_text().splitlines()
    us = round(BOOT * 1e6)
    strange = ["FMT, 200, 40, AAAA, Qf, TimeUS,X", "FMT, 201, 40, ARM, QB, TimeUS,Nothing"]
    lines = [lines[0], *strange, f"AAAA, {us}, 1.0", f"ARM, {us}, 1", *(s for s in lines[1:] if ", ARM, " not in s)]
    (tmp_path / "b.log").write_text("\n".join(lines) + "\n")
    (plain,), (run,) = (load_runs(tmp_path / n) for n in ("a.log", "b.log"))
    assert set(run.channels) == set(plain.channels)
    assert len(run["psi"]) == len(plain["psi"])
