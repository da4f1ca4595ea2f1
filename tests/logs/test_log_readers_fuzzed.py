"""Damaged, cut and random files of every kind: only our own errors or fewer samples result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from early_onboard_log import as_binary, sailed
from early_onboard_log import as_text as early_text
from foreign_writing import PSI, N, R, T, bag2, mat, ulog
from log_writing import BOAT, Tlog, beats, parameters, sail, swing
from onboard_log_writer import Board

from gcs_autotune.errors import AutotuneError
from gcs_autotune.logs import cut_runs, load_runs, record, survey
from gcs_autotune.logs.dataflash_format import BinaryLog

CASES = 60


def tlog(folder: Path) -> bytes:
    log = Tlog()
    parameters(log, BOAT)
    beats(log, 0.0, 8.0, armed=True)
    sail(log, swing(8.0))
    return log.write(folder / "whole.tlog").read_bytes()


def on_board(folder: Path) -> bytes:
    board = Board()
    board.boat()
    for i, r in enumerate(swing(8.0)["r"]):
        t = 100.0 + 0.05 * i
        board.row("ATT", t, 0.5, 1.5, 10.0 + i % 90)
        board.row("IMU", t, 0, 0.0, 0.0, float(r))
        board.row("RCOU", t, 1500 + 10 * (i // 40 % 2), 0, 1600)
    return board.write(folder / "whole.bin").read_bytes()


def as_text(folder: Path) -> bytes:
    on_board(folder)
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for blocks in BinaryLog((folder / "whole.bin").open("rb")):
        for b in blocks:
            letters = "".join("Z" if f == 0.0 else "d" for f in b.layout.factors)
            lines.append(f"FMT, 1, 9, {b.kind}, {letters}, {','.join(b.names)}")
            columns = [b.column(n) for n in b.names]
            lines += [f"{b.kind}, {', '.join(str(c[i]) for c in columns)}" for i in range(len(b.order))]
    return "\n".join(lines).encode()


def planner_csv(folder: Path) -> bytes:
    row = "2026-05-01T12:00:{s:02d}.500,FD,1C, 0, 0,7D, 1, 1,    1E,mavlink_{kind}_t,{fields},,Len,36"
    lines = []
    for s in range(40):
        beat = "type,11,autopilot,3,base_mode,128,custom_mode,0,system_status,4"
        lines.append(row.format(s=s, kind="heartbeat", fields=beat))
        angles = f"time_boot_ms,{1000 * s},roll,0,pitch,0,yaw,0.{s},rollspeed,0,pitchspeed,0,yawspeed,0.1"
        lines.append(row.format(s=s, kind="attitude", fields=angles))
    return "\r\n".join(lines).encode()


def qgc_csv(folder: Path) -> bytes:
    head = "Timestamp,roll,pitch,heading,groundSpeed,localPosition.x\n"
    return (head + "".join(f"2026-05-01 12:00:{s:02d}.000,1,2,{s},--.--,{s}\n" for s in range(60))).encode()


def spoilt(data: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    for _ in range(CASES // 4):
        yield data[: int(rng.integers(0, len(data)))]
        flipped = bytearray(data)
        for i in rng.integers(0, len(data), int(rng.integers(1, 300))):
            flipped[int(i)] ^= 1 << int(rng.integers(0, 8))
        yield bytes(flipped)
        torn = bytearray(data)
        for i in rng.integers(0, len(data), 12):
            torn[int(i) : int(i) + int(rng.integers(1, 300))] = rng.bytes(int(rng.integers(0, 300)))
        yield bytes(torn)
        yield rng.bytes(int(rng.integers(0, 4000)))


@pytest.mark.parametrize(
    ("suffix", "make"),
    [(".tlog", tlog), (".bin", on_board), (".log", as_text), (".csv", planner_csv), (".csv", qgc_csv)],
    ids=["tlog", "bin", "log", "planner", "qgc"],
)
def test_any_file_is_read_or_rejected_with_our_own_error(tmp_path: Path, suffix: str, make: object) -> None:
    assert callable(make)
    data = make(tmp_path)
    path = tmp_path / f"spoilt{suffix}"
    path.write_bytes(data)
    whole = record(path)
    assert whole is not None
    assert cut_runs(whole).runs or cut_runs(whole).left_out
    reported = 0
    for bad in spoilt(data, np.random.default_rng(20)):
        path.write_bytes(bad)
        try:
            log = record(path)
            if log is None:
                reported += 1  # that it is no ground station's CSV
            else:
                survey(log, cut_runs(log))
        except AutotuneError as error:
            reported += 1
            assert str(path.name) in str(error) or str(path) in str(error)
    assert reported >= CASES // 8


def table(folder: Path) -> bytes:
    rows = [f"{t:.3f},{np.degrees(psi):.4f},{r:.5f},{n:.2f}" for t, psi, r, n in zip(T, PSI, R, N, strict=True)]
    return "\n".join(["t[s],psi[deg],r[rad/s],N[N m]", *rows]).encode()


def bag(folder: Path) -> bytes:
    (file,) = bag2(folder).glob("*.db3")
    return file.read_bytes()


WORDS = [
    b"nan", b"inf", b"1e999", b"", b"1_0", "١٢".encode(), b";", b'"', b"\0", b"9" * 400, b"1e308", b"-1e300", b",",
    b"\n", b"\r", b"\t", b"#", b"[", b"]", b"2024-05-02", b"--", b"1,5", b"\xff\xfe", b"\xb0", b"FMT, 1, 2, X",
    b"t[s]", b"N[us]",
]  # fmt: skip
"""Cell contents of tables that are not runs."""


def misspelt(data: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    """Yield text with other words in a few cells, now and then with a line of it in another place."""
    for _ in range(CASES):
        lines = data.split(b"\n")
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.integers(0, len(lines)))
            cells = lines[at].split(b",")
            cells[int(rng.integers(0, len(cells)))] = WORDS[int(rng.integers(0, len(WORDS)))]
            lines[at] = b",".join(cells)
        if rng.random() < 0.2:
            lines.insert(int(rng.integers(0, len(lines))), lines[int(rng.integers(0, len(lines)))])
        yield b"\n".join(lines)


def damaged_heads(data: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    """Yield a file with a few bytes of its first hundreds changed, where format and layout are defined."""
    for _ in range(CASES):
        torn = bytearray(data)
        for i in rng.integers(0, min(600, len(torn)), int(rng.integers(1, 5))):
            torn[int(i)] = int(rng.choice([0, 1, 13, 127, 128, 255]))
        yield bytes(torn)


@pytest.mark.parametrize(
    ("suffix", "make"),
    [
        (".csv", table),
        pytest.param(".log", lambda folder: early_text(sailed()).encode(), marks=pytest.mark.slow),
        (".bin", lambda folder: as_binary(sailed())),
        (".tlog", tlog),
        (".ulg", lambda folder: ulog()),
        (".mat", lambda folder: mat()),
        pytest.param(".db3", bag, marks=pytest.mark.slow),
    ],
    ids=["csv", "early text", "early binary", "tlog", "ulog", "mat", "rosbag"],
)
def test_a_damaged_run_is_rejected_by_name_or_contains_plausible_numbers(
    tmp_path: Path, suffix: str, make: Callable[[Path], bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    data = make(tmp_path)
    path = tmp_path / f"spoilt{suffix}"
    path.write_bytes(data)
    assert suffix == ".tlog" or len(load_runs(path)) == 1
    rng = np.random.default_rng(34)
    is_text = suffix in (".csv", ".log")
    for bad in (*spoilt(data, rng), *damaged_heads(data, rng), *(misspelt(data, rng) if is_text else ())):
        path.write_bytes(bad)
        try:
            runs = load_runs(path)
        except AutotuneError as error:
            assert "spoilt" in str(error)
            assert "\n" not in str(error)
            continue
        for channel in (c for run in runs for c in run.channels.values()):
            assert np.all(np.isfinite(channel.t)) and np.all(np.abs(channel.values) <= 1e12)
    assert capsys.readouterr().out == "", "standard output contains only JSON"
