"""Time and peak memory to read logs of hundreds of megabytes.

Run: ``python3 -m benchmarks.long_logs --megabytes 500``. A piece of log with all messages of a boat (attitude, outputs,
position, and messages that are not read) is repeated, each repetition as its own boot, or with ``--one-run`` as one
run of hours. Each log is read and cut into runs in its own process, whose peak memory the operating system reports.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.results import Figure, headline

PIECE = 5_000_000
"""Bytes of the repeated piece."""
BOAT = {"SERVO1_FUNCTION": 26, "SERVO3_FUNCTION": 70, **{
    f"SERVO{n}_{k}": v for n in (1, 3) for k, v in (("MIN", 1000), ("TRIM", 1500), ("MAX", 2000), ("REVERSED", 0))
}}  # fmt: skip
RATE = 50.0

READ = """
import json, resource, sys, time
from pathlib import Path
from gcs_autotune.logs import cut_runs, record
begun = time.process_time()
log = record(Path(sys.argv[1]))
read = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
cut = cut_runs(log)
hours = sum(t.span[1] - t.span[0] for t in log.stores) / 3600
print(json.dumps({"messages": log.meta["messages"], "hours": hours, "runs": len(cut.runs), "read": read / 1024,
    "cut": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "cpu": time.process_time() - begun}))
"""


def motion(t: float) -> tuple[float, float, int]:
    """Return heading, turn rate and steering pulse at *t*: an oscillation of 20 s."""
    turn = 2.0 * math.pi * t / 20.0
    return (
        0.5 * math.sin(turn),
        0.5 * 2.0 * math.pi / 20.0 * math.cos(turn),
        1500 + (300 if math.sin(turn) > 0 else -300),
    )


def telemetry(out: BinaryIO, size: int) -> None:
    """Write a telemetry log of *size* bytes."""
    mav = mavlink.MAVLink(None, 1, 1)
    written = i = 0

    def write(t: float, message: mavlink.MAVLink_message) -> None:
        nonlocal written
        written += out.write(struct.pack(">Q", round((1.7e9 + t) * 1e6)) + bytes(message.pack(mav)))
        mav.seq = (mav.seq + 1) % 256

    for n, (name, value) in enumerate(BOAT.items()):
        write(0.0, mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(BOAT), n))
    while written < size:
        t = i / RATE
        psi, r, pwm = motion(t)
        ms = round((10.0 + t) * 1e3) % 2**32
        write(t, mavlink.MAVLink_attitude_message(ms, 0.01, 0.02, psi, 0.0, 0.0, r))
        write(t, mavlink.MAVLink_servo_output_raw_message(ms * 1000 % 2**32, 0, pwm, 0, 1600, 0, 0, 0, 0, 0))
        if i % 5 == 0:
            write(
                t, mavlink.MAVLink_global_position_int_message(ms, -353629380 + i, 1491650850, 100, 10, 50, 6, 7, 100)
            )
            write(t, mavlink.MAVLink_vfr_hud_message(1.0, 1.5, 10, 20, 3.0, 0.1))
            write(t, mavlink.MAVLink_rc_channels_message(ms, 8, *([1500] * 18), 100))
            write(t, mavlink.MAVLink_raw_imu_message(ms * 1000, 1, 2, 3, 4, 5, 6, 7, 8, 9))
        if i % 50 == 0:
            write(t, mavlink.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3))
        i += 1


def onboard_log(out: BinaryIO, size: int) -> None:
    """Write an onboard binary log of *size* bytes, half of them in messages that are not read."""
    kinds = {
        "PARM": (129, "<Q16sf", "QNf", "TimeUS,Name,Value"),
        "MSG": (130, "<Q64s", "QZ", "TimeUS,Message"),
        "ATT": (131, "<Qfff", "Qfff", "TimeUS,Roll,Pitch,Yaw"),
        "IMU": (132, "<QBfff", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
        "RCOU": (133, "<QHHHH", "QHHHH", "TimeUS,C1,C2,C3,C4"),
        "XKF2": (134, "<Q16f", "Qffffffffffffffff", "TimeUS," + ",".join("abcdefghijklmnop")),
    }
    written = 0

    def write(number: int, body: bytes) -> None:
        nonlocal written
        written += out.write(b"\xa3\x95" + bytes([number]) + body)

    own = (128, "<BB4s16s64s", "BBnNZ", "Type,Length,Name,Format,Columns")
    for name, (number, layout, letters, columns) in {"FMT": own, **kinds}.items():
        head = (number, 3 + struct.calcsize(layout), name.encode(), letters.encode(), columns.encode())
        write(128, struct.pack("<BB4s16s64s", *head))
    for name, value in BOAT.items():
        write(129, struct.pack("<Q16sf", 10_000_000, name.encode(), value))
    write(130, struct.pack("<Q64s", 10_000_000, b"ArduRover V4.6.0"))
    i = 0
    while written < size:
        psi, r, pwm = motion(i / RATE)
        us = round((10.0 + i / RATE) * 1e6)
        write(131, struct.pack("<Qfff", us, 0.5, 1.0, math.degrees(psi)))
        for core in (0, 1):
            write(132, struct.pack("<QBfff", us, core, 0.0, 0.0, r))
        write(133, struct.pack("<QHHHH", us, pwm, 0, 1600, 0))
        write(134, struct.pack("<Q16f", us, *([0.0] * 16)))
        i += 1


WRITERS: dict[str, Callable[[BinaryIO, int], None]] = {".tlog": telemetry, ".bin": onboard_log}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=int, default=500)
    parser.add_argument("--one-run", action="store_true", help="one run for hours instead of many boots")
    args = parser.parse_args()
    figures = []
    print("log     size   hours   messages   runs   CPU time   peak while reading   peak with all runs")
    for suffix, writer in WRITERS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"long{suffix}"
            size = args.megabytes * 1_000_000
            with path.open("wb") as out:
                writer(out, size if args.one_run else min(PIECE, size))
            piece = path.read_bytes() if not args.one_run else b""
            with path.open("ab") as out:
                for _ in range(size // PIECE - 1 if piece else 0):
                    out.write(piece)
            begun = time.perf_counter()
            answer = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, check=True, text=True)
            measured = json.loads(answer.stdout)
            megabytes = path.stat().st_size / 1e6
            figures += [
                Figure(f"{suffix}, {megabytes:.0f} MB, processor time", measured["cpu"], "s"),
                Figure(f"{suffix}, {megabytes:.0f} MB, peak memory with all runs", measured["cut"], "MB"),
            ]
            print(
                f"{suffix:6} {path.stat().st_size / 1e6:4.0f} MB {measured['hours']:6.1f} {measured['messages']:10d} "
                f"{measured['runs']:6d} {measured['cpu']:8.0f} s {measured['read']:17.0f} MB "
                f"{measured['cut']:17.0f} MB ({time.perf_counter() - begun:.0f} s)"
            )
    headline("long_logs", "time and memory to read long logs", figures)


if __name__ == "__main__":
    main()
